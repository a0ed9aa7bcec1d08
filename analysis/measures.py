"""Errors of waves and shocks against exact solutions, for the scripts beside this file."""

from __future__ import annotations

import numpy as np

from discsim import Simulation
from discsim.exact import dustyshock, dustywave
from discsim.kernels.sph.smoothing import KERNELS, NORM, SUPPORT, shape
from discsim.study.errors import measure_of

Array = np.ndarray


def run_of(scheme: str, problem: str, coefficient: float, h: float, particles: tuple[int, int], **keys) -> Simulation:
    """A DustyWave on [0, 1] or a DustyShock on [-1/2, 1/2], isothermal and adiabatic, with `particles` of gas and dust,
    with the artificial viscosity of published runs, and at steps so short that only schemes differ.

    keys: kernel, ratio, boost, amplitude, drag (more of that table), run (more of that table).
    """
    grid = scheme.endswith("-ppm")
    gas = {"particles": particles[0]} | ({} if grid else {"smoothing_length": h, "kernel": keys.get("kernel", "cubic")})
    wave = problem == "wave"
    start = {"kind": problem}
    if wave:
        start |= {"velocity": keys.get("boost", 0.0), "amplitude": keys.get("amplitude", 1e-4)}
        gas["eos"] = {"kind": "isothermal", "sound_speed": 1.0}
    else:
        gas["eos"] = {"kind": "adiabatic", "gamma": 1.4}
        gas |= {} if grid else {"viscosity": {"pairs": "approaching"}}
    return Simulation(
        {
            "units": {"system": "code"},
            "run": {"until": 0.5 if wave else 0.2, "courant": 0.3} | keys.get("run", {}),
            "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic" if wave else "open"},
            "initial": start,
            "gas": gas,
            "dust": {"particles": particles[1], "ratio": keys.get("ratio", 1.0)},
            "drag": {"law": "constant", "K": coefficient, "scheme": scheme} | keys.get("drag", {}),
        }
    )


def exact_velocity(sim: Simulation, kind: str, x: Array) -> Array:
    """Velocity of gas or dust at x (n,) now; of a shock that of strong drag."""
    scene, time = sim.scene, sim.time
    ratio, start = scene.dust[0].ratio, scene.initial
    if start.kind == "shock":
        return dustyshock.solution(x, time, ratio, start.left, start.right, scene.gas.eos.gamma).velocity
    wave = dustywave.solution(
        x, time, scene.drag.K, ratio, scene.gas.eos.sound_speed, start.amplitude, boost=start.velocity[0]
    )
    return getattr(wave, f"{kind}_velocity")


def frame_of(sim: Simulation) -> float:
    return sim.scene.initial.velocity[0] if sim.scene.initial.kind == "wave" else 0.0


def particle_error(sim: Simulation, kind: str) -> float:
    """Rms over particles (those that move) of the velocity minus the exact one, over the largest exact."""
    measure = measure_of(sim.scene)
    assert measure is not None
    return measure.errors(sim)[kind]


def smoothed_error(sim: Simulation, kind: str, h: float, kernel: str, of_exact: bool = False) -> float:
    """L2 of the plain SPH interpolant of the velocity at 600 nodes of a wave or 1000 of a shock, over max |exact|.

    Stoyanovskaya et al. 2018 (arXiv:1811.06506), eq. (38); interpolants are not divided by the sum of their weights.
    of_exact: of the exact velocities at the particles' places, so that the error is the interpolant's own.
    """
    shock = sim.scene.initial.kind == "shock"
    count = 1000 if shock else 600
    x = (np.arange(count) + 0.5) / count - (0.5 if shock else 0.0)
    p, code = getattr(sim, kind), KERNELS[kernel]
    order = np.argsort(p.pos[:, 0])
    place, mass = p.pos[order, 0], p.mass[order]
    vel = exact_velocity(sim, kind, place) if of_exact else p.vel[order, 0]
    if not shock:  # one period more on both sides
        place = np.concatenate([place - 1, place, place + 1])
        mass, vel = np.tile(mass, 3), np.tile(vel, 3)
    density, boost = _sums(x, place, mass, h, code), frame_of(sim)
    found = _sums(x, place, mass * (vel - boost) / np.interp(place, x, density), h, code)
    exact = exact_velocity(sim, kind, x) - boost
    return float(np.sqrt(((found - exact) ** 2).mean()) / np.abs(exact).max())


def _sums(x: Array, place: Array, values: Array, h: float, code: int) -> Array:
    """Sum of values W(x - place, h) at each x (n,); places rise."""
    out = np.zeros(len(x))
    for i, at in enumerate(x):
        lo, hi = np.searchsorted(place, (at - SUPPORT[code] * h, at + SUPPORT[code] * h))
        weights = [shape(code, 1, q)[0] for q in np.abs(place[lo:hi] - at) / h]
        out[i] = NORM[0][code] / h * (values[lo:hi] @ np.array(weights))
    return out


def amplitude_error(sim: Simulation, kind: str) -> float:
    """|found - exact| of the velocity's Fourier amplitude at the wave's own number, over the largest exact velocity."""
    p, k = getattr(sim, kind), 2 * np.pi
    phase = np.exp(-1j * k * p.pos[:, 0])
    exact = exact_velocity(sim, kind, p.pos[:, 0])
    return float(2 * abs(((p.vel[:, 0] - exact) * phase).mean()) / np.abs(exact - frame_of(sim)).max())
