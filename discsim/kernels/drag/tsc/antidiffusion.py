"""Anti-diffusion: second-order correction for the smoothing by gather and scatter, and the rotation for eq. (4).

Gather and scatter with TSC weights smooth the velocity changes. These functions add the part that the smoothing
removes, to second order in the side of the cells. The equations are in `nodes.py`.
"""

from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.kernels.drag.tsc.heat import node_heat, write_rotation
from discsim.kernels.drag.tsc.nodes import DX, DY, LEAST_INERTIA, ONE, RATE, SPIN, X, Y


@inline_jit
def clip(value, largest):
    """Return `value`, with its absolute value limited to `largest`."""
    return min(max(value, -largest), largest)


@inline_jit
def relative_change(of, n, s, c):
    """Return the absolute change of the velocity of species s relative to the gas at node n, component c."""
    return abs(of[n, s, c] - of[n, 0, c])


@inline_jit
def restore_slip(n, s, nodes, change, two_way, value):
    """Correct `value` at node n for the smoothing of velocity changes of species s due to its slip.

    Gather and scatter each smooth with a variance of side^2 / 4. The correction of the dust is a flux through the faces
    between node n and its neighbours. It takes the momentum from the gas at the same node. Uniform changes are not
    altered.
    """
    slip, reduced, sums = change.slip, change.mass, nodes.sums
    for k in range(1, 9, 2):  # across faces
        other = nodes.stencil[n, k]
        if other < 0:
            continue
        face, limit = 0.25 * min(sums[n, s, ONE], sums[other, s, ONE]), 0.25 * min(reduced[n, s], reduced[other, s])
        for c in range(2):
            largest = limit * (relative_change(slip, n, s, c) + relative_change(slip, other, s, c))
            d = clip(face * (slip[n, s, c] - slip[other, s, c]), largest)
            value[n, s, DX + c] += d / sums[n, s, ONE]
            if two_way:
                value[n, 0, DX + c] -= d / sums[n, 0, ONE]


@inline_jit
def restore_drive(n, s, nodes, change, two_way, value):
    """Correct `value` at node n for the smoothing of velocity changes of species s due to sources, as `restore_slip`.

    The correction is by second differences along each axis, so that changes linear in space are not altered.
    """
    drive, sums, limit = change.drive, nodes.sums, 0.25 * change.mass[n, s]
    for step in (3, 1):
        low, high = nodes.stencil[n, 4 - step], nodes.stencil[n, 4 + step]
        if low < 0 or high < 0 or min(sums[low, 0, ONE], sums[high, 0, ONE]) <= 0.0:
            continue
        if min(sums[low, s, ONE], sums[high, s, ONE]) <= 0.0:
            continue
        for c in range(2):
            largest = 2.0 * relative_change(drive, n, s, c)
            largest = limit * (largest + relative_change(drive, low, s, c) + relative_change(drive, high, s, c))
            d = 2.0 * drive[n, s, c] - (drive[low, s, c] + drive[high, s, c])
            d = clip(0.25 * sums[n, s, ONE] * d, largest)
            value[n, s, DX + c] += d / sums[n, s, ONE]
            if two_way:
                value[n, 0, DX + c] -= d / sums[n, 0, ONE]


@inline_jit
def displaced_momentum(n, other, c, nodes, change):
    """Return the momentum that smoothing moves from the gas at node n to another node, eq. (5) of `nodes.py`."""
    slip, drive, sums, reduced = change.slip, change.drive, nodes.sums, change.mass
    moved, largest = 0.0, 0.0
    of_gas = (slip[n, 0, c] + drive[n, 0, c]) + (slip[other, 0, c] + drive[other, 0, c])
    moved += 0.125 * (sums[other, 0, ONE] - sums[n, 0, ONE]) * of_gas
    for s in range(1, sums.shape[1]):
        of_dust = (slip[n, s, c] + drive[n, s, c]) + (slip[other, s, c] + drive[other, s, c])
        moved += 0.125 * (sums[other, s, ONE] - sums[n, s, ONE]) * of_dust
        at_n, at_other = relative_change(slip, n, s, c), relative_change(slip, other, s, c)
        at_n += relative_change(drive, n, s, c)
        at_other += relative_change(drive, other, s, c)
        largest += 0.25 * min(reduced[n, s], reduced[other, s]) * min(at_n, at_other)
    return clip(moved, largest)


@inline_jit
def return_displaced_momentum(n, nodes, change, motion, value):
    """Return to the gas at node n the momentum that smoothing moved to its neighbours; return (torque, energy).

    torque: half of the torque of this transfer. energy: energy that the transfer carries, with the velocity of the gas
    at the faces; 0 if `motion` is empty. motion (2, nodes): mean velocity of the gas near each node.
    """
    torque, energy, gas = 0.0, 0.0, nodes.sums[n, 0, ONE]
    if gas <= 0.0:
        return torque, energy
    for k in range(1, 9, 2):  # across faces
        other, i, j = nodes.stencil[n, k], k // 3 - 1.0, k % 3 - 1.0
        if other < 0 or nodes.sums[other, 0, ONE] <= 0.0:
            continue
        x, y = displaced_momentum(n, other, 0, nodes, change), displaced_momentum(n, other, 1, nodes, change)
        value[n, 0, DX] += x / gas
        value[n, 0, DY] += y / gas
        torque -= 0.5 * (i * y - j * x)
        if motion.shape[1] > 0:
            energy += 0.5 * (x * (motion[0, n] + motion[0, other]) + y * (motion[1, n] + motion[1, other]))
    return torque, energy


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
def cancelling_rotation(n, nodes, value, torque):
    """Return the angular velocity that the gas at node n needs about its centroid to compensate `torque` and eq. (4).

    The result is 0 if there is too little gas.
    """
    m, x, y = nodes.sums[n, 0, ONE], nodes.sums[n, 0, X], nodes.sums[n, 0, Y]
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
def restore(node_from, node_to, nodes, pooled, change, motion, two_way, dt, impulse):
    """Write the changes at nodes, corrected for smoothing, to `impulse`.

    `impulse.heat` and `impulse.rotation` are written only if these arrays have entries. pooled (nodes, 4): fitted
    slopes of the velocity. change: `DragChanges`. motion: as in `return_displaced_momentum`, needed with heating.
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
        torque, energy = return_displaced_momentum(n, nodes, change, motion, value) if two_way else (0.0, 0.0)
        omega = cancelling_rotation(n, nodes, value, torque) if len(nodes.square) > 0 else 0.0
        if len(impulse.heat) > 0:
            impulse.heat[n] = node_heat(n, nodes, value, dt) + energy
        if len(impulse.rotation) > 0:
            write_rotation(n, omega, nodes, dt, impulse.rotation)
        add_rotation(n, omega, nodes, value)
