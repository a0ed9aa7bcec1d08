"""The cheapest settings of a scene for a given error: the search of `search.py` over the knobs of `knobs.py`.

Each run is recorded as soon as it ends. All decisions of the search follow from recorded runs, so a search that was
stopped repeats the same steps without repeating its runs. Runs use one thread. Further runs of the same settings use
the next seeds.
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

from discsim.output.files import appended, replace_atomically
from discsim.preview.accuracy import learn
from discsim.printable import printable
from discsim.scene import load_scene, near
from discsim.scene.units import UnitError, clock, seconds
from discsim.study.cost import WIDTH
from discsim.study.knobs import Knobs
from discsim.study.measures import Measure, Run, mean_of, measures_of
from discsim.study.points import Settings, StudyError, Varied, label_of, percent
from discsim.study.runs import RUNS, DeadlineError, Limits, Runs, Say
from discsim.study.search import Search
from discsim.study.trials import BudgetError, Measured, Place, Trial
from discsim.version import __version__

_FRACTION = re.compile(r"[0-9]*\.[0-9]+")
SCENE = "scene"  # argument of --error for the scene's own error
OWN_SEEDS = 2  # seeds of the reference run; their difference is the floor of the error
MOST_LEARNT = 10  # settings of the frontier that are recorded for `discsim check`, at most
FINER = 2.0  # factor in particle number from the scene to the reference run, by default


@dataclass
class Wanted:
    """Options of a search.

    `error` is the goal, None for the scene's own error. `budget` is in seconds of wall-clock time. `reference` has
    the settings of the reference run.
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
    """Return the options from texts of the command line. Raises StudyError."""
    for text in reference:
        key, equals, value = text.partition("=")
        if not (key.strip() and equals and value.strip()):
            raise StudyError(f"--reference {text}: not a key with a value; expected one like run.courant=0.2")
    goal, time_there_is = _goal_in(error), _budget_in(budget)
    return Wanted(goal, time_there_is, measure, tuple(reference), tuple(varied), tuple(keep), repeat, parallel)


def _goal_in(text: str) -> float | None:
    """Return the error that --error gives; None for the scene's own. Raises StudyError."""
    if text == SCENE:
        return None
    try:
        hundredths = text.strip().endswith("%")
        goal = float(text.strip().removesuffix("%")) / (100.0 if hundredths else 1.0)
    except ValueError:
        goal = math.nan
    if not 0.0 < goal < math.inf:
        raise StudyError(f'--error {text}: not an error; expected a number above 0, like 1% or 0.01, or "{SCENE}"')
    return goal


def _budget_in(text: str) -> float:
    try:
        budget = seconds(text)
    except UnitError:
        budget = math.nan
    if not budget > 0.0:
        raise StudyError(f'--budget {text}: not a positive wall-clock time; expected one like "1 h"')
    return budget


class Workshop:
    """Execution of the runs of a search; recorded runs are reused. Implements the protocol `trials.Bench`."""

    def __init__(self, runs: Runs, knobs: Knobs, measure: Measure, wanted: Wanted, say: Say) -> None:
        self.runs, self.knobs, self.measure, self.say = runs, knobs, measure, say
        self.parallel, self.deadline = wanted.parallel, time.monotonic() + wanted.budget
        self.seed = knobs.base.scene.run.seed
        self.trials: dict[Place, Trial] = {}
        self.reference: Run | None = None
        self.kept = {_key(settings): run for settings, run in runs.open({"search": "cheapest"})}
        self.counted: set[tuple[tuple[str, str], ...]] = set()
        self.count, self.cpu = 0, 0.0  # number and CPU seconds of the runs of this search, recorded ones included

    def allowed(self, place: Place) -> bool:
        """Return whether the settings of a place are valid."""
        return self.knobs.settings(place) is not None

    def run(self, places: Sequence[Place], number: int = 1, most: float = math.inf) -> None:
        """Run each place with `number` seeds. Raises BudgetError.

        A run is given up after `most` CPU seconds; its trial is then stopped.
        """
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
        """Return the settings with the seed number `seed` of the scene's sequence."""
        return settings | ({"run.seed": str(self.seed + seed)} if seed else {})

    def found(self, wanted: Sequence[Settings], most: float = math.inf) -> list[Run]:
        """Return a run for each of the settings, recorded or made now. Raises BudgetError after the deadline."""
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
        """Return whether a usable run is recorded; a run given up at a much lower limit is not usable."""
        run = self.kept.get(_key(settings))
        return run is not None and ("most" not in run or most <= 1.5 * run["most"])

    def _made(self, todo: Sequence[Settings], most: float) -> None:
        """Make and record runs. Raises BudgetError after the deadline."""
        if time.monotonic() > self.deadline:
            raise BudgetError
        try:
            limits = Limits(most, self.deadline)
            for settings, run in zip(todo, self.runs.made(todo, self.say, self.parallel, limits), strict=True):
                self.kept[_key(settings)] = run
                self.runs.keep(settings, run)
                self.say(f"  {in_words(settings)}: {self._words(run)}")
        except DeadlineError as late:
            self.cpu += late.cpu
            raise BudgetError from None

    def _words(self, run: Run) -> str:
        if "stopped" in run:
            return str(run["stopped"])
        known = self.measure.exact or self.reference is not None
        error = f"error {percent(self.measure.error(run, self.reference))}, " if known else ""
        return f"{error}{run['cpu']:.3g} s of CPU, {run['steps']} steps"


class Cheapest:
    """A search with its scene, directory and results. Raises StudyError, SceneError."""

    def __init__(
        self, scene: Path, directory: Path, wanted: Wanted, settings: Sequence[str] = (), without: Sequence[str] = ()
    ) -> None:  # fmt: skip
        self.path, self.directory, self.wanted = scene, directory, wanted
        self.settings, self.without = tuple(settings), tuple(without)
        loaded = load_scene(scene, settings, without)
        single = [] if loaded.run.threads else ["run.threads=1"]  # total CPU time is least with one thread
        self.runs = Runs(scene, directory, [*settings, *single], without)
        self.measure = _measure(measures_of(loaded), wanted.measure)
        self.knobs = Knobs(self.runs.scene, wanted.varied, wanted.keep, **self._finest())
        self.finer = self._finer()
        self.goal = wanted.error or 0.0
        self.floor = 0.0  # error below which differences are due to the seed
        self.found: Trial | None = None
        self.ended = ""  # the reason for the end of the search, if it found nothing or was cut short
        self.begun = time.monotonic()

    def _finest(self) -> dict[str, int]:
        """Return arguments of `Knobs`: without an exact solution no setting may have more particles than the scene."""
        return {} if self.measure.exact else {"finest": 0}

    def _finer(self) -> Settings:
        """Return the settings of the reference run; {} with an exact solution. Raises StudyError, SceneError."""
        if self.measure.exact:
            return {}
        if self.wanted.reference:
            given = [text.partition("=") for text in self.wanted.reference]
            settings = {key.strip(): value.strip() for key, _, value in given}
        else:
            base = self.knobs.base
            settings = {key: base.times(key, FINER, whole=True) for key in base.species}
        self.runs.scene(settings)  # raises SceneError if invalid
        return settings

    @property
    def bench(self) -> Workshop:
        assert self._bench is not None
        return self._bench

    _bench: Workshop | None = None

    @property
    def scene(self) -> Trial | None:
        """The trial of the unchanged scene; None if it has no run."""
        trial = self.bench.trials.get(tuple(0 for _ in self.knobs.all))
        return trial if trial and trial.runs else None

    def make(self, title: str) -> bool:
        """Search, print the results, and write cost.png and cheapest.toml.

        Returns whether the error was reached.
        """
        from discsim.study.frontier import frontier_figure, show

        console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
        console.width = max(console.width, WIDTH)
        log = self.directory / "cost.log"
        (self.directory / "cheapest.toml").unlink(missing_ok=True)
        say = _Teller(console, log)
        self._bench = Workshop(self.runs, self.knobs, self.measure, self.wanted, say)
        say(f"discsim {__version__}")
        say(
            f"{title}: search for the least CPU time with an error of {self._goal_words()}, into "
            f"{printable(self.directory)}"
        )
        say("knobs: " + ", ".join(knob.name for knob in self.knobs.all))
        try:
            self._search(say)
        except BudgetError:
            self.ended = f"the budget of {clock(self.wanted.budget)} is used up"
            trials = [t for t in self._bench.trials.values() if t.runs and t.error <= self.goal]
            self.found = min(trials, key=lambda trial: trial.cpu, default=None)
        with console.capture() as text:
            show(self, console)
        say(text.get().rstrip())
        if any(trial.runs for trial in self.bench.trials.values()):
            with replace_atomically(self.directory / "cost.png", ".png") as temporary:
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
                raise StudyError(
                    f"the error of the scene cannot be measured: it was {self.bench.trials[scene].stopped}"
                )
            self.goal = self.scene.error
        if self.goal < self.floor:
            say(f"{percent(self.goal)} is below the scatter between seeds: the search is for {percent(self.floor)}")
            self.goal = self.floor
        search = Search(self.knobs.all, self.bench, self.goal, self.knobs.start(), say, self.wanted.repeat)
        self.found = search.run()
        if not search.done():
            raise StudyError(f"no run completed; the scene was {self.bench.trials[scene].stopped}")
        if self.found is None:
            self.ended = "no tested setting reaches it"

    def _compare(self, say: Say) -> None:
        """Run the reference with OWN_SEEDS seeds: runs are compared with the mean; the mean difference is the floor."""
        say(f"no exact solution is used; the reference run has {in_words(self.finer)}")
        runs = self.bench.found([self.bench.seeded(self.finer, seed) for seed in range(OWN_SEEDS)])
        for run in runs:
            if "stopped" in run:
                raise StudyError(
                    f"the reference run ({label_of(self.finer)}) was {run['stopped']}; expected other settings in "
                    "--reference"
                )
        self.bench.reference = mean_of(runs)
        self.floor = fmean(self.measure.error(one, other) for one, other in combinations(runs, 2))
        say(f"floor: two seeds of it differ by {percent(self.floor)}; smaller errors are not resolved")

    def settings_of(self, trial: Trial) -> Settings:
        return self.knobs.settings(trial.place) or {}

    def words(self, trial: Trial) -> str:
        return in_words(self.settings_of(trial))

    def front(self) -> list[Trial]:
        """Return the Pareto front, the cheapest first: no other trial is both cheaper and at least as accurate."""
        found: list[Trial] = []
        for trial in sorted((t for t in self.bench.trials.values() if t.runs), key=lambda t: t.cpu):
            if not found or trial.error < found[-1].error:
                found.append(trial)
        return found

    def best(self) -> Trial | None:
        """Return the trial found, or else the trial with the smallest error."""
        done = [trial for trial in self.bench.trials.values() if trial.runs]
        return self.found or min(done, key=lambda trial: trial.error, default=None)

    def _learn(self) -> None:
        """Record the errors and costs of the frontier and of the scene, for estimates of `discsim check`."""
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
        with replace_atomically(self.directory / "cheapest.toml") as temporary:
            temporary.write_text(head + text, encoding="utf-8")


class _Teller:
    """Printer of lines that also appends them to a log once its directory exists."""

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
    """Return settings as text with four digits; the unchanged scene has a text of its own."""
    short = {key: f"{float(text):.4g}" if _FRACTION.fullmatch(text) else text for key, text in settings.items()}
    own = [] if settings.keys() - {"run.seed"} else ["the scene"]
    return ", ".join([*own, *([label_of(short)] if short else [])])


def _key(settings: Settings) -> tuple[tuple[str, str], ...]:
    """Return settings as a key of a dict."""
    return tuple(sorted(settings.items()))


def _measure(known: dict[str, Measure], name: str | None) -> Measure:
    """Return the measure `name`, or the default measure. Raises StudyError."""
    if not known:
        raise StudyError("this scene has neither gas nor dust to measure")
    if name is None:
        return next(iter(known.values()))
    if name not in known:
        words = ", ".join(known)
        raise StudyError(
            f"--measure {name}: not available for this scene; expected one of {words}{near(name, list(known))}"
        )
    return known[name]
