"""Numbers that scenes gave when they were last recorded, so that a change of any of them is seen.

These numbers do not say what is right, as the tests of physics do. They show what an edit changes. After an edit that
is meant to change results, record them again and tell the changes in the commit's message:

    python tests/helpers/recorded.py          prints what changed by more than rounding
    python tests/helpers/recorded.py --write  records it
"""

from __future__ import annotations

import csv
import io
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any
from unittest.mock import patch

import h5py
import numpy as np

from discsim import load_scene, parts, read_snapshot
from discsim.output.fields.base import FieldError
from discsim.preview.check import report
from discsim.run.runner import run_scene

FOLDER = Path(__file__).parents[1] / "regression"
VALUES = FOLDER / "values.json"
SCENES = sorted((FOLDER / "scenes").glob("*.toml"))
ROOT = FOLDER.parents[1]
CHECKED = sorted([*ROOT.glob("setups/*.toml"), *ROOT.glob("tests/scenes_of_published_discs/*.toml")])
# Results differ between processors by rounding alone, 1e-15 a sum, and a few steps with neighbours chosen by
# continuous functions make no more than a few hundred times that of it.
ROUNDING = 1e-10
PRINTED = 0.011  # of numbers in texts, which have three digits
TINY = 1e-300
OF_MACHINE = r"^\s*(?:CPU time|memory)"
ALREADY = {"costs", "OpenStep"}  # seconds; what the checkpoint has too
OF_LIGHT = ("emission", "optical_depth")
PIXELS = 7


def moments(array: Any, order: Any = None) -> list[float]:
    """Three numbers of an array that see its values and whose they are: its size and two weighted sums."""
    a = np.asarray(array, dtype=np.float64)
    if a.size == 0:
        return [0.0, 0.0, 0.0]
    a = a.reshape(len(a), -1) if a.ndim else a.reshape(1, 1)
    if order is not None:
        a = a[order]
    a = np.where(np.isfinite(a), a, 0.0)
    angle = 0.7 * np.arange(len(a))[:, None] + 1.9 * np.arange(a.shape[1])
    sums = np.abs(a).sum(), (a * np.cos(angle)).sum(), (a * np.sin(angle)).sum()
    return [float(f"{value:.12g}") for value in sums]


def of_checks() -> dict[str, list[float]]:
    """Numbers that `discsim check` prints for the shipped setups and for scenes after published discs."""
    return {f"check {path.stem}": numbers_of_check(path) for path in CHECKED}


def of_run(path: Path) -> dict[str, list[float]]:
    """Numbers of a scene: its check, and the rows, files and fields that its run of some steps leaves."""
    scene = load_scene(path)
    out = {"check": numbers_of_check(path)}
    no_figure = patch("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    with tempfile.TemporaryDirectory() as folder, redirect_stderr(io.StringIO()) as said, no_figure:
        if run_scene(scene, Path(folder), quiet=True) != 0:
            raise RuntimeError(f"{path}: {said.getvalue()}")
        for table in ("history", "companions"):
            if Path(folder, f"{table}.csv").exists():
                out |= {f"{table} {name}": values for name, values in _columns(Path(folder, f"{table}.csv"))}
        last = sorted(Path(folder, "snapshots").glob("*.h5"))[-1]
        for file in (last, Path(folder, "checkpoint.h5")):
            out |= {f"{file.stem if file != last else 'snapshot'} {name}": value for name, value in _stored(file)}
        snap = read_snapshot(last)
    for name in parts.FIELDS:
        try:
            values = snap.field(name, pixels=PIXELS, **({"wavelength": "1.3 mm"} if name in OF_LIGHT else {}))
        except FieldError:
            continue
        out[f"field {name}"] = moments(values.value)
    return out


def numbers_of_check(path: Path) -> list[float]:
    """All numbers that `discsim check` prints of a scene, but for those of this machine."""
    text = "\n".join(line for line in report(load_scene(path)).splitlines() if not re.search(OF_MACHINE, line))
    return [float(word) for word in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", text)]


def _columns(path: Path) -> Iterator[tuple[str, list[float]]]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in rows[0]:
        if name != "dt_set_by":
            yield name, moments([float(row[name]) for row in rows])


def _stored(path: Path) -> list[tuple[str, list[float]]]:
    """Columns of a file in the order of its particles' ids."""
    found: list[tuple[str, list[float]]] = []

    def visit(name: str, entry: Any) -> None:
        if isinstance(entry, h5py.Dataset) and entry.dtype.kind == "f" and not ALREADY & {*name.split("/")}:
            ids = next((entry.parent[key][()] for key in ("ids", "ParticleIDs") if key in entry.parent), None)
            order = np.argsort(ids, kind="stable") if ids is not None and len(ids) == len(entry) else None
            found.append((name, moments(entry[()], order)))

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


def recorded() -> dict[str, dict[str, list[float]]]:
    return json.loads(VALUES.read_text(encoding="utf-8"))


def changes(before: dict[str, list[float]], now: dict[str, list[float]]) -> list[str]:
    """A line for each number that differs by more than rounding."""
    out = [f"{name}: {'new' if name in now else 'gone'}" for name in before.keys() ^ now.keys()]
    for name in before.keys() & now.keys():
        a, b, text = np.array(before[name]), np.array(now[name]), name.startswith("check")
        if a.shape != b.shape:
            out.append(f"{name}: {len(a)} numbers, now {len(b)}")
            continue
        size = np.abs(a) if text else np.full(a.shape, max(abs(a[0]), TINY))
        off = np.abs(b - a) > (PRINTED if text else ROUNDING) * size
        if off.any():
            i = int(np.argmax(np.abs(b - a) / np.maximum(size, TINY)))
            out.append(f"{name}[{i}]: {float(a[i])!r}, now {float(b[i])!r}")
    return sorted(out)


def main(write: bool) -> None:
    found: dict[str, dict[str, list[float]]] = {}
    kept = recorded() if VALUES.exists() else {}
    for name in ("checks", *(path.stem for path in SCENES)):
        found[name] = of_checks() if name == "checks" else of_run(FOLDER / "scenes" / f"{name}.toml")
        for line in changes(kept.get(name, {}), found[name]):
            print(f"{name}: {line}", flush=True)
    if write:
        lines = (f"{json.dumps(name)}: {{\n{_lines(values)}\n}}" for name, values in found.items())
        VALUES.write_text("{" + ",\n".join(lines) + "}\n", encoding="utf-8")


def _lines(values: dict[str, list[float]]) -> str:
    return ",\n".join(f"{json.dumps(name)}: {json.dumps(values[name])}" for name in sorted(values))


if __name__ == "__main__":
    main("--write" in sys.argv[1:])
