"""What is not finite is told with the particle, the field and the step where it came in, before it spreads."""

import numpy as np
import pytest

from discsim import Simulation
from discsim.run.simulation import PhysicsError

ADIABATIC = {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1.0}


def box(dim, eos=None, drag=None, **tables):
    """A small box of gas and as much dust, of two populations where they are particles."""
    drag = drag or {"law": "stopping-time", "t_stop": 0.1}
    dust = {"particles": 64, "ratio": 0.5}
    out = {
        "units": {"system": "code"}, "run": {"until": 1.0, "threads": 2},
        "space": {"size": 1.0, "dimensions": dim, "boundary": "periodic"},
        "initial": {"kind": "box", "dust_velocity": 0.1},
        "gas": {"particles": 64, "viscosity": {}, "eos": eos or {"kind": "isothermal", "sound_speed": 1.0}},
        "dust": dust if drag.get("scheme") == "sios-ppm" else [dust, dust], "drag": drag,
    }  # fmt: skip
    return {name: table for name, table in (out | tables).items() if table is not None}


def star(**tables):
    disc = {"kind": "disc", "mass": 1e-3, "inner": 1.0, "outer": 2.0}
    cold = {"kind": "isothermal", "sound_speed": 0.1}  # the pressure of a hot disc would blow it apart
    return box(2, cold, initial=disc, space={"size": 6.0}, star={"mass": 1.0}, **tables)


CASES = {
    "tsc in 1D": box(1),
    "tsc": box(2, ADIABATIC),
    "idic-linear": box(2, drag={"law": "constant", "K": 3.0, "scheme": "idic-linear"}),
    "pairs": box(1, drag={"law": "constant", "K": 3.0, "scheme": "lab14"}),
    "interpolated": box(1, drag={"law": "constant", "K": 3.0, "scheme": "esph"}),
    "cells": box(1, ADIABATIC, drag={"law": "constant", "K": 3.0, "scheme": "sios-ppm"}, gas={
        "particles": 64, "eos": ADIABATIC}),
    "one-way": box(1, drag={"law": "stopping-time", "t_stop": 0.1, "direction": "one-way"}),
    "star and self-gravity": star(self_gravity={"softening": 0.1}),
}  # fmt: skip
CASES["gas alone"] = {name: table for name, table in CASES["cells"].items() if name not in ("dust", "drag")}
GIVEN_DISC = star(gas=None, drag={"law": "stokes-number", "stokes": 0.1, "direction": "one-way"}, background={
    "surface_density": 1e-3, "eos": {"kind": "isothermal", "sound_speed": 0.05}})  # fmt: skip


def spoilt(sim, species, field, value):
    """Put `value` at one particle; its id."""
    p = getattr(sim, species)
    which = int(np.flatnonzero(p.ids % 64 == 41)[0])
    getattr(p, field)[which] = value
    return int(p.ids[which])


def told(sim, species, field, value, running):
    """The id of the particle spoilt, and the message: before a step, or between two steps of a run."""
    found = []
    with pytest.raises(PhysicsError) as caught:
        if running:
            sim.evolve(1.0, lambda: found.append(spoilt(sim, species, field, value)))
        else:
            found.append(spoilt(sim, species, field, value))
            sim.step()
    return found[0], str(caught.value)


@pytest.mark.parametrize("case", CASES)
def test_the_particle_that_was_spoilt_is_named(case):
    """Every field of both species, NaN and infinite."""
    for species in {"gas", "dust"} & CASES[case].keys():
        element = "cell" if case == "cells" else "particle"
        for field in ("pos", "vel", "mass", "u", "h"):
            for value, running in ((np.nan, False), (-np.inf, True)):
                sim = Simulation(CASES[case])
                sim.step()
                if getattr(getattr(sim, species), field, None) is None:
                    continue
                number, message = told(sim, species, field, value, running)
                start = f"{species} {element} {number} is not finite in its {field} before the step ("
                assert message.startswith(start)
                assert f"; step {1 + running})" in message


@pytest.mark.parametrize(
    "field, running", [("pos", False), ("vel", False), ("mass", False), ("pos", True), ("vel", True)]
)
def test_where_nobody_feels_another_too(field, running):
    """There a run looks at what it makes alone: it costs 5 ns a particle, of 30 that a step takes."""
    sim = Simulation(GIVEN_DISC)
    sim.step()
    number, message = told(sim, "dust", field, np.nan, running)
    assert message.startswith(f"dust particle {number} is not finite in its {field}")
    assert f"; step {1 + running})" in message


def test_before_the_first_step_too():
    sim = Simulation(CASES["tsc"])
    sim.gas.u[3] = np.nan
    with pytest.raises(PhysicsError, match=r"gas particle 3 is not finite in its u before the step \(nan; step 0\)"):
        sim.step()


def test_sums_that_overflow_name_the_largest():
    sim = Simulation(CASES["tsc in 1D"])
    sim.dust.vel[:] = 1e307
    sim.dust.vel[77] = 1.7e308
    with pytest.raises(PhysicsError, match="dust particle 141 is not finite in its vel"):
        sim.step()


def test_energy_made_infinite_by_a_kick_is_named():
    sim = Simulation(CASES["gas alone"])
    sim.step()
    sim.gas.heating_rate[9] = np.inf
    name = sim.gas.ids[9]
    with pytest.raises(PhysicsError, match=rf"gas particle {name} is not finite in its u after a kick \(inf; step 1\)"):
        sim.step()
