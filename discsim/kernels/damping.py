"""Velocities that relax to a local equilibrium: dv/dt = -(v - v*(r)) R(r), over dt v - v* falls by exp(-R dt).

R is a sum over zones, each rate x^2 with x from 0 at its near end to 1 at its far end and beyond (de Val-Borro et al.
2006, sec. 3.2). v* is radial and azimuthal, tabulated over v_K of the star. Where velocities are ahead of the places by
s, a particle on a circle of frequency Omega has turned by asin(Omega s) in a leapfrog, at which v* is taken.

If the drift contains the star's pull, or a share of it, the velocities are ahead by the kick of all other forces alone.
On a circle of speed v these give (share v_K^2 - v^2) / r outwards, and s times that is added to the radial part of v*.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import compiled
from discsim.kernels.totals import LIMBS, SOME, add, carry


class Zones(NamedTuple):
    """Where velocities relax, and to what."""

    ends: np.ndarray  # (zones, 3): near end, far end, rate at the far end
    first: float  # ln r of the first node of the table
    nodes: float  # number of them per unit of ln r
    table: np.ndarray  # (kinds, nodes, 2): radial and azimuthal velocity over v_K
    star: float
    softening: float
    in_drift: np.ndarray  # (kinds,): share of the star's pull that the drift has


@compiled
def relax(first, last, pos, vel, mass, species, kind, centre, zones, ahead, dt):
    """Relax the particles `first` to `last`, of kind `kind` or of kind + species, over dt; returns the limbs (3, LIMBS)
    of the momentum x, y and the angular momentum that they lose.

    centre: (x, y, v_x, v_y) about which the zones lie.
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
                # A drift has reached another radius by then, where circles are slower by half of that.
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
