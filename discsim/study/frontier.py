"""Tables and figure of a search for the cheapest settings: the frontier, and the effect of each knob.

The frontier has the trials for which no other trial is both cheaper and at least as accurate (Pareto front). A knob is
a parameter that the search varies, and a trial is a combination of values of all knobs with its runs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
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
from discsim.study.trials import RUNG, Place, Trial
from discsim.version import __version__

if TYPE_CHECKING:
    from discsim.study.cheapest import Cheapest

ROWS = 12  # largest number of rows of the frontier in the table


def show(study: Cheapest, console: Console) -> None:
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
        if study.ended:
            console.print(f"not complete, {study.ended}; repeat the command to continue")
        console.print(
            f"cheapest for {percent(study.goal)}: {study.words(study.found)}: {_error_and_cost(study, study.found)}"
        )
    else:
        console.print(
            f"an error of {percent(study.goal)} was not reached: {study.ended}; {_closest_text(study, chosen)}"
        )
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
    """Return text on the most accurate trial, if none reaches the goal."""
    if chosen is None:
        return "no run completed"
    return f"closest is {study.words(chosen)}: {_error_and_cost(study, chosen)}"


def _cost_of_own_error(study: Cheapest, scene: Trial) -> str:
    """Return text on the cheapest trial that is as accurate as the unchanged scene.

    An error that is larger by up to twice the scatter between seeds counts as equal.
    """
    most = scene.error + 2.0 * scene.scatter
    tried = (trial for trial in study.runner.trials.values() if trial.runs and trial.error <= most)
    least = min(tried, key=lambda trial: trial.cpu)
    if least is scene:
        return "; no tested setting is as accurate and cheaper"
    return f"; the same accuracy for {least.cpu / scene.cpu:.2g} of that: {study.words(least)}"


def _frontier_table(study: Cheapest, front: list[Trial]) -> Table:
    """Return the table of at most ROWS trials of the frontier, the result and the scene."""
    table = Table("", "error", "CPU s", "of scene's", "seeds", "settings that differ from the scene", box=SIMPLE)
    few = np.unique(np.linspace(0, len(front) - 1, min(len(front), ROWS)).astype(int))
    shown = {trial.place: trial for trial in (*(front[i] for i in few), study.found, study.scene) if trial}
    for trial in sorted(shown.values(), key=lambda t: t.cpu):
        mark = "->" if trial is study.found else "=" if trial is study.scene else "*" if trial in front else ""
        times = f"{trial.cpu / study.scene.cpu:.2g}" if study.scene else ""
        row = percent(trial.error), f"{trial.cpu:.3g}", times, str(len(trial.runs)), study.words(trial)
        table.add_row(mark, *row)
    table.caption = (
        "* Pareto-optimal: no tested setting is both cheaper and at least as accurate; -> cheapest "
        "for the error; = the scene"
    )
    table.caption_justify = "left"
    return table


def _knob_table(study: Cheapest, chosen: Trial) -> Table:
    """Return the table of numeric knobs: values, effect of one rung up near the trial `chosen`, and power laws."""
    table = Table("knob", "scene", "found", "one step finer", "error ~", "CPU time ~", box=SIMPLE)
    trials = [trial for trial in study.runner.trials.values() if trial.runs]
    scene = tuple(0 for _ in study.knobs.all)
    for k, knob in enumerate(study.knobs.all):
        if knob.choice:
            continue
        values = value_words(study.knobs, scene, k), value_words(study.knobs, chosen.place, k)
        fitted = powers(trials, k, knob.ratio)
        laws = ("", "") if fitted is None else (f"x^{fitted[0]:.2g}", f"x^{fitted[1]:.2g}")
        finer = [(a, b) for a in trials if (b := _trial_with_rung(study, a, k, a.place[k] + RUNG))]
        table.add_row(f"{knob.name} x {knob.ratio:.2g}", *values, _ratios_of_nearest_pair(finer, chosen, k), *laws)
    table.caption = (
        "effect of each setting near the result: error and CPU time relative to runs without it; x: its value, all runs"
    )
    table.caption_justify = "left"
    return table


def _choice_lines(study: Cheapest, chosen: Trial) -> Iterator[str]:
    """Yield a line per choice with the effect of its other values, from the pair of trials nearest to `chosen`."""
    trials = [trial for trial in study.runner.trials.values() if trial.runs]
    for k, knob in enumerate(study.knobs.all):
        own, out = chosen.place[k], []
        for rung in range(knob.lowest, knob.highest + 1) if knob.choice else ():
            pairs = [(a, b) for a in trials if a.place[k] == own if (b := _trial_with_rung(study, a, k, rung))]
            if rung != own:
                told = _ratios_of_nearest_pair(pairs, chosen, k) or _reason_for_none(study, k, rung)
                out.append(f"{knob.word(study.knobs.base, rung)} ({told})")
        if out:
            yield f"{knob.name} {knob.word(study.knobs.base, own)}; instead {', '.join(out)}"


def _trial_with_rung(study: Cheapest, trial: Trial, k: int, rung: int) -> Trial | None:
    """Return the trial that has this rung of knob k and all other rungs of `trial`; None without runs."""
    found = study.runner.trials.get((*trial.place[:k], rung, *trial.place[k + 1 :]))
    return found if found and found.runs else None


def _reason_for_none(study: Cheapest, k: int, rung: int) -> str:
    """Return the reason, as text, why no trial with this rung of knob k has a result."""
    stopped = [t.stopped for t in study.runner.trials.values() if t.place[k] == rung and t.stopped]
    return stopped[0].partition(":")[0] if stopped else "not tried"


def _ratios_of_nearest_pair(pairs: list[tuple[Trial, Trial]], chosen: Trial, k: int) -> str:
    """Return, as text, the ratios of error and CPU time in the pair whose first trial is nearest to `chosen`."""
    if not pairs:
        return ""
    one, other = min(pairs, key=lambda pair: sum(abs(a - b) for a, b in zip(pair[0].place, chosen.place, strict=True)))
    return f"error x {other.error / max(one.error, 1e-300):.2g}, CPU x {other.cpu / one.cpu:.2g}"


def value_words(knobs: Knobs, place: Place, k: int) -> str:
    """Return the value of knob k at a place (a tuple of rungs) as text."""
    settings, key = knobs.settings(place) or {}, knobs.all[k].keys[0]
    value: Any = settings[key].strip('"') if key in settings else knobs.base.value(key)
    return "default" if value is None else printable(value)


def powers(trials: Sequence[Trial], k: int, ratio: float) -> tuple[float, float] | None:
    """Return the exponents p and q of error ~ value^p and CPU time ~ value^q, with the value of knob k.

    `ratio` is the factor of one rung. Trials that differ only in knob k form a group; p and q are a common fit to all
    groups. None if no group has two trials.
    """
    groups: dict[Place, list[Trial]] = {}
    for trial in trials:
        groups.setdefault((*trial.place[:k], 0, *trial.place[k + 1 :]), []).append(trial)
    x, y = [], []
    for group in groups.values():
        if len(group) > 1:
            rungs = np.array([trial.place[k] / RUNG * math.log(ratio) for trial in group])
            values = np.log([[max(trial.error, 1e-300), trial.cpu] for trial in group])
            x.append(rungs - rungs.mean())
            y.append(values - values.mean(axis=0))
    if not x:
        return None
    along, across = np.concatenate(x), np.concatenate(y)
    slopes = along @ across / (along @ along)
    return float(slopes[0]), float(slopes[1])


def frontier_figure(study: Cheapest, path: Path) -> None:
    """Draw error against CPU time of all trials to the PNG file `path`; mark the frontier, the scene and the result."""
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    trials = [trial for trial in study.runner.trials.values() if trial.runs]
    front, scene, found = study.front(), study.scene, study.found
    axes.plot([t.cpu for t in trials], [t.error for t in trials], "o", color="0.75", ms=4, label="tested settings")
    line = [t.cpu for t in front], [t.error for t in front]
    axes.step(*line, where="post", color="C0", lw=1.2)
    axes.plot(*line, "o", color="C0", ms=5, label="Pareto-optimal")
    for trial, style, size, name in (
        (scene, "s", 11, "the scene"),
        (found, "*", 17, "cheapest for the error"),
    ):
        if trial is not None:
            colour = "C3" if style == "s" else "C1"
            axes.errorbar(trial.cpu, trial.error, trial.scatter or None, color=colour, capsize=3)
            axes.plot(trial.cpu, trial.error, style, color=colour, ms=size, mec="black", mew=0.8, label=name, zorder=5)
    if study.goal > 0.0:
        axes.axhline(study.goal, color="C1", ls="--", lw=0.9, label=f"target error, {percent(study.goal)}")
    if study.floor > 0.0:
        label = f"difference of two seeds of the reference run, {percent(study.floor)}"
        axes.axhspan(0.0, study.floor, color="0.9", zorder=0, label=label)
    errors = [t.error for t in trials if t.error > 0.0] + [study.goal or 1.0]
    axes.set(xscale="log", yscale="log", ylim=(0.5 * min(errors), 2.0 * max(errors)))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: percent(value)))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("CPU time of the steps on one thread [s]")
    axes.set_ylabel(f"error: {study.measure.words}", wrap=True)
    axes.grid(alpha=0.3, which="both", lw=0.4)
    title = f"{figure_text(study.path.stem)}: error against CPU time"
    found_words = f"\nfound: {figure_text(study.words(found))}" if found else ""
    axes.set_title(title + found_words, fontsize=10, wrap=True)
    axes.legend(fontsize=8, framealpha=0.9)
    figure.savefig(path, dpi=150, metadata={"Software": f"discsim {__version__}"})
