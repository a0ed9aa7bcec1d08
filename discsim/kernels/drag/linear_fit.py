"""Means, second moments and linear fits of the velocities of the particles in a block (`kernels/drag/cells.py`)."""

from discsim.jit.decorators import INLINE, cached_njit, inline_jit, jit_subroutine
from discsim.jit.index import index

# The compiler may reorder the sums in these functions, and so vectorise them. The functions are always inlined: a
# process that compiles a function and a process that loads it could otherwise call different copies of a callee, and
# their results differ in the last bits.
inline_reordered = cached_njit(fastmath={"reassoc", "contract", "nsz"}, **INLINE)
# Blocks are many and small. To make, slice or pass a scratch array costs as much as the work on ten particles. There
# are therefore few such arrays, made once for all blocks. Loops over particles have unsigned indices, as numba wraps
# negative ones, which prevents vectorisation.
#
# Rows of the packed particles `p` of a block: position from the corner of the block, velocity, source and mass.
X, Y, VX, VY, BX, BY, MASS, ROWS = range(8)
# Columns of `o`, which has a row for each species in a block and a last row for all species: centroid (2), mean
# velocity (2), mean source (2) and mass, with the same names as above; second moments about these means, of position
# with position (xx, xy, yy), with velocity and with source (xx, xy, yx, yy each); slopes of velocity and of source (4
# each); changes of the mean velocity (2) and of the slope (4).
PLACE, VELOCITY, SOURCE = X, VX, BX
INERTIA, MOMENT, MOMENT_SOURCE, SLOPE, SLOPE_SOURCE, CHANGE, SLOPE_CHANGE, COLUMNS = 7, 10, 14, 18, 22, 26, 28, 32


@jit_subroutine
def clip01(x):
    """Return x limited to the range from 0 to 1."""
    return min(max(x, 0.0), 1.0)


@inline_reordered
def mean_square(p, first, last, x0, y0):
    """Return the mean squared distance of packed particles from the star; the corner of the block is at (x0, y0)."""
    total = 0.0
    for k in range(index(first), index(last)):
        x, y = p[X, k] + x0, p[Y, k] + y0
        total += x * x + y * y
    return total / (last - first)


@inline_reordered
def mass_and_means(p, first, last, f, o, s):
    """Write to `o` the mass of species s, and the mass-weighted means of the rows f and f + 1 of its particles."""
    mass, u, v = 0.0, 0.0, 0.0
    for k in range(index(first), index(last)):
        m = p[MASS, k]
        mass += m
        u += m * p[f, k]
        v += m * p[f + 1, k]
    o[s, MASS] = mass
    o[s, f], o[s, f + 1] = (u / mass, v / mass) if mass > 0.0 else (0.0, 0.0)


@inline_reordered
def second_moments(p, first, last, o, s):
    """Write the second moments of position with position and with velocity of species s to `o`, about its means."""
    x0, y0, u0, v0 = o[s, X], o[s, Y], o[s, VX], o[s, VY]
    xx, xy, yy, xu, xv, yu, yv = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(index(first), index(last)):
        m, x, y, u, v = p[MASS, k], p[X, k] - x0, p[Y, k] - y0, p[VX, k] - u0, p[VY, k] - v0
        mx, my = m * x, m * y
        xx += mx * x
        xy += mx * y
        yy += my * y
        xu += mx * u
        xv += mx * v
        yu += my * u
        yv += my * v
    o[s, INERTIA], o[s, INERTIA + 1], o[s, INERTIA + 2] = xx, xy, yy
    o[s, MOMENT], o[s, MOMENT + 1], o[s, MOMENT + 2], o[s, MOMENT + 3] = xu, xv, yu, yv


@inline_reordered
def moments_of_source(p, first, last, o, s):
    """Write the second moments of position with source of species s to `o`, about its means."""
    x0, y0, a0, b0 = o[s, X], o[s, Y], o[s, BX], o[s, BY]
    xa, xb, ya, yb = 0.0, 0.0, 0.0, 0.0
    for k in range(index(first), index(last)):
        mx, my, a, b = p[MASS, k] * (p[X, k] - x0), p[MASS, k] * (p[Y, k] - y0), p[BX, k] - a0, p[BY, k] - b0
        xa += mx * a
        xb += mx * b
        ya += my * a
        yb += my * b
    o[s, MOMENT_SOURCE], o[s, MOMENT_SOURCE + 1], o[s, MOMENT_SOURCE + 2], o[s, MOMENT_SOURCE + 3] = xa, xb, ya, yb


@inline_jit
def solve(xx, xy, yy, xu, xv, yu, yv, dim, factor):
    """Return (found, a, b, c, d) with [a b; c d] = factor [xx xy; xy yy]^-1 [xu xv; yu yv], the slope of a linear fit.

    xx, xy, yy: second moments of position. xu, xv, yu, yv: moments of position with the fitted vector. found: False if
    the particles are too nearly at a point, or in two dimensions on a line; the slope is then 0.
    """
    if dim == 1:
        return (True, factor * xu / xx, 0.0, 0.0, 0.0) if xx > 0.0 else (False, 0.0, 0.0, 0.0, 0.0)
    det, trace = xx * yy - xy * xy, xx + yy
    if det <= 1e-3 * trace * trace:
        return False, 0.0, 0.0, 0.0, 0.0
    factor /= det
    return (
        True, factor * (yy * xu - xy * yu), factor * (yy * xv - xy * yv),
        factor * (xx * yu - xy * xu), factor * (xx * yv - xy * xv),
    )  # fmt: skip


@inline_jit
def solve_columns(o, s, xx, xy, yy, f, out, dim, factor):
    """Apply `solve` to the four moments from o[s, f] on, and write the four numbers of the slope from o[s, out] on.

    Returns `found` of `solve`. factor: as in `solve`.
    """
    found, o[s, out], o[s, out + 1], o[s, out + 2], o[s, out + 3] = solve(
        xx, xy, yy, o[s, f], o[s, f + 1], o[s, f + 2], o[s, f + 3], dim, factor
    )
    return found


@jit_subroutine
def fit_species(o, s, dim, fade):
    """Fit the slopes of velocity and source of species s, write them, times `fade`, to row s of `o`; return `fade`.

    Without a fit the slopes and the result are 0.
    """
    xx, xy, yy = o[s, INERTIA], o[s, INERTIA + 1], o[s, INERTIA + 2]
    if fade > 0.0 and solve_columns(o, s, xx, xy, yy, MOMENT, SLOPE, dim, fade):
        solve_columns(o, s, xx, xy, yy, MOMENT_SOURCE, SLOPE_SOURCE, dim, fade)
        return fade
    for f in range(SLOPE, CHANGE):
        o[s, f] = 0.0
    return 0.0


@jit_subroutine
def fit_slopes(bound, dim, two_way, o):
    """Write the slopes of velocity and source to `o`: of each species, and in the last row pooled over all species.

    With one-way drag the pooled slopes are those of the gas. Slopes fade in with the number of particles: a species
    with few particles has a mean of its own and the pooled slopes. bound (n + 1,): first packed particle of each
    species.
    """
    n = len(bound) - 1
    freedom = 0
    for f in range(INERTIA, SLOPE):
        o[n, f] = 0.0
    for s in range(n if two_way else 1):
        freedom += max(bound[s + 1] - bound[s] - 1, 0)
        for f in range(INERTIA, SLOPE):
            o[n, f] += o[s, f]
    fit_species(o, n, dim, clip01((freedom - dim) / (3.0 * dim)))
    for s in range(n):
        fade = fit_species(o, s, dim, clip01((bound[s + 1] - bound[s] - 1.0 - dim) / (2.0 * dim)))
        if fade < 1.0:
            for f in range(SLOPE, CHANGE):
                o[s, f] += (1.0 - fade) * o[n, f]
