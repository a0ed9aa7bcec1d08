"""Motion in polar coordinates, at a constant radial velocity v and a constant angular momentum l per mass.

    r(t) = r + v t,        dphi/dt = l / r(t)^2                                                           (1)

The azimuth changes by l dt / (r r(dt)), exactly.
"""

import math

from discsim.jit.decorators import inline_jit

STRAIGHT = 0.5  # smallest change of r, as a factor, for which eq. (1) is used; else grains move on straight lines


@inline_jit
def move_on_arc(i, r, after, v, spin, dt, pos, vel):
    """Move the grain `i` over dt by eq. (1), from the radius r to `after`; `pos` and `vel` (n, 2) change in place.

    v: radial velocity at the end. spin: l.
    """
    if after > STRAIGHT * r:
        x, y = pos[i, 0], pos[i, 1]
        angle = spin * dt / (r * after)
        c, s = math.cos(angle) / r, math.sin(angle) / r
        x, y = x * c - y * s, x * s + y * c
        w = spin / after
        pos[i, 0], pos[i, 1] = after * x, after * y
        vel[i, 0], vel[i, 1] = v * x - w * y, v * y + w * x
    else:
        pos[i, 0] += dt * vel[i, 0]
        pos[i, 1] += dt * vel[i, 1]
