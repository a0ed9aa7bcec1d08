"""Random scenes of all tables, and what becomes of one: it runs, or it is refused, or the physics stops it.

Keys and words are those of `discsim.scene.tables`: new ones take part by themselves. What does not go together is left
out as the scene's own messages say, so that most scenes run. Look at one with

    python tests/helpers/fuzz.py SEED
"""

from __future__ import annotations

import signal
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from drags import ON_GRID, POLAR

from discsim import SceneError, Simulation, parts, read_snapshot
from discsim.output.history import history_row
from discsim.output.snapshot_writer import write_snapshot
from discsim.preview.check import report
from discsim.run import outputs
from discsim.run.simulation import PhysicsError
from discsim.scene import fields, load_scene
from discsim.scene.tables import TABLES, Run, Space

PATIENCE = 180  # seconds, those in which kernels compile among them
STEPS = 3
STARTS = {model.model_fields["kind"].default: model for model in fields.models_in(TABLES["initial"])}
GAS, BACKGROUND, DRAG = (TABLES[name] for name in ("gas", "background", "drag"))
(DUST,) = fields.models_in(TABLES["dust"])
GASES = {m.model_fields["kind"].default: m for m in fields.models_in(GAS.model_fields["eos"].annotation)}
SCHEMES = fields.choices_in(DRAG.model_fields["scheme"].annotation)
LAWS = fields.choices_in(DRAG.model_fields["law"].annotation)
KERNELS = fields.choices_in(GAS.model_fields["kernel"].annotation)
LINES, PLANES = ("shock", "settling"), ("disc", "blast", "vortex")  # starts of one dimension, and of two
OPEN = ("disc", "shock", "settling", "blast")
EXTREME = (
    0, 1, -1, 0.5, 3, 1e-3, 1e3, 1e-12, 1e12, 1e-59, 1e59, 1e-300, 1e300, -1e9, float("nan"), float("inf"), 10**400, "",
    "1 au", "no", "nan", True, [], [1], [1, 2], [1, 2, 3], [1e9, -1e9], {}, {"kind": "disc"}, None,
)  # fmt: skip
# Sizes that go with each other, where a key has another than about 1.
SIZES = {
    "particles": (20, 150), "cells": (6, 40), "seed": (0, 9), "threads": (1, 2), "snapshots": (1, 5),
    "wavenumber": (1, 3), "inner": (0.5, 0.9), "outer": (1.5, 2.0), "inner_taper": (0.01, 0.3),
    "outer_taper": (0.01, 0.3), "mass": (1e-4, 1.0), "toomre_q": (0.5, 3.0), "surface_density": (1e-4, 1e-1),
    "aspect_ratio": (0.02, 0.2), "sound_speed": (0.05, 1.0), "perturbation": (0.0, 0.19), "amplitude": (-0.99, 0.99),
    "radius": (0.05, 0.2), "gamma": (1.05, 3.0), "eta": (1.0, 3.0), "smoothing_length": (0.02, 0.2),
    "softening": (0.01, 0.2), "thickness": (0.02, 0.2), "accretion_radius": (0.0, 0.6), "t_stop": (1e-5, 10.0),
    "K": (1e-2, 1e3), "stokes": (1e-4, 1e3), "ratio": (1e-4, 2.0), "courant": (0.05, 0.6), "timestep": (1e-4, 0.1),
    "cell": (0.5, 4.0), "cell_length": (0.02, 0.5), "temperature_index": (-0.5, 1.0), "vertical_extent": (0.5, 2.0),
    "share": (0.1, 1.0), "vertical_frequency": (0.0, 2.0),
    "until": (0.1, 2.0), "every": (0.01, 0.5), "grain_size": (1e-6, 1e2),
}  # fmt: skip
# The start's kind is chosen first; the next are seen by a run alone, and the last two are drawn apart.
SKIPPED = ("kind", "checkpoint_every", "walltime", "precision", "quiet")


class StuckError(Exception):
    """A scene that does not end."""


# Gas on a polar grid is drawn by `randomscenes.py`.
WITHOUT_GRID = tuple(name for name in SCHEMES if name not in POLAR)


def scene_of(seed: int, schemes: tuple[str, ...] = WITHOUT_GRID, kernels: tuple[str, ...] = tuple(KERNELS)) -> dict:
    """A scene: one that hangs together, some of its other keys set, at times one of them or a table put wrong."""
    rng = np.random.default_rng([seed, 7])

    def pick(choices: Any, among: Callable[[Any], bool] = lambda choice: True) -> Any:
        left = [choice for choice in choices if among(choice)]
        return left[rng.integers(len(left))]

    def chance(share: float) -> bool:
        return bool(rng.random() < share)

    # Schemes and kernels change slowly with the seed: most of the time goes into compiling them.
    scheme = schemes[seed // 20 % len(schemes)]
    on_cells = scheme in ON_GRID
    kind = pick(("box", "wave", "shock")) if on_cells else pick(STARTS)
    dimensions = 1 if on_cells or kind in LINES else 2 if kind in PLANES else pick((1, 2))
    given_disc = kind == "disc" and chance(0.2)
    scene: dict[str, Any] = {
        "units": {"system": "code"}, "run": _filled(rng, Run, 0.1, ("until",)),
        "space": {"dimensions": dimensions, "size": {"disc": 5.0, "settling": 2.0}.get(kind, 1.0)},
        "initial": {"kind": kind} | _filled(rng, STARTS[kind], 0.2),
    }  # fmt: skip
    if kind not in OPEN or (kind == "blast" and chance(0.5)):
        scene["space"]["boundary"] = "periodic"
    if kind == "disc":
        for key in ("mass", "toomre_q", "surface_density"):
            scene["initial"].pop(key, None)
        scene["initial"] |= _filled(rng, STARTS[kind], 1.0, (pick(("mass", "toomre_q", "surface_density")),), only=True)
        if chance(0.9):
            scene["star"] = _filled(rng, TABLES["star"], 0.4)
    if "star" in scene and chance(0.3):
        model = fields.models_in(TABLES["companion"])[0]
        scene["companion"] = [_filled(rng, model, 0.3) for _ in range(rng.integers(1, 3))]
        for companion in scene["companion"]:
            companion["softening"] = pick((0.6, "0.05"))
            if companion.get("orbit") != "live":
                companion.pop("feels", None)
            if chance(0.9):
                companion["eccentricity"] = 0.9 * float(rng.random())
    if kind == "settling" or chance(0.15):
        scene["external"] = _filled(rng, TABLES["external"], 0.5, ("vertical_frequency",))
    if not given_disc and chance(0.93):
        kinds = parts.STARTS[kind].eos or tuple(GASES)
        eos = pick(kinds, lambda name: "star" in scene or name != "locally-isothermal")
        scene["gas"] = _filled(rng, GAS, 0.1) | {"eos": _gas_of(rng, eos, "star" in scene)}
        if not on_cells:
            scene["gas"]["kernel"] = kernels[seed // 60 % len(kernels)]
            scene["gas"]["precision"] = "single" if seed % 10 == 6 else "double"
        for key in ("viscosity", "conductivity"):
            scene["gas"].pop(key, None)
            if not on_cells and chance(0.4) and (key == "viscosity" or eos == "adiabatic"):
                scene["gas"][key] = _filled(rng, fields.models_in(GAS.model_fields[key].annotation)[0], 0.3)
    if given_disc:
        scene["background"] = _filled(rng, BACKGROUND, 0.3) | {"eos": _gas_of(rng, "locally-isothermal", True)}
    if given_disc or on_cells or "gas" not in scene or chance(0.7):
        dust = [_filled(rng, DUST, 0.1) for _ in range(1 if on_cells else rng.integers(1, 4))]
        scene["dust"] = dust[0] if len(dust) == 1 else dust
        if on_cells and "gas" in scene:
            scene["dust"]["particles"] = scene["gas"]["particles"]
        if given_disc or ("gas" in scene and chance(0.9)):
            scene["drag"] = _drag(rng, scene, scheme, pick(LAWS), given_disc)
    if not on_cells and chance(0.25):
        kernel = pick(("plummer", "thin-disc"))
        length = {"plummer": "softening", "thin-disc": "thickness"}[kernel]
        scene["self_gravity"] = _filled(rng, TABLES["self_gravity"], 0.2, (length,)) | {"kernel": kernel}
    scene["space"] |= _filled(rng, Space, 0.0, ("cells",) if chance(0.3) and not on_cells else (), only=True)
    if "star" in scene:
        scene |= _surroundings(np.random.default_rng([seed, 8]))
        own = np.random.default_rng([seed, 9])
        if "gas" in scene and scene["gas"]["eos"]["kind"].endswith("isothermal") and own.random() < 0.5:
            scene["gas"] |= {"quiet": _filled(own, fields.models_in(GAS.model_fields["quiet"].annotation)[0], 0.5)}
            if "viscosity" in scene["gas"]:
                scene["gas"]["viscosity"] = {"pairs": "reconstructed"}
        if "growth" in scene and "gas" in scene and isinstance(scene.get("dust"), dict) and "drag" in scene:
            scene["drag"] = {"law": "epstein", "direction": scene["drag"].get("direction", "two-way")}
            scene["dust"] |= {"grain_size": 10.0 * scene["growth"]["small_size"], "grain_density": 1.0}
    _mend(scene)
    if chance(0.3):
        _stretch(rng, scene)
    if chance(0.2):
        _spoil(rng, scene)
    return scene


def _surroundings(rng: np.random.Generator) -> dict[str, Any]:
    """Tables of what acts on a disc, each in a third of the scenes."""
    size = float(10.0 ** rng.uniform(-3.0, 1.0))
    step = {"inner_alpha": size, "outer_alpha": 0.1, "radius": 1.2, "width": 0.1}
    laws = ({"alpha": size}, {"nu": 1e-2 * size}, step)
    coolings = ({"kind": "beta", "beta": size}, {"kind": "constant", "t_cool": 1e-3 * size}, {"kind": "radiative"})
    zones = ({"inner": [0.5, 0.9]}, {"outer": [1.5, 2.2], "time": size}, {"inner": [0.4, 1.3], "outer": [1.2, 2.0]})
    tables = {
        "alpha_viscosity": laws[rng.integers(3)],
        "cooling": coolings[rng.integers(3)] | {"aspect_ratio": 0.05 * float(rng.integers(2))},
        "radiation_pressure": {"beta": float(1.5 * rng.random())},
        "damping": zones[rng.integers(3)],
    }
    found = {name: table for name, table in tables.items() if rng.random() < 1 / 3}
    stirring = ({"alpha": size}, {"D": 1e-2 * size}, {})
    if rng.random() < 1 / 3:
        found["dust_diffusion"] = stirring[rng.integers(3)]
    if rng.random() < 1 / 3:
        speed, small = 10.0 ** rng.uniform(-4.0, 1.0), 10.0 ** rng.uniform(-9.0, 0.0)
        found["growth"] = {"fragmentation_speed": float(speed), "alpha": size, "small_size": float(small)}
    return found


def _mend(scene: dict) -> None:
    """Leave out what the scene's messages name, where it can be."""
    for _ in range(8):
        try:
            load_scene(scene)
        except SceneError as error:
            for problem in error.problems:
                name = problem.removeprefix("scene: ").partition(": ")[0]
                *way, key = name.split(".")
                table: Any = scene
                for part in way:
                    table = table[int(part)] if isinstance(table, list) else table.get(part, {})
                if isinstance(table, dict) and key != "kind":
                    table.pop(key, None)
        else:
            return


def _gas_of(rng: Any, kind: str, star: bool) -> dict:
    eos = {"kind": kind} | _filled(rng, GASES[kind], 0.2)
    if kind == "adiabatic":
        for key in ("sound_speed", "aspect_ratio"):
            eos.pop(key, None)
        key = "aspect_ratio" if star and rng.random() < 0.5 else "sound_speed"
        eos |= _filled(rng, GASES[kind], 1.0, (key,), only=True)
    return eos


def _drag(rng: Any, scene: dict, scheme: str, law: str, given_disc: bool) -> dict:
    in_2d = scene["space"]["dimensions"] == 2
    if "star" not in scene and (law.startswith("stokes") or (law.startswith("epstein") and in_2d)):
        law = "stopping-time"
    needed = ("K", "t_stop", "stokes", "mean_free_column")  # the law has one of them at most
    drag = {"law": law} | _filled(rng, DRAG, 1.0, needed, only=True)
    if law.startswith("epstein"):
        for dust in scene["dust"] if isinstance(scene["dust"], list) else [scene["dust"]]:
            dust |= _filled(rng, DUST, 1.0, ("grain_size", "grain_density"), only=True)
            if rng.random() < 0.3:
                largest = float(dust["grain_size"] * 10.0 ** rng.uniform(0.1, 8))
                many = {"smallest": dust["grain_size"], "largest": largest}
                dust["grain_size"] = many | ({"bins": int(rng.integers(1, 9))} if rng.random() < 0.5 else {})
    drag |= {"direction": "one-way"} if given_disc or rng.random() < 0.25 else {}
    return drag if given_disc else drag | {"scheme": scheme} | _filled(rng, DRAG, 0.07, (), OF_SCHEMES, only=True)


OF_SCHEMES = ("supersonic", "convention", "cell", "cell_length", "heating", "integration", "kernel")


def _filled(
    rng: Any, model: Any, share: float, wanted: tuple[str, ...] = (), others: tuple[str, ...] = (), only: bool = False
) -> dict[str, Any]:
    """Values of what a table must have and of `wanted`, and of a share of its other keys; with `only` of `others`."""
    out = {}
    for key, field in model.model_fields.items():
        must = key in wanted or (field.is_required() and not only)
        may = key in others if only else key not in SKIPPED
        if must or (may and rng.random() < share):
            value = _value(rng, key, field)
            if value is not None and not isinstance(value, dict):
                out[key] = value
    return out


def _value(rng: Any, key: str, field: Any) -> Any:
    """A value that a key may well have: a word, true or false, a whole number or one of its usual size."""
    words = fields.choices_in(field.annotation)
    if words:
        word = words[rng.integers(len(words))]
        return [word] if "tuple" in str(field.annotation) else word
    if fields.models_in(field.annotation) and fields.measure_of(field) is None:
        return None
    if "bool" in str(field.annotation):
        return bool(rng.random() < 0.5)
    low, high = SIZES.get(key, (0.3, 3.0))
    if isinstance(low, int) and isinstance(high, int):
        return int(rng.integers(low, high + 1))
    # Evenly in the logarithm where a range is wide.
    return float(low * (high / low) ** rng.random()) if low > 0 else float(rng.uniform(low, high))


def _stretch(rng: Any, scene: dict) -> None:
    """Make one or two of its numbers larger or smaller by many powers of ten."""
    found = list(_numbers(scene))
    for _ in range(rng.integers(1, 3)):
        table, key = found[rng.integers(len(found))]
        table[key] *= 10.0 ** float(rng.choice([-30, -9, -4, -2, 2, 4, 9, 30]))


def _numbers(table: Any) -> Iterator[tuple[Any, Any]]:
    """Every number with a fraction, with the table or list that holds it."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        if isinstance(value, dict | list):
            yield from _numbers(value)
        elif isinstance(value, float):
            yield table, key


def _spoil(rng: Any, scene: dict) -> None:
    """Give one or two keys an extreme value or one of a wrong kind, or leave out a table, or put one in."""
    for _ in range(rng.integers(1, 3)):
        if rng.random() < 0.15:
            scene.pop(list(scene)[rng.integers(len(scene))], None)
            continue
        name = list(TABLES)[rng.integers(len(TABLES))]
        table = scene.get(name)
        table = table[0] if isinstance(table, list) else table
        models = fields.models_in(TABLES[name])
        if isinstance(table, dict) and isinstance(table.get("eos"), dict) and rng.random() < 0.4:
            table, models = table["eos"], list(GASES.values())
        keys = sorted({key for model in models for key in model.model_fields})
        if isinstance(table, dict) and table and rng.random() < 0.7:
            keys = list(table)
        value = EXTREME[rng.integers(len(EXTREME))]
        if isinstance(table, dict):
            table[keys[rng.integers(len(keys))]] = value
        elif rng.random() < 0.2:
            scene[name] = _filled(rng, models[rng.integers(len(models))], 0.3)


@contextmanager
def no_longer_than(seconds: int) -> Iterator[None]:
    def stop(number: int, frame: Any) -> None:
        raise StuckError(f"no end after {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def outcome(scene: dict) -> str:
    """How a scene ends: "ran", "SceneError" or "PhysicsError". Anything else is raised, StuckError among it."""
    with no_longer_than(PATIENCE):
        return _outcome(scene)


def _outcome(scene: dict) -> str:
    try:
        loaded = load_scene(scene)
        text = report(loaded)
        assert "forecast" in text
        sim = Simulation(loaded)
        for _ in range(STEPS):
            sim.step(most=loaded.run.until)  # without gas or a star nothing else may limit it
        row = _left(sim)
    except SceneError as error:
        assert error.problems
        for problem in error.problems:
            assert 10 < len(problem) < 700 and "\n" not in problem, problem
        return "SceneError"
    except PhysicsError as error:
        assert str(error)
        return "PhysicsError"
    assert all(np.isfinite(entry) for entry in row if not isinstance(entry, str)), row
    return "ran"


def _left(sim: Simulation) -> list[object]:
    """The row of its history, once a snapshot is written and a checkpoint goes on with the same bits."""
    with sim.synchronised() as state, tempfile.TemporaryDirectory() as directory:
        snapshot, checkpoint = Path(directory) / "0000.h5", Path(directory) / "checkpoint.h5"
        extra = outputs.effect_columns(state, sim.effects.values())
        write_snapshot(snapshot, sim.scene, state.time, state.gas, state.dust, extra)
        assert read_snapshot(snapshot).time == state.time
        sim.save(checkpoint)
        other = Simulation(sim.scene)
        other.restore(checkpoint)
        row = history_row(state, sim.effects, 0.0, "")
    ends = []
    for one in (sim, other):
        try:
            one.step(most=sim.scene.run.until)
        except PhysicsError as error:
            ends.append(str(error))
        else:
            ends.append({k: a.tobytes() for p in one.state.species.values() for k, a in p.arrays().items()})
    assert ends[0] == ends[1]
    return row


if __name__ == "__main__":
    warnings.simplefilter("error")
    for given in sys.argv[1:]:
        print(scene_of(int(given)))
        print(outcome(scene_of(int(given))))
