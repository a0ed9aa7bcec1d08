"""A small disc whose dust grows within some orbits, exact growth of one zone, and totals of a run."""

import math

import numpy as np
from scipy.integrate import solve_ivp

from discsim.formulas import growth as formulas
from discsim.numerics.state import SubcycleClock
from discsim.output.history import history_columns, history_row

SMALL, SMALLEST, MATERIAL = 1e-9, 5e-12, 1.0


def disc(until=1.0, gas=1000, dust=800, size=1e-6, ratio=0.3, growth=None, direction="two-way", **tables):
    """Code units, H/r = .1, Sigma about 1e-3: St = 2500 sizes and more."""
    return {
        "units": {"system": "code"},
        "run": {"until": until, "courant": 0.3},
        "space": {"size": 5.0},
        "initial": {"kind": "disc", "surface_density": 1e-3, "inner": 0.6, "outer": 1.7},
        "gas": {
            "particles": gas,
            "kernel": "cubic",
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1},
            "viscosity": {"pairs": "approaching"},  # sizes by the densities of single particles: .06 off, not .16
        },
        "dust": {"particles": dust, "ratio": ratio, "grain_size": size, "grain_density": MATERIAL},
        "star": {"mass": 1.0, "accretion_radius": 0.6},
        "drag": {"law": "epstein", "convention": "papers", "direction": direction},
        "growth": {"fragmentation_speed": 0.02, "alpha": 1e-3, "small_size": SMALL, **(growth or {})},
        **tables,
    }


def drift_limit(dust, gamma, aspect):
    """The size 2 Sigma_d (v_K / c_s)^2 / (pi rho_s gamma) of Birnstiel et al. (2012), without their factor f_d."""
    return 2.0 * dust / (math.pi * MATERIAL * gamma * aspect**2)


def small_part(size):
    """Fraction of the dust mass below SMALL, for n(a) ~ a^-3.5 up to `size`: the mass below a is ~ sqrt(a)."""
    return (math.sqrt(SMALL) - math.sqrt(SMALLEST)) / (np.sqrt(size) - math.sqrt(SMALLEST))


def one_zone(start, times, sigma, ratio, sound, omega, alpha, headwind, material=MATERIAL, edge=math.inf):
    """Sizes at `times` where nothing changes but the size: of da/dt = rho_d v_rel / rho_s, without fragmentation.

    edge: size from which on the drag is Stokes', 9 lambda / 4.
    """

    def drift(stokes):
        return -headwind / (1.0 + stokes**2) * np.array([2.0 * stokes, 1.0])

    def rate(time, log):
        size = math.exp(log[0])
        stokes = math.sqrt(2.0 * math.pi) * size * material / sigma * max(1.0, size / edge)
        part, height = small_part(size), sound / omega
        settled = height * math.sqrt(alpha / (alpha + stokes))
        density = ratio * sigma * (part / height + (1.0 - part) / settled) / math.sqrt(2.0 * math.pi)
        apart = drift(stokes) - drift(0.5 * stokes)
        speed = math.sqrt(3.0 * alpha * sound**2 / (stokes + 1.0 / stokes) + apart @ apart)
        return [density * speed / (material * size)]

    span = (0.0, times[-1])
    found = solve_ivp(rate, span, [math.log(start)], t_eval=times, rtol=1e-12, atol=1e-12, method="DOP853")
    return np.exp(found.y[0])


def steady_flow(p, alpha, aspect, stokes, outer, inner):
    """a at `inner` over the drift limit 2 Sigma_d (v_K / c_s)^2 / (pi rho_s gamma), of grown dust that flows there
    steadily from `outer`, where it has that limit and the Stokes number `stokes`.

    Sigma ~ r^-p, c_s^2 ~ r^-1/2, H/r = aspect at 1.
    """
    root, gamma = math.sqrt(2.0 * math.pi), p + 0.5

    def at(r, log, flow):
        """d ln a / d ln r, and a over the drift limit."""
        sigma, omega, sound = 1e-3 * r**-p, r**-1.5, aspect * r**-0.25
        headwind, own = 0.5 * gamma * sound**2 / (r * omega), root * math.exp(log) * MATERIAL / sigma
        inwards = 2.0 * headwind * own / (1.0 + own**2)
        dust = flow / (r * inwards)
        density = formulas.midplane_density(0.0, dust, sound / omega, own, alpha)
        rate = density * formulas.relative_speed(own, alpha, sound, headwind) / (MATERIAL * math.exp(log))
        return -rate * r / inwards, math.exp(log) / drift_limit(dust, gamma, sound / (r * omega))

    push, sigma = gamma * (aspect * outer**0.25) ** 2, 1e-3 * outer**-p
    flow = 0.5 * math.pi / root * stokes * push * sigma * stokes * push * math.sqrt(outer)  # r Sigma_d v
    log = math.log(stokes * sigma / (root * MATERIAL))
    nodes = np.log(np.geomspace(outer, inner, 2001))
    for x, step in zip(nodes[:-1], np.diff(nodes), strict=True):
        half = log + 0.5 * step * at(math.exp(x), log, flow)[0]
        log += step * at(math.exp(x + 0.5 * step), half, flow)[0]
    return at(inner, log, flow)[1]


def totals(sim):
    """Mass of gas, grown and small dust, and momentum and angular momentum of all, but for what was accreted."""
    gas, dust = sim.gas, sim.dust
    momentum = sum((p.mass[:, None] * p.vel).sum(axis=0) for p in (gas, dust))
    spin = sum((p.mass * (p.pos[:, 0] * p.vel[:, 1] - p.pos[:, 1] * p.vel[:, 0])).sum() for p in (gas, dust))
    beside = 0.0 if sim.scene.drag.direction == "two-way" else gas.small.sum()
    return gas.mass.sum() + dust.mass.sum() + beside, momentum, float(spin)


def row_of(sim):
    """The row of the history for the present state, by columns."""
    with sim.synchronised() as state:
        return dict(zip(history_columns(sim.scene), history_row(state, sim.effects, 0.0, ""), strict=True))


def masses(sim):
    """Mass of gas, grown and small dust, with what the star and open edges have accreted."""
    row = row_of(sim)
    return sum(row[f"{what}_{of}"] for what in ("mass", "accreted") for of in ("gas", "dust", "small"))


def exchange(sim, dt, fragmentation):
    """Let dust grow over dt. Changes of mass, momentum and angular momentum over the totals, and the part that moved.

    The part that moved is the mass that small and grown dust exchange, over all mass.
    """
    effect = sim.effects["growth"]
    sim.state.subcycle_clock, effect.grains = SubcycleClock(dt), effect.grains._replace(fragmentation=fragmentation)
    (mass, momentum, spin), small = totals(sim), sim.gas.small.sum()
    effect.event(sim.state)
    after = totals(sim)
    moved = abs(sim.gas.small.sum() - small)
    return after[0] / mass - 1.0, np.abs(after[1] - momentum).max() / mass, (after[2] - spin) / spin, moved / mass
