"""Relaxation of velocities to a local equilibrium v*: dv/dt = -(v - v*(r)) R(r), so v - v* falls by exp(-R dt) over dt.

R is a sum over damping zones. Each zone adds its full rate times x^2, with x rising from 0 at the near end of the zone
to 1 at its far end and beyond (de Val-Borro et al. 2006, sec. 3.2). v* has a radial and an azimuthal part, tabulated in
units of the Keplerian speed v_K.

The velocities of a leapfrog may be those of a time s later than the positions. The velocity on a circular orbit of
frequency Omega has then turned by asin(Omega s), and v* is rotated by this angle. If the drift contains a fraction f
of the star's gravity, velocities are ahead only by the kick of all other forces. On a circular orbit of speed v the
other forces give the outward acceleration (f v_K^2 - v^2) / r; s times this acceleration is added to the radial part
of v*. The same holds, with f = 0, for a drift in polar coordinates.
"""

import math
from typing import NamedTuple

import numpy as np

from discsim.jit.decorators import jit
from discsim.kernels.common.totals import LIMBS, MAX_TERMS, add_number, carry


class Zones(NamedTuple):
    """Damping zones, and the equilibrium velocities of each kind of particles: gas, or a dust population."""

    ends: np.ndarray  # (zones, 3): radius of the near end, radius of the far end, rate at the far end
    first: float  # ln r of the first node of `table`
    nodes: float  # number of nodes per unit of ln r
    table: np.ndarray  # (kinds, nodes, 2): radial and azimuthal part of v*, over v_K
    star: float  # G M
    softening: float
    in_drift: np.ndarray  # (kinds,): fraction of the star's gravity that the drift contains
    polar: bool = False  # whether the drift is in polar coordinates (`kernels/polar/dust.py`)
    # (nodes, 2): surface density to which cells relax, and energy per mass of added gas; empty if cells keep mass.
    reservoir: np.ndarray = np.empty((0, 2))


@jit
def relax(first, last, pos, vel, mass, u, species, area, kind, centre, zones, ahead, dt):
    """Relax the velocities `vel` (n, 2) of the particles `first` to `last` over dt, in place.

    area (n,): areas of cells whose `mass` (n,) relaxes too; empty for particles, and cells that keep their mass.
    u (n,): energies of these cells; empty without an energy equation.

    kind: row of the gas in `zones.table`, or of the first dust population. species (n,): population of each particle,
    which is added to `kind`; empty for gas. centre: (x, y, v_x, v_y) of the centre of the zones. ahead: the time s by
    which velocities are ahead of positions.

    Returns the x and y momentum, the angular momentum and the mass that the particles lose, as limbs (4, LIMBS) of
    exact sums (`kernels/common/totals.py`).
    """
    last_node = zones.table.shape[1] - 1
    limbs, terms = np.zeros((4, LIMBS), np.int64), np.zeros(4)
    bits = terms.view(np.int64)
    for block in range(first, last, MAX_TERMS):
        for i in range(block, min(block + MAX_TERMS, last)):
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
            position = min(max((math.log(r) - zones.first) * zones.nodes, 0.0), float(last_node))
            node = min(int(position), last_node - 1)
            part = position - node
            kepler = math.sqrt(zones.star * r2 / (r2 + zones.softening * zones.softening) ** 1.5)
            radial = kepler * ((1.0 - part) * zones.table[row, node, 0] + part * zones.table[row, node + 1, 0])
            azimuthal = kepler * ((1.0 - part) * zones.table[row, node, 1] + part * zones.table[row, node + 1, 1])
            if zones.polar or zones.in_drift[row] > 0.0:
                v, w = radial - (azimuthal * azimuthal - zones.in_drift[row] * kepler * kepler) * ahead / r, azimuthal
            else:
                sine = min(1.0, max(-1.0, azimuthal / r * ahead))
                cosine = math.sqrt(1.0 - sine * sine)
                # The radial velocity changes r during `ahead`. If r grows by a fraction, the speed falls by half of it.
                around = azimuthal - 0.5 * sine * radial
                v, w = radial * cosine - around * sine, around * cosine + radial * sine
            lost = -math.expm1(-rate * dt)  # fraction of v - v* that is lost
            aim_x, aim_y = centre[2] + v * x - w * y, centre[3] + v * y + w * x
            dx, dy = lost * (vel[i, 0] - aim_x), lost * (vel[i, 1] - aim_y)
            vel[i, 0] -= dx
            vel[i, 1] -= dy
            dx, dy, dm = mass[i] * dx, mass[i] * dy, 0.0
            if len(area) > 0:
                density = (1.0 - part) * zones.reservoir[node, 0] + part * zones.reservoir[node + 1, 0]
                dm = lost * (mass[i] - density * area[i])
                mass[i] -= dm
                if dm < 0.0:
                    dx, dy, added = dx + dm * aim_x, dy + dm * aim_y, -dm / mass[i]
                    vel[i, 0] += added * (aim_x - vel[i, 0])
                    vel[i, 1] += added * (aim_y - vel[i, 1])
                    if len(u) > 0:
                        energy = (1.0 - part) * zones.reservoir[node, 1] + part * zones.reservoir[node + 1, 1]
                        u[i] += added * (energy - u[i])
                else:
                    dx, dy = dx + dm * vel[i, 0], dy + dm * vel[i, 1]
            terms[0], terms[1], terms[2], terms[3] = dx, dy, pos[i, 0] * dy - pos[i, 1] * dx, dm
            for k in range(4):
                add_number(bits[k], limbs[k])
        for k in range(4):
            carry(limbs[k])
    return limbs
