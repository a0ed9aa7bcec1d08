"""Every setup, effect, drag scheme and law, kernel, start, equation of state and integrator makes a few steps."""

import math
from dataclasses import asdict

import numpy as np
import pytest
from drags import BETWEEN_PAIRS, INTERPOLATING, OF_PARTICLES, ON_GRID
from runs import on_threads
from typer.testing import CliRunner

from discsim import Simulation, load_scene
from discsim.cli import app
from discsim.parts import EFFECTS
from discsim.preview.derived import dust_masses, gas_mass
from discsim.scene import fields
from discsim.scene.tables import TABLES, removable
from setups import SETUPS

FEW = {"gas.particles": 1500, "dust.particles": 1500, "space.cells": 64}
ISOTHERMAL = {"kind": "isothermal", "sound_speed": 1.0}
LOCALLY = {"kind": "locally-isothermal", "aspect_ratio": 0.1}


def scene(initial, gas=None, dimensions=1, boundary="periodic", **tables):
    """A scene in code units, of 64 gas particles in 1D and 400 in 2D."""
    gas = {"particles": 64 if dimensions == 1 else 400, "eos": ISOTHERMAL} | (gas or {})
    return {
        "units": {"system": "code"},
        "run": {"until": 1.0} | tables.pop("run", {}),
        "space": {"dimensions": dimensions, "size": 1.0, "boundary": boundary} | tables.pop("space", {}),
        "initial": initial,
        "gas": gas,
        **tables,
    }


def disc(**more):
    start = {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 2.0}
    whole = scene(start, {"eos": LOCALLY}, 2, "open", star={"mass": 1.0}, space={"size": 6.0, "cells": 32})
    return whole | more


def choices(model, key):
    return fields.choices_in(model.model_fields[key].annotation)


def kinds(annotation):
    return {model.model_fields["kind"].default for model in fields.models_in(annotation)}


def moving(sim):
    """The particles of each species that move: mass (n,), pos and vel (n, d); and what one-way gas carries of dust."""
    for p in sim.state.species.values():
        free = slice(None) if p.immobile is None else ~p.immobile
        yield p.mass[free], p.pos[free], p.vel[free]
    gas = sim.gas
    if gas is not None and gas.small is not None and sim.scene.drag.direction == "one-way":
        yield gas.small, gas.pos, gas.vel  # beside its mass, as it must not notice


def totals(sim):
    """Mass, momentum and (2D) angular momentum of gas and dust, with what the star has taken."""
    ledger, found = sim.state.ledger, {"mass": 0.0, "momentum": 0.0, "spin": 0.0, "size": 0.0}
    found["mass"] += ledger.accreted_gas + ledger.accreted_dust + ledger.accreted_small
    found["spin"] += ledger.accreted_angular_momentum
    for mass, pos, vel in moving(sim):
        found["mass"] += mass.sum()
        found["momentum"] += mass @ vel
        found["size"] += mass @ np.abs(vel).sum(axis=1)
        if vel.shape[1] == 2:
            found["spin"] += mass @ (pos[:, 0] * vel[:, 1] - pos[:, 1] * vel[:, 0])
    return found


def momentum(sim):
    """Momentum of gas and dust whose sum is not rounded: a step far beyond its limit makes velocities of 1000."""
    products = np.concatenate([mass[:, None] * vel for mass, _, vel in moving(sim)])
    return np.array([math.fsum(column) for column in products.T])


def assert_sane(sim):
    for p in sim.state.species.values():
        for name, array in p.arrays().items():
            assert np.isfinite(array).all(), name
    if sim.gas is not None:
        assert (sim.gas.density > 0).all() and (sim.gas.h > 0).all()
    assert sim.time > 0


# Setups


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_setup_passes_check(path):
    done = CliRunner().invoke(app, ["check", str(path)])
    assert done.exit_code == 0, done.stderr
    assert load_scene(path).title in done.stdout


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_setup_steps(path):
    whole = load_scene(path)
    reduced = [f"{key}={number}" for key, number in FEW.items() if getattr(whole, key.split(".")[0])]
    if whole.space.dimensions == 1:
        reduced = []  # small as they are, and with a fixed smoothing length
    sim = Simulation(load_scene(path, reduced))
    before = totals(sim)
    # What `discsim check` says, but for the particle at the end of a tube.
    expected = (gas_mass(sim.scene) if sim.gas is not None else 0.0) + sum(dust_masses(sim.scene))
    assert before["mass"] == pytest.approx(expected, rel=2e-3 if sim.scene.initial.kind == "shock" else 1e-6)
    for _ in range(3):
        sim.step()
    after = totals(sim)
    assert_sane(sim)
    assert after["mass"] == pytest.approx(before["mass"], rel=1e-13)  # a sum of a thousand terms
    moved = after["momentum"] - before["momentum"]
    if sim.scene.star is not None:
        # Central forces on particles that lie evenly; the rest is the noise of a thousand of them.
        assert np.abs(moved).max() < 1e-3 * after["size"]
        # The star's torque is none; a coarse grid's self-gravity leaves this much of one, and what dust loses to
        # gas that it does not push is nobody's. Companions and damping zones give and take as little in three steps.
        alone = sim.scene.drag is not None and sim.scene.drag.direction == "one-way"
        others = sim.scene.companion is not None or sim.scene.damping is not None
        assert after["spin"] == pytest.approx(before["spin"], rel=1e-3 if alone or others else 1e-4)
    elif sim.scene.initial.kind == "shock":
        left, right = sim.scene.initial.left[1], sim.scene.initial.right[1]
        # The push of the pressures on the two ends; SPH smooths them over a few spacings.
        assert moved[0] == pytest.approx((left - right) * sim.time, rel=0.02)
    else:
        # Pairs and cells exchange momentum to rounding; the interpolated field of gravity nearly so.
        scale = max(after["size"], before["size"], sim.gas.mass @ sim.gas.sound_speed)
        assert np.abs(moved).max() < 1e-12 * scale


# Effects: every table that can be left out, left out of a scene that has them all

# Of the kernel that setups with most effects have, and of masses that are unequal from the start, as growth makes them:
# so sums that compile for one of these tests serve the others.
EVERYTHING = disc(
    gas={
        "particles": 400,
        "kernel": "wendland-c4",
        "eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 0.1},
        "viscosity": {},
        "conductivity": {},
    },
    alpha_viscosity={"alpha": 0.01},
    companion=[{"mass": 1e-3, "semi_major_axis": 1.5, "softening": "0.1"}],
    dust={"particles": 300, "ratio": 0.1, "grain_size": 1e-3, "grain_density": 1.0},
    self_gravity={"softening": 0.2},
    external={"gas": [0.01, 0.0], "dust": [0.0, 0.01]},
    drag={"law": "epstein"},
    radiation_pressure={"beta": 0.1},
    cooling={"kind": "constant", "t_cool": 0.5, "aspect_ratio": 0.05},
    dust_diffusion={},
    damping={"inner": [1.0, 1.2]},
    growth={"fragmentation_speed": 0.1, "alpha": 1e-3, "small_size": 1e-6, "small_ratio": 0},
)
STEPPED = (
    "gas", "gas.viscosity", "gas.conductivity", "alpha_viscosity", "dust", "star", "companion", "self_gravity",
    "radiation_pressure", "external", "cooling", "drag", "dust_diffusion", "damping", "growth",
)  # fmt: skip
# What cannot stay without it.
NEEDS = {
    "gas": ("alpha_viscosity", "drag", "dust_diffusion", "cooling", "growth"), "alpha_viscosity": ("dust_diffusion",),
    "dust": ("drag", "dust_diffusion", "radiation_pressure", "growth"), "drag": ("dust_diffusion", "growth"),
    "star": (
        "alpha_viscosity", "dust_diffusion", "companion", "radiation_pressure", "cooling", "damping", "drag", "growth",
    ),
}  # fmt: skip


def test_every_effect_is_stepped_here():
    given = {"background", "background.bump", "background.gap"}  # no partner of gas: effects/test_background.py
    assert {*STEPPED, *given} == set(removable())
    assert set(load_scene(EVERYTHING).effects) == set(STEPPED)


@pytest.fixture(scope="module")
def start():
    """Positions, velocities and masses of a disc in balance, one of whose gas particles is a little heavier."""
    species = Simulation(EVERYTHING).state.species
    found = {name: {key: getattr(p, key).copy() for key in ("pos", "vel", "mass")} for name, p in species.items()}
    found["gas"]["mass"][0] *= 1.01
    return found


def test_the_same_bits_on_any_number_of_threads(monkeypatch, start):
    """Of effects at once, particles and what is added up over them, in pieces of 50 and of all particles; the field of
    self-gravity has threads of its own (numerics/test_poisson.py).
    """
    scene = {name: table for name, table in EVERYTHING.items() if name != "self_gravity"}
    ends = []
    for _ in on_threads(monkeypatch):
        sim = Simulation(scene, start)
        for _ in range(3):
            sim.step()
        held = [*sim.state.species.values(), sim.bodies]
        arrays = [array for group in held for array in group.arrays().values()]
        arrays += [np.atleast_1d(value) for value in asdict(sim.state.ledger).values()]
        ends.append([array.tobytes() for array in arrays])
    assert ends[0] == ends[1]


def test_effects_act_on_whom_they_say(start):
    """And give gas and dust at one place the same where they say that they do."""
    sim = Simulation(EVERYTHING, start)
    sim.dust.pos[:] = sim.gas.pos[: sim.dust.count]
    sim.step()
    sim.dust.pos[:] = sim.gas.pos[: sim.dust.count]
    for name, effect in sim.effects.items():
        given = dict(zip(("gas", "dust"), sim.acceleration(name), strict=True))
        felt = {species for species, acc in given.items() if np.any(acc)}
        assert felt == set(effect.acts_on), name
        alike = bool(felt) and np.allclose(given["gas"][: sim.dust.count], given["dust"], rtol=1e-9)
        assert alike == effect.shared, name


def two_steps(start, without=()):
    """The scene without some effects after two steps from one and the same start."""
    whole = load_scene(EVERYTHING, ["run.timestep=0.01"], without)
    sim = Simulation(whole, {name: arrays for name, arrays in start.items() if name not in without})
    sim.step()
    sim.step()
    assert_sane(sim)
    return sim


@pytest.fixture(scope="module")
def with_everything(start):
    return two_steps(start)


@pytest.mark.parametrize("effect", STEPPED)
def test_effect_matters_and_can_be_left_out(effect, start, with_everything):
    gone = (effect, *NEEDS.get(effect, ()))
    sim = two_steps(start, gone)
    assert set(sim.effects) == set(EFFECTS) - {"background"} - set(gone)
    kept = "dust" if effect == "gas" else "gas"
    ours, theirs = getattr(sim, kept), getattr(with_everything, kept)
    fields = ("vel", "u") if kept == "gas" else ("vel",)
    changes = [getattr(ours, f)[np.argsort(ours.ids)] - getattr(theirs, f)[np.argsort(theirs.ids)] for f in fields]
    assert max(np.abs(change).max() for change in changes) > 1e-9


@pytest.mark.parametrize("effect", [name for name in EFFECTS if name != "background"])
def test_acceleration_of_each_effect(effect, with_everything):
    gas, dust = with_everything.acceleration(effect)
    assert gas.shape == (400, 2) and dust.shape == (300, 2)
    # SPH pushes gas alone, by its viscosity too; dust alone gives nothing; drag is the kick itself, damping one more.
    nothing = dict.fromkeys(
        ("alpha_viscosity", "dust", "drag", "dust_diffusion", "cooling", "damping", "growth"), (False, False)
    )
    acts = (nothing | {"gas": (True, False), "radiation_pressure": (False, True)}).get(effect, (True, True))
    assert (np.abs(gas).max() > 0, np.abs(dust).max() > 0) == acts


# Drag: schemes, directions, laws

LAWS = {
    "constant": {"K": 3.0},
    "stopping-time": {"t_stop": 0.3},
    "epstein": {},
    "epstein-stokes": {"mean_free_column": 1e-3, "supersonic": True},
    "stokes-number": {"stokes": 0.3},
    "stokes-over-density": {"stokes": 0.3},
}
OF_DISCS = ("stokes-number", "stokes-over-density")


def dragged(dimensions, law, **drag):
    """A wave in 1D, a disc in 2D, with stopping times of about .1 (in the disc grains are small in its units)."""
    drag = {"law": law, **LAWS[law], **drag}
    dust = {"particles": 90, "ratio": 0.5, "grain_density": 1.0}
    if dimensions == 2:
        return disc(dust=dust | {"particles": 500, "grain_size": 1e-4}, drag=drag)
    return scene({"kind": "wave", "amplitude": 0.1}, dust=dust | {"grain_size": 0.1}, drag=drag)


def test_every_drag_law_is_stepped_here():
    assert set(LAWS) == set(choices(TABLES["drag"], "law"))
    # Those of the fixed grid are in tests/numerics/test_ppm.py.
    assert {*OF_PARTICLES, *ON_GRID} == set(choices(TABLES["drag"], "scheme"))


every_drag = pytest.mark.parametrize(
    ("dimensions", "law"),
    [(d, law) for d in (1, 2) for law in LAWS if d == 2 or law not in OF_DISCS],  # no orbits in 1D
)


CONSERVING = [name for name in OF_PARTICLES if name not in INTERPOLATING]
INTEGRATED = [(name, {"integration": way}) for name in CONSERVING for way in choices(TABLES["drag"], "integration")]


@every_drag
@pytest.mark.parametrize(("scheme", "more"), [*[pair for pair in INTEGRATED if pair[0] != "mk"], ("mk", {})])
def test_two_way_drag_conserves_momentum(dimensions, law, scheme, more):
    sim = Simulation(dragged(dimensions, law, scheme=scheme, **more))
    sim.step()
    assert_sane(sim)
    sim.dust.vel += 0.3
    before, dt = totals(sim), 0.2
    push = sum(p.mass @ p.acc for p in (sim.gas, sim.dust))
    start = momentum(sim)
    undragged = sim.dust.vel + dt * sim.dust.acc
    sim.effects["drag"].kick(sim.state, dt)
    # All that the kick adds is the forces' own momentum: rounding of a sum of 900 terms, or of 20,000 pairs.
    gained = momentum(sim) - start
    rounding = (1e-13 if scheme in BETWEEN_PAIRS else 1e-14) * before["size"]
    np.testing.assert_allclose(gained, dt * push, rtol=0, atol=rounding)
    assert np.abs(sim.dust.vel - undragged).max() > 0.01


@every_drag
@pytest.mark.parametrize("scheme", OF_PARTICLES)
def test_one_way_drag_leaves_the_gas_alone(dimensions, law, scheme):
    source = dragged(dimensions, law, scheme=scheme, direction="one-way")
    sim, alone = Simulation(load_scene(source)), Simulation(load_scene(source, without=("drag", "dust")))
    start = sim.dust.vel.copy()
    for one in (sim, alone):
        one.step()
        one.step()
    assert_sane(sim)
    # To the last bit.
    for name, array in alone.gas.arrays().items():
        np.testing.assert_array_equal(getattr(sim.gas, name), array, err_msg=name)
    assert np.abs(sim.dust.vel - start).max() > 0


# Kernels, starts, equations of state, integrators


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("kernel", choices(TABLES["gas"], "kernel"))
def test_kernel(kernel, dimensions):
    sim = Simulation(scene({"kind": "box", "gas_velocity": 0.5}, {"kernel": kernel}, dimensions))
    sim.step()
    assert_sane(sim)
    # In 1D h is whole spacings and the sum is exact for splines; a square lattice leaves half a per cent.
    np.testing.assert_allclose(sim.gas.density, 1.0, rtol=0.01)
    # Forces on a lattice cancel.
    assert np.abs(sim.gas.vel[:, 0] - 0.5).max() < 1e-12


STARTS = {
    "box": ({"gas_velocity": 0.2, "dust_velocity": 1.0}, "periodic", ISOTHERMAL, (1, 2)),
    "wave": ({}, "periodic", ISOTHERMAL, (1, 2)),
    "sheet": ({}, "periodic", ISOTHERMAL, (1, 2)),
    "shock": ({}, "open", {"kind": "adiabatic", "gamma": 1.4}, (1,)),
    "disc": ({"mass": 0.01, "inner": 0.1, "outer": 0.45}, "open", LOCALLY, (2,)),
    "viscous-ring": ({"radius": 0.25, "mass": 0.01}, "open", LOCALLY, (2,)),
    "steady": ({"surface_density": 0.01, "inner": 0.1, "outer": 0.45}, "open", LOCALLY, (2,)),
    "blast": ({"radius": 0.2}, "open", {"kind": "adiabatic", "gamma": 1.4}, (2,)),
    "vortex": ({"velocity": [0.5, 0.0]}, "periodic", {"kind": "adiabatic", "gamma": 1.4}, (2,)),
    "settling": ({}, "open", ISOTHERMAL, (1,)),
}


@pytest.mark.parametrize(("kind", "dimensions"), [(kind, d) for kind, (*_, allowed) in STARTS.items() for d in allowed])
def test_start(kind, dimensions):
    keys, boundary, eos, _ = STARTS[kind]
    dust = {"particles": 80, "ratio": 0.1}
    drag = {"law": "stopping-time", "t_stop": 0.1}
    star = {"star": {"mass": 1.0}}
    viscous = star | {"alpha_viscosity": {"alpha": 0.01}}
    more = {"disc": star, "viscous-ring": viscous, "steady": viscous}
    more = (more | {"settling": {"external": {"vertical_frequency": 4.0}}}).get(kind, {})
    gas = {"eos": eos} | ({"kernel": "cubic"} if "alpha_viscosity" in more else {})
    source = scene({"kind": kind, **keys}, gas, dimensions, boundary, dust=dust, drag=drag, **more)
    sim = Simulation(source)
    before = totals(sim)["mass"]
    sim.step()
    assert_sane(sim)
    assert totals(sim)["mass"] == pytest.approx(before, rel=1e-14)
    assert sim.gas.vel.shape[1] == dimensions


def test_every_start_is_stepped_here():
    of_files = {"table", "snapshot"}  # initial/test_table.py and test_restart.py
    assert set(STARTS) | of_files == kinds(TABLES["initial"])


GASES = {
    "isothermal": {"sound_speed": 0.5},
    "locally-isothermal": {"aspect_ratio": 0.1},
    "adiabatic": {"gamma": 1.4, "sound_speed": 0.5},
    "polytropic": {"gamma": 2.0, "constant": 0.1},
}


@pytest.mark.parametrize("kind", GASES)
def test_equation_of_state(kind):
    sim = Simulation(disc(gas={"particles": 400, "viscosity": {}, "eos": {"kind": kind, **GASES[kind]}}))
    sim.step()
    assert_sane(sim)
    gas = sim.gas
    ratio = {
        "isothermal": 0.25,
        "locally-isothermal": 0.01 * np.linalg.norm(gas.pos, axis=1) ** -0.5,
        "adiabatic": 0.25 / 1.4,
        "polytropic": 0.1 * gas.density,
    }[kind]
    # c_s^2 / gamma. The energy of adiabatic gas has had one step of work, on rings that are uneven at the edges.
    np.testing.assert_allclose(gas.pressure / gas.density, ratio, rtol=0.05 if kind == "adiabatic" else 1e-12)


def test_every_equation_of_state_is_stepped_here():
    assert set(GASES) == kinds(TABLES["gas"].model_fields["eos"].annotation)


@pytest.mark.parametrize("integrator", choices(TABLES["run"], "integrator"))
def test_integrator(integrator):
    """Positions after a step: x + v dt (euler), x + v dt + a dt^2 / 2 (kdk)."""
    source = scene({"kind": "wave", "amplitude": 0.1}, run={"integrator": integrator, "timestep": 0.004})
    sim = Simulation(source)
    acc = sim.acceleration("gas")[0]
    x, v = sim.gas.pos.copy(), sim.gas.vel.copy()
    dt = sim.step()
    assert dt == 0.004
    order = np.argsort(sim.gas.ids)
    expected = x + v * dt + {"kdk": 0.5, "euler": 0.0}[integrator] * acc * dt**2
    np.testing.assert_allclose(sim.gas.pos[order], expected % 1.0, rtol=0, atol=1e-15)
    assert_sane(sim)
