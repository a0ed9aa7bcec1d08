"""Anti-diffusion: second-order correction for the smoothing by gather and scatter, and the rotation for eq. (4).

Gather and scatter with TSC weights smooth the velocity changes. These functions add the part that the smoothing
removes, to second order in the side of the cells. The equations are in `nodes.py`.
"""

from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.kernels.drag.tsc.heat import node_heat, write_rotation
from discsim.kernels.drag.tsc.nodes import DX, DY, LEAST_INERTIA, ONE, RATE, SPIN, X, Y


@inline_jit
def restore_slip(n, s, nodes, change, two_way, value):
    """Correct `value` at node n for the smoothing of velocity changes due to the slip of gas and species s.

    Gather and scatter each smooth with a variance of side^2 / 4. The correction is a flux through the faces between
    node n and its neighbours, in proportion to the smaller reduced mass of the two nodes. Uniform changes are not
    altered, and momentum is exact.
    """
    slip, mass = change.slip, change.mass
    for k in range(1, 9, 2):  # across faces
        other = nodes.stencil[n, k]
        if other < 0:
            continue
        face = 0.25 * min(mass[n, s], mass[other, s])
        for c in range(2):
            d = face * (slip[n, s, c] - slip[n, 0, c] - slip[other, s, c] + slip[other, 0, c])
            value[n, s, DX + c] += d / nodes.sums[n, s, ONE]
            if two_way:
                value[n, 0, DX + c] -= d / nodes.sums[n, 0, ONE]


@inline_jit
def restore_drive(n, s, nodes, change, two_way, value):
    """Correct `value` at node n for the smoothing of velocity changes due to sources of gas and species s.

    The correction is by second differences along each axis, so that changes linear in space are not altered.
    """
    drive, sums = change.drive, nodes.sums
    for step in (3, 1):
        low, high = nodes.stencil[n, 4 - step], nodes.stencil[n, 4 + step]
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
def restore_slope(n, nodes, pooled, out):
    """Write to out[n] the slope of the velocity at node n, corrected for the fit of a curved field over nine cells.

    pooled (nodes, 4): fitted slopes. For a sine wave the fit loses k^2 m_4 / (6 m_2) along the slope, and the mean
    loses k^2 m_2 / 2 across it. m_2 = 7/12 and m_4 = 61/80 are the moments of the weights 1/4, 1/2, 1/4 of the cells.
    """
    sums = nodes.sums
    for a in range(4):
        out[n, a] = pooled[n, a]
    for axis in range(2):
        step = 3 if axis == 0 else 1
        low, high = nodes.stencil[n, 4 - step], nodes.stencil[n, 4 + step]
        if low < 0 or high < 0 or min(sums[n, 0, ONE], sums[low, 0, ONE], sums[high, 0, ONE]) <= 0.0:
            continue
        for a in range(4):
            lost = 61.0 / 280.0 if a // 2 == axis else 7.0 / 24.0
            out[n, a] -= lost * (pooled[low, a] - 2.0 * pooled[n, a] + pooled[high, a])


@inline_jit
def cancelling_rotation(n, nodes, value):
    """Return the angular velocity that the gas at node n needs about its centroid to compensate the torque of eq. (4).

    The result is 0 if there is too little gas.
    """
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
def add_rotation(n, omega, nodes, value):
    """Add the rotation of the gas at node n to `value`: the angular velocity `omega`, and the velocity at the node."""
    if omega != 0.0:
        value[n, 0, SPIN] = omega
        value[n, 0, DX] += omega * nodes.sums[n, 0, Y] / nodes.sums[n, 0, ONE]
        value[n, 0, DY] -= omega * nodes.sums[n, 0, X] / nodes.sums[n, 0, ONE]


@jit_no_alloc
def restore(node_from, node_to, nodes, pooled, change, two_way, dt, impulse):
    """Write the changes at nodes, corrected for smoothing, to `impulse`.

    `impulse.heat` and `impulse.rotation` are written only if these arrays have entries. pooled (nodes, 4): fitted
    slopes of the velocity. change: `DragChanges`.
    """
    value = impulse.value
    for n in range(node_from, node_to):
        for s in range(value.shape[1]):
            value[n, s, DX] = change.slip[n, s, 0] + change.drive[n, s, 0]
            value[n, s, DY] = change.slip[n, s, 1] + change.drive[n, s, 1]
            value[n, s, SPIN], value[n, s, RATE] = 0.0, change.rate[n, s]
        for s in range(1, value.shape[1]):
            if change.mass[n, s] > 0.0:
                restore_slip(n, s, nodes, change, two_way, value)
                restore_drive(n, s, nodes, change, two_way, value)
        restore_slope(n, nodes, pooled, impulse.slope)
        omega = cancelling_rotation(n, nodes, value) if len(nodes.square) > 0 else 0.0
        if len(impulse.heat) > 0:
            impulse.heat[n] = node_heat(n, nodes, value, dt)
        if len(impulse.rotation) > 0:
            write_rotation(n, omega, nodes, dt, impulse.rotation)
        add_rotation(n, omega, nodes, value)
