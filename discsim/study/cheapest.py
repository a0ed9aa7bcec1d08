"""The cheapest setting of a scene at an error: the search of `search.py` over the knobs of `knobs.py`, with real runs.

Each run is kept as soon as it ends. The search decides by what is kept, so one that was stopped goes the same way
again, without the runs that are there. Runs take one thread, and each further run of a setting the next seed.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from statistics import fmean

from rich.console import Console

from discsim import __version__
from discsim.output.files import appended, written
from discsim.preview.accuracy import learn
from discsim.printable import printable
from discsim.scene import load_scene, near
from discsim.scene.units import UnitError, clock, seconds
from discsim.study.cost import WIDTH
from discsim.study.knobs import Knobs
from discsim.study.measures import Measure, Run, mean_of, measures_of
from discsim.study.points import Settings, StudyError, Varied, label_of, percent
from discsim.study.runs import RUNS, Late, Limits, Runs, Say
from discsim.study.search import Search
from discsim.study.trials import Measured, Place, Spent, Trial

_FRACTION = re.compile(r"[0-9]*\.[0-9]+")
SCENE = "scene"  # the word for the scene's own error
OWN_SEEDS = 2  # of the finer run, whose distance is the floor
MOST_LEARNT = 10  # settings of the frontier that `discsim check` is told of
FINER = 2.0  # times the particles of the scene that the finer run has, where a user does not say which it is


@dataclass
class Wanted:
    """What the command line asks of a search.

    error: None for the scene's own. budget: seconds of wall-clock time. reference: keys of the finer run.
    """

    error: float | None
    budget: float = 3600.0
    measure: str | None = None
    reference: tuple[str, ...] = ()
    varied: tuple[Varied, ...] = ()
    keep: tuple[str, ...] = ()
    repeat: int = 3
    parallel: int = 1


def wanted(
    error: str, budget: str, measure: str | None, reference: Sequence[str], varied: Sequence[Varied],
    keep: Sequence[str], repeat: int, parallel: int,
) -> Wanted:  # fmt: skip
    """From the texts of the command line. Raises StudyError."""
    for text in reference:
        key, equals, value = text.partition("=")
        if not (key.strip() and equals and value.strip()):
            raise StudyError(f"--reference {text}: not a key with its value; expected one like run.courant=0.2")
    goal, time_there_is = _goal_in(error), _budget_in(budget)
    return Wanted(goal, time_there_is, measure, tuple(reference), tuple(varied), tuple(keep), repeat, parallel)


def _goal_in(text: str) -> float | None:
    """The error that --error names, None for the scene's own."""
    if text == SCENE:
        return None
    try:
        hundredths = text.strip().endswith("%")
        goal = float(text.strip().removesuffix("%")) / (100.0 if hundredths else 1.0)
    except ValueError:
        goal = math.nan
    if not 0.0 < goal < math.inf:
        raise StudyError(f'--error {text}: not an error; expected one above 0, like 1% or 0.01, or "{SCENE}"')
    return goal


def _budget_in(text: str) -> float:
    try:
        budget = seconds(text)
    except UnitError:
        budget = math.nan
    if not budget > 0.0:
        raise StudyError(f'--budget {text}: no wall-clock time to spend; expected one above 0, like "1 h"')
    return budget


class Workshop:
    """Makes the runs that a search asks for, or finds them among those that are kept (`search.Bench`)."""

    def __init__(self, runs: Runs, knobs: Knobs, measure: Measure, wanted: Wanted, say: Say) -> None:
        self.runs, self.knobs, self.measure, self.say = runs, knobs, measure, say
        self.parallel, self.deadline = wanted.parallel, time.monotonic() + wanted.budget
        self.seed = knobs.base.scene.run.seed
        self.trials: dict[Place, Trial] = {}
        self.reference: Run | None = None
        self.kept = {_key(settings): run for settings, run in runs.open({"search": "cheapest"})}
        self.counted: set[tuple[tuple[str, str], ...]] = set()
        self.count, self.cpu = 0, 0.0  # of the runs that this search rests on, whenever they were made

    def allowed(self, place: Place) -> bool:
        return self.knobs.settings(place) is not None

    def run(self, places: Sequence[Place], number: int = 1, most: float = math.inf) -> None:
        for seed in range(number):
            todo = [
                place
                for place in dict.fromkeys(places)
                if len(self._trial(place).runs) <= seed and not self._trial(place).stopped
            ]
            found = self.found([self._settings(place, seed) for place in todo], most)
            for place, run in zip(todo, found, strict=True):
                trial = self._trial(place)
                if "stopped" in run:
                    trial.stopped = run["stopped"]
                elif not trial.stopped:
                    error = self.measure.error(run, self.reference)
                    if math.isfinite(error):
                        trial.runs.append(Measured(run["cpu"], error))
                    else:
                        trial.stopped = "without a finite error"

    def _trial(self, place: Place) -> Trial:
        return self.trials.setdefault(place, Trial(place))

    def _settings(self, place: Place, seed: int) -> Settings:
        settings = self.knobs.settings(place)
        assert settings is not None
        return self.seeded(settings, seed)

    def seeded(self, settings: Settings, seed: int) -> Settings:
        return settings | ({"run.seed": str(self.seed + seed)} if seed else {})

    def found(self, wanted: Sequence[Settings], most: float = math.inf) -> list[Run]:
        """A run for each of the settings: kept, or made now and kept. Raises Spent where time is up."""
        todo = [each for each in wanted if not self._is_kept(each, most)]
        if self.parallel == 1:
            for each in todo:
                self._made([each], most)
        elif todo:
            self._made(todo, most)
        for each in wanted:
            if _key(each) not in self.counted:
                self.counted.add(_key(each))
                self.count, self.cpu = self.count + 1, self.cpu + self.kept[_key(each)]["cpu"]
        return [self.kept[_key(each)] for each in wanted]

    def _is_kept(self, settings: Settings, most: float) -> bool:
        run = self.kept.get(_key(settings))
        return run is not None and ("most" not in run or most <= 1.5 * run["most"])

    def _made(self, todo: Sequence[Settings], most: float) -> None:
        if time.monotonic() > self.deadline:
            raise Spent
        try:
            limits = Limits(most, self.deadline)
            for settings, run in zip(todo, self.runs.made(todo, self.say, self.parallel, limits), strict=True):
                self.kept[_key(settings)] = run
                self.runs.keep(settings, run)
                self.say(f"  {in_words(settings)}: {self._words(run)}")
        except Late as late:
            self.cpu += late.cpu
            raise Spent from None

    def _words(self, run: Run) -> str:
        if "stopped" in run:
            return str(run["stopped"])
        known = self.measure.exact or self.reference is not None
        error = f"error {percent(self.measure.error(run, self.reference))}, " if known else ""
        return f"{error}{run['cpu']:.3g} s of CPU, {run['steps']} steps"


class Cheapest:
    """A search with its scene, directory and findings. Raises StudyError, SceneError."""

    def __init__(
        self, scene: Path, directory: Path, wanted: Wanted, settings: Sequence[str] = (), without: Sequence[str] = ()
    ) -> None:  # fmt: skip
        self.path, self.directory, self.wanted = scene, directory, wanted
        self.settings, self.without = tuple(settings), tuple(without)
        loaded = load_scene(scene, settings, without)
        single = [] if loaded.run.threads else ["run.threads=1"]  # CPU time of one thread is the least
        self.runs = Runs(scene, directory, [*settings, *single], without)
        self.measure = _measure(measures_of(loaded), wanted.measure)
        self.knobs = Knobs(self.runs.scene, wanted.varied, wanted.keep, **self._finest())
        self.finer = self._finer()
        self.goal = wanted.error or 0.0
        self.floor = 0.0  # of the error, below which seeds decide
        self.found: Trial | None = None
        self.ended = ""  # why, where nothing was found
        self.begun = time.monotonic()

    def _finest(self) -> dict[str, int]:
        """Against a finer run no setting with as many particles can be judged."""
        return {} if self.measure.exact else {"finest": 0}

    def _finer(self) -> Settings:
        if self.measure.exact:
            return {}
        if self.wanted.reference:
            given = [text.partition("=") for text in self.wanted.reference]
            settings = {key.strip(): value.strip() for key, _, value in given}
        else:
            base = self.knobs.base
            settings = {key: base.times(key, FINER, whole=True) for key in base.species}
        self.runs.scene(settings)  # raises where it is none
        return settings

    @property
    def bench(self) -> Workshop:
        assert self._bench is not None
        return self._bench

    _bench: Workshop | None = None

    @property
    def scene(self) -> Trial | None:
        """The scene as it stands."""
        trial = self.bench.trials.get(tuple(0 for _ in self.knobs.all))
        return trial if trial and trial.runs else None

    def make(self, title: str) -> bool:
        """Search, print what was found, and write cost.png and cheapest.toml; False where the error was not reached."""
        from discsim.study.frontier import frontier_figure, show

        console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
        console.width = max(console.width, WIDTH)
        log = self.directory / "cost.log"
        (self.directory / "cheapest.toml").unlink(missing_ok=True)
        say = _Teller(console, log)
        self._bench = Workshop(self.runs, self.knobs, self.measure, self.wanted, say)
        say(f"discsim {__version__}")
        say(f"{title}: the least CPU time for an error of {self._goal_words()}, into {printable(self.directory)}")
        say("knobs: " + ", ".join(knob.name for knob in self.knobs.all))
        try:
            self._search(say)
        except Spent:
            self.ended = f"the budget of {clock(self.wanted.budget)} is used up"
            trials = [t for t in self._bench.trials.values() if t.runs and t.error <= self.goal]
            self.found = min(trials, key=lambda trial: trial.cpu, default=None)
        with console.capture() as text:
            show(self, console)
        say(text.get().rstrip())
        if any(trial.runs for trial in self.bench.trials.values()):
            with written(self.directory / "cost.png", ".png") as temporary:
                frontier_figure(self, temporary)
            say(f"figure {printable(self.directory / 'cost.png')}")
            self._learn()
        if self.found is not None:
            self._write()
            path = printable(self.directory / "cheapest.toml")
            say(f"scene {path}, which takes: discsim run {path}")
        for what, kept in (("runs", self.directory / RUNS), ("log", log)):
            say(f"{what} {printable(kept)}")
        return self.found is not None

    def _goal_words(self) -> str:
        return SCENE if self.wanted.error is None else f"{100.0 * self.wanted.error:.3g}%"

    def _search(self, say: Say) -> None:
        if not self.measure.exact:
            self._compare(say)
        scene = tuple(0 for _ in self.knobs.all)
        if self.wanted.error is None:
            self.bench.run([scene], self.wanted.repeat)
            if self.scene is None:
                raise StudyError(f"the scene as it stands has no error: it was {self.bench.trials[scene].stopped}")
            self.goal = self.scene.error
        if self.goal < self.floor:
            say(f"{percent(self.goal)} is below what seeds scatter by: the search is for {percent(self.floor)}")
            self.goal = self.floor
        search = Search(self.knobs.all, self.bench, self.goal, self.knobs.start(), say, self.wanted.repeat)
        self.found = search.run()
        if not search.done():
            raise StudyError(f"no run came to its end; the scene as it stands was {self.bench.trials[scene].stopped}")
        if self.found is None:
            self.ended = "no setting that was tried reaches it"

    def _compare(self, say: Say) -> None:
        """The finer run with two seeds: their mean is what others are compared with, their distance the floor."""
        say(f"no exact solution is taken: the finer run has {in_words(self.finer)}")
        runs = self.bench.found([self.bench.seeded(self.finer, seed) for seed in range(OWN_SEEDS)])
        for run in runs:
            if "stopped" in run:
                raise StudyError(f"the finer run ({label_of(self.finer)}) was {run['stopped']}; expected --reference")
        self.bench.reference = mean_of(runs)
        self.floor = fmean(self.measure.error(one, other) for one, other in combinations(runs, 2))
        say(f"floor: two seeds of it are {percent(self.floor)} apart; nothing is called better than that")

    def settings_of(self, trial: Trial) -> Settings:
        return self.knobs.settings(trial.place) or {}

    def words(self, trial: Trial) -> str:
        return in_words(self.settings_of(trial))

    def front(self) -> list[Trial]:
        """Settings than which none that was tried is both cheaper and no worse, the cheapest first."""
        found: list[Trial] = []
        for trial in sorted((t for t in self.bench.trials.values() if t.runs), key=lambda t: t.cpu):
            if not found or trial.error < found[-1].error:
                found.append(trial)
        return found

    def best(self) -> Trial | None:
        """What was found, or else what came nearest to the error."""
        done = [trial for trial in self.bench.trials.values() if trial.runs]
        return self.found or min(done, key=lambda trial: trial.error, default=None)

    def _learn(self) -> None:
        """Leave what the frontier and the scene had to `discsim check`."""
        for trial in dict.fromkeys(t.place for t in (*self.front()[-MOST_LEARNT:], self.found, self.scene) if t):
            there = self.bench.trials[trial]
            changes = [f"{key}={value}" for key, value in self.settings_of(there).items()]
            scene = load_scene(self.path, [*self.settings, *changes], self.without)
            learn(scene, self.measure.name, there.error, there.cpu)

    def _write(self) -> None:
        assert self.found is not None
        changes = [f"{key}={value}" for key, value in self.settings_of(self.found).items()]
        text = load_scene(self.path, [*self.settings, *changes], self.without).text
        head = (
            f"# Found by: discsim cost {printable(self.path)} --error {self._goal_words()}\n"
            f"# {self.measure.name}: error {percent(self.found.error)}, {self.found.cpu:.3g} s of CPU on one thread; "
            f"changed: {printable(', '.join(changes) or 'nothing')}\n"
        )
        with written(self.directory / "cheapest.toml") as temporary:
            temporary.write_text(head + text, encoding="utf-8")


class _Teller:
    """Prints lines, and keeps them in a log once there is a directory."""

    def __init__(self, console: Console, log: Path) -> None:
        self.console, self.log = console, log
        self.lines: list[str] = []

    def __call__(self, text: str) -> None:
        self.console.print(text)
        self.lines.append(text)
        if self.log.parent.exists():
            with appended(self.log) as file:
                file.write("".join(f"{line}\n" for line in self.lines).encode())
            self.lines.clear()


def in_words(settings: Settings) -> str:
    """Settings for people, with four digits, of a scene that is otherwise as it stands."""
    short = {key: f"{float(text):.4g}" if _FRACTION.fullmatch(text) else text for key, text in settings.items()}
    own = [] if settings.keys() - {"run.seed"} else ["the scene as it stands"]
    return ", ".join([*own, *([label_of(short)] if short else [])])


def _key(settings: Settings) -> tuple[tuple[str, str], ...]:
    return tuple(sorted(settings.items()))


def _measure(known: dict[str, Measure], name: str | None) -> Measure:
    if not known:
        raise StudyError("this scene has neither gas nor dust to measure")
    if name is None:
        return next(iter(known.values()))
    if name not in known:
        words = ", ".join(known)
        raise StudyError(f"--measure {name}: not one of this scene's; expected one of {words}{near(name, list(known))}")
    return known[name]
