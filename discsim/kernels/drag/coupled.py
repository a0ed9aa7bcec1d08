"""Exact relaxation of gas and several dust populations: the exponential of their coupling as a sum over poles.

With z_j = dt / t_j and e_j = M_j / M_g, eq. (1) of `kernels/drag/cells.py` damps the slips Y from the gas at the rate
A Y / dt,

    (A Y)_j = z_j Y_j + sum_i e_i z_i Y_i,

so drag changes the slips by f(A) Y + g(A) B dt, with the differences B of the sources (accelerations of one species
alone), f(z) = exp(-z) - 1 and g(z) = -f(z) / z - 1. The change by B alone without drag, B dt, is not included. For any
z >= 0, f and g are, to relative errors of 2e-14 and 1e-13,

    sum_k Re w_k z / (z - p_k),                                                                           (1)

with p_k the poles of the best rational approximation of degree 16 to exp(-z), one of each conjugate pair (Pusa 2012,
Nucl. Sci. Eng. 171, 155). The weights w_k are fitted to f and to g. For backward Euler f and g are -z / (1 + z), which
has one pole. With the matrix A in place of z, each term takes one loop over the populations, as they couple only
through the gas. Term k changes population j by

    Re w_k z_j r_j (Y_j - q),    r_j = 1 / (z_j - p_k),    q = sum_i e_i z_i r_i Y_i / (1 + sum_i e_i z_i r_i),   (2)

and the gas such that momentum is conserved.
"""

import numpy as np

from discsim.jit.decorators import inline_jit, jit_no_alloc
from discsim.kernels.common.simd import LANES, extract, load, store, zeros

POLES = (
    -6.416177699099435 + 1.1941223933701386j, -5.948152268951177 + 3.587457362018322j,
    -4.993174737717997 + 5.996881713603942j, -3.509103608414918 + 8.436198985884374j,
    -1.419375897185666 + 10.925363484496723j, 1.4139284624888862 + 13.497725698892745j,
    5.264971343442647 + 16.22022147316793j, 10.843917078696988 + 19.27744616718165j,
)  # fmt: skip
FOR_SLIPS = (
    -32.025829097947444 + 64.0484218734613j, 43.118362775157735 - 8.273013811801054j,
    -12.456738445970243 - 10.478464687915897j, 0.10362905940556635 + 3.527124677277039j,
    0.2837998441223101 - 0.30767123752793857j, -0.023704215622398377 + 0.0035954346369145j,
    0.00048196709043706515 + 0.000182524018949936j, -1.8862359601737991e-06 - 1.1138407606892213e-06j,
)  # fmt: skip
FOR_SOURCES = (
    -6.619944191309062 + 8.750288566480508j, 5.930599889030935 + 2.1860173137827026j,
    0.010501292978218512 - 2.0859464572464437j, -0.35206905003700983 + 0.15873009925088474j,
    0.03101237958537903 + 0.02194721049717225j, -8.150147997405428e-05 - 0.0017647205215907177j,
    -1.8904302005538264e-05 + 2.3579844470878637e-05j, 8.553351889939035e-08 - 4.957653975928147e-08j,
)  # fmt: skip


def table_of(poles, for_slips, for_sources):
    """Return a table (poles, 10) of the poles and weights of eq. (1), for `add_pole`.

    Columns: real and imaginary part of the pole; real parts of the weights, twice for slips and twice for sources;
    imaginary parts in the same order.
    """
    weights = np.repeat(np.stack([for_slips, for_sources], axis=1).astype(complex), 2, axis=1)
    poles = np.array(poles, complex)[:, None]
    return np.ascontiguousarray(np.hstack([poles.real, poles.imag, weights.real, weights.imag]))


WEIGHT = 2  # column at which the weights begin
EXPONENTIAL, EULER = table_of(POLES, FOR_SLIPS, FOR_SOURCES), table_of([-1.0], [-1.0], [-1.0])
LARGEST_Z = 1e140  # upper bound of z, whose square must not overflow
# Columns of the scratch array, which has one row per population: z, e z, real and imaginary part of 1 / (z - p); slips
# (2) and sources (2); the sum over poles of w / (z - p), and that of the term with q in eq. (2), for slips (2) and
# sources (2).
Z, STRENGTH, INVERSE, SLIP, OWN, COMMON, SCRATCH_COLUMNS = 0, 1, 2, LANES, 2 * LANES, 3 * LANES, 4 * LANES


@inline_jit
def load_populations(mass, time, y, b, dt, scratch):
    """Write each population with mass to the next row of `scratch`, with sums of 0; return the number of rows."""
    count = 0
    for s in range(1, len(mass)):
        if mass[s] > 0.0:
            scratch[count, Z] = min(dt / time[s], LARGEST_Z)
            scratch[count, STRENGTH] = mass[s] / mass[0] * scratch[count, Z]
            for f in range(SLIP, SCRATCH_COLUMNS):
                scratch[count, f] = 0.0
            for c in range(y.shape[1]):
                scratch[count, SLIP + c] = y[s, c] - y[0, c]
                scratch[count, SLIP + 2 + c] = dt * (b[s, c] - b[0, c])
            count += 1
    return count


@inline_jit
def add_pole(k, table, count, scratch):
    """Add the term of pole k in (1) to the sums of all `count` populations in `scratch`, by eq. (2)."""
    real_part, imaginary_part = table[k, 0], table[k, 1]
    own, other, re, im = 1.0, 0.0, zeros(), zeros()
    for j in range(count):
        d = scratch[j, Z] - real_part
        inverse = 1.0 / (d * d + imaginary_part * imaginary_part)
        real, imaginary = d * inverse, imaginary_part * inverse
        scratch[j, INVERSE], scratch[j, INVERSE + 1] = real, imaginary
        real, imaginary = scratch[j, STRENGTH] * real, scratch[j, STRENGTH] * imaginary
        own += real
        other += imaginary
        slip = load(scratch, j * SCRATCH_COLUMNS + SLIP)
        re += real * slip
        im += imaginary * slip
    norm = 1.0 / (own * own + other * other)
    own, other = own * norm, other * norm
    re, im = own * re + other * im, own * im - other * re
    w_re, w_im = load(table, k * (WEIGHT + 2 * LANES) + WEIGHT), load(table, k * (WEIGHT + 2 * LANES) + WEIGHT + LANES)
    q_re, q_im = w_re * re - w_im * im, w_re * im + w_im * re
    for j in range(count):
        real, imaginary, at = scratch[j, INVERSE], scratch[j, INVERSE + 1], j * SCRATCH_COLUMNS
        store(scratch, at + OWN, load(scratch, at + OWN) + (real * w_re - imaginary * w_im))
        store(scratch, at + COMMON, load(scratch, at + COMMON) + (real * q_re - imaginary * q_im))


@jit_no_alloc
def relax_coupled(mass, time, y, b, dt, exponential, scratch, slip, drive):
    """Add velocity changes by drag over dt to `slip` and `drive`, of the gas (row 0) and populations with mass.

    Changes due to the initial slips are added to `slip`, and changes due to the sources b to `drive`; both are (n, d),
    and may be the same array. mass, time (n,): masses and stopping times. y, b (n, d): velocities, and sources, the
    accelerations of each species alone. scratch (n, SCRATCH_COLUMNS): overwritten.
    """
    table = EXPONENTIAL if exponential else EULER
    count, at = load_populations(mass, time, y, b, dt, scratch), 0
    for k in range(len(table)):
        add_pole(k, table, count, scratch)
    for s in range(1, len(mass)):
        if mass[s] > 0.0:
            e, begin = mass[s] / mass[0], at * SCRATCH_COLUMNS
            change = load(scratch, begin + OWN) * load(scratch, begin + SLIP) - load(scratch, begin + COMMON)
            change = scratch[at, Z] * change
            at += 1
            for c in range(y.shape[1]):
                slip[s, c] += extract(change, c)
                slip[0, c] -= e * extract(change, c)
                drive[s, c] += extract(change, 2 + c)
                drive[0, c] -= e * extract(change, 2 + c)
