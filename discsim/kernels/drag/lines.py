"""Means, second moments and linear fits of the velocities of the particles of a block (`kernels/drag/cells.py`)."""

from discsim.jit.decorators import INLINE, inline_jit, jit_subroutine, kept
from discsim.jit.index import index

# Sums within a block take any order, so that they are vectorised. Functions with such sums are always inlined: a
# process that compiles would otherwise call another copy than one that loads, and differ in the last bits.
fast = kept(fastmath={"reassoc", "contract", "nsz"}, **INLINE)
# Blocks are many and small. Scratch arrays are few and made once for all blocks: to make, slice or pass one costs as
# much as the work on ten particles. Loops over particles have unsigned indices: numba wraps negative ones, which
# prevents vectorisation.
#
# Rows of the packed particles of a block: position from its corner, velocity, source and mass.
X, Y, VX, VY, BX, BY, MASS, ROWS = range(8)
# Columns of the quantities of a species in a block, and of all species in the last row: mass, centroid (2), mean
# velocity (2) and mean source (2), with the same names as above; second moments about these, of position (xx, xy, yy),
# of position with velocity and with source (x, x; x, y; y, x; y, y); slopes of velocity and source; changes of the mean
# and of the slope.
PLACE, VELOCITY, SOURCE = X, VX, BX
INERTIA, MOMENT, MOMENT_SOURCE, SLOPE, SLOPE_SOURCE, CHANGE, SLOPE_CHANGE, NUMBERS = 7, 10, 14, 18, 22, 26, 28, 32


@jit_subroutine
def clip01(x):
    return min(max(x, 0.0), 1.0)


@fast
def mean_square(p, first, last, x0, y0):
    """Return the mean squared distance from the origin; the corner of the block is at (x0, y0)."""
    total = 0.0
    for k in range(index(first), index(last)):
        x, y = p[X, k] + x0, p[Y, k] + y0
        total += x * x + y * y
    return total / (last - first)


@fast
def means(p, first, last, f, o, s):
    """Compute the mass of species s, and its mass-weighted means of the rows f and f + 1."""
    mass, u, v = 0.0, 0.0, 0.0
    for k in range(index(first), index(last)):
        m = p[MASS, k]
        mass += m
        u += m * p[f, k]
        v += m * p[f + 1, k]
    o[s, MASS] = mass
    o[s, f], o[s, f + 1] = (u / mass, v / mass) if mass > 0.0 else (0.0, 0.0)


@fast
def second_moments(p, first, last, o, s):
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


@fast
def moments_of_source(p, first, last, o, s):
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
    """Return whether particles with second moments xx, xy, yy span the space of `dim` dimensions, and
    factor [xx xy; xy yy]^-1 [xu xv; yu yv], row by row; zeros if they lie too nearly on a point or a line.
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
def solve_in(o, s, xx, xy, yy, f, out, dim, factor):
    """Apply `solve` to the four numbers from o[s, f] on, and write its result from o[s, out] on."""
    found, o[s, out], o[s, out + 1], o[s, out + 2], o[s, out + 3] = solve(
        xx, xy, yy, o[s, f], o[s, f + 1], o[s, f + 2], o[s, f + 3], dim, factor
    )
    return found


@jit_subroutine
def fit_line(o, s, dim, fade):
    """Fit slopes of velocity and source, times `fade`, and return `fade`; without a fit slopes and result are 0."""
    xx, xy, yy = o[s, INERTIA], o[s, INERTIA + 1], o[s, INERTIA + 2]
    if fade > 0.0 and solve_in(o, s, xx, xy, yy, MOMENT, SLOPE, dim, fade):
        solve_in(o, s, xx, xy, yy, MOMENT_SOURCE, SLOPE_SOURCE, dim, fade)
        return fade
    for f in range(SLOPE, CHANGE):
        o[s, f] = 0.0
    return 0.0


@jit_subroutine
def fit_slopes(bound, dim, two_way, o):
    """Fit slopes of velocity and source: for each species, and pooled within species (gas alone for one-way drag).

    Slopes fade in with the number of particles; a species with too few particles takes the pooled slopes.
    """
    n = len(bound) - 1
    freedom = 0
    for f in range(INERTIA, SLOPE):
        o[n, f] = 0.0
    for s in range(n if two_way else 1):
        freedom += max(bound[s + 1] - bound[s] - 1, 0)
        for f in range(INERTIA, SLOPE):
            o[n, f] += o[s, f]
    fit_line(o, n, dim, clip01((freedom - dim) / (3.0 * dim)))
    for s in range(n):
        fade = fit_line(o, s, dim, clip01((bound[s + 1] - bound[s] - 1.0 - dim) / (2.0 * dim)))
        if fade < 1.0:
            for f in range(SLOPE, CHANGE):
                o[s, f] += (1.0 - fade) * o[n, f]
