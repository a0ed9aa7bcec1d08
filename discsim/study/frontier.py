"""Tables and figure of a search for the cheapest settings: the frontier, and the effect of each knob.

The frontier consists of the trials for which no other trial is both cheaper and at least as accurate (Pareto front). A
knob is a parameter that the search varies, and a trial is a combination of values of all knobs with its runs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from discsim.output.drawing import figure_text
from discsim.printable import printable
from discsim.scene.units import clock
from discsim.study.knobs import Knobs
from discsim.study.points import percent
from discsim.study.trials import UNITS_PER_RUNG, GridPoint, Trial, finished_trial, finished_trials, with_rung
from discsim.version import __version__

if TYPE_CHECKING:
    from discsim.study.cheapest import Cheapest

ROWS = 12  # largest number of rows of the frontier in the table


def print_results(study: Cheapest, console: Console) -> None:
    """Print tables of the frontier and of the effect of each knob, and the cheapest settings."""
    runner, scene = study.runner, study.scene
    console.print(f"\nerror ({study.measure.name}): {study.measure.words}")
    front = study.front()
    if front:
        console.print(_frontier_table(study, front))
    chosen = study.best()
    if chosen is not None:
        console.print(_knob_table(study, chosen))
        for line in _choice_lines(study, chosen):
            console.print(line)
    if study.found is not None:
        if study.end_reason:
            console.print(f"not complete, {study.end_reason}; repeat the command to continue")
        found = f"{study.settings_text(study.found)}: {_error_and_cost(study, study.found)}"
        console.print(f"cheapest for {percent(study.goal)}: {found}")
    else:
        wrong = f"an error of {percent(study.goal)} was not reached: {study.end_reason}"
        console.print(f"{wrong}; {_closest_text(study, chosen)}")
    if scene is not None:
        console.print(f"the scene: {_error_and_cost(study, scene)}{_cost_of_own_error(study, scene)}")
    times = f", {runner.cpu / scene.cpu:.3g} times the scene's" if scene else ""
    wall = clock(time.monotonic() - study.begun)
    console.print(f"search: {runner.count} runs, {runner.cpu:.3g} s of CPU{times}; this call took {wall}")


def _error_and_cost(study: Cheapest, trial: Trial) -> str:
    """Return error and CPU time of a trial as text."""
    seeds = f" +- {percent(trial.scatter)} ({len(trial.runs)} seeds)" if trial.scatter else ""
    text = f"error {percent(trial.error)}{seeds}, {trial.cpu:.3g} s of CPU"
    scene = study.scene
    return f"{text}, {trial.cpu / scene.cpu:.2g} times the scene's" if scene and trial is not scene else text


def _closest_text(study: Cheapest, chosen: Trial | None) -> str:
    """Return text about the most accurate trial, `chosen`, for a search in which no trial reaches the goal."""
    if chosen is None:
        return "no run completed"
    return f"closest is {study.settings_text(chosen)}: {_error_and_cost(study, chosen)}"


def _cost_of_own_error(study: Cheapest, scene: Trial) -> str:
    """Return text about the cheapest trial that is as accurate as `scene`, the trial of the unchanged scene.

    An error that is larger by at most twice the scatter between seeds counts as equal.
    """
    most = scene.error + 2.0 * scene.scatter
    accurate = (trial for trial in finished_trials(study.runner.trials) if trial.error <= most)
    least = min(accurate, key=lambda trial: trial.cpu)
    if least is scene:
        return "; no tested setting is as accurate and cheaper"
    return f"; the same accuracy in {least.cpu / scene.cpu:.2g} of this CPU time: {study.settings_text(least)}"


def _frontier_table(study: Cheapest, front: list[Trial]) -> Table:
    """Return a table of at most ROWS trials of the frontier `front`, the trial found, and the unchanged scene."""
    table = Table("", "error", "CPU s", "of scene's", "seeds", "settings that differ from the scene", box=SIMPLE)
    few = np.unique(np.linspace(0, len(front) - 1, min(len(front), ROWS)).astype(int))
    shown = {trial.point: trial for trial in (*(front[i] for i in few), study.found, study.scene) if trial}
    for trial in sorted(shown.values(), key=lambda t: t.cpu):
        mark = "->" if trial is study.found else "=" if trial is study.scene else "*" if trial in front else ""
        times = f"{trial.cpu / study.scene.cpu:.2g}" if study.scene else ""
        row = percent(trial.error), f"{trial.cpu:.3g}", times, str(len(trial.runs)), study.settings_text(trial)
        table.add_row(mark, *row)
    table.caption = (
        "* Pareto-optimal: no tested setting is both cheaper and at least as accurate; -> cheapest "
        "for the error; = the scene"
    )
    table.caption_justify = "left"
    return table


def _knob_table(study: Cheapest, chosen: Trial) -> Table:
    """Return a table of the numeric knobs: values, effect of one rung near the trial `chosen`, and power laws.

    A rung is one step to a finer value. Knobs that the scene of `chosen` does not have are left out.
    """
    table = Table("knob", "scene", "found", "one step finer", "error ~", "CPU time ~", box=SIMPLE)
    trials = finished_trials(study.runner.trials)
    for k, knob in enumerate(study.knobs.all):
        if knob.is_choice or not _has_knob(study.knobs, chosen.point, k):
            continue
        values = (value_text(study.knobs, point, k) for point in (study.unchanged, chosen.point))
        fitted = fit_powers(trials, k, knob.ratio)
        laws = ("", "") if fitted is None else (f"x^{fitted[0]:.2g}", f"x^{fitted[1]:.2g}")
        finer = [(a, b) for a in trials if (b := _trial_with_rung(study, a, k, a.point[k] + UNITS_PER_RUNG))]
        table.add_row(f"{knob.name} x {knob.ratio:.2g}", *values, _ratios_of_nearest_pair(finer, chosen, k), *laws)
    table.caption = (
        "effect of each knob near the result: error and CPU time relative to runs without the "
        "change; x: value of the knob, from all runs"
    )
    table.caption_justify = "left"
    return table


def _choice_lines(study: Cheapest, chosen: Trial) -> Iterator[str]:
    """Yield a line of text per choice with the effect of its other values, measured near the trial `chosen`."""
    trials = finished_trials(study.runner.trials)
    for k, knob in enumerate(study.knobs.all):
        if not _has_knob(study.knobs, chosen.point, k):
            continue
        own, out = chosen.point[k], []
        for rung in range(knob.lowest, knob.highest + 1) if knob.is_choice else ():
            pairs = [(a, b) for a in trials if a.point[k] == own if (b := _trial_with_rung(study, a, k, rung))]
            if rung != own:
                told = _ratios_of_nearest_pair(pairs, chosen, k) or _reason_of_no_result(study, k, rung)
                out.append(f"{knob.word(study.knobs.base, rung)} ({told})")
        if out:
            yield f"{knob.name} {knob.word(study.knobs.base, own)}; instead {', '.join(out)}"


def _has_knob(knobs: Knobs, point: GridPoint, k: int) -> bool:
    """Return whether the scene with the settings of a grid point has knob k; a fluid on a grid has no kernel."""
    knob = knobs.all[k]
    others = (rung for rung in range(knob.lowest, knob.highest + 1) if rung != point[k])
    return point[k] != 0 or any(knobs.settings(with_rung(point, k, rung)) is not None for rung in others)


def _trial_with_rung(study: Cheapest, trial: Trial, k: int, rung: int) -> Trial | None:
    """Return the trial in which knob k has the entry `rung` and all other knobs are as in `trial`.

    Returns None if no run of that trial has a result.
    """
    return finished_trial(study.runner.trials, with_rung(trial.point, k, rung))


def _reason_of_no_result(study: Cheapest, k: int, rung: int) -> str:
    """Return the reason, as text, why no trial in which knob k has the entry `rung` has a result."""
    stopped = [t.stopped for t in study.runner.trials.values() if t.point[k] == rung and t.stopped]
    return stopped[0].partition(":")[0] if stopped else "not tried"


def _ratios_of_nearest_pair(pairs: list[tuple[Trial, Trial]], chosen: Trial, k: int) -> str:
    """Return the ratios of error and CPU time of two trials as text; "" without pairs.

    The two trials are the pair in `pairs` whose first trial is nearest to the trial `chosen`.
    """
    if not pairs:
        return ""
    one, other = min(pairs, key=lambda pair: sum(abs(a - b) for a, b in zip(pair[0].point, chosen.point, strict=True)))
    return f"error x {other.error / max(one.error, 1e-300):.2g}, CPU x {other.cpu / one.cpu:.2g}"


def value_text(knobs: Knobs, point: GridPoint, k: int) -> str:
    """Return the value of knob k at a grid point as text."""
    settings, key = knobs.settings(point) or {}, knobs.all[k].keys[0]
    value: Any = settings[key].strip('"') if key in settings else knobs.base.value(key)
    return "default" if value is None else printable(value)


def fit_powers(trials: Sequence[Trial], k: int, ratio: float) -> tuple[float, float] | None:
    """Return (p, q) of the fits error ~ x^p and CPU time ~ x^q, where x is the value of knob k.

    ratio: ratio of the values of x one rung apart. Trials that differ only in knob k form a group; p and q are a
    common fit to all groups. Returns None if no group has two trials.
    """
    groups: dict[GridPoint, list[Trial]] = {}
    for trial in trials:
        groups.setdefault(with_rung(trial.point, k, 0), []).append(trial)
    x, y = [], []
    for group in groups.values():
        if len(group) > 1:
            rungs = np.array([trial.point[k] / UNITS_PER_RUNG * math.log(ratio) for trial in group])
            values = np.log([[max(trial.error, 1e-300), trial.cpu] for trial in group])
            x.append(rungs - rungs.mean())
            y.append(values - values.mean(axis=0))
    if not x:
        return None
    along, across = np.concatenate(x), np.concatenate(y)
    slopes = along @ across / (along @ along)
    return float(slopes[0]), float(slopes[1])


def frontier_figure(study: Cheapest, path: Path) -> None:
    """Draw error against CPU time of all trials, mark the frontier, the scene and the result, and write a PNG file."""
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    axes = figure.add_subplot()
    trials = finished_trials(study.runner.trials)
    front, scene, found = study.front(), study.scene, study.found
    axes.plot([t.cpu for t in trials], [t.error for t in trials], "o", color="0.75", ms=4, label="tested settings")
    line = [t.cpu for t in front], [t.error for t in front]
    axes.step(*line, where="post", color="C0", lw=1.2)
    axes.plot(*line, "o", color="C0", ms=5, label="Pareto-optimal")
    marked = (scene, "s", "C3", 11, "the scene"), (found, "*", "C1", 17, "cheapest for the error")
    for trial, style, colour, size, name in marked:
        if trial is not None:
            axes.errorbar(trial.cpu, trial.error, trial.scatter or None, color=colour, capsize=3)
            axes.plot(trial.cpu, trial.error, style, color=colour, ms=size, mec="black", mew=0.8, label=name, zorder=5)
    if study.goal > 0.0:
        axes.axhline(study.goal, color="C1", ls="--", lw=0.9, label=f"target error, {percent(study.goal)}")
    if study.floor > 0.0:
        label = f"difference of two seeds of the reference run, {percent(study.floor)}"
        axes.axhspan(0.0, study.floor, color="0.9", zorder=0, label=label)
    errors = [t.error for t in trials if t.error > 0.0] + [study.goal or 1.0]
    axes.set(xscale="log", yscale="log", ylim=(0.5 * min(errors), 2.0 * max(errors)))
    for axis, text in ((axes.yaxis, percent), (axes.xaxis, "{:g}".format)):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _, text=text: text(value)))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("CPU time of the steps on one thread [s]")
    axes.set_ylabel(f"error: {study.measure.words}", wrap=True)
    axes.grid(alpha=0.3, which="both", lw=0.4)
    title = f"{figure_text(study.path.stem)}: error against CPU time"
    found_words = f"\nfound: {figure_text(study.settings_text(found))}" if found else ""
    axes.set_title(title + found_words, fontsize=10, wrap=True)
    axes.legend(fontsize=8, framealpha=0.9)
    figure.savefig(path, dpi=150, metadata={"Software": f"discsim {__version__}"})
