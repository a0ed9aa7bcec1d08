"""The starts of a fixed 1D grid, one particle a cell at its centre: values at the centre, in a shock means of the cell.

Box, wave and shock are those of their own modules; a cell that the jump of a shock is in has its share of both sides.
"""

import numpy as np

from discsim.initial.base import Start
from discsim.scene.fields import Table


def particles(scene):
    count, length, start = scene.gas.particles, scene.space.size[0], scene.initial
    dx = length / count
    x = (np.arange(count) + 0.5) * dx - (0.5 * length if scene.centred else 0.0)
    density, vel, u = MAKERS[start.kind](scene, x, dx)
    out = {name: {"pos": x[:, None], "vel": vel[name][:, None]} for name in ("gas", "dust")}
    out["gas"] |= {"mass": density * dx, "density": density} | ({} if u is None else {"u": u})
    out["dust"] |= {"mass": scene.dust[0].ratio * density * dx}
    return out


def _box(scene, x, dx):
    start = scene.initial
    vel = {"gas": np.full_like(x, start.gas_velocity[0]), "dust": np.full_like(x, start.dust_velocity[0])}
    return np.full_like(x, start.density), vel, None


def _wave(scene, x, dx):
    start = scene.initial
    waves = start.wavenumber * start.direction[0]
    wave = start.amplitude * np.sin(2.0 * np.pi * waves / scene.space.size[0] * x)
    vel = start.velocity[0] + np.sign(waves) * wave
    return 1.0 + wave, {"gas": vel, "dust": vel}, None


def _shock(scene, x, dx):
    left, right = scene.initial.left, scene.initial.right
    share = np.clip(0.5 - x / dx, 0.0, 1.0)
    density = share * left[0] + (1.0 - share) * right[0]
    vel = (share * left[0] * left[2] + (1.0 - share) * right[0] * right[2]) / density
    u = None
    if scene.gas.eos.kind == "adiabatic":
        u = (share * left[1] + (1.0 - share) * right[1]) / (scene.gas.eos.gamma - 1.0) / density
    return density, {"gas": vel, "dust": vel}, u


MAKERS = {"box": _box, "wave": _wave, "shock": _shock}
START = Start(Table, particles)
