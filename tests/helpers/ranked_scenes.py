"""Scenes that many ranks run with the bits of one: by name what makes it, changes, steps, and the longest one."""

import copy
import tempfile
import tomllib
from functools import partial
from pathlib import Path

import growing
import numpy as np
from drags import OF_PARTICLES, ON_GRID
from runs import DISC, RINGS, SHOCK, put_out

from discsim import Simulation, load_scene
from setups import SETUPS

MOST = 0.1  # of a step: where all is gone nothing limits it
COMPANION = {"mass": 1e-3, "semi_major_axis": 1.2, "softening": 0.05, "accretion_radius": 0.1}
FEW = {"gas.particles": 1500, "dust.particles": 1500, "space.cells": 64}
ISOTHERMAL = {"kind": "isothermal", "sound_speed": 1.0}
ADIABATIC = {"kind": "adiabatic", "gamma": 1.4}


def changed(text, changes):
    """Tables of a text, with keys of some changed; what is None is left out."""
    tables = tomllib.loads(text)
    for name, change in changes.items():
        merges = isinstance(change, dict) and name in tables
        tables[name] = without_nothing({**tables[name], **change}) if merges else change
    return copy.deepcopy(without_nothing(tables))


def without_nothing(table):
    return {key: value for key, value in table.items() if value is not None}


def warm_growth():
    """Adiabatic gas with as much small dust, which counts neither in its thermal speed nor in Stokes' drag."""
    drag = {"law": "epstein-stokes", "mean_free_column": 1e-9, "supersonic": True}
    scene = growing.disc(gas=400, dust=300, ratio=1.0, drag=drag)
    scene["gas"]["eos"] = ADIABATIC | {"aspect_ratio": 0.1}
    return scene


def from_table(folder):
    """A disc from a file of columns."""
    path = folder / "disc.txt"
    rows = [f"{r} {1e-3 * r**-1.5} {0.0025 / r} 0.02" for r in np.geomspace(1.0, 3.0, 40)]
    path.write_text("\n".join(["# r Sigma T ratio", *rows]))
    return {
        "units": {"system": "code"},
        "run": {"until": 0.1},
        "space": {"size": 8.0, "cells": 32},
        "initial": {"kind": "table", "file": str(path)},
        "gas": {"particles": 1000, "eos": ADIABATIC},
        "dust": {"particles": 700, "ratio": 0.5},
        "star": {"mass": 1.0},
        "drag": {"law": "stokes-number", "stokes": 0.1},
    }


def from_snapshot(folder):
    """The disc with everything, from its third step on, refined."""
    sim, path = Simulation(changed(DISC, {})), folder / "snapshot.h5"
    for _ in range(3):
        sim.step()
    put_out(sim, path)
    return changed(DISC, {"initial": None}) | {"initial": {"kind": "snapshot", "file": str(path), "refine": 2}}


def from_clumps(widths, places, folder, **tables):
    """Gas and dust that have fallen together at some places."""
    random, path, given = np.random.default_rng(5), folder / "snapshot.h5", {}
    for name, mass in (("gas", 0.05), ("dust", 0.005)):
        spread = np.repeat(widths, 150)[:, None] * random.standard_normal((150 * len(places), 2))
        pos = np.repeat(places, 150, axis=0) + spread
        turned = np.stack([-pos[:, 1], pos[:, 0]], axis=1)
        vel = turned / np.linalg.norm(pos, axis=1)[:, None] ** 1.5
        given[name] = {"pos": pos, "vel": vel, "mass": np.full(len(pos), mass / len(pos))}
    whole = changed(DISC, {"initial": None})
    sim = Simulation(whole, given)
    put_out(sim, path)
    return whole | {"initial": {"kind": "snapshot", "file": str(path)}} | tables


def from_patch(folder):
    """Few grains, all in one place, that grow in the gas of a disc: others' gas is about them too."""
    random, path, source = np.random.default_rng(6), folder / "snapshot.h5", growing.disc(gas=700, dust=60)
    gas = Simulation(source).gas
    pos = [0.02, 0.9] + 0.15 * random.random((60, 2))
    vel = np.stack([-pos[:, 1], pos[:, 0]], axis=1) / np.linalg.norm(pos, axis=1)[:, None] ** 1.5
    given = {"dust": {"pos": pos, "vel": vel, "mass": np.full(60, 1e-6)}}
    given["gas"] = {name: getattr(gas, name) for name in ("pos", "vel", "mass", "small")}
    put_out(Simulation(source, given), path)
    return source | {"initial": {"kind": "snapshot", "file": str(path)}}


def from_patch_in_rings(folder):
    """Few grains, all in one place, that grow and diffuse in gas of few rings: of many ranks some have nothing."""
    random, path = np.random.default_rng(6), folder / "snapshot.h5"
    few = {"gas": {"particles": 300, "grid": {"rings": 5}}, "dust_diffusion": {"alpha": 0.02}}
    source = changed(RINGS, GROWING | few)
    gas = Simulation(source).gas
    pos = [0.1, 1.3] + 0.2 * random.random((60, 2))
    vel = np.stack([-pos[:, 1], pos[:, 0]], axis=1) * 1.3**0.5 / np.linalg.norm(pos, axis=1)[:, None] ** 1.5
    given = {"dust": {"pos": pos, "vel": vel, "mass": np.full(60, 1e-6)}}
    given["gas"] = {name: getattr(gas, name) for name in ("pos", "vel", "mass", "small")}
    put_out(Simulation(source, given), path)
    growth = without_nothing(GROWING["growth"] | {"small_ratio": None})
    return source | {"initial": {"kind": "snapshot", "file": str(path)}, "growth": growth}


def of_files(make, steps=3):
    def source():
        with tempfile.TemporaryDirectory() as folder:
            return load_scene(make(Path(folder)))

    return source, None, steps, MOST


def disc(steps=3, **changes):
    """Of the disc with everything that most tests run."""
    return partial(changed, DISC, changes), [], steps, MOST


def setup(path, steps=3):
    """One that is shipped, of few particles; in 1D it is small as it is."""
    whole = load_scene(path)
    flat = whole.space.dimensions == 1
    few = [] if flat else [f"{key}={n}" for key, n in FEW.items() if getattr(whole, key.split(".")[0])]
    return (lambda: path), few, steps, float("inf")


def rings(steps=3, **changes):
    """Gas on a polar grid, with dust; about 30 rings."""
    return (lambda: changed(RINGS, changes)), [], steps, MOST


def line(kind="wave", boundary="periodic", steps=3, gas=ISOTHERMAL, **tables):
    """In one dimension."""
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"dimensions": 1, "size": 1.0, "boundary": boundary},
        "initial": {"kind": kind},
        "gas": {"particles": 120, "eos": gas},
        "dust": {"particles": 120, "ratio": 0.5},
        "drag": {"law": "stopping-time", "t_stop": 0.05},
    } | tables
    return (lambda: copy.deepcopy(scene)), [], steps, float("inf")


def plane(kind, boundary="periodic", steps=3, gas=ISOTHERMAL, initial=None, particles=900, **tables):
    """In two, without a star."""
    scene = {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": 1.0, "boundary": boundary, "cells": 32},
        "initial": {"kind": kind, **(initial or {})},
        "gas": {"particles": particles, "eos": gas},
        "dust": {"particles": particles * 7 // 9, "ratio": 0.5},
        "drag": {"law": "stopping-time", "t_stop": 0.05},
    } | tables
    return (lambda: copy.deepcopy(scene)), [], steps, float("inf")


SIZES = {"smallest": 1e-4, "largest": 1e-2, "bins": 40}
GRAINS = {"particles": 1100, "ratio": 0.1, "grain_density": 1.0}
VISCOUS = {"alpha_viscosity": {"alpha": 0.01}}
HEATED = {"gas": {"eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 0.1}}}
BOTH = ("two-way", "one-way")
FINE = {"gas": {"particles": 20_000}, "dust": {"particles": 20_000}, "space": {"cells": 512}}
CLUMPS = [[1.2, 0.3], [1.25, 0.35], [-0.7, 0.9]]
EVERYTHING = {
    **HEATED, **VISCOUS,
    "companion": [COMPANION],
    "dust": {"particles": 1100, "ratio": 0.1, "grain_size": 1e-3, "grain_density": 1.0},
    "external": {"gas": [0.01, 0.0], "dust": [0.0, 0.01]},
    "drag": {"law": "epstein", "stokes": None},
    "radiation_pressure": {"beta": 0.1},
    "cooling": {"kind": "constant", "t_cool": 0.5, "aspect_ratio": 0.05},
    "dust_diffusion": {},
    "damping": {"inner": [0.6, 0.8]},
    "growth": {"fragmentation_speed": 0.1, "alpha": 1e-3, "small_size": 1e-6, "small_ratio": 0.05},
}  # fmt: skip

# Gas that loses mass at the edges of its disc.
LOSING = {"gas": {"grid": {"inner": 0.55, "outer": 1.9, "edges": "open"}}}
CLOSED_AND_WARM = {"eos": ADIABATIC | {"aspect_ratio": 0.07}, "grid": {"edges": "closed"}}
PLANET = {"mass": 3e-3, "semi_major_axis": 1.1, "softening": 0.05, "orbit": "live"}
EATER = PLANET | {"accretion_radius": 0.15}
GROWING = {
    "dust": {"grain_size": 1e-6, "grain_density": 1.0},
    "drag": {"law": "epstein", "stokes": None},
    "growth": {"fragmentation_speed": 0.1, "alpha": 1e-3, "small_size": 1e-9, "small_ratio": 0.05},
}

SCENES = {
    # Of 18 steps two sort, and cut space anew where that is due.
    "long": disc(18),
    # Many cells and leaves, of which each rank has a part.
    "fine": disc(18, **FINE),
    "fine idic": disc(3, **FINE, drag={"scheme": "idic"}),
    "fine sizes": disc(
        2,
        **FINE | {"dust": GRAINS | {"particles": 20_000, "grain_size": SIZES}},
        drag={"law": "epstein", "stokes": None},
    ),
    "fine off the grid": disc(3, **FINE | {"space": {"size": 4.2, "cells": 512}}),
    "fine diffusion": disc(2, **FINE, **VISCOUS, dust_diffusion={}),
    "shearing box": plane(
        "streaming",
        initial={"amplitude": 0.02, "wavelengths": [1, 2]},
        gas={"kind": "isothermal", "sound_speed": 3.0},
        particles=1800,
        steps=17,
        shearing_box={"omega": 1.3, "shear": 1.4, "headwind": 0.7},
    ),
    "shearing box isph": plane(
        "streaming",
        initial={"amplitude": 0.0},
        gas={"kind": "isothermal", "sound_speed": 3.0},
        shearing_box={"omega": 1.3, "shear": 1.4, "headwind": 0.7},
        drag={"law": "stopping-time", "t_stop": 0.05, "scheme": "isph"},
    ),
    "fine box": plane(
        "box",
        initial={"gas_velocity": 0.2, "dust_velocity": 1.0},
        particles=22_500,
        dust_diffusion={"D": 1e-3},
        space={"size": [1.0, 0.9], "boundary": "periodic", "cells": 300},
    ),
    "idic": disc(4, drag={"scheme": "idic"}),
    "linear": disc(4, drag={"scheme": "idic-linear", "direction": "one-way"}),
    "one-way": disc(4, drag={"direction": "one-way"}),
    "off the grid": disc(10, space={"size": 4.2}),
    "eaten": disc(12, star={"accretion_radius": 1.9}),
    "all gone": disc(4, star={"accretion_radius": 2.8}),
    "bodies": disc(4, companion=[COMPANION], star={"frame": "inertial", "grows": True}),
    "relaxed": disc(3, initial={"relax": 0.2}),
    "thin disc": disc(3, self_gravity={"kernel": "thin-disc", "thickness": 0.1, "softening": None}),
    "one-way thin disc": disc(
        3, self_gravity={"kernel": "thin-disc", "thickness": 0.1, "softening": None}, drag={"direction": "one-way"}
    ),
    "single": disc(6, gas={"precision": "single", "viscosity": {"switch": "balsara"}}, **VISCOUS),
    "reconstructed": disc(6, gas={"viscosity": {"alpha": 0.3, "pairs": "reconstructed"}}, **VISCOUS),
    "quiet": disc(6, gas={"quiet": True, "viscosity": None}, star={"frame": "inertial"}, companion=[COMPANION]),
    "euler": disc(3, run={"integrator": "euler"}),
    "heat": disc(3, **HEATED),
    "heat paid around": disc(6, gas={"eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 0.003}}),
    "heat idic": disc(3, **HEATED, drag={"scheme": "idic"}),
    "constant": disc(3, drag={"law": "constant", "K": 0.5, "stokes": None}),
    "constant sparse": disc(3, drag={"law": "constant", "K": 0.5, "stokes": None}, dust={"particles": 300}),
    "sizes": disc(6, dust=GRAINS | {"grain_size": SIZES}, drag={"law": "epstein", "stokes": None}),
    "sizes idic": disc(
        3, dust=GRAINS | {"grain_size": SIZES}, drag={"law": "epstein", "stokes": None, "scheme": "idic"}
    ),
    "sizes nonlinear": disc(
        3, dust=GRAINS | {"grain_size": SIZES}, drag={"law": "epstein", "stokes": None, "supersonic": True}
    ),
    "growth": (partial(growing.disc), [], 10, MOST),
    "growth one-way": (partial(growing.disc, direction="one-way"), [], 10, MOST),
    "growth of all": (
        partial(growing.disc, growth={"small_ratio": 0.1}, star={"mass": 1.0, "accretion_radius": 0.9}),
        [],
        18,
        MOST,
    ),
    "growth in heat": (warm_growth, [], 6, MOST),
    "growth of many": (partial(growing.disc, gas=200, dust=6000), [], 2, MOST),
    "growth inertial": disc(
        8,
        **{
            **EVERYTHING,
            "star": {"frame": "inertial", "grows": True},
            "dust_diffusion": None,
            "self_gravity": None,
        },
    ),
    "diffusion": disc(4, **VISCOUS, dust_diffusion={}),
    "diffusion one-way": disc(4, dust_diffusion={"alpha": 0.01}, drag={"direction": "one-way"}),
    "diffusion far": disc(4, dust_diffusion={"alpha": 0.5}),
    "diffusion of sizes": disc(
        4, dust=GRAINS | {"grain_size": SIZES}, drag={"law": "epstein", "stokes": None}, dust_diffusion={"alpha": 0.01}
    ),
    "diffusion without drag": disc(4, drag=None, dust_diffusion={"D": 1e-4}),
    "diffusion in a layer": line(
        "settling", "open", external={"vertical_frequency": 4.0}, dust_diffusion={"alpha": 0.01}
    ),
    "diffusion in a box": plane("box", dust_diffusion={"D": 1e-3}),
    "diffusion eaten": disc(8, dust_diffusion={"alpha": 0.01}, star={"accretion_radius": 1.9}),
    "everything": disc(6, **EVERYTHING),
    "everything one-way": disc(6, **EVERYTHING | {"drag": {"law": "epstein", "stokes": None, "direction": "one-way"}}),
    "table": of_files(from_table),
    "snapshot": of_files(from_snapshot),
    "growth in a patch": of_files(from_patch),
    "clumps": of_files(partial(from_clumps, [0.02, 0.02, 0.1], CLUMPS), 18),
    "diffusion in clumps": of_files(partial(from_clumps, [0.02, 0.02, 0.1], CLUMPS, dust_diffusion={"D": 1e-3})),
    "one tile": of_files(partial(from_clumps, [1e-3], [[1.3, 0.2]])),
    "box": plane("box", initial={"gas_velocity": 0.2, "dust_velocity": 1.0}),
    "wave": plane("wave"),
    "sheet": plane("sheet", self_gravity={"softening": 0.05}),
    "flat sheet": line("sheet", self_gravity={"softening": 0.05}),
    "blast": plane("blast", "open", gas=ADIABATIC, initial={"radius": 0.2}),
    "vortex": plane("vortex", gas=ADIABATIC, initial={"velocity": [0.5, 0.0]}),
    "settling": line("settling", "open", external={"vertical_frequency": 4.0}),
    "flat box": line("box", initial={"kind": "box", "gas_velocity": 0.2, "dust_velocity": 1.0}),
    "shock": (lambda: tomllib.loads(SHOCK), [], 3, MOST),
    "steady": disc(3, initial={"kind": "steady", "surface_density": 0.01, "mass": None}, **VISCOUS),
    "viscous-ring": disc(3, initial={"kind": "viscous-ring", "radius": 1.0, "inner": None, "outer": None}, **VISCOUS),
    "rings": rings(
        6,
        gas=CLOSED_AND_WARM,
        companion=[PLANET],
        self_gravity={"softening": 0.05},
        cooling={"kind": "beta", "beta": 7.0},
        damping={"inner": [0.5, 0.6], "outer": [1.7, 2.0]},
        **VISCOUS,
    ),
    "rings losing": rings(18, **LOSING),
    "rings losing heat": rings(5, gas=CLOSED_AND_WARM | LOSING["gas"], drag={"direction": "one-way"}),
    "rings alone": rings(5, dust=None, drag=None, **VISCOUS),
    "rings idic": rings(3, drag={"scheme": "idic"}),
    "rings linear": rings(3, drag={"scheme": "idic-linear", "direction": "one-way"}),
    "rings emsi": rings(3, drag={"scheme": "emsi"}),
    "rings grown": rings(6, star={"grows": True}, damping={"outer": [1.7, 2.0], "surface_density": True}),
    "rings thin disc": rings(3, self_gravity={"kernel": "thin-disc", "thickness": 0.1}),
    # Fewer rings than a rank has ghosts.
    "few rings": rings(4, gas={"particles": 300, "grid": {"rings": 7}}, self_gravity={"softening": 0.1}),
    # Dust that flies away: other ranks get the rings.
    "rings growth": rings(5, **GROWING),
    # Small dust leaves both edges, and grains that are blown away are among the rings of all ranks, and beyond them.
    "rings growth losing": rings(
        18,
        **LOSING,
        dust=GROWING["dust"] | {"particles": 5000},
        drag=GROWING["drag"] | {"direction": "one-way"},
        growth=GROWING["growth"],
        radiation_pressure={"beta": 2.0},
    ),
    "rings diffusion": rings(3, dust_diffusion={"alpha": 0.02}, drag={"scheme": "emsi"}),
    "rings diffusion far": rings(3, dust_diffusion={"alpha": 0.5}, dust={"particles": 700}),
    "rings diffusion one-way": rings(3, dust_diffusion={"D": 1e-3}, drag={"direction": "one-way"}),
    "rings accretion": rings(3, companion=[EATER, EATER | {"semi_major_axis": 0.8, "accretion_rate": 20.0}]),
    "rings everything": rings(
        18,
        gas={"eos": ADIABATIC | {"aspect_ratio": 0.07}, "grid": {"edges": "open"}},
        companion=[EATER],
        star={"grows": True, "accretion_radius": 0.5},
        cooling={"kind": "beta", "beta": 7.0},
        dust_diffusion={"alpha": 0.02},
        self_gravity={"softening": 0.05},
        damping={"outer": [1.7, 2.0], "surface_density": True},
        **GROWING,
    ),
    # Grains in one place among rings of others, and none on other ranks.
    "rings growth in a patch": of_files(from_patch_in_rings, 6),
    "few rings growth": rings(
        4, gas={"particles": 300, "grid": {"rings": 7}}, dust_diffusion={"alpha": 0.02}, companion=[EATER], **GROWING
    ),
    "rings that move": rings(
        18,
        dust={"particles": 9000},
        radiation_pressure={"beta": 2.0},
        initial={"dust_velocity": "drift"},
        drag={"stokes": 1.0},
        **VISCOUS,
    ),
}
# Of those above, and below, one for each thing that ranks ask or fetch of each other.
FEW_SCENES = (
    "long", "fine", "fine box", "idic", "linear", "one-way", "off the grid", "eaten", "all gone", "bodies",
    "shearing box", "shearing box isph",
    "heat paid around", "constant sparse", "sizes", "growth of all", "growth of many", "growth in a patch",
    "diffusion in clumps", "diffusion eaten", "diffusion in a box", "everything", "clumps", "one tile", "mk heat",
    "esph two-way 1D", "emsi-ppm shock", "setup dead_zone_oneway", "setup dead_zone_sph",
    "rings", "rings losing", "few rings", "rings that move", "rings everything", "rings growth losing",
    "rings growth in a patch", "few rings growth", "rings diffusion", "rings diffusion far",
)  # fmt: skip
for scheme in OF_PARTICLES:
    for way in BOTH:
        SCENES[f"{scheme} {way}"] = disc(3, drag={"scheme": scheme, "direction": way})
        SCENES[f"{scheme} {way} 1D"] = line(
            initial={"kind": "wave", "amplitude": 0.1},
            drag={"law": "stopping-time", "t_stop": 0.05, "scheme": scheme, "direction": way},
        )
    SCENES[f"{scheme} heat"] = disc(3, **HEATED, drag={"scheme": scheme})
for scheme in ON_GRID:
    SCENES[scheme] = line(drag={"law": "stopping-time", "t_stop": 0.05, "scheme": scheme}, gas=ISOTHERMAL, steps=18)
    SCENES[f"{scheme} shock"] = line(
        "shock", "open", drag={"law": "constant", "K": 5.0, "scheme": scheme}, gas=ADIABATIC, steps=4
    )
SCENES |= {f"setup {path.stem}": setup(path) for path in SETUPS}
