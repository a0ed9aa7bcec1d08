"""Random scenes as somebody would type them, with units, and three runs of each that must leave the same bits.

A scene is drawn from tables of usual sizes about a star, in a given disc, in a periodic plane or on a line. Start,
scheme, law, equation of state and one effect go round with the seed, so that some hundred seeds see all of each.
Optional keys come in at random. What `check` refuses, in one message a fault, is drawn again with fewer of them.

    python tests/helpers/randomscenes.py 0 300
"""

from __future__ import annotations

import io
import signal
import sys
import tempfile
import tomllib
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit
from drags import ON_GRID, POLAR
from runs import assert_same_files, at_step, errors_of, on_threads, put_out

from discsim import SceneError, Simulation, load_scene, parts
from discsim.preview.check import report
from discsim.run.runner import run_scene
from discsim.run.simulation import PhysicsError
from discsim.scene import fields
from discsim.scene.tables import TABLES
from discsim.scene.units import Units

TRIES = 8  # draws of a scene, each with fewer optional keys
STEPS = 4.6  # of the first step's length until the end
PATIENCE = 240  # CPU seconds of a scene, those in which kernels compile among them
DISCS = ("disc", "table", "snapshot", "viscous-ring", "steady")
LINES = ("wave", "box", "shock", "settling")
PLANES = ("box", "wave", "sheet", "blast", "vortex")
# Bounds of a key's values in units of the scene, or its words, by its name or that of table and key.
USUAL: dict[str, Any] = {
    "run.snapshots": (1, 2), "run.seed": (0, 99), "run.courant": (0.11, 0.42), "run.timestep": (2e-4, 2e-3),
    "space.cells": (11, 37), "gas.particles": (41, 170), "dust.particles": (23, 90), "gas.eta": (1.15, 2.3),
    "gas.smoothing_length": (0.04, 0.13), "sound_speed": (0.07, 0.4), "aspect_ratio": (0.03, 0.19),
    "temperature_index": (-0.3, 1.1), "reference_radius": (0.7, 2.1), "mean_molecular_weight": (1.3, 2.4),
    "gamma": (1.1, 2.2), "constant": (0.01, 0.3), "viscosity.alpha": (0.1, 2.0), "viscosity.beta": (0.3, 4.0),
    "conductivity.alpha": (0.1, 1.5), "alpha": (1e-4, 0.06), "nu": (1e-6, 1e-3), "index": (-0.9, 1.2),
    "inner_alpha": (1e-3, 0.05), "outer_alpha": (1e-4, 0.02), "alpha_viscosity.radius": (0.9, 1.4),
    "alpha_viscosity.width": (0.05, 0.3), "dead_alpha": (1e-5, 1e-3), "dead_inner": (0.8, 1.0),
    "dead_outer": (1.2, 1.6), "dead_width": (0.03, 0.2), "surface_density": (1e-4, 0.02),
    "surface_density_index": (0.3, 1.6), "bump.radius": (0.9, 1.5), "bump.width": (0.1, 0.3), "bump.height": (0.1, 0.9),
    "gap.radius": (0.9, 1.5), "gap.width": (0.15, 0.3), "gap.depth": (0.05, 0.4), "ratio": (3e-4, 0.4),
    "grain_size": (1e-13, 1e-9), "smallest": (1e-13, 1e-11), "largest": (2e-11, 1e-9), "grain_size.index": (2.4, 3.9),
    "bins": (2, 5), "grain_density": (1e5, 3e6), "offset": (0.1, 0.9), "dust.inner": (0.75, 0.95),
    "dust.outer": (1.1, 1.6), "star.mass": (0.4, 2.3), "star.accretion_radius": (0.05, 0.4), "softening": (0.02, 0.15),
    "companion.mass": (1e-5, 0.6), "semi_major_axis": (0.3, 3.0), "eccentricity": (0.03, 0.6), "phase": (7.0, 351.0),
    "ramp": (0.1, 20.0), "companion.accretion_radius": (0.01, 0.1), "accretion_rate": (0.1, 5.0), "every": (1e-3, 0.1),
    "thickness": (0.03, 0.2), "radiation_pressure.beta": (0.01, 0.5), "external.gas": (-0.02, 0.02),
    "external.dust": (-0.02, 0.02), "vertical_frequency": (0.3, 1.7), "cooling.beta": (0.05, 30.0),
    "t_cool": (0.01, 9.0), "opacity": (1e4, 1e7), "K": (0.1, 900.0), "t_stop": (1e-4, 4.0), "stokes": (1e-3, 30.0),
    "omega": (0.4, 1.9), "shear": (0.6, 1.7), "headwind": (-0.1, 0.3),
    "mean_free_column": (1e-12, 1e-8), "cell": (0.6, 3.1), "cell_length": (0.05, 0.3), "class_width": (1.1, 2.5),
    "D": (1e-7, 1e-4), "damping.time": (0.05, 3.0), "fragmentation_speed": (1e-4, 0.1), "small_size": (1e-14, 1e-12),
    "growth.smallest": (1e-16, 1e-15), "small_ratio": (1e-4, 3e-3), "initial.mass": (1e-4, 0.05),
    "toomre_q": (1.4, 9.0), "initial.inner": (0.6, 0.8), "initial.outer": (1.7, 2.0), "inner_taper": (0.02, 0.2),
    "outer_taper": (0.02, 0.3), "perturbation": (1e-3, 0.1), "tau": (0.01, 0.1), "initial.radius": (0.15, 0.24),
    "accretion": (1e-6, 1e-4), "relax": (0.02, 0.1), "density": (0.3, 2.2), "gas_velocity": (-0.3, 0.3),
    "dust_velocity": (-0.3, 0.3), "amplitude": (1e-4, 0.2), "wavenumber": (1, 3), "velocity": (-0.4, 0.4),
    "energy": (0.2, 2.0), "vertical_extent": (0.6, 0.9), "speed": (0.3, 1.4), "refine": (1, 2), "thin": (1, 2),
    "quiet.share": (0.1, 0.95), "quiet.time": (0.3, 30.0), "quiet.guard": (0.2, 2.0),
    "Sc": (0.4, 3.0), "schmidt": (0.4, 3.0),
}  # fmt: skip
# Keys that are drawn with their table, or change nothing that is compared here.
LEFT_OUT = {
    "kind", "until", "threads", "checkpoint_every", "walltime", "title", "dimensions", "size", "boundary", "scheme",
    "law", "file", "left", "right", "direction_of_wave", "initial.accretion_rate", "initial.every", "run.every",
    "gas.method",
}  # fmt: skip


class StuckError(Exception):
    """A scene that does not end."""


class Scribe:
    """Draws tables key by key; `share` of the optional keys are written."""

    def __init__(self, seed: int, attempt: int) -> None:
        self.rng = np.random.default_rng([56, seed, attempt])
        self.share = 0.35 * (1.0 - attempt / (TRIES - 1)) ** 2
        self.attempt = attempt

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def pick(self, choices: Any) -> Any:
        choices = list(choices)
        return choices[int(self.rng.integers(len(choices)))]

    def between(self, low: Any, high: Any) -> Any:
        if isinstance(low, int) and isinstance(high, int):
            return int(self.rng.integers(low, high + 1))
        if low > 0.0:
            return float(low * (high / low) ** self.rng.random())
        return float(self.rng.uniform(low, high))

    def value(self, table: str, key: str, field: Any) -> Any:
        """A usual value of a key, in units of the scene; None of one that is not drawn by itself."""
        if {key, f"{table}.{key}"} & LEFT_OUT or (fields.models_in(field.annotation) and not fields.measure_of(field)):
            return None
        words = fields.choices_in(field.annotation)
        if words:
            several = "tuple" in str(field.annotation)
            return [self.pick(words)] if several else self.pick(words)
        if "bool" in str(field.annotation):
            return self.chance(0.5)
        bounds = USUAL.get(f"{table}.{key}", USUAL.get(key))
        return None if bounds is None else self.between(*bounds)

    def keys(self, table: str, model: Any, *wanted: str, **given: Any) -> dict[str, Any]:
        """A table with what it requires, the keys `wanted` and a share of the others; `given` as they are."""
        out: dict[str, Any] = {}
        for key, field in model.model_fields.items():
            if key not in given and (field.is_required() or key in wanted or self.chance(self.share)):
                value = self.value(table, key, field)
                if value is not None:
                    out[key] = value
        return out | given


def draw(seed: int, attempt: int = 0) -> dict[str, Any]:
    """The tables of a scene in code units, for `typed`; "kind" of its surroundings by the seed."""
    s = Scribe(seed, attempt)
    starts = [name for name in parts.STARTS if name in {*DISCS, *LINES, *PLANES}]
    start = starts[seed % len(starts)]
    effects = [name for name in parts.EFFECTS if name not in ("gas", "dust", "drag", "star", "shearing_box")]
    effect = effects[(seed // 2) % len(effects)]  # so that starts of discs meet all of them
    schemes, laws, gases = [n for n in parts.SCHEMES if n not in POLAR], list(parts.LAWS), list(parts.EOS)
    scheme, law, gas = (
        schemes[(seed // 3) % len(schemes)],
        laws[(seed // 4) % len(laws)],
        gases[(seed // 5) % len(gases)],
    )
    if seed % 17 == 16:
        return _consistent(_sheared(s, scheme))
    if scheme in ON_GRID:  # which few starts have
        start, effect = s.pick(("box", "wave", "shock")), ""
    if start in DISCS or effect in ("background", "companion", "damping", "growth", "cooling", "radiation_pressure"):
        start = start if start in DISCS else s.pick(("disc", "table", "steady", "viscous-ring"))
        scene = _about_a_star(s, start, effect, scheme, law, gas)
        return _consistent(_on_a_polar_grid(s, scene) if seed % 7 == 4 else scene)
    return _consistent(_periodic(s, start, effect, scheme, law, gas))


def _consistent(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene without optional keys that mean nothing beside its other tables."""
    star, drag, gas, initial = (scene.get(name, {}) for name in ("star", "drag", "gas", "initial"))
    if "accretion_radius" not in star:
        star.pop("grows", None)
    if "companion" not in scene:
        star.pop("centre", None)
    elif star.get("centre") == "barycentre":
        star["frame"] = "inertial"
    star.pop("indirect", None)
    if "background" in scene:
        star.pop("frame", None)
        scene["run"].pop("integrator", None)
    if not gas or "perturbation" in initial:
        initial.pop("relax", None)
    if gas.get("eos", {}).get("kind") != "adiabatic":
        scene.pop("cooling", None)
        drag.pop("heating", None)
    if drag.get("direction") == "one-way":
        drag.pop("heating", None)
    if scene["initial"]["kind"] not in ("box", "wave"):
        for dust in scene.get("dust", ()):
            dust.pop("offset", None)
    if scene["space"].get("boundary") == "periodic":
        scene["space"].pop("cells", None)
        if isinstance(scene["space"]["size"], list):
            scene["space"]["cells"] = 26  # square ones along both sides
    if drag:
        _consistent_drag(scene, drag)
    return scene


def _consistent_drag(scene: dict[str, Any], drag: dict[str, Any]) -> None:
    name = drag.get("scheme", "tsc")
    scheme = parts.SCHEMES[name]
    if not scheme.sizes:
        for dust in scene["dust"]:
            if isinstance(dust.get("grain_size"), dict):
                dust["grain_size"] = dust["grain_size"]["largest"]
    sizes = any(isinstance(dust.get("grain_size"), dict) for dust in scene["dust"])
    for key in ("cell", "cell_length", "class_width"):
        if scheme.cells is None or (key == "class_width" and not sizes):
            drag.pop(key, None)
    if name not in ("mk", "lab14"):
        drag.pop("kernel", None)
    if name not in ("idic", "idic-linear", "tsc", *POLAR):
        drag.pop("integration", None)
    if name in ON_GRID or not drag["law"].startswith("epstein"):
        drag.pop("supersonic", None)


def _about_a_star(s: Scribe, start: str, effect: str, scheme: str, law: str, gas: str) -> dict[str, Any]:
    scene: dict[str, Any] = {
        "run": s.keys("run", TABLES["run"], until=1.0),
        "space": s.keys("space", TABLES["space"], size=s.between(4.7, 8.0)),
        "star": s.keys("star", TABLES["star"]),
    }
    given = effect == "background"
    start = "disc" if given else start
    (initial,) = [m for m in fields.models_in(TABLES["initial"]) if m.model_fields["kind"].default == start]
    scene["initial"] = s.keys("initial", initial, kind=start)
    one_of = {"disc": ("mass", "toomre_q", "surface_density"), "steady": ("surface_density",)}.get(start, ())
    for key in one_of:
        scene["initial"].pop(key, None)
    if one_of:
        key = s.pick(("mass", "surface_density") if given else one_of)
        scene["initial"][key] = s.between(*USUAL.get(f"initial.{key}", USUAL.get(key)))
    if start == "viscous-ring":
        scene["initial"] |= {"radius": s.between(0.9, 1.3)}
    if start in ("table", "snapshot"):
        scene["initial"]["file"] = {"table": "disc.txt", "snapshot": "0000.h5"}[start]
    if given:
        eos = s.pick(("locally-isothermal", "isothermal", "polytropic"))
        background = TABLES["background"]
        scene["background"] = s.keys("background", background, "surface_density", eos=_gas(s, eos))
        for part in ("bump", "gap"):
            if s.chance(0.4):
                (model,) = fields.models_in(background.model_fields[part].annotation)[:1]
                scene["background"][part] = s.keys(part, model)
    else:
        gas = "adiabatic" if effect == "cooling" else gas
        if start in ("steady", "viscous-ring"):
            gas = s.pick(("isothermal", "locally-isothermal"))
        scene["gas"] = _sph(s, gas, quiet=True)
    if given or start == "snapshot" or s.chance(0.75):
        scene["dust"] = [_dust(s) for _ in range(s.between(1, 2) if start != "snapshot" else 1)]
        if given or s.chance(0.85):
            scene["drag"] = _drag(s, scene, "tsc" if given or scheme in ON_GRID else scheme, law)
            if given:
                scene["drag"] = {
                    key: value for key, value in scene["drag"].items() if key in ("law", "convention", *NEEDED)
                }
                scene["drag"]["direction"] = "one-way"
    needed = ["alpha_viscosity"] if start in ("steady", "viscous-ring") else []
    for name in dict.fromkeys([*needed, *_surroundings(s, effect, scene)]):
        _put_in(s, scene, name)
    return scene


def _surroundings(s: Scribe, effect: str, scene: dict[str, Any]) -> list[str]:
    """The effect whose turn it is, and some others about a star."""
    others = ("companion", "self_gravity", "alpha_viscosity", "cooling", "damping", "radiation_pressure", "external",
              "dust_diffusion")  # fmt: skip
    chosen = [name for name in others if s.chance(0.5 * s.share)]
    return list(dict.fromkeys([*([effect] if effect != "background" else []), *chosen]))


def _put_in(s: Scribe, scene: dict[str, Any], name: str) -> None:
    """A table of an effect, with what it cannot be without."""
    if name in ("dust_diffusion", "radiation_pressure", "growth") and "dust" not in scene:
        scene["dust"] = [_dust(s)]
    if name in ("dust_diffusion", "growth") and "drag" not in scene:
        scene["drag"] = _drag(s, scene, "tsc", "epstein")
    model = fields.models_in(TABLES[name])[0]
    table = s.keys(name, model)
    if name == "companion":
        table = [_companion(s, model) for _ in range(s.between(1, 2))]
    elif name == "self_gravity":
        kernel = s.pick(("plummer", "thin-disc"))
        length = {"plummer": "softening", "thin-disc": "thickness"}[kernel]
        table = {"kernel": kernel, length: s.between(*USUAL[length])} | (
            {"sources": table["sources"]} if "sources" in table else {}
        )
    elif name == "alpha_viscosity":
        laws = (("alpha",), ("nu",), ("inner_alpha", "outer_alpha", "radius", "width"),
                ("alpha", "dead_alpha", "dead_inner", "dead_outer", "dead_width"))  # fmt: skip
        table = {key: s.value(name, key, model.model_fields[key]) for key in s.pick(laws)}
    elif name == "cooling":
        kind = s.pick(("beta", "constant", "radiative"))
        key = {"beta": "beta", "constant": "t_cool", "radiative": "opacity"}[kind]
        table = {"kind": kind, key: s.between(*USUAL.get(f"cooling.{key}", USUAL.get(key)))}
        table |= {"aspect_ratio": s.between(*USUAL["aspect_ratio"])} if s.chance(0.5) else {}
    elif name == "damping":
        table = {"time": s.between(*USUAL["damping.time"])}
        table |= s.pick(({"inner": [0.61, 0.83]}, {"outer": [1.53, 2.07]}, {"inner": [0.5, 0.74], "outer": [1.6, 1.9]}))
    elif name == "dust_diffusion":
        table = s.pick(({"alpha": s.between(*USUAL["alpha"])}, {"D": s.between(*USUAL["D"])}))
    elif name == "growth":
        scene["dust"] = [{**_dust(s), "grain_size": 3.7e-12, "grain_density": s.between(*USUAL["grain_density"])}]
        scene["drag"] = {"law": "epstein", "direction": s.pick(("one-way", "two-way"))}
        table = {"fragmentation_speed": s.between(1e-3, 0.1), "alpha": s.between(*USUAL["alpha"]),
                 "small_size": s.between(1e-13, 1e-12), "smallest": s.between(1e-16, 1e-15)}  # fmt: skip
    scene[name] = table


def _companion(s: Scribe, model: Any) -> dict[str, Any]:
    table = s.keys("companion", model, "orbit", softening=s.pick((0.37, "0.043")))
    if table.get("orbit") != "live":
        table.pop("feels", None)
    if "feels" in table:
        table["feels"] = s.pick((["star"], ["star", "gas"], ["companions", "star"]))
    if "accretion_radius" not in table:
        table.pop("accretion_rate", None)
    return table


def _periodic(s: Scribe, start: str, effect: str, scheme: str, law: str, gas: str) -> dict[str, Any]:
    on_grid = scheme in ON_GRID and start in ("box", "wave", "shock")
    scheme = scheme if on_grid or scheme not in ON_GRID else "tsc"
    law = "stopping-time" if on_grid and law == "epstein-stokes" else law
    dimensions = (
        1 if on_grid or start in ("shock", "settling") else 2 if start not in ("box", "wave") else s.pick((1, 2))
    )
    (initial,) = [m for m in fields.models_in(TABLES["initial"]) if m.model_fields["kind"].default == start]
    size: Any = 2.0 if start == "settling" else s.between(0.8, 1.7)
    if dimensions == 2 and start in ("box", "wave") and s.chance(0.4):
        size = [size, 0.5 * size]
    scene: dict[str, Any] = {
        "run": s.keys("run", TABLES["run"], until=1.0),
        "space": {"dimensions": dimensions, "size": size, "boundary": "periodic"},
        "initial": s.keys("initial", initial, kind=start),
    }
    if start in ("shock", "settling"):
        scene["space"]["boundary"] = "open"
    if start == "wave" and dimensions == 2:
        scene["initial"].pop("wavenumber", None)
        scene["initial"]["direction"] = s.pick(([1, 2], [2, 1], [1, 0]))
    kinds = parts.STARTS[start].eos or ("isothermal", "adiabatic", "polytropic")
    gas = gas if gas in kinds else s.pick(kinds)
    scene["gas"] = _sph(s, gas)
    if on_grid:
        scene["gas"] = {"particles": scene["gas"]["particles"], "eos": scene["gas"]["eos"]}
    if on_grid or s.chance(0.8) or start == "settling":
        scene["dust"] = [{key: value for key, value in _dust(s).items() if key not in ("inner", "outer")}]
        if on_grid:
            scene["dust"][0]["particles"] = scene["gas"]["particles"]
        scene["drag"] = _drag(s, scene, scheme, law)
    if start == "settling":
        scene["external"] = {"vertical_frequency": s.between(*USUAL["vertical_frequency"])}
    elif (effect == "external" or (effect == "self_gravity" and start != "shock")) and not on_grid:
        _put_in(s, scene, effect)
    return scene


def _sheared(s: Scribe, scheme: str) -> dict[str, Any]:
    """A shearing box, whose drag has no direction of its own; the wave is that of two-way drag."""
    scheme = scheme if parts.SCHEMES[scheme].by_component and scheme not in ON_GRID else "tsc"
    scene = _periodic(s, "streaming", "", scheme, "stopping-time", "isothermal")
    scene["shearing_box"] = s.keys("shearing_box", TABLES["shearing_box"])
    scene["initial"]["wavelengths"] = s.pick(([1, 1], [2, 1], [1, 3]))
    drag = scene.get("drag")
    if drag is None or drag.get("direction") == "one-way":
        scene["initial"]["amplitude"] = 0.0
    if drag is not None and s.chance(0.5):
        scene["dust"][0]["t_stop"] = s.between(*USUAL["t_stop"])
    return scene


def _on_a_polar_grid(s: Scribe, scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with its gas on a polar grid, without what that excludes; unchanged without gas."""
    if "gas" not in scene:
        return scene
    scene["gas"] = {"method": "grid", "particles": s.between(300, 900), "eos": scene["gas"]["eos"]}
    if s.chance(0.5):
        scene["gas"]["grid"] = {"edges": s.pick(("open", "closed"))}
    if scene["initial"]["kind"] == "snapshot":
        scene["gas"].setdefault("grid", {}).update(inner=s.between(0.5, 0.8), outer=s.between(1.7, 2.1))
    for key in ("frame", "centre"):
        scene["star"].pop(key, None)
    scene["initial"].pop("relax", None)
    scene["run"].pop("integrator", None)
    if "drag" in scene and s.chance(0.5):
        scene["drag"]["scheme"] = s.pick(POLAR)
    elif parts.SCHEMES[scene.get("drag", {}).get("scheme", "tsc")].cells is None:
        scene["drag"]["scheme"] = "tsc"
    if "damping" in scene and s.chance(0.5):
        scene["damping"]["surface_density"] = True
    return scene


def _gas(s: Scribe, kind: str) -> dict[str, Any]:
    eos = s.keys("eos", parts.EOS[kind].keys, kind=kind)
    if kind == "adiabatic":
        eos.pop("aspect_ratio", None)
        eos["sound_speed"] = s.between(*USUAL["sound_speed"])
        eos.pop("temperature_index", None)
        eos.pop("reference_radius", None)
    return eos


def _sph(s: Scribe, kind: str, quiet: bool = False) -> dict[str, Any]:
    model = TABLES["gas"]
    table = s.keys("gas", model, eos=_gas(s, kind))
    if not s.chance(0.2):
        table.pop("kernel", None)  # most of the time goes into compiling them
    if not s.chance(0.2):
        table.pop("precision", None)
    if s.chance(0.5):
        table.pop("smoothing_length", None)
    if "smoothing_length" in table:
        table.pop("eta", None)
    for part, share in (("viscosity", 0.6), ("conductivity", 0.5 if kind == "adiabatic" else 0.0)):
        table.pop(part, None)
        if s.chance(share):
            table[part] = s.keys(part, fields.models_in(model.model_fields[part].annotation)[0])
    viscosity = table.get("viscosity", {})
    if quiet and kind in ("isothermal", "locally-isothermal") and s.chance(0.25):
        table["quiet"] = s.keys("quiet", fields.models_in(model.model_fields["quiet"].annotation)[0])
        if viscosity:
            viscosity["pairs"] = "reconstructed"
    if viscosity.get("pairs") == "reconstructed":
        viscosity.pop("switch", None)
    return table


def _dust(s: Scribe) -> dict[str, Any]:
    (model, *_) = fields.models_in(TABLES["dust"])
    table = s.keys("dust", model, t_stop=None)  # of one law alone: `_sheared`
    del table["t_stop"]
    return table


NEEDED = ("K", "t_stop", "stokes", "mean_free_column")


def _drag(s: Scribe, scene: dict[str, Any], scheme: str, law: str) -> dict[str, Any]:
    model = TABLES["drag"]
    found = parts.LAWS[law]
    if "star" not in scene and (
        law.startswith("stokes") or (found.of_grains and scene["space"].get("dimensions") != 1)
    ):
        law = "stopping-time"
    found = parts.LAWS[law]
    table = s.keys("drag", model, law=law, scheme=scheme)
    for key in NEEDED:
        table.pop(key, None)
    for key in {found.key, "mean_free_column" if law == "epstein-stokes" else found.key} - {""}:
        table[key] = s.between(*USUAL[key])
    if "cell_length" in table:
        table.pop("cell", None)
    for dust in scene["dust"]:
        dust.pop("grain_size", None)
        dust.pop("grain_density", None)
        if found.of_grains:
            dust |= {"grain_size": s.between(*USUAL["grain_size"]), "grain_density": s.between(*USUAL["grain_density"])}
            if s.chance(0.3):
                dust["grain_size"] = {"smallest": s.between(1e-13, 1e-11), "largest": s.between(2e-11, 1e-9)}
                dust["grain_size"] |= {"bins": s.between(2, 4)} if s.chance(0.5) else {}
    return table


# Typing it


def typed(tables: dict[str, Any], seed: int) -> str:
    """A scene as TOML: in code units, or of another size and mass with units of many kinds."""
    rng = np.random.default_rng([57, seed])
    dimensions = tables["space"].get("dimensions", 2)
    document: dict[str, Any] = {"title": f"scene {seed}: $\\alpha$ and \u03b2"}
    if rng.random() < 0.4:
        return tomlkit.dumps(document | {"units": {"system": "code"}} | tables)
    length, mass = f"{10.0 ** rng.uniform(0.0, 2.0):.4g} au", f"{10.0 ** rng.uniform(-0.7, 0.5):.4g} Msun"
    units = Units("physical", dimensions, length, mass)
    document["units"] = {"length": length, "mass": mass}
    for name, table in tables.items():
        several = table if isinstance(table, list) else [table]
        models = fields.models_in(TABLES[name])
        found = [_with_units(one, models, units, rng) for one in several]
        document[name] = found if isinstance(table, list) else found[0]
    return tomlkit.dumps(document)


def _with_units(table: dict[str, Any], models: Any, units: Units, rng: Any) -> dict[str, Any]:
    """The table with every number that has a dimension as a text."""
    known = [
        model
        for model in models
        if "kind" in model.model_fields and table.get("kind") == model.model_fields["kind"].default
    ]
    model = (known or list(models))[0]
    out = {}
    for key, value in table.items():
        field = model.model_fields[key]
        if isinstance(value, dict):
            out[key] = _with_units(value, fields.models_in(field.annotation), units, rng)
            continue
        measure = fields.measure_of(field)
        if key == "softening" and isinstance(value, str):  # of a companion
            out[key] = f"{float(value) * units.cgs('length')!r} cm"
            continue
        out[key] = _text(value, measure, units, table.get("gamma", 1.0), rng) if measure and measure.name else value
    return out


def _text(value: Any, measure: Any, units: Units, gamma: float, rng: Any) -> Any:
    if isinstance(value, list):
        return [_text(one, measure, units, gamma, rng) for one in value]
    if isinstance(value, str):
        return value
    exponents = units.exponents(measure.name, gamma)
    bases = (("g", "cm", "s"), ("kg", "km", "day"), ("Msun", "au", "yr"))[int(rng.integers(3))]
    one = units.quantity(1.0, "mass"), units.quantity(1.0, "length"), units.quantity(1.0, "time")
    number = value
    for power, base, unit in zip(exponents, bases, one, strict=True):
        number *= float(unit.to_value(base)) ** power
    name = " ".join(
        f"{base}{'' if power == 1 else f'^({power!r})'}" for base, power in zip(bases, exponents, strict=True) if power
    )
    return f"{number!r} {name}"


# Running it


def scene_file(seed: int, folder: Path) -> tuple[Path | None, list[str]]:
    """A file of a scene that `check` takes, with the files that it names; and what was refused before. Else None."""
    refused: list[str] = []
    for attempt in range(TRIES):
        tables = draw(seed, attempt)
        path = folder / f"scene_{seed}.toml"
        if tables["initial"]["kind"] == "table":
            _write_table(folder / "disc.txt", seed, Scribe(seed, attempt))
        if tables["initial"]["kind"] == "snapshot":
            _write_snapshot(folder / "0000.h5")
        path.write_text(typed(tables, seed), encoding="utf-8")
        try:
            assert "forecast" in report(load_scene(path))
        except SceneError as fault:
            for problem in fault.problems:
                assert problem.isprintable() and problem.startswith(f"{path}:") and len(problem) < 700, problem
            refused += fault.problems
        else:
            return path, refused
    return None, refused


def _write_table(path: Path, seed: int, s: Scribe) -> None:
    """Columns for either system of units: those of code units have none in the header."""
    r = np.geomspace(0.71, 1.93, 7)
    physical = np.random.default_rng([57, seed]).random() >= 0.4
    rng = np.random.default_rng([57, seed])
    rng.random()
    length, mass = (10.0 ** rng.uniform(0.0, 2.0), 10.0 ** rng.uniform(-0.7, 0.5)) if physical else (1.0, 1.0)
    sigma = s.between(1e-4, 1e-2) * r**-1.3 * (mass * 8.885e6 / length**2 if physical else 1.0)
    head = "# r [au]  Sigma [g/cm2]" if physical else "# r  Sigma"
    rows = "".join(f"{length * a!r} {b!r}\n" for a, b in zip(r.tolist(), sigma.tolist(), strict=True))
    path.write_text(f"{head}\n{rows}")


def _write_snapshot(path: Path) -> None:
    """Snapshot of a small disc of gas and dust after a step, in code units."""
    sim = Simulation({
        "units": {"system": "code"}, "run": {"until": 1.0, "threads": 1}, "space": {"size": 6.3}, "star": {"mass": 1.1},
        "initial": {"kind": "disc", "mass": 0.003, "inner": 0.71, "outer": 1.83},
        "gas": {"particles": 70, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.07}},
        "dust": {"particles": 40, "ratio": 0.03}, "drag": {"law": "stokes-number", "stokes": 0.2},
    })  # fmt: skip
    sim.step()
    put_out(sim, path)


def over_some_steps(path: Path) -> Any:
    """The scene until about STEPS of its first steps. Raises SceneError, PhysicsError."""
    scene = load_scene(path)
    sim = Simulation(scene)
    begun = sim.time
    dt = sim.step(most=0.01 * (scene.run.until - begun))
    until = scene.units.quantity(begun + STEPS * dt, "time")
    text = repr(float(until.value)) if scene.units.system == "code" else f"{float(until.to_value('s'))!r} s"
    return load_scene(path, [f"run.until={text}"])


def ended(scene: Any, out: Path, resume: bool = False) -> tuple[int, str]:
    """Exit status of a run, and its message without warnings."""
    with redirect_stderr(io.StringIO()) as said:
        status = run_scene(scene, out, resume=resume, quiet=True)
    return status, "".join(f"{line}\n" for line in errors_of(said.getvalue())).replace(str(out), "OUT")


def outcome(seed: int, folder: Path, patch: pytest.MonkeyPatch) -> str:
    """How a scene ends, by its three runs: "ran", "refused", "physics". Anything else is raised."""
    path, refused = scene_file(seed, folder)
    if path is None:
        assert refused
        return "refused"
    try:
        scene = over_some_steps(path)
    except SceneError as fault:  # of what only a start finds
        assert all(problem.isprintable() for problem in fault.problems)
        return "refused"
    except PhysicsError as fault:
        assert str(fault)
        return "physics"
    whole, killed, threads = (folder / f"{seed}-{name}" for name in ("whole", "killed", "threads"))
    status, message = ended(scene, whole)
    assert status in (0, 3) and message.count("\n") == (2 if status == 3 else 0), message
    with patch.context() as one:
        at_step(one, 2, lambda sim: signal.raise_signal(signal.SIGTERM))
        first = ended(scene, killed)
    if status == 0:
        assert first[0] in (0, 143), first
        resumed = ended(scene, killed, resume=True)
        assert resumed == (0, ""), resumed
        assert_same_files(whole, killed)
    with patch.context() as other:
        for _ in on_threads(other, (2,), least=8):
            found = ended(scene, threads)
            assert found == (status, message), found
    if status == 0:
        assert_same_files(whole, threads)
    return "ran" if status == 0 else "physics"


@contextmanager
def no_longer_than(seconds: int) -> Iterator[None]:
    def stop(number: int, frame: Any) -> None:
        raise StuckError(f"no end after {seconds} s of CPU")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)  # of CPU: a busy machine takes longer
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def outcomes(
    seeds: Any, folder: Path, patch: pytest.MonkeyPatch, tell: Any = None
) -> tuple[Counter[str], Counter[str]]:
    """How the scenes of these seeds end, and which parts those that ran have had. Raises with the scene."""
    patch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())
    ends: Counter[str] = Counter()
    seen: Counter[str] = Counter()
    for seed in seeds:
        place = folder / str(seed)
        place.mkdir()
        try:
            with no_longer_than(PATIENCE):
                end = outcome(seed, place, patch)
        except Exception as error:
            written = place / f"scene_{seed}.toml"
            error.add_note(f"seed {seed}:\n{written.read_text() if written.exists() else draw(seed)}")
            if tell is None:
                raise
            end = f"{type(error).__name__}: {str(error)[:300]}"
            tell(seed, error)
        ends[end if len(end) < 12 else "fault"] += 1
        if end == "ran":
            seen.update(parts_of(tomllib.loads((place / f"scene_{seed}.toml").read_text(encoding="utf-8"))))
    return ends, seen


def parts_of(tables: dict[str, Any]) -> Iterator[str]:
    """The parts that the tables of a scene name."""
    yield from (name for name in tables if name in parts.EFFECTS)
    yield f"start {tables['initial']['kind']}"
    if "gas" in tables:
        yield f"eos {tables['gas']['eos']['kind']}"
    if "drag" in tables:
        yield f"law {tables['drag']['law']}"
        yield f"scheme {tables['drag'].get('scheme', parts.DEFAULT_SCHEME)}"


def unseen(seen: Counter[str]) -> list[str]:
    """Parts that no scene has had."""
    wanted = [*parts.EFFECTS, *(f"start {name}" for name in parts.STARTS), *(f"eos {name}" for name in parts.EOS)]
    wanted += [*(f"scheme {name}" for name in parts.SCHEMES), *(f"law {name}" for name in parts.LAWS)]
    return [name for name in wanted if not seen[name]]


if __name__ == "__main__":
    import time
    import traceback

    warnings.simplefilter("error")
    begun = time.monotonic()
    ends: Counter[str] = Counter()
    seen: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as made, pytest.MonkeyPatch.context() as patch:
        for number in range(*map(int, sys.argv[1:3])):

            def tell(seed: int, error: BaseException) -> None:
                print(f"seed {seed}", "".join(traceback.format_exception(error))[-6000:], flush=True)

            some, parts_seen = outcomes([number], Path(made), patch, tell)
            ends += some
            seen += parts_seen
            print(number, dict(some), dict(ends), f"{time.monotonic() - begun:.0f} s", flush=True)
    print("not seen:", unseen(seen), "seen:", dict(seen))
