"""Search for the cheapest settings of a scene at a given error (`discsim cost --error`).

The knobs are those of `knobs.py`, the method is that of `search.py`. Each run is recorded as soon as it ends. All
decisions follow from recorded runs, so a search that was stopped repeats the same decisions without repeating runs.
Runs use one thread, unless the scene sets `run.threads`. Further runs of the same settings use the next seeds.
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
from discsim.preview.accuracy import store_error
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
REFERENCE_SEEDS = 2  # seeds of the reference run; smaller errors than their difference cannot be measured
MAX_RECORDED = 10  # settings of the frontier that are recorded for `discsim check`, at most
FINER = 2.0  # default particle number of the reference run over that of the scene


@dataclass
class Wanted:
    """Options of a search.

    `error` is the goal, None for the error of the unchanged scene. `budget` is in seconds of wall-clock time.
    `measure` is the name of the error measure, None for the default. `reference` has the settings of the reference
    run as texts. `varied` and `keep` are knobs to add and to leave out. `repeat` is the number of seeds, `parallel`
    the number of runs at a time.
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
    """Return the options of a search from the arguments of the command line. Raises StudyError."""
    for text in reference:
        key, equals, value = text.partition("=")
        if not (key.strip() and equals and value.strip()):
            raise StudyError(f"--reference {text}: not a key with a value; expected one like run.courant=0.2")
    goal, time_there_is = _parsed_error(error), _parsed_budget(budget)
    return Wanted(goal, time_there_is, measure, tuple(reference), tuple(varied), tuple(keep), repeat, parallel)


def _parsed_error(text: str) -> float | None:
    """Return the argument of --error as a number; None for the error of the scene. Raises StudyError."""
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


def _parsed_budget(text: str) -> float:
    """Return the argument of --budget in seconds. Raises StudyError."""
    try:
        budget = seconds(text)
    except UnitError:
        budget = math.nan
    if not budget > 0.0:
        raise StudyError(f'--budget {text}: not a positive wall-clock time; expected one like "1 h"')
    return budget


class RecordingRunner:
    """Maker of the runs of a search, which implements the protocol `trials.Runner`; recorded runs are reused."""

    def __init__(self, runs: Runs, knobs: Knobs, measure: Measure, wanted: Wanted, say: Say) -> None:
        self.runs, self.knobs, self.measure, self.say = runs, knobs, measure, say
        self.parallel, self.deadline = wanted.parallel, time.monotonic() + wanted.budget
        self.seed = knobs.base.scene.run.seed
        self.trials: dict[Place, Trial] = {}
        self.reference: Run | None = None
        self.kept = {_hashable(settings): run for settings, run in runs.open({"search": "cheapest"})}
        self.counted: set[tuple[tuple[str, str], ...]] = set()
        self.count, self.cpu = 0, 0.0  # number and CPU seconds of the runs of this search, recorded ones included

    def allowed(self, place: Place) -> bool:
        """Return whether the settings of a place are valid."""
        return self.knobs.settings(place) is not None

    def run(self, places: Sequence[Place], number: int = 1, most: float = math.inf) -> None:
        """Make runs until the trial of each place has `number` seeds. Raises BudgetError.

        A run is stopped after `most` CPU seconds; its trial then has no further runs.
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
        """Return the settings with the seed of the scene plus `seed`."""
        return settings | ({"run.seed": str(self.seed + seed)} if seed else {})

    def found(self, wanted: Sequence[Settings], most: float = math.inf) -> list[Run]:
        """Return a run of each of the settings, recorded or made now. Raises BudgetError after the deadline."""
        todo = [each for each in wanted if not self._is_recorded(each, most)]
        if self.parallel == 1:
            for each in todo:
                self._make_runs([each], most)
        elif todo:
            self._make_runs(todo, most)
        for each in wanted:
            if _hashable(each) not in self.counted:
                self.counted.add(_hashable(each))
                self.count, self.cpu = self.count + 1, self.cpu + self.kept[_hashable(each)]["cpu"]
        return [self.kept[_hashable(each)] for each in wanted]

    def _is_recorded(self, settings: Settings, most: float) -> bool:
        """Return whether the record has a run of these settings; a run stopped at a much lower limit does not count."""
        run = self.kept.get(_hashable(settings))
        return run is not None and ("most" not in run or most <= 1.5 * run["most"])

    def _make_runs(self, todo: Sequence[Settings], most: float) -> None:
        """Make and record runs. Raises BudgetError after the deadline."""
        if time.monotonic() > self.deadline:
            raise BudgetError
        try:
            limits = Limits(most, self.deadline)
            for settings, run in zip(todo, self.runs.made(todo, self.say, self.parallel, limits), strict=True):
                self.kept[_hashable(settings)] = run
                self.runs.keep(settings, run)
                self.say(f"  {in_words(settings)}: {self._run_text(run)}")
        except DeadlineError as late:
            self.cpu += late.cpu
            raise BudgetError from None

    def _run_text(self, run: Run) -> str:
        if "stopped" in run:
            return str(run["stopped"])
        known = self.measure.exact or self.reference is not None
        error = f"error {percent(self.measure.error(run, self.reference))}, " if known else ""
        return f"{error}{run['cpu']:.3g} s of CPU, {run['steps']} steps"


class Cheapest:
    """A search for the cheapest settings of a scene, with its directory and results. Raises StudyError, SceneError."""

    def __init__(
        self, scene: Path, directory: Path, wanted: Wanted, settings: Sequence[str] = (), without: Sequence[str] = ()
    ) -> None:  # fmt: skip
        self.path, self.directory, self.wanted = scene, directory, wanted
        self.settings, self.without = tuple(settings), tuple(without)
        loaded = load_scene(scene, settings, without)
        single = [] if loaded.run.threads else ["run.threads=1"]  # total CPU time is least with one thread
        self.runs = Runs(scene, directory, [*settings, *single], without)
        self.measure = _selected_measure(measures_of(loaded), wanted.measure)
        self.knobs = Knobs(self.runs.scene, wanted.varied, wanted.keep, **self._limit_of_particles())
        self.finer = self._reference_settings()
        self.goal = wanted.error or 0.0
        self.floor = 0.0  # error below which differences are due to the seed
        self.found: Trial | None = None
        self.ended = ""  # the reason for the end of the search, if it found nothing or was cut short
        self.begun = time.monotonic()

    def _limit_of_particles(self) -> dict[str, int]:
        """Return arguments of `Knobs`: without an exact solution, the scene limits particle numbers."""
        return {} if self.measure.exact else {"finest": 0}

    def _reference_settings(self) -> Settings:
        """Return the settings of the reference run; {} if there is an exact solution. Raises StudyError, SceneError."""
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
    def runner(self) -> RecordingRunner:
        assert self._runner is not None
        return self._runner

    _runner: RecordingRunner | None = None

    @property
    def scene(self) -> Trial | None:
        """The trial of the unchanged scene; None if it has no run."""
        trial = self.runner.trials.get(tuple(0 for _ in self.knobs.all))
        return trial if trial and trial.runs else None

    def make(self, title: str) -> bool:
        """Search, print the results, and write cost.png and cheapest.toml. Return whether the goal was reached."""
        from discsim.study.frontier import frontier_figure, show

        console = Console(markup=False, highlight=False, emoji=False, soft_wrap=True)
        console.width = max(console.width, WIDTH)
        log = self.directory / "cost.log"
        (self.directory / "cheapest.toml").unlink(missing_ok=True)
        say = _LoggedConsole(console, log)
        self._runner = RecordingRunner(self.runs, self.knobs, self.measure, self.wanted, say)
        say(f"discsim {__version__}")
        say(
            f"{title}: search for the least CPU time with an error of {self._goal_text()}, into "
            f"{printable(self.directory)}"
        )
        say("knobs: " + ", ".join(knob.name for knob in self.knobs.all))
        try:
            self._search(say)
        except BudgetError:
            self.ended = f"the budget of {clock(self.wanted.budget)} is used up"
            trials = [t for t in self._runner.trials.values() if t.runs and t.error <= self.goal]
            self.found = min(trials, key=lambda trial: trial.cpu, default=None)
        with console.capture() as text:
            show(self, console)
        say(text.get().rstrip())
        if any(trial.runs for trial in self.runner.trials.values()):
            with replace_atomically(self.directory / "cost.png", ".png") as temporary:
                frontier_figure(self, temporary)
            say(f"figure {printable(self.directory / 'cost.png')}")
            self._record_estimates()
        if self.found is not None:
            self._write_cheapest()
            path = printable(self.directory / "cheapest.toml")
            say(f"scene {path}, which takes: discsim run {path}")
        for what, kept in (("runs", self.directory / RUNS), ("log", log)):
            say(f"{what} {printable(kept)}")
        return self.found is not None

    def _goal_text(self) -> str:
        return SCENE if self.wanted.error is None else f"{100.0 * self.wanted.error:.3g}%"

    def _search(self, say: Say) -> None:
        if not self.measure.exact:
            self._run_reference(say)
        scene = tuple(0 for _ in self.knobs.all)
        if self.wanted.error is None:
            self.runner.run([scene], self.wanted.repeat)
            if self.scene is None:
                raise StudyError(
                    f"the error of the scene cannot be measured: it was {self.runner.trials[scene].stopped}"
                )
            self.goal = self.scene.error
        if self.goal < self.floor:
            say(f"{percent(self.goal)} is below the scatter between seeds: the search is for {percent(self.floor)}")
            self.goal = self.floor
        search = Search(self.knobs.all, self.runner, self.goal, self.knobs.start(), say, self.wanted.repeat)
        self.found = search.run()
        if not search.finished_trials():
            raise StudyError(f"no run completed; the scene was {self.runner.trials[scene].stopped}")
        if self.found is None:
            self.ended = "no tested setting reaches it"

    def _run_reference(self, say: Say) -> None:
        """Run the reference with REFERENCE_SEEDS seeds; set `runner.reference` to the mean, `floor` to the difference.

        Raises StudyError, BudgetError.
        """
        say(f"no exact solution is used; the reference run has {in_words(self.finer)}")
        runs = self.runner.found([self.runner.seeded(self.finer, seed) for seed in range(REFERENCE_SEEDS)])
        for run in runs:
            if "stopped" in run:
                raise StudyError(
                    f"the reference run ({label_of(self.finer)}) was {run['stopped']}; expected other settings in "
                    "--reference"
                )
        self.runner.reference = mean_of(runs)
        self.floor = fmean(self.measure.error(one, other) for one, other in combinations(runs, 2))
        say(f"floor: two seeds of it differ by {percent(self.floor)}; smaller errors are not resolved")

    def settings_of(self, trial: Trial) -> Settings:
        return self.knobs.settings(trial.place) or {}

    def words(self, trial: Trial) -> str:
        return in_words(self.settings_of(trial))

    def front(self) -> list[Trial]:
        """Return the Pareto front, the cheapest first: no other trial is both cheaper and at least as accurate."""
        found: list[Trial] = []
        for trial in sorted((t for t in self.runner.trials.values() if t.runs), key=lambda t: t.cpu):
            if not found or trial.error < found[-1].error:
                found.append(trial)
        return found

    def best(self) -> Trial | None:
        """Return the result of the search, or without one the trial with the smallest error."""
        done = [trial for trial in self.runner.trials.values() if trial.runs]
        return self.found or min(done, key=lambda trial: trial.error, default=None)

    def _record_estimates(self) -> None:
        """Record the errors and costs of the frontier and of the scene, for estimates of `discsim check`."""
        for trial in dict.fromkeys(t.place for t in (*self.front()[-MAX_RECORDED:], self.found, self.scene) if t):
            there = self.runner.trials[trial]
            changes = [f"{key}={value}" for key, value in self.settings_of(there).items()]
            scene = load_scene(self.path, [*self.settings, *changes], self.without)
            store_error(scene, self.measure.name, there.error, there.cpu)

    def _write_cheapest(self) -> None:
        assert self.found is not None
        changes = [f"{key}={value}" for key, value in self.settings_of(self.found).items()]
        text = load_scene(self.path, [*self.settings, *changes], self.without).text
        head = (
            f"# Found by: discsim cost {printable(self.path)} --error {self._goal_text()}\n"
            f"# {self.measure.name}: error {percent(self.found.error)}, {self.found.cpu:.3g} s of CPU on one thread; "
            f"changed: {printable(', '.join(changes) or 'nothing')}\n"
        )
        with replace_atomically(self.directory / "cheapest.toml") as temporary:
            temporary.write_text(head + text, encoding="utf-8")


class _LoggedConsole:
    """Printer of lines on the console that also appends them to a log, as soon as its directory exists."""

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
    """Return settings as text, with numbers rounded to four digits; "the scene" if they change none but the seed."""
    short = {key: f"{float(text):.4g}" if _FRACTION.fullmatch(text) else text for key, text in settings.items()}
    own = [] if settings.keys() - {"run.seed"} else ["the scene"]
    return ", ".join([*own, *([label_of(short)] if short else [])])


def _hashable(settings: Settings) -> tuple[tuple[str, str], ...]:
    """Return settings as a tuple, which can be a key of a dict."""
    return tuple(sorted(settings.items()))


def _selected_measure(known: dict[str, Measure], name: str | None) -> Measure:
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
