"""Relaxation of velocities to a local equilibrium: dv/dt = -(v - v*(r)) R(r), so v - v* falls by exp(-R dt) over dt.

R is a sum over zones. Each contributes its full rate times x^2, with x rising from 0 at the near end of the zone to 1
at its far end and beyond (de Val-Borro et al. 2006, sec. 3.2). v* has a radial and an azimuthal part, tabulated in
units of v_K of the star. If velocities are ahead of the positions by s, a particle on a circle of frequency Omega has
turned by asin(Omega s) in a leapfrog; v* is rotated by this angle.

If the drift contains the star's pull, or a share of it, velocities are ahead only by the kick of all other forces. On a
circle of speed v these forces give (share v_K^2 - v^2) / r outwards; s times this is added to the radial part of v*.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit
from discsim.kernels.common.totals import LIMBS, SOME, add, carry


class Zones(NamedTuple):
    """Zones in which velocities relax, and the equilibrium velocities."""

    ends: np.ndarray  # (zones, 3): radius of the near end, radius of the far end, rate at the far end
    first: float  # ln r of the first node of the table
    nodes: float  # number of nodes per unit of ln r
    table: np.ndarray  # (kinds, nodes, 2): radial and azimuthal velocity over v_K
    star: float
    softening: float
    in_drift: np.ndarray  # (kinds,): share of the star's pull that the drift contains


@jit
def relax(first, last, pos, vel, mass, species, kind, centre, zones, ahead, dt):
    """Relax the particles `first` to `last` over dt; return the momentum x and y and the angular momentum that they
    lose, as limbs (3, LIMBS) of exact sums (`kernels/common/totals.py`).

    kind: row of `zones.table`, to which `species` (n,) is added unless it is empty. centre: (x, y, v_x, v_y) of the
    centre of the zones. ahead: time by which velocities are ahead of the positions.
    """
    most = zones.table.shape[1] - 1
    limbs, terms = np.zeros((3, LIMBS), np.int64), np.empty(3)
    bits = terms.view(np.int64)
    for block in range(first, last, SOME):
        for i in range(block, min(block + SOME, last)):
            x, y = pos[i, 0] - centre[0], pos[i, 1] - centre[1]
            r2 = x * x + y * y
            r = math.sqrt(r2)
            rate = 0.0
            for k in range(len(zones.ends)):
                near, far = zones.ends[k, 0], zones.ends[k, 1]
                depth = min(1.0, (r - near) / (far - near))
                if depth > 0.0:
                    rate += zones.ends[k, 2] * depth * depth
            if rate == 0.0 or r == 0.0:
                continue
            x /= r
            y /= r
            row = kind + (species[i] if len(species) > 0 else 0)
            place = min(max((math.log(r) - zones.first) * zones.nodes, 0.0), float(most))
            node = min(int(place), most - 1)
            part = place - node
            kepler = math.sqrt(zones.star * r2 / (r2 + zones.softening * zones.softening) ** 1.5)
            radial = kepler * ((1.0 - part) * zones.table[row, node, 0] + part * zones.table[row, node + 1, 0])
            azimuthal = kepler * ((1.0 - part) * zones.table[row, node, 1] + part * zones.table[row, node + 1, 1])
            if zones.in_drift[row] > 0.0:
                v, w = radial - (azimuthal * azimuthal - zones.in_drift[row] * kepler * kepler) * ahead / r, azimuthal
            else:
                sine = min(1.0, max(-1.0, azimuthal / r * ahead))
                cosine = math.sqrt(1.0 - sine * sine)
                # The radial drift changes r during `ahead`; the circular speed falls by half the relative change of r.
                around = azimuthal - 0.5 * sine * radial
                v, w = radial * cosine - around * sine, around * cosine + radial * sine
            gone = -math.expm1(-rate * dt)
            vx, vy = vel[i, 0] - centre[2], vel[i, 1] - centre[3]
            dx, dy = gone * (vx - (v * x - w * y)), gone * (vy - (v * y + w * x))
            vel[i, 0] -= dx
            vel[i, 1] -= dy
            terms[0], terms[1] = mass[i] * dx, mass[i] * dy
            terms[2] = mass[i] * (pos[i, 0] * dy - pos[i, 1] * dx)
            for k in range(3):
                add(bits[k], limbs[k])
        for k in range(3):
            carry(limbs[k])
    return limbs
