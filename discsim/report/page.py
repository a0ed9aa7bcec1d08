"""The HTML report of a run, made from the files in its directory; all text from these files is escaped.

The page is one file for screens of any width, in light and dark mode, and for paper. It has no scripts, no links and
no embedded fonts.
"""

from __future__ import annotations

import platform
import tomllib
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2

from discsim.output.costtable import read_costs
from discsim.output.files import refuse_special, replace_atomically
from discsim.output.history import read_history
from discsim.parts import EFFECTS, SCHEMES
from discsim.preview.check import effect_lines
from discsim.preview.derived import derived_rows
from discsim.preview.reference import docstring, paragraphs, split_code
from discsim.printable import UserError, printable, printable_lines
from discsim.report import figures
from discsim.report.conservation import conserved_quantities
from discsim.scene import Scene, load_scene
from discsim.scene.populations import populations_of
from discsim.scene.units import clock
from discsim.study.outcomes import read_results, select_outcomes
from discsim.userfiles import read_text
from discsim.version import __version__

LIBRARIES = ("numpy", "numba", "scipy", "astropy", "h5py", "matplotlib")


class ReportError(UserError):
    """Error for a directory without the files of a run; the message has the reason."""


def write_report(directory: Path, path: Path) -> None:
    """Write the report of the run in `directory` to the HTML file `path`.

    Raises UserError if scene.toml, history.csv or the snapshots are missing or damaged, and OSError.
    """
    refuse_special(path)
    snapshots = sorted((directory / "snapshots").glob("*.h5"))
    if not snapshots or not (directory / "scene.toml").exists():
        raise ReportError(f"{directory}: no run found; give a directory with scene.toml and snapshots")
    scene = load_scene(directory / "scene.toml")
    rows = read_history(directory / "history.csv", scene)
    if not rows:
        raise ReportError(f"{directory / 'history.csv'}: the file has no rows; expected the history.csv of a run")
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("discsim.report", "."), autoescape=True, undefined=jinja2.StrictUndefined,
        finalize=_printable_text, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    found = conserved_quantities(scene, rows)
    text = environment.get_template("page.html.j2").render(
        title=scene.title or printable(directory.resolve().name),
        directory=printable(directory),
        facts=[*_fact_rows(scene, rows), ("snapshots", str(len(snapshots)))],
        outcomes=_outcome_rows(directory, scene),
        pictures=[figures.snapshot_figure(each) for each in dict.fromkeys((snapshots[0], snapshots[-1]))],
        totals=found,
        history=figures.history_figures(scene, rows, found),
        effects=list(_effect_sections(scene)),
        derived=derived_rows(scene) if scene.initial is not None else [],
        costs=_cost_rows(directory / "costs.csv"),
        warnings=_log_warnings(directory / "run.log"),
        scene=read_text(directory / "scene.toml"),
        command=printable(f"discsim run {directory / 'scene.toml'} -o {directory}-again"),
        versions=_version_rows(directory / "run.log"),
    )
    with replace_atomically(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _printable_text(value: object) -> object:
    """Return `value` with control characters escaped; markup from the template is returned unchanged."""
    return value if hasattr(value, "__html__") else printable_lines(value)


def _fact_rows(scene: Scene, rows: list[dict[str, str]]) -> Iterator[tuple[str, str]]:
    """Yield names and values for the table at the top of the page; `rows` are the rows of history.csv by column."""
    show, last = scene.show_time, float(rows[-1]["time"])
    ended = (
        "finished" if last >= (1.0 - 1e-9) * scene.run.until else f"stopped before its end at {show(scene.run.until)}"
    )
    yield "time", f"{show(float(rows[0]['time']))} to {show(last)}; {ended}"
    yield "steps", rows[-1]["step"]
    if scene.gas is not None:
        yield "gas", f"{scene.gas.particles:,} {scene.model.elements}"
    for each, dust in zip(populations_of(tomllib.loads(scene.text)), scene.dust or (), strict=False):
        yield each.legend if len(scene.dust) > 1 else "dust", f"{dust.particles:,} particles"
    yield "effects", ", ".join(scene.effects)


def _outcome_rows(directory: Path, scene: Scene) -> list[tuple[str, str]]:
    """Return names and values of the results that `discsim sweep` tabulates by default for such a scene."""
    wanted = select_outcomes(scene)
    values = read_results(directory, scene, wanted).values
    return [(each.head, f"{values[each.name]:.4g}") for each in wanted]


def _effect_sections(scene: Scene) -> Iterator[dict[str, Any]]:
    """Yield a dict for each effect of the scene: its name, its keys with values, and its documentation.

    The entry "blocks" has a pair for each paragraph of the documentation: True for an equation, and the text.
    """
    keys: dict[str, list[str]] = {}
    for name, text in effect_lines(scene):
        keys.setdefault(name.partition(".")[0], []).append(f"{name}: {text}" if text else name)
    for name in scene.named:
        text = docstring(EFFECTS.module(name))
        if name == "drag":
            text += f"\n\n{docstring(SCHEMES.module(scene.drag.scheme))}"
        blocks = [
            (part.startswith(" "), part if part.startswith(" ") else split_code(part)) for part in paragraphs(text)
        ]
        yield {"name": name, "keys": keys.get(name, []), "blocks": blocks}


def _cost_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of costs.csv, the most expensive effect first; [] if the file does not exist."""
    if not path.exists():
        return []
    rows = sorted(read_costs(path), key=lambda row: -row.share)
    return [
        {"effect": row.effect, "calls": row.calls, "time": _duration_text(row.seconds), "share": 100.0 * row.share}
        for row in rows
    ]


def _duration_text(value: float) -> str:
    """Return a duration in seconds as text."""
    return f"{value:.3g} s" if value < 10.0 else clock(value)


def _log_lines(path: Path) -> list[str]:
    """Return the lines of run.log; [] if the file does not exist."""
    return read_text(path, "replace").splitlines() if path.exists() else []


def _log_warnings(log: Path) -> list[str]:
    """Return the warnings in run.log without repetitions, and the reason if the run was stopped."""
    lines = _log_lines(log)
    warnings = [line.removeprefix("warning: ") for line in lines if line.startswith("warning: ")]
    stopped = [line for line in lines[-2:] if line.startswith(("interrupted by", "stopped by", "out of memory"))]
    return list(dict.fromkeys([*warnings, *stopped]))


def _version_rows(log: Path) -> list[tuple[str, str]]:
    """Return the versions of discsim in the run and now, and the present versions of Python and of libraries."""
    first = next(iter(_log_lines(log)), "").partition(":")[0]
    run = first.removeprefix("discsim ") if first.startswith("discsim ") else "not known"
    here = [("Python", platform.python_version()), *((name, version(name)) for name in LIBRARIES)]
    return [("discsim of the run", run), ("discsim of this page", __version__), *here]
