"""Pressure of gas whose sound speed is c_s ~ r^(-1/2) or r^(-1/4). Square roots are faster than powers."""

import math

from discsim.jit.decorators import jit
from discsim.jit.index import index

ONE, TWO = index(1), index(2)


@jit
def write_pressure_and_sound(begin, end, pos, density, speed, r0, quarter_power, pressure, sound):
    """Write the sound speed c_s to `sound` (n,), and c_s^2 rho to `pressure` (n,), of particles at `pos` (n, 2).

    c_s is `speed` (r / r0)^(-1/2) or, if `quarter_power`, `speed` (r / r0)^(-1/4). density (n,): rho.
    """
    flat, least = pos.reshape(-1), 1e-12 * r0
    for i in range(index(begin), index(end)):  # a flat array and unsigned indices: vectorised
        r = math.sqrt(flat[TWO * i] * flat[TWO * i] + flat[TWO * i + ONE] * flat[TWO * i + ONE])
        root = math.sqrt((least if r < least else r) / r0)
        c = speed * (1.0 / (math.sqrt(root) if quarter_power else root))
        pressure[i], sound[i] = c * c * density[i], c
