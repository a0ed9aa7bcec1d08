"""Fourth-order gradient of a field on a uniform grid."""

import numpy as np

from discsim.jit.decorators import jit, jit_subroutine

# Row k has the weights of f at five nodes, for 12 * cell * f' at the k-th of them: fourth order (Fornberg 1988).
_STENCILS = np.array(
    [
        [-25.0, 48.0, -36.0, 16.0, -3.0],
        [-3.0, -10.0, 18.0, -6.0, 1.0],
        [1.0, -8.0, 0.0, 8.0, -1.0],
        [-1.0, 6.0, -18.0, 10.0, 3.0],
        [3.0, -16.0, 36.0, -48.0, 25.0],
    ]
)


@jit_subroutine
def _stencil_start(i, count, periodic):
    """Return the first of the five nodes of the stencil at node i of `count`, and the position of i among the five.

    The stencil is centred on i, but shifted at the edges of an open axis.
    """
    first = i - 2
    if not periodic:
        first = max(0, min(first, count - 5))
    return first, i - first


@jit
def gradient(begin, end, potential, cell, periodic, first_column, end_column, out):
    """Write the gradient of `potential` to `out` (nx, ny, 2), for the rows `begin` to `end`, by stencils of five nodes.

    potential: (nx, ny); stencils are then centred, but shifted at open edges. Along an axis on which it is larger than
    `out` by two nodes at each end, all stencils are centred.

    first_column, end_column (nx,): in row i only the columns first_column[i] to end_column[i] - 1 are written and, if
    the potential is not larger along y, the two columns at each edge.
    """
    nx, ny = potential.shape
    border_x, border = (nx - out.shape[0]) // 2, (ny - out.shape[1]) // 2
    scale = 1.0 / (12.0 * cell)
    a, b = 8.0 * scale, scale
    for i in range(begin, end):
        first, position = _stencil_start(i + border_x, nx, periodic)
        w = _STENCILS[position]
        w0, w1, w2, w3, w4 = scale * w[0], scale * w[1], scale * w[2], scale * w[3], scale * w[4]
        low, high = max(first_column[i] + border - 2, 0), min(end_column[i] + border - 2, ny - 4)
        r0, r1, r2 = potential[first % nx, low:], potential[(first + 1) % nx, low:], potential[(first + 2) % nx, low:]
        r3, r4 = potential[(first + 3) % nx, low:], potential[(first + 4) % nx, low:]
        line, row = potential[i + border_x, low:], out[i, 2 - border + low :]
        for j in range(high - low):  # both components in one loop without negative indices: vectorised
            row[j, 0] = w0 * r0[j + 2] + w1 * r1[j + 2] + w2 * r2[j + 2] + w3 * r3[j + 2] + w4 * r4[j + 2]
            row[j, 1] = a * (line[j + 3] - line[j + 1]) - b * (line[j + 4] - line[j])
        r0, r1, r2 = potential[first % nx], potential[(first + 1) % nx], potential[(first + 2) % nx]
        r3, r4 = potential[(first + 3) % nx], potential[(first + 4) % nx]
        line, row = potential[i + border_x], out[i]
        for edge in range(0 if border else min(4, ny)):
            j = edge if edge < 2 else ny + 1 - edge
            first, position = _stencil_start(j, ny, periodic)
            row[j, 0] = w0 * r0[j] + w1 * r1[j] + w2 * r2[j] + w3 * r3[j] + w4 * r4[j]
            row[j, 1] = 0.0
            for k in range(5):
                row[j, 1] += scale * _STENCILS[position, k] * line[(first + k) % ny]
