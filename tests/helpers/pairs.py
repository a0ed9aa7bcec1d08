"""Gas and dust for schemes between pairs."""

import numpy as np

from discsim import Simulation

ISOTHERMAL = {"kind": "isothermal", "sound_speed": 1.0}


def scene(drag, gas=40, dust=40, ratio=1.0, dimensions=1, boundary="periodic", **tables):
    gas = {"particles": gas, "eos": ISOTHERMAL} if isinstance(gas, int) else gas
    dust = {"particles": dust, "ratio": ratio} if isinstance(dust, int) else dust
    return {
        "units": {"system": "code"}, "run": {"until": 1.0} | tables.pop("run", {}),
        "space": {"dimensions": dimensions, "size": 1.0, "boundary": boundary}, "gas": gas, "dust": dust,
        "drag": drag, **tables,
    }  # fmt: skip


def cloud(dimensions=2, boost=0.0, order=None, n=(500, 400), boundary="open", field=None):
    """Gas and two populations of dust at random places; random velocities, or those of `field` at the place."""
    rng = np.random.default_rng(8)
    low = -0.3 if boundary == "open" else 0.0
    given = {}
    for name, count in zip(("gas", "dust"), n, strict=True):
        pos = rng.uniform(low, low + (0.6 if boundary == "open" else 1.0), (count, dimensions))
        vel = rng.normal(size=(count, dimensions))
        mass = rng.uniform(0.5, 2.0, count) / count
        given[name] = {"pos": pos, "vel": (vel if field is None else field(pos)) + boost, "mass": mass}
    given["gas"]["mass"][:] = 1 / n[0]
    given["gas"]["u"] = np.full(n[0], 10.0)
    given["dust"]["species"] = rng.integers(0, 2, n[1])
    if order is not None:
        for name, arrays in given.items():
            given[name] = {key: value[order[name]] for key, value in arrays.items()}
    return given


def kicked(scheme, dt=0.01, eos=ISOTHERMAL, given=None, law=None, boundary="open", **drag):
    """A simulation of `cloud` before its kick, and what makes one kick of drag alone."""
    given = given or cloud()
    dimensions = given["gas"]["pos"].shape[1]
    n = len(given["gas"]["mass"])
    dust = [{"particles": 1, "ratio": 0.5}] * 2
    law = law or {"law": "constant", "K": 30.0}
    tables = scene(
        law | {"scheme": scheme} | drag, {"particles": n, "eos": eos}, dust, dimensions=dimensions, boundary=boundary
    )
    if eos is ISOTHERMAL:
        given["gas"].pop("u", None)
    sim = Simulation(tables, particles=given)
    sim._prepare()
    for p in sim.state.species.values():
        p.acc[:] = 0.0
    sim.state.acc_unshared["gas"][:] = 0.0
    if sim.gas.u is not None:
        sim.gas.heating_rate[:] = sim.gas.pressure_acc[:] = 0.0
    return sim, lambda: sim.operators.kick(dt)


def both(sim):
    return sim.gas, sim.dust


def momentum(sim):
    return sum(p.mass @ p.vel for p in both(sim))


def spin(sim):
    return sum(p.mass @ (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0]) for p in both(sim))


def motion(sim, boost=0.0):
    return sum(0.5 * p.mass @ ((p.vel - boost) ** 2).sum(axis=1) for p in both(sim))
