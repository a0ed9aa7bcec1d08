"""Grains in SPH gas that come to the drift limit, growing or as larger ones drift away: `pytest -m slow`."""

import numpy as np
import pytest
from growing import drift_limit, steady_flow

from discsim import Simulation

pytestmark = pytest.mark.slow

ASPECT, SLOPE, RATIO = 0.15, 1.5, 0.0049  # H/r and the dust-to-gas ratio at r = 1, -d ln P / d ln r
RINGS = np.array([0.8, 1.03, 1.3])  # wide: dust gathers in streaks


def aspect(r):
    return ASPECT * r**0.25


def start(share):
    """Sigma ~ 1/r, with dust as in a steady flow, Sigma_d / Sigma_g ~ r^(1/4), of a `share` of its drift limit.

    alpha is such that grains of St = .2 settle, and meet by turbulence rather than by drift, as the formula has it.
    """
    sim = Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 1e9},
            "space": {"size": 10.0},
            "initial": {"kind": "disc", "surface_density": 1e-3, "inner": 0.5, "outer": 4.0},
            "star": {"mass": 1.0, "accretion_radius": 0.5},
            "gas": {
                "particles": 8_000,
                "kernel": "wendland-c4",
                "eta": 1.6,
                "viscosity": {"alpha": 0.05, "beta": 0.5, "pairs": "all"},
                "eos": {"kind": "locally-isothermal", "aspect_ratio": ASPECT},
            },
            "damping": {"inner": [0.5, 0.65], "outer": [3.5, 4.0], "time": 5e-4},
            # Fewer grains feel themselves: what is about one is then more than what is in its ring.
            "dust": {"particles": 32_000, "ratio": RATIO, "grain_size": 1e-5, "grain_density": 1.0},
            "drag": {"law": "epstein", "convention": "papers", "direction": "one-way"},
            "growth": {"fragmentation_speed": 1e3, "alpha": 0.01, "small_size": 1e-10, "small_ratio": 0.0},
        }
    )
    r = np.hypot(*sim.dust.pos.T)
    sim.dust.mass *= r**0.25
    sim.dust.size = share * drift_limit(RATIO * r**0.25 * 1e-3 / r, SLOPE, aspect(r))
    return sim


def hold(gas, dt):
    """Friction against the circles that the gas is in balance on, ten times as fast as its orbits: noise of so few
    particles is a viscosity that would empty the disc within r = 1 in this time.
    """
    r = np.hypot(*gas.pos.T)
    speed = np.sqrt(1.0 / r - SLOPE * aspect(r) ** 2 / r)
    circle = np.stack([-gas.pos[:, 1], gas.pos[:, 0]], axis=1) * (speed / r)[:, None]
    gas.vel += (circle - gas.vel) * -np.expm1(-10.0 * dt * r**-1.5)[:, None]


def over_limit(dust):
    """Mean size of the grains of each ring over the drift limit of its surface density."""
    ring, r = np.digitize(np.hypot(*dust.pos.T), RINGS), 0.5 * (RINGS[1:] + RINGS[:-1])
    mass, weighted = (np.bincount(ring, w, len(RINGS) + 1)[1:-1] for w in (dust.mass, dust.mass * dust.size))
    return weighted / mass / drift_limit(mass / (np.pi * np.diff(RINGS**2)), SLOPE, aspect(r))


@pytest.mark.parametrize(("share", "until", "limit"), [(0.6, 300.0, 0.1), (1.3, 240.0, 0.2)])
def test_grains_come_to_the_drift_limit_from_below_and_above(share, until, limit):
    """By (1) to (3) of docs/physics/growth.md a steady flow has .94 of the formula here; .90 and 1.05 were seen.

    By the equations in radius alone .86 and 1.00 are reached by then, and outer grains are gone soon after: so the
    latter is further off. Rings of dust that gathers as it grows and drifts pass through, of .07 here.
    """
    steady = steady_flow(1.0, alpha=0.01, aspect=ASPECT, stokes=0.08, outer=40.0, inner=1.05)
    sim, found = start(share), []
    assert over_limit(sim.dust).mean() == pytest.approx(share, rel=0.05)
    while sim.time < until:
        hold(sim.gas, sim.step())
        if sim.time > until - 40.0:
            found.append(over_limit(sim.dust))
    assert np.mean(found) == pytest.approx(steady, rel=limit)
