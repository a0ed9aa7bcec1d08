"""Drift of dust in polar coordinates, as the gas in polar cells moves (`transport.py`).

    dv_r/dt = l^2 / r^3,    dr/dt = v_r,    dphi/dt = l / r^2,    l = r v_phi constant                       (1)

The centrifugal acceleration acts over half of dt before and half of dt after a motion with constant v_r and l. With
gravity in the kick this is a leapfrog in polar coordinates. On a circular orbit dust has exactly the velocity of cold
gas, at any step; a leapfrog in Cartesian coordinates is slower by (Omega dt)^2 / 8, which may exceed the drift.
"""

import math

from discsim.jit.decorators import jit_no_alloc
from discsim.kernels.common.arc import move_on_arc


@jit_no_alloc
def drift(first, last, pos, vel, dt):
    """Move grains over dt by eq. (1): `pos` and `vel` (n, 2) change in place."""
    for i in range(first, last):
        x, y, vx, vy = pos[i, 0], pos[i, 1], vel[i, 0], vel[i, 1]
        r = math.sqrt(x * x + y * y)
        spin = x * vy - y * vx
        before = 0.5 * dt * spin * spin
        v = (x * vx + y * vy) / r + before / r**3 if r > 0.0 else 0.0
        after = r + dt * v
        move_on_arc(i, r, after, v + before / after**3, spin, dt, pos, vel)
