"""Pressure and sound speed of gas with c_s ~ r^(-1/2) or r^(-1/4), by square roots alone."""

import math

from discsim.jit.decorators import jit
from discsim.jit.index import index

ONE, TWO = index(1), index(2)


@jit
def by_roots(begin, end, pos, density, speed, r0, twice, pressure, sound):
    """Write c_s = `speed` (r / r0)^(-1/2) or, if `twice`, (r / r0)^(-1/4), and P = c_s^2 rho, at positions (n, 2)."""
    flat, least = pos.reshape(-1), 1e-12 * r0
    for i in range(index(begin), index(end)):  # a flat array and unsigned indices: vectorised
        r = math.sqrt(flat[TWO * i] * flat[TWO * i] + flat[TWO * i + ONE] * flat[TWO * i + ONE])
        root = math.sqrt((least if r < least else r) / r0)
        c = speed * (1.0 / (math.sqrt(root) if twice else root))
        pressure[i], sound[i] = c * c * density[i], c
