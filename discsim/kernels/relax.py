"""Exact relaxation of coupled velocities with the accelerations inside: eq. (1) of `kernels/drag.py` over any dt.

Of two velocities the slip y obeys dy/dt = b - rate y; of gas and several populations, which meet through the gas
alone, each eigenmode of the coupling does. Increments are those beyond free motion, so that they vanish with the drag.
"""

import math

import numpy as np
from numba import njit

from discsim.kernels.inner import making


@njit(nogil=True, cache=True, error_model="numpy")
def response(rate, dt, exponential):
    """What dy/dt = b - rate y does beyond the free y + b dt: (f, g) of y' = y + b dt + f y + g b."""
    x = rate * dt
    if not exponential:
        low = 1.0 / (1.0 + x)
        return -x * low, -x * dt * low
    f = math.expm1(-x)
    if x > 1e-2:
        return f, -f / rate - dt
    return f, -dt * x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))))


@njit(nogil=True, cache=True, error_model="numpy")
def relax_pair(w0, w1, rate, y0, y1, b0, b1, dt, exponential):
    """Increments of two coupled velocities of weights w0, w1 beyond their free motion."""
    f, g = response(rate, dt, exponential)
    change = f * (y0 - y1) + g * (b0 - b1)
    return w1 / (w0 + w1) * change, -w0 / (w0 + w1) * change


@making
def eigen(matrix):
    """Eigenvalues and orthonormal eigenvectors (columns) of a small symmetric matrix, which is overwritten.

    Jacobi's cyclic rotations (Golub & Van Loan, sec. 8.5): small rates keep their digits beside large ones, and
    a LAPACK call would cost every run ten seconds of compilation.
    """
    n = len(matrix)
    vectors = np.zeros((n, n))
    for i in range(n):
        vectors[i, i] = 1.0
    for _ in range(50):
        done = True
        for i in range(n):
            for j in range(i + 1, n):
                if abs(matrix[i, j]) <= 1e-17 * math.sqrt(abs(matrix[i, i] * matrix[j, j])):
                    continue
                done = False
                theta = 0.5 * (matrix[j, j] - matrix[i, i]) / matrix[i, j]
                t = math.copysign(1.0, theta) / (abs(theta) + math.hypot(theta, 1.0))
                c = 1.0 / math.hypot(t, 1.0)
                s = c * t
                for k in range(n):
                    p, q = matrix[k, i], matrix[k, j]
                    matrix[k, i], matrix[k, j] = c * p - s * q, s * p + c * q
                for k in range(n):
                    p, q = matrix[i, k], matrix[j, k]
                    matrix[i, k], matrix[j, k] = c * p - s * q, s * p + c * q
                    p, q = vectors[k, i], vectors[k, j]
                    vectors[k, i], vectors[k, j] = c * p - s * q, s * p + c * q
        if done:
            break
    rates = np.empty(n)
    for i in range(n):
        rates[i] = matrix[i, i]
    return rates, vectors


@making
def relax_many(weight, time, y, b, dt, exponential, change):
    """The same for gas (entry 0) and several populations (n, d): writes `change`.

    The coupling is a star graph; symmetrised with sqrt(weight) it has orthogonal modes, of which the
    resting one is the barycentre.
    """
    n = len(weight)
    root = np.empty(n)
    for i in range(n):
        root[i] = math.sqrt(weight[i])
    matrix = np.zeros((n, n))
    for j in range(1, n):
        k = weight[j] / time[j]
        matrix[0, 0] += k / weight[0]
        matrix[j, j] = k / weight[j]
        matrix[0, j] = matrix[j, 0] = -k / (root[0] * root[j])
    rates, modes = eigen(matrix)
    rest = 0  # the barycentre, which no drag moves
    for m in range(n):
        if rates[m] < rates[rest]:
            rest = m
    for i in range(n):
        for k in range(y.shape[1]):
            change[i, k] = 0.0
    for m in range(n):
        if m == rest:
            continue
        f, g = response(rates[m], dt, exponential)
        for k in range(y.shape[1]):
            c, s = 0.0, 0.0
            for i in range(n):
                c += modes[i, m] * root[i] * y[i, k]
                s += modes[i, m] * root[i] * b[i, k]
            for i in range(1, n):
                change[i, k] += modes[i, m] / root[i] * (f * c + g * s)
    for k in range(y.shape[1]):
        for i in range(1, n):
            change[0, k] -= weight[i] / weight[0] * change[i, k]


@making
def relax_present(mass, time, y, b, dt, exponential, change):
    """`relax_many` of those that have mass; `change` of the others stays."""
    n, dim = y.shape
    # Copied by loops: indexing with arrays would cost seconds of compilation.
    who = np.empty(n, np.int64)
    count = 0
    for s in range(n):
        if mass[s] > 0.0:
            who[count] = s
            count += 1
    weight, times = np.empty(count), np.empty(count)
    velocity, source, part = np.empty((count, dim)), np.empty((count, dim)), np.empty((count, dim))
    for k in range(count):
        weight[k], times[k] = mass[who[k]], time[who[k]]
        for c in range(dim):
            velocity[k, c], source[k, c] = y[who[k], c], b[who[k], c]
    relax_many(weight, times, velocity, source, dt, exponential, part)
    for k in range(count):
        for c in range(dim):
            change[who[k], c] = part[k, c]


@njit(nogil=True, cache=True, error_model="numpy")
def relax_means(mass, time, y, b, two_way, dt, exponential, several, change):
    """Changes (n, d) beyond their free motion of the velocities of gas (entry 0) and populations, those of no mass
    left out; one-way: of the populations alone. `several` is None where there is one population: without it numba
    leaves out the modes of many, four seconds of compilation.
    """
    n, dim = y.shape
    count, only = 0, 0
    for s in range(n):
        for c in range(dim):
            change[s, c] = 0.0
        if s > 0 and mass[s] > 0.0:
            count += 1
            only = s
            if not two_way:
                f, g = response(1.0 / time[s], dt, exponential)
                for c in range(dim):
                    change[s, c] = f * (y[s, c] - y[0, c]) + g * (b[s, c] - b[0, c])
    if not two_way or count == 0:
        return
    if count == 1:
        rate = (1.0 + mass[only] / mass[0]) / time[only]
        for c in range(dim):
            change[0, c], change[only, c] = relax_pair(
                mass[0], mass[only], rate, y[0, c], y[only, c], b[0, c], b[only, c], dt, exponential
            )
    elif several is not None:
        relax_present(mass, time, y, b, dt, exponential, change)
