"""Slopes at a node (`kernels/drag/tsc/nodes.py`), of velocities pooled within species and of each species' sources."""

from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.kernels.common.simd import LANES, extract, load, zeros
from discsim.kernels.drag.lines import solve
from discsim.kernels.drag.tsc.grains import moments_within
from discsim.kernels.drag.tsc.nodes import BX, FIELDS, LEAST_INERTIA, ONE, VX, XX, XY, YX, YY, X, Y

ROUNDING = 1e-9  # over mass times side^2: inertia of coincident particles, by rounding


@inline_jit
def moments_about(n, s, near, slot, own):
    """Return the moments of a species in the nine cells about a node; nearer cells have larger weights.

    These are mass, second moments of position (xx, xy, yy), and two vectors: the moments of x and of y with velocity
    and source.
    """
    mass, by_x, by_y, ii, ij, jj = zeros(), zeros(), zeros(), 0.0, 0.0, 0.0
    shift_x, shift_y, motion, along, across = zeros(), zeros(), zeros(), zeros(), zeros()
    for k in range(9):
        block = near[n, k]
        cell = slot[block, s] if block >= 0 else -1
        if cell < 0:
            continue
        # Relative to the node, which lies at (-i, -j) from the cell's centre.
        i, j, at = k // 3 - 1.0, k % 3 - 1.0, cell * 3 * FIELDS
        w = (0.5 if i == 0.0 else 0.25) * (0.5 if j == 0.0 else 0.25)
        row, moves = w * load(own, at), w * load(own, at + LANES)
        mass += row
        by_x += w * load(own, at + FIELDS)
        by_y += w * load(own, at + 2 * FIELDS)
        shift_x += i * row
        shift_y += j * row
        motion += moves
        along += w * load(own, at + FIELDS + LANES) + i * moves
        across += w * load(own, at + 2 * FIELDS + LANES) + j * moves
        ii += i * i * extract(row, ONE)
        ij += i * j * extract(row, ONE)
        jj += j * j * extract(row, ONE)
    m = extract(mass, ONE)
    if m <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, zeros(), zeros()
    x, y = (extract(mass, X) + extract(shift_x, ONE)) / m, (extract(mass, Y) + extract(shift_y, ONE)) / m
    xx = extract(by_x, X) + 2.0 * extract(shift_x, X) + ii - m * x * x
    xy = extract(by_x, Y) + extract(shift_x, Y) + extract(shift_y, X) + ij - m * x * y
    yy = extract(by_y, Y) + 2.0 * extract(shift_y, Y) + jj - m * y * y
    return m, xx, xy, yy, along - x * motion, across - y * motion


@inline_jit
def slope_of(mass, xx, xy, yy, along, across, f, dim):
    """Return whether lanes f and f + 1 have a slope, and this slope, 0 where there is none."""
    if xx + yy <= ROUNDING * mass:
        return False, 0.0, 0.0, 0.0, 0.0
    return solve(
        xx, xy, yy, extract(along, f), extract(along, f + 1), extract(across, f), extract(across, f + 1), dim, 1.0
    )


@inline_jit
def fit_node(n, cells, nodes, dim, two_way, sourced, slopes):
    mass, xx, xy, yy, along, across = 0.0, 0.0, 0.0, 0.0, zeros(), zeros()
    grains = len(cells.total) > 0  # grains taken one by one have no sources
    for s in range(1 if grains else nodes.sums.shape[1]):
        if not (s == 0 or two_way or sourced[s]):
            continue
        m, ixx, ixy, iyy, by_x, by_y = moments_about(n, s, nodes.near, cells.slot, cells.own)
        if s == 0 or two_way:
            mass, xx, xy, yy = mass + m, xx + ixx, xy + ixy, yy + iyy
            along += by_x
            across += by_y
        if sourced[s]:
            found, uu, uv, vu, vv = slope_of(m, ixx, ixy, iyy, by_x, by_y, BX - VX, dim)
            slopes.known[n, s] = found and ixx + iyy > LEAST_INERTIA * m
            slopes.source[n, s, XX], slopes.source[n, s, XY] = uu, uv
            slopes.source[n, s, YX], slopes.source[n, s, YY] = vu, vv
    if grains and two_way:
        m, ixx, ixy, iyy, by_x, by_y = moments_within(n, nodes.near, cells.slot, cells.own, cells.total)
        mass, xx, xy, yy = mass + m, xx + ixx, xy + ixy, yy + iyy
        along += by_x
        across += by_y
    if nodes.sums[n, 0, ONE] <= 0.0:
        xx, yy = 0.0, 0.0
    _, uu, uv, vu, vv = slope_of(mass, xx, xy, yy, along, across, 0, dim)
    slopes.pooled[n, XX], slopes.pooled[n, XY], slopes.pooled[n, YX], slopes.pooled[n, YY] = uu, uv, vu, vv


@jit_no_alloc
def fit(node_from, node_to, cells, nodes, dim, two_way, sourced, slopes):
    """Fit the slopes at nodes, of velocities and of the sources of species that have any.

    Velocities have a slope where there is gas; for one-way drag it is that of the gas alone.
    """
    for n in range(node_from, node_to):
        fit_node(n, cells, nodes, dim, two_way, sourced, slopes)
