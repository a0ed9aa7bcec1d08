"""Scene of a new run that starts from a snapshot of an earlier run, with changed physics, and a list of the changes.

The new scene is a copy of the earlier scene, with its comments, but [initial] names the snapshot. Time continues from
the time of the snapshot, so that both runs have outputs at the same times.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from discsim.initial import start_of
from discsim.output.restart import KIND
from discsim.parts import EFFECTS
from discsim.printable import UserError, printable, printable_lines
from discsim.scene import Scene, load_scene
from discsim.scene.differences import differences
from discsim.scene.messages import value_at
from discsim.scene.reading import parse_scene, read_scene_text
from discsim.scene.tomltext import inline


class BranchError(UserError):
    """Error for a snapshot that is missing or cannot start a run; the message gives the reason."""


class Branch(NamedTuple):
    """Scene of a new run, path of the snapshot from which it starts, and texts about the changed tables and keys."""

    scene: Scene
    snapshot: Path
    changes: list[str]

    @property
    def text(self) -> str:
        """Text about the snapshot and its time, and the changes, one line each."""
        when = self.scene.initial.file.time_text
        return "\n  ".join(
            [f"branch of {printable(self.snapshot)} at t = {when}, with", *(self.changes or ["nothing changed"])]
        )


def branch(run: Path, number: int | None, settings: Sequence[str] = (), without: Sequence[str] = ()) -> Branch:
    """Return the scene of a new run that starts from a snapshot of an earlier run.

    run: directory of the earlier run. number: number of the snapshot; None: the last one. settings: changed keys with
    their values, such as "gas.particles=1000". without: names of tables to remove. Raises BranchError for the snapshot,
    and SceneError for the new scene.
    """
    snapshot = _snapshot_path(run, number)
    path = run / "scene.toml"
    before = load_scene(path)
    initial = _initial_table(path, f"snapshots/{snapshot.name}", hasattr(before.initial, "reference_radius"))
    _refuse_lost_temperature(before, settings)
    scene = load_scene(path, [f"initial={initial}", *settings], without)
    changes = list(_list_changes(before, scene))
    text = Branch(scene, snapshot, changes).text
    comment = "".join(f"# {line}\n" for line in printable_lines(text).split("\n"))
    return Branch(scene.model_copy(update={"text": f"{comment}\n{scene.text}"}), snapshot, changes)


def _snapshot_path(run: Path, number: int | None) -> Path:
    """Return the path of snapshot `number` of a run; None: of the last one. Raises BranchError."""
    found = {int(path.stem): path for path in (run / "snapshots").glob("*.h5") if path.stem.isdecimal()}
    if not found:
        raise BranchError(f"{run}: no snapshots found; give the directory of a run")
    wanted = max(found) if number is None else number
    if wanted not in found:
        raise BranchError(
            f"{run}: there is no snapshot {wanted:04d}; choose a number from {min(found):04d} to {max(found):04d}"
        )
    return found[wanted]


def _initial_table(path: Path, file: str, has_reference: bool) -> str:
    """Return the table [initial] of the new scene as an inline TOML table.

    path: scene file of the earlier run. file: snapshot of the earlier run. has_reference: whether the start of the
    earlier run has a reference radius of power laws, which is then copied.
    """
    entries: dict[str, Any] = {"kind": KIND, "file": file, "keep_time": True}
    was = value_at(parse_scene(path, read_scene_text(path)), "initial") or {}
    radius = was.get("reference_radius", was.get("radius"))  # a ring refers to its own radius
    if has_reference and radius is not None:
        entries["reference_radius"] = radius
    return inline(entries)


def _refuse_lost_temperature(before: Scene, settings: Sequence[str]) -> None:
    """Raise BranchError if the gas temperature came from the start, which snapshots do not store, and is not replaced.

    before: scene of the earlier run. settings: changed keys.
    """
    brings = before.initial is not None and start_of(before).thermal_speed
    if not brings or before.gas is None or not getattr(before.initial, "sets_temperature", False):
        return
    given = any(each.startswith("gas.eos") for each in settings)
    if before.gas.eos.kind == "locally-isothermal" and not given:
        wrong = "the gas temperature came from the table of the start, and snapshots do not contain it"
        raise BranchError(f"{before.path}: {wrong}; set a temperature, for example: --set gas.eos.aspect_ratio=0.05")


def _list_changes(before: Scene, after: Scene) -> Iterator[str]:
    """Yield texts about the changes of tables and keys between two scenes, such as "gas.particles = 100, was 200"."""
    old, new = (tomllib.loads(scene.text) for scene in (before, after))
    for key in differences(before, after):
        path = [int(part) if part.isdecimal() else part for part in key.split(".")]
        if path[0] == "initial" or path[-1] == "particles":
            continue
        if isinstance(old.get(str(path[0])), dict) and len(path) > 1 and isinstance(path[1], int):
            path.pop(1)  # a list of one is written as a table
        was, now = (value_at(data, *path) for data in (old, new))
        if path == [path[0]] and path[0] in EFFECTS:
            yield f"[{key}] removed" if now is None else f"[{key}] added" if was is None else f"[{key}] changed"
        else:
            yield f"{'.'.join(map(str, path))} = {_value_text(now)}, was {_value_text(was)}"


def _value_text(value: Any) -> str:
    """Return a value of a key as text; None: the key is absent."""
    return "the default" if value is None else json.dumps(value, ensure_ascii=False)
