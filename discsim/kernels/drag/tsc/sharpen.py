"""Sharpening: the second-order correction for smoothing by gather and scatter, and the rotation that cancels eq. (4).

Equations: `kernels/drag/tsc/nodes.py`.
"""

from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.kernels.drag.tsc.heat import heat_of, work_of_turn
from discsim.kernels.drag.tsc.nodes import DX, DY, LEAST_INERTIA, ONE, RATE, SPIN, X, Y


@inline_jit
def sharpen_slip(n, s, nodes, change, two_way, value):
    """Add to `value` the part of the changes by the slip of gas and species s that the clouds smoothed away.

    Each of the two clouds has a variance of 1/4 side^2. The correction is a flux through the faces between nodes, in
    proportion to the lesser reduced mass of the two. A uniform change is unaffected, and momentum is exact.
    """
    slip, mass = change.slip, change.mass
    for k in range(1, 9, 2):  # across faces
        other = nodes.about[n, k]
        if other < 0:
            continue
        face = 0.25 * min(mass[n, s], mass[other, s])
        for c in range(2):
            d = face * (slip[n, s, c] - slip[n, 0, c] - slip[other, s, c] + slip[other, 0, c])
            value[n, s, DX + c] += d / nodes.sums[n, s, ONE]
            if two_way:
                value[n, 0, DX + c] -= d / nodes.sums[n, 0, ONE]


@inline_jit
def sharpen_drive(n, s, nodes, change, two_way, value):
    """Add to `value` the part of the changes by sources that the clouds smoothed away.

    The correction is by second differences along each axis: changes linear in space are unaffected.
    """
    drive, sums = change.drive, nodes.sums
    for step in (3, 1):
        low, high = nodes.about[n, 4 - step], nodes.about[n, 4 + step]
        if low < 0 or high < 0 or min(sums[low, 0, ONE], sums[high, 0, ONE]) <= 0.0:
            continue
        if min(sums[low, s, ONE], sums[high, s, ONE]) <= 0.0:
            continue
        for c in range(2):
            d = 2.0 * (drive[n, s, c] - drive[n, 0, c])
            d -= drive[low, s, c] - drive[low, 0, c] + drive[high, s, c] - drive[high, 0, c]
            d *= 0.25 * change.mass[n, s]
            value[n, s, DX + c] += d / sums[n, s, ONE]
            if two_way:
                value[n, 0, DX + c] -= d / sums[n, 0, ONE]


@inline_jit
def sharpen_slope(n, nodes, pooled, out):
    """Write the slope of the velocities at a node, corrected for pooling a curved field over nine cells.

    For a sine wave the fit loses k^2 m_4 / (6 m_2) along the slope, and the mean loses k^2 m_2 / 2 across it. Here
    m_2 = 7/12 and m_4 = 61/80 are the moments of the cells' weights 1/4, 1/2, 1/4.
    """
    sums = nodes.sums
    for a in range(4):
        out[n, a] = pooled[n, a]
    for axis in range(2):
        step = 3 if axis == 0 else 1
        low, high = nodes.about[n, 4 - step], nodes.about[n, 4 + step]
        if low < 0 or high < 0 or min(sums[n, 0, ONE], sums[low, 0, ONE], sums[high, 0, ONE]) <= 0.0:
            continue
        for a in range(4):
            taken = 61.0 / 280.0 if a // 2 == axis else 7.0 / 24.0
            out[n, a] -= taken * (pooled[low, a] - 2.0 * pooled[n, a] + pooled[high, a])


@inline_jit
def spin_of(n, nodes, value):
    """Return the rate of rotation of the gas about its centroid that cancels eq. (4)."""
    m, x, y, torque = nodes.sums[n, 0, ONE], nodes.sums[n, 0, X], nodes.sums[n, 0, Y], 0.0
    if m <= 0.0:
        return 0.0
    inertia = nodes.square[n] - (x * x + y * y) / m
    if inertia < LEAST_INERTIA * m:
        return 0.0
    for s in range(nodes.sums.shape[1]):
        torque += nodes.sums[n, s, X] * value[n, s, DY] - nodes.sums[n, s, Y] * value[n, s, DX]
    return -torque / inertia


@inline_jit
def turn(n, spin, nodes, value):
    """Add the rotation of the gas at node n to `value`: its rate, and its velocity at the node."""
    if spin != 0.0:
        value[n, 0, SPIN] = spin
        value[n, 0, DX] += spin * nodes.sums[n, 0, Y] / nodes.sums[n, 0, ONE]
        value[n, 0, DY] -= spin * nodes.sums[n, 0, X] / nodes.sums[n, 0, ONE]


@jit_no_alloc
def sharpen(node_from, node_to, nodes, pooled, change, two_way, dt, sharp):
    """Write the sharpened changes at each node to `sharp`, as far as this has entries."""
    value = sharp.value
    for n in range(node_from, node_to):
        for s in range(value.shape[1]):
            value[n, s, DX] = change.slip[n, s, 0] + change.drive[n, s, 0]
            value[n, s, DY] = change.slip[n, s, 1] + change.drive[n, s, 1]
            value[n, s, SPIN], value[n, s, RATE] = 0.0, change.rate[n, s]
        for s in range(1, value.shape[1]):
            if change.mass[n, s] > 0.0:
                sharpen_slip(n, s, nodes, change, two_way, value)
                sharpen_drive(n, s, nodes, change, two_way, value)
        sharpen_slope(n, nodes, pooled, sharp.slope)
        spin = spin_of(n, nodes, value) if len(nodes.square) > 0 else 0.0
        if len(sharp.heat) > 0:
            sharp.heat[n] = heat_of(n, nodes, value, dt)
        if len(sharp.turn) > 0:
            work_of_turn(n, spin, nodes, dt, sharp.turn)
        turn(n, spin, nodes, value)
