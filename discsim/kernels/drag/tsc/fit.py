"""Slopes at nodes (`nodes.py`): of the velocities of all species together, and of the sources of each species."""

from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.kernels.common.simd import LANES, extract, load, zeros
from discsim.kernels.drag.linear_fit import solve
from discsim.kernels.drag.tsc.grains import moments_within
from discsim.kernels.drag.tsc.nodes import BX, FIELDS, LEAST_INERTIA, ONE, VX, XX, XY, YX, YY, X, Y
from discsim.kernels.drag.tsc.weights import slope_weight

ROUNDING = 1e-9  # inertia over mass times side^2 that is only rounding, of coincident particles


@inline_jit
def moments_about(n, s, node_cells, species_row, moments):
    """Return six moments of a species in the nine cells about node n, about the centroid of the species.

    The moments are the mass, the second moments of position xx, xy and yy, and two vectors: the moments of x, and of
    y, with velocity and source. Nearer cells have larger weights.
    """
    mass, by_x, by_y, ii, ij, jj = zeros(), zeros(), zeros(), 0.0, 0.0, 0.0
    shift_x, shift_y, motion, along, across = zeros(), zeros(), zeros(), zeros(), zeros()
    for k in range(9):
        block = node_cells[n, k]
        cell = species_row[block, s] if block >= 0 else -1
        if cell < 0:
            continue
        # Relative to the node, which lies at (-i, -j) from the cell's centre.
        i, j, at, w = k // 3 - 1.0, k % 3 - 1.0, cell * 3 * FIELDS, slope_weight(k)
        row, moves = w * load(moments, at), w * load(moments, at + LANES)
        mass += row
        by_x += w * load(moments, at + FIELDS)
        by_y += w * load(moments, at + 2 * FIELDS)
        shift_x += i * row
        shift_y += j * row
        motion += moves
        along += w * load(moments, at + FIELDS + LANES) + i * moves
        across += w * load(moments, at + 2 * FIELDS + LANES) + j * moves
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
    """Return (found, uu, uv, vu, vv), the slope of the lanes f and f + 1 from the moments of `moments_about`.

    The slope is 0 if particles are too few, or nearly at a point.
    """
    if xx + yy <= ROUNDING * mass:
        return False, 0.0, 0.0, 0.0, 0.0
    return solve(
        xx, xy, yy, extract(along, f), extract(along, f + 1), extract(across, f), extract(across, f + 1), dim, 1.0
    )


@jit_no_alloc
def fit(node_from, node_to, cells, nodes, dim, two_way, sourced, slopes):
    """Write the slopes at nodes to `slopes`: of velocities, and of the sources of species that are `sourced`.

    Velocities have a slope at nodes with gas. With one-way drag it is the slope of the gas alone.
    """
    for n in range(node_from, node_to):
        mass, xx, xy, yy, along, across = 0.0, 0.0, 0.0, 0.0, zeros(), zeros()
        grains = len(cells.dust_moments) > 0  # then nodes sum single grains, which have no sources
        for s in range(1 if grains else nodes.sums.shape[1]):
            if not (s == 0 or two_way or sourced[s]):
                continue
            m, ixx, ixy, iyy, by_x, by_y = moments_about(n, s, nodes.node_cells, cells.species_row, cells.moments)
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
            m, ixx, ixy, iyy, by_x, by_y = moments_within(
                n, nodes.node_cells, cells.species_row, cells.moments, cells.dust_moments
            )
            mass, xx, xy, yy = mass + m, xx + ixx, xy + ixy, yy + iyy
            along += by_x
            across += by_y
        if nodes.sums[n, 0, ONE] <= 0.0:
            xx, yy = 0.0, 0.0
        _, uu, uv, vu, vv = slope_of(mass, xx, xy, yy, along, across, 0, dim)
        slopes.pooled[n, XX], slopes.pooled[n, XY], slopes.pooled[n, YX], slopes.pooled[n, YY] = uu, uv, vu, vv
