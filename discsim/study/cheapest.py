"""Search for the cheapest settings of a scene at a given error (`discsim cost --error`).

`knobs.py` defines the parameters that vary, `search.py` the method. Each run is recorded as soon as it ends. All
decisions follow from recorded runs, so that a search that was stopped repeats its decisions without repeating runs.
Runs use one thread, unless the scene sets `run.threads`. Further runs of the same settings use the next seeds.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from pathlib import Path
from statistics import fmean

from discsim.output.files import replace_atomically
from discsim.preview.accuracy import store_error
from discsim.printable import printable
from discsim.scene import Scene, load_scene, nearest_hint
from discsim.scene.units import UnitError, clock, seconds
from discsim.study.knobs import MAX_RUNGS, Knobs
from discsim.study.measures import Measure, Run, mean_run, measures_of
from discsim.study.points import Settings, StudyError, Varied, label_of, pareto_front, percent
from discsim.study.runs import RUNS, DeadlineError, Limits, LoggedConsole, Runs, Say
from discsim.study.search import Search
from discsim.study.trials import BudgetError, GridPoint, Measured, Trial, finished_trial, finished_trials
from discsim.version import __version__

_FRACTION = re.compile(r"[0-9]*\.[0-9]+")
SCENE = "scene"  # argument of --error for the scene's own error
REFERENCE_SEEDS = 2  # seeds of the reference run; smaller errors than their difference cannot be measured
MAX_RECORDED = 10  # settings of the frontier that are recorded for `discsim check`, at most
FINER = 2.0  # default ratio of the particle numbers in the reference run and in the scene


@dataclass
class SearchOptions:
    """Options of a search.

    error: the goal; None for the error of the unchanged scene. budget: wall-clock time in seconds. measure: name of the
    error measure; None for the default. reference: settings of the reference run; {} for the default. varied: knobs to
    add. keep: names or keys of knobs to leave out. repeat: number of seeds. parallel: number of simultaneous runs.
    """

    error: float | None
    budget: float = 3600.0
    measure: str | None = None
    reference: Settings = field(default_factory=dict)
    varied: Sequence[Varied] = ()
    keep: Sequence[str] = ()
    repeat: int = 3
    parallel: int = 1


def parse_reference(texts: Sequence[str]) -> Settings:
    """Return the arguments of --reference, texts "key=value", as settings. Raises StudyError."""
    settings: Settings = {}
    for text in texts:
        key, _, value = (part.strip() for part in text.partition("="))
        if not (key and value):
            raise StudyError(
                f"--reference {text}: not a key with a value; expected table.key=value, like run.courant=0.2"
            )
        settings[key] = value
    return settings


def parse_error(text: str) -> float | None:
    """Return the argument of --error as a number; None for the error of the scene. Raises StudyError."""
    if text == SCENE:
        return None
    try:
        hundredths = text.strip().endswith("%")
        goal = float(text.strip().removesuffix("%")) / (100.0 if hundredths else 1.0)
    except ValueError:
        goal = math.nan
    if not 0.0 < goal < math.inf:
        raise StudyError(
            f"--error {text}: not an error; expected a number above 0, like 1% or 0.01, or the word {SCENE}"
        )
    if goal >= 1.0:
        meant = f'; for {goal:g} per cent write "{goal:g}%"' if not hundredths and goal < 100.0 else ", like 2%"
        raise StudyError(f"--error {text}: an error of {100.0 * goal:g}%; expected less than 100%{meant}")
    return goal


def parse_budget(text: str) -> float:
    """Return the argument of --budget in seconds. Raises StudyError."""
    try:
        budget = seconds(text)
    except UnitError:
        budget = math.nan
    if not budget > 0.0:
        raise StudyError(f'--budget {text}: not a positive wall-clock time; expected a time like "1 h"')
    return budget


class RecordingRunner:
    """Maker of the runs of a search, which records new runs and reuses recorded ones (protocol `trials.Runner`).

    reference: result of the reference run; None with an exact solution, or before that run.
    """

    def __init__(self, runs: Runs, knobs: Knobs, measure: Measure, options: SearchOptions, say: Say) -> None:
        self.runs, self.knobs, self.measure, self.say = runs, knobs, measure, say
        self.parallel, self.deadline = options.parallel, time.monotonic() + options.budget
        self.seed = knobs.base.scene.run.seed
        self.trials: dict[GridPoint, Trial] = {}
        self.reference: Run | None = None
        self.recorded = {
            _hashable_settings(settings): run for settings, run in runs.open_record({"search": "cheapest"})
        }
        self.counted: set[tuple[tuple[str, str], ...]] = set()
        self.count, self.cpu = 0, 0.0  # number and CPU seconds of the runs of this search, recorded ones included

    def is_valid(self, point: GridPoint) -> bool:
        """Return whether the scene is valid with the settings of a grid point."""
        return self.knobs.settings(point) is not None

    def run(self, points: Sequence[GridPoint], number: int = 1, most: float = math.inf) -> None:
        """Make runs until the trial of each grid point has `number` seeds. Raises BudgetError.

        A run is stopped after `most` CPU seconds, and its trial then has no further runs.
        """
        for seed in range(number):
            todo = [
                point
                for point in dict.fromkeys(points)
                if len(self._trial(point).runs) <= seed and not self._trial(point).stopped
            ]
            settings = [self._settings(point, seed) for point in todo]
            try:
                self.runs_of(settings, most)
            finally:  # after a BudgetError or an interrupt, the runs that did end count
                for point, each in zip(todo, settings, strict=True):
                    if (run := self.recorded.get(_hashable_settings(each))) is not None:
                        self._add_result(self._trial(point), run)

    def _add_result(self, trial: Trial, run: Run) -> None:
        """Add the result of a run to its trial."""
        if "stopped" in run:
            trial.stopped = run["stopped"]
        elif not trial.stopped:
            error = self.measure.error(run, self.reference)
            if math.isfinite(error):
                trial.runs.append(Measured(run["cpu"], error))
            else:
                trial.stopped = "without a finite error"

    def _trial(self, point: GridPoint) -> Trial:
        """Return the trial of a grid point, which is created if necessary."""
        return self.trials.setdefault(point, Trial(point))

    def _settings(self, point: GridPoint, seed: int) -> Settings:
        """Return the settings of a grid point, with the seed of the scene plus `seed`."""
        settings = self.knobs.settings(point)
        assert settings is not None
        return self.seeded(settings, seed)

    def seeded(self, settings: Settings, seed: int) -> Settings:
        """Return the settings with the seed of the scene plus `seed`."""
        return settings | ({"run.seed": str(self.seed + seed)} if seed else {})

    def runs_of(self, settings: Sequence[Settings], most: float = math.inf) -> list[Run]:
        """Return one run for each entry of `settings`, recorded or made now. Raises BudgetError after the deadline."""
        todo = [each for each in settings if not self._is_recorded(each, most)]
        batches = [[each] for each in todo] if self.parallel == 1 else [todo] if todo else []
        try:
            for batch in batches:
                self._make_runs(batch, most)
        finally:
            self._count_runs(settings)
        return [self.recorded[_hashable_settings(each)] for each in settings]

    def _count_runs(self, settings: Sequence[Settings]) -> None:
        """Add the recorded runs with these settings to the number and CPU time of the runs, each run once."""
        for each in map(_hashable_settings, settings):
            if each in self.recorded and each not in self.counted:
                self.counted.add(each)
                self.count, self.cpu = self.count + 1, self.cpu + self.recorded[each]["cpu"]

    def _is_recorded(self, settings: Settings, most: float) -> bool:
        """Return whether the record has a run of these settings that was not stopped, or not much before `most`."""
        run = self.recorded.get(_hashable_settings(settings))
        return run is not None and ("most" not in run or most <= 1.5 * run["most"])

    def _make_runs(self, todo: Sequence[Settings], most: float) -> None:
        """Make and record runs. Raises BudgetError after the deadline."""
        if time.monotonic() > self.deadline:
            raise BudgetError
        try:
            limits = Limits(most, self.deadline)
            for settings, run in zip(todo, self.runs.make(todo, self.say, self.parallel, limits), strict=True):
                self.recorded[_hashable_settings(settings)] = run
                self.runs.record(settings, run)
                self.say(f"  {settings_text(settings)}: {self._run_text(run)}")
        except DeadlineError as late:
            self.cpu += late.cpu
            raise BudgetError from None

    def _run_text(self, run: Run) -> str:
        """Return the results of a run as text, or the reason why it has none."""
        if "stopped" in run:
            return str(run["stopped"])
        known = self.measure.is_exact or self.reference is not None
        error = f"error {percent(self.measure.error(run, self.reference))}, " if known else ""
        return f"{error}{run['cpu']:.3g} s of CPU, {run['steps']} steps"


class Cheapest:
    """A search for the cheapest settings of a scene, with its directory and results. Raises StudyError, SceneError.

    path: scene file. settings, without: changes of the scene for all runs. Results are the attribute `found`, the
    cheapest trial, and `end_reason`, the reason why the search found nothing or was cut short.
    """

    runner: RecordingRunner  # set by `make`

    def __init__(
        self, path: Path, directory: Path, options: SearchOptions, settings: Sequence[str] = (),
        without: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.path, self.directory, self.options = path, directory, options
        self.settings, self.without = tuple(settings), tuple(without)
        loaded = load_scene(path, settings, without)
        single = [] if loaded.run.threads else ["run.threads=1"]  # total CPU time is least with one thread
        self.runs = Runs(path, directory, [*settings, *single], without)
        self.measure = _select_measure(measures_of(loaded), options.measure)
        # Without an exact solution, errors are those relative to the reference run, and the scene limits the particles.
        most_particles = MAX_RUNGS if self.measure.is_exact else 0
        self.knobs = Knobs(self.runs.scene, options.varied, options.keep, most_particles)
        self.unchanged: GridPoint = tuple(0 for _ in self.knobs.all)
        self.reference_settings = self._reference_settings()
        self.goal = options.error or 0.0
        self.floor = 0.0  # error below which differences are due to the seed
        self.found: Trial | None = None
        self.end_reason = ""
        self.begun = time.monotonic()

    def _reference_settings(self) -> Settings:
        """Return the settings of the reference run; {} if there is an exact solution. Raises StudyError, SceneError."""
        if self.measure.is_exact:
            return {}
        base = self.knobs.base
        settings = self.options.reference or {key: base.times(key, FINER, whole=True) for key in base.species}
        self.runs.scene(settings, "--reference")  # raises SceneError if invalid
        return settings

    @property
    def scene(self) -> Trial | None:
        """The trial of the unchanged scene; None if no run of this trial has a result."""
        return finished_trial(self.runner.trials, self.unchanged)

    def make(self, title: str) -> bool:
        """Search, print the results, and write cost.png and cheapest.toml. Return whether the goal was reached."""
        from discsim.study.frontier import frontier_figure, print_results

        cheapest = self.directory / "cheapest.toml"
        replaced = cheapest.exists()
        cheapest.unlink(missing_ok=True)
        say = LoggedConsole(self.directory / "cost.log")
        self.runner = RecordingRunner(self.runs, self.knobs, self.measure, self.options, say)
        say(f"discsim {__version__}")
        say(
            f"{title}: search for the least CPU time with an error of {self._goal_text()}, into "
            f"{printable(self.directory)}"
        )
        if replaced:
            say(
                f"{printable(cheapest)} of the last search is replaced; another directory, with -o, keeps both, and "
                "the command of that search writes its result again without new runs"
            )
        say("knobs: " + ", ".join(knob.name for knob in self.knobs.all))
        try:
            self._search(say)
        except BudgetError:
            self.end_reason = f"the budget of {clock(self.options.budget)} is used up"
            reached = (trial for trial in finished_trials(self.runner.trials) if trial.error <= self.goal)
            self.found = min(reached, key=lambda trial: trial.cpu, default=None)
        say.say_all(partial(print_results, self))
        if finished_trials(self.runner.trials):
            with replace_atomically(self.directory / "cost.png", ".png") as temporary:
                frontier_figure(self, temporary)
            say(f"figure {printable(self.directory / 'cost.png')}")
            self._record_estimates()
        if self.found is not None:
            self._write_cheapest()
            path = printable(cheapest)
            say(f"scene {path}; run it with: discsim run {path}")
        say(f"runs {printable(self.directory / RUNS)}")
        say(f"log {printable(say.log)}")
        return self.found is not None

    def _goal_text(self) -> str:
        """Return the goal as the argument of --error."""
        return SCENE if self.options.error is None else f"{100.0 * self.options.error:.3g}%"

    def _search(self, say: Say) -> None:
        """Search, and set `found`. Raises StudyError if nothing can be measured, BudgetError after the deadline."""
        if not self.measure.is_exact:
            self._run_reference(say)
        if self.options.error is None:
            self.runner.run([self.unchanged], self.options.repeat)
            if self.scene is None:
                stopped = self.runner.trials[self.unchanged].stopped
                raise StudyError(f"the error of the scene cannot be measured: the run of the scene was {stopped}")
            self.goal = self.scene.error
        if self.goal < self.floor:
            say(
                f"{percent(self.goal)} is below the scatter between seeds: the search uses an error of "
                f"{percent(self.floor)}"
            )
            self.goal = self.floor
        search = Search(self.knobs.all, self.runner, self.goal, self.knobs.start(), say, self.options.repeat)
        self.found = search.run()
        if not finished_trials(self.runner.trials):
            raise StudyError(f"no run completed; the run of the scene was {self.runner.trials[self.unchanged].stopped}")
        if self.found is None:
            self.end_reason = "no tested setting reaches this error"

    def _run_reference(self, say: Say) -> None:
        """Run the reference settings with REFERENCE_SEEDS seeds. Raises StudyError, BudgetError.

        Sets `runner.reference` to the mean over the seeds, and `floor`, the smallest error that counts, to the mean
        difference between two seeds.
        """
        say(f"no exact solution is used; the reference run has {settings_text(self.reference_settings)}")
        seeded = [self.runner.seeded(self.reference_settings, seed) for seed in range(REFERENCE_SEEDS)]
        runs = self.runner.runs_of(seeded)
        for run in runs:
            if "stopped" in run:
                wrong = f"the reference run ({label_of(self.reference_settings)}) was {run['stopped']}"
                raise StudyError(f"{wrong}; choose other settings with --reference")
        self.runner.reference = mean_run(runs)
        self.floor = fmean(self.measure.error(one, other) for one, other in combinations(runs, 2))
        say(f"floor: two seeds of the reference run differ by {percent(self.floor)}; smaller errors are not resolved")

    def settings_of(self, trial: Trial) -> Settings:
        """Return the settings of a trial."""
        return self.knobs.settings(trial.point) or {}

    def settings_text(self, trial: Trial) -> str:
        """Return the settings of a trial as text."""
        return settings_text(self.settings_of(trial))

    def front(self) -> list[Trial]:
        """Return the Pareto front of the trials, the cheapest first."""
        return pareto_front(finished_trials(self.runner.trials))

    def best(self) -> Trial | None:
        """Return the cheapest trial that reaches the goal; if none does, the trial with the smallest error."""
        return self.found or min(finished_trials(self.runner.trials), key=lambda trial: trial.error, default=None)

    def _scene_of(self, trial: Trial) -> Scene:
        """Return the scene with the settings of a trial."""
        return load_scene(self.path, [*self.settings, *_assignment_texts(self.settings_of(trial))], self.without)

    def _record_estimates(self) -> None:
        """Record the errors and costs of the frontier and of the scene, for estimates of `discsim check`."""
        recorded = {trial.point: trial for trial in (*self.front()[-MAX_RECORDED:], self.found, self.scene) if trial}
        for trial in recorded.values():
            store_error(self._scene_of(trial), self.measure.name, trial.error, trial.cpu)

    def _write_cheapest(self) -> None:
        """Write the scene with the settings found, and a comment about them, to cheapest.toml."""
        assert self.found is not None
        changes = _assignment_texts(self.settings_of(self.found))
        head = (
            f"# Found by: discsim cost {printable(self.path)} --error {self._goal_text()}\n"
            f"# {self.measure.name}: error {percent(self.found.error)}, {self.found.cpu:.3g} s of CPU on one thread; "
            f"changed: {printable(', '.join(changes) or 'nothing')}\n"
        )
        with replace_atomically(self.directory / "cheapest.toml") as temporary:
            temporary.write_text(head + self._scene_of(self.found).text, encoding="utf-8")


def settings_text(settings: Settings) -> str:
    """Return settings as text, with numbers rounded to four digits; "the scene" if no setting but the seed changes."""
    short = {key: f"{float(text):.4g}" if _FRACTION.fullmatch(text) else text for key, text in settings.items()}
    own = [] if settings.keys() - {"run.seed"} else ["the scene"]
    return ", ".join([*own, *([label_of(short)] if short else [])])


def _assignment_texts(settings: Settings) -> list[str]:
    """Return settings as texts "key=value"."""
    return [f"{key}={value}" for key, value in settings.items()]


def _hashable_settings(settings: Settings) -> tuple[tuple[str, str], ...]:
    """Return settings as a tuple, which can be a key of a dict."""
    return tuple(sorted(settings.items()))


def _select_measure(known: dict[str, Measure], name: str | None) -> Measure:
    """Return the measure `name`, or the default measure. Raises StudyError."""
    if not known:
        raise StudyError("the scene has neither gas nor dust to measure")
    if name is None:
        return next(iter(known.values()))
    if name not in known:
        expected = f"expected one of {', '.join(known)}{nearest_hint(name, list(known))}"
        raise StudyError(f"--measure {name}: not available for this scene; {expected}")
    return known[name]
