"""Smoothing kernels W(r, h) = sigma h^-d w(q), q = r/h, as numba formulas.

Cubic and quintic B-splines M4, M6 (Schoenberg 1946; Monaghan & Lattanzio 1985; Price 2012, eqs. 6 and 8), M6 squeezed
to support h ("quintic-h", M6-h of Stoyanovskaya et al. 2018), Wendland C2 and C4 (Wendland 1995; Dehnen & Aly 2012,
table 1), whose polynomials in one dimension differ from those in two.
"""

from numba import njit

from discsim.formulas.smoothing import SMOOTHING
from discsim.jit.decorators import inline_sums

CUBIC, QUINTIC, QUINTIC_H, WENDLAND_C2, WENDLAND_C4 = range(5)
KERNELS = {name: code for code, name in enumerate(SMOOTHING)}

# For each kernel: radius of the support in h; h over the usual h of the same kernel, which differs for
# "quintic-h"; and <q^2>. NORM[dim - 1] is sigma for each kernel.
SUPPORT = tuple(kernel.support for kernel in SMOOTHING.values())
SQUEEZED = tuple(kernel.squeezed for kernel in SMOOTHING.values())
MEAN_Q2 = tuple(kernel.mean_q[1] for kernel in SMOOTHING.values())
NORM = tuple(tuple(kernel.norm[dim] for kernel in SMOOTHING.values()) for dim in (0, 1))


# w(q), dw/dq and d2w/dq2 of the cubic kernel are the values that `cubic` returns, times these factors.
CUBIC_FACTORS = 0.25, -0.75, 1.5


@njit(inline="always")
def cubic(q):
    """Return w(q), dw/dq and d2w/dq2 of the cubic kernel, each divided by its entry of CUBIC_FACTORS.

    The results are (2 - q)^k - 4 (1 - q)^k for k = 3, 2, 1, with powers of negative numbers set to 0.
    """
    a, b = max(0.0, 2.0 - q), max(0.0, 1.0 - q)
    a2, b2 = a * a, 4.0 * b * b
    return a2 * a - b2 * b, a2 - b2, a - 4.0 * b


@njit(inline="always")
def shape(kernel, dim, q):
    """Return w(q) and dw/dq of a kernel. `kernel` and `dim` are compile-time constants, so one branch is compiled."""
    if kernel == CUBIC:
        w, dw, _ = cubic(q)
        return CUBIC_FACTORS[0] * w, CUBIC_FACTORS[1] * dw
    if kernel == WENDLAND_C2:
        t = max(0.0, 1.0 - 0.5 * q)
        if dim == 1:
            return t * t * t * (1.5 * q + 1.0), -3.0 * q * t * t
        return t * t * t * t * (2.0 * q + 1.0), -5.0 * q * t * t * t
    if kernel == WENDLAND_C4:
        t = max(0.0, 1.0 - 0.5 * q)
        t4 = t * t * t * t
        if dim == 1:
            return t4 * t * (2.0 * q * q + 2.5 * q + 1.0), -3.5 * q * t4 * (2.0 * q + 1.0)
        return t4 * t * t * (35.0 / 12.0 * q * q + 3.0 * q + 1.0), -14.0 / 3.0 * q * t4 * t * (2.5 * q + 1.0)
    scale = 3.0 if kernel == QUINTIC_H else 1.0
    s = scale * q
    a, b, c = max(0.0, 3.0 - s), max(0.0, 2.0 - s), max(0.0, 1.0 - s)
    a4, b4, c4 = a * a * a * a, b * b * b * b, c * c * c * c
    return a4 * a - 6.0 * b4 * b + 15.0 * c4 * c, scale * (-5.0 * a4 + 30.0 * b4 - 75.0 * c4)


@njit(inline="always")
def curvature(kernel, dim, q):
    """Return the second derivative d2w/dq2 of a kernel."""
    if kernel == CUBIC:
        _, _, ddw = cubic(q)
        return CUBIC_FACTORS[2] * ddw
    if kernel == WENDLAND_C2:
        t = max(0.0, 1.0 - 0.5 * q)
        return 3.0 * t * (1.5 * q - 1.0) if dim == 1 else 5.0 * t * t * (2.0 * q - 1.0)
    if kernel == WENDLAND_C4:
        t = max(0.0, 1.0 - 0.5 * q)
        if dim == 1:
            return 3.5 * t * t * t * (6.0 * q * q - 1.5 * q - 1.0)
        return 14.0 / 3.0 * t * t * t * t * (8.75 * q * q - 2.0 * q - 1.0)
    scale = 3.0 if kernel == QUINTIC_H else 1.0
    s = scale * q
    a, b, c = max(0.0, 3.0 - s), max(0.0, 2.0 - s), max(0.0, 1.0 - s)
    return scale * scale * (20.0 * a * a * a - 120.0 * b * b * b + 300.0 * c * c * c)


@inline_sums
def scaled_shape(kernel, dim, q):
    """Return w(q), dw/dq and d2w/dq2, each divided by its entry of `shape_factors(kernel)`.

    Callers multiply their sums by these factors at the end.
    """
    if kernel == CUBIC:
        return cubic(q)
    w, dw = shape(kernel, dim, q)
    return w, dw, curvature(kernel, dim, q)


@inline_sums
def shape_factors(kernel):
    """Return the factors by which sums of `scaled_shape` are multiplied."""
    return CUBIC_FACTORS if kernel == CUBIC else (1.0, 1.0, 1.0)
