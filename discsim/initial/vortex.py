"""Gresho's vortex in the middle of a periodic box (`exact/gresho.py`); dust turns with the gas."""

import numpy as np

from discsim.exact import gresho
from discsim.initial.lattice import uniform


def particles(scene):
    start = scene.initial
    out = uniform(scene, start.density)
    for arrays in out.values():
        away, r = _about_middle(scene, arrays["pos"])
        turn = gresho.speed(r, start.speed, start.radius) / r
        arrays["vel"] = turn[:, None] * np.stack([-away[:, 1], away[:, 0]], axis=1) + np.array(start.velocity)
    _, r = _about_middle(scene, out["gas"]["pos"])
    pressure = gresho.pressure(r, start.density, start.speed, start.radius)
    out["gas"]["u"] = pressure / (scene.gas.eos.gamma - 1.0) / start.density
    return out


def _about_middle(scene, pos):
    """Places (n, 2) relative to the middle of the box, and their distances (n,) from it, above 0."""
    away = pos - 0.5 * np.array(scene.space.size)
    return away, np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-300)
