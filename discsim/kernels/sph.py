"""SPH sums over packed neighbours: density with its smoothing length, and pressure, viscosity and conduction.

    rho_i   = sum_j m_j W(r_ij, h_i),   h_i = eta (m_i / rho_i)^(1/d)                               (1)
    Omega_i = 1 + h_i / (d rho_i) sum_j m_j dW/dh_i                                                 (2)
    dv_i/dt = -sum_j m_j [P_i / (Omega_i rho_i^2) grad W(h_i) + P_j / (Omega_j rho_j^2) grad W(h_j)]  (3)
    du_i/dt = P_i / (Omega_i rho_i^2) sum_j m_j v_ij . grad W(h_i)                                  (4)
    Pi_ij   = (-alpha c_ij w + beta w^2) / rho_ij,   w = min(0, v_ij . r_ij / r_ij)                   (5)
              with `receding` = 1 the first w is that of all pairs (Lodato & Price 2010): on approaching pairs
              alone the shear of a disc makes a pressure of it, and twice the noise at one shear viscosity

(1-4): Springel & Hernquist 2002; Price 2012, eqs. 10, 27, 30, 36. (5): Monaghan 1997, with the mean of the two
kernels' gradients; Balsara 1995 multiplies it by f = |div v| / (|div v| + |curl v| + 1e-4 c/h). Conduction:
Price 2008, eq. 28.

All sums gather (each particle sums over its own neighbours, in a fixed order), so that they are bitwise the
same on any number of threads. Candidates of a cell are packed once, relative to the cell's centre, and serve
every particle of it and every Newton iteration.
"""

import functools
import math

import numpy as np
from numba import njit

from discsim.kernels.neighbours import find_candidates
from discsim.kernels.smoothing import NORM, SUPPORT, shape

# No 'nnan'/'ninf': a run that goes wrong must still be seen to.
# Drivers take error_model="numpy": with Python's, a division may raise, and no loop with one is vectorised.
FAST = {"reassoc", "contract", "arcp", "nsz"}
NEWTON_TOLERANCE = 1e-3  # of h, on the last step before the final sums; the error left is its square
NEWTON_ITERATIONS = 60


@njit(inline="always")
def density_sums(kernel, dim, x, y, h, cx, cy, cm):
    """Sums of eqs. (1, 2) over packed candidates: rho and drho/dh."""
    support = SUPPORT[kernel]
    inv_h = 1.0 / h
    total_w, total_dh = 0.0, 0.0
    for k in range(len(cx)):
        dx, dy = x - cx[k], y - cy[k]
        q = min(math.sqrt(dx * dx + dy * dy) * inv_h, support)
        w, dw = shape(kernel, dim, q)
        total_w += cm[k] * w
        total_dh -= cm[k] * (dim * w + q * dw)
    norm = NORM[dim - 1][kernel] * inv_h**dim
    return norm * total_w, norm * inv_h * total_dh


@njit(inline="always")
def solve_h(kernel, dim, x, y, m, h, eta, h_most, reach, cx, cy, cm):
    """(h, rho, Omega) of eq. (1) by Newton's method kept in a bracket; the sums are those at the last h.

    (h wanted, -1, 1) where the candidates do not reach far enough.
    """
    h = min(h, h_most)
    low, high = 0.0, np.inf
    rho, omega = -1.0, 1.0
    near = False
    for _ in range(NEWTON_ITERATIONS):
        rho = -1.0
        if SUPPORT[kernel] * h > reach:
            break
        rho, drho = density_sums(kernel, dim, x, y, h, cx, cy, cm)
        wanted = m * (eta / h) ** dim
        omega = 1.0 + h / (dim * rho) * drho
        if near:
            break
        if rho > wanted:
            high = h
        elif h >= h_most:  # a lone particle: h stays at its cap, as if fixed
            omega = 1.0
            break
        else:
            low = h
        step = -(rho - wanted) / (drho + dim * wanted / h)
        near = abs(step) <= NEWTON_TOLERANCE * h
        new = min(h + min(max(step, -0.3 * h), 0.5 * h), h_most)
        if not low < new < high and not near:
            new = 0.5 * (low + high) if high < np.inf else min(1.5 * low, h_most)
        h = new
    return h, rho, omega


@njit(inline="always")
def shear_sums(kernel, dim, x, y, vx, vy, h, cx, cy, cm, cvx, cvy):
    """|div v| and |curl v| over packed candidates, times the density."""
    support = SUPPORT[kernel]
    inv_h = 1.0 / h
    div, curl = 0.0, 0.0
    for k in range(len(cx)):
        dx, dy = x - cx[k], y - cy[k]
        dvx, dvy = vx - cvx[k], vy - cvy[k]
        inv_r = 1.0 / math.sqrt(dx * dx + dy * dy + 1e-300)
        _, dw = shape(kernel, dim, min((dx * dx + dy * dy) * inv_r * inv_h, support))
        weight = cm[k] * dw * inv_r
        div += weight * (dvx * dx + dvy * dy)
        curl += weight * (dvy * dx - dvx * dy)
    norm = NORM[dim - 1][kernel] * inv_h ** (dim + 1)
    return abs(div) * norm, abs(curl) * norm


@functools.cache
def density_driver(kernel: int, dim: int, shear: bool):
    """Compile the pass that gives each particle its h, density and Omega, and with `shear` |div v| and |curl v|."""
    support = SUPPORT[kernel]

    @njit(nogil=True, cache=True, fastmath=FAST, error_model="numpy")
    def density(
        piece, last, pos, vel, mass, h, rho, gradh, div, curl, eta, h_most, fixed,
        filled, grids, order, start, bounds, low, width, periodic,
    ):  # fmt: skip
        for c in range(piece, last):
            cell = filled[c]
            members = order[start[cell] : start[cell + 1]]
            ox = 0.5 * (bounds[cell, 0] + bounds[cell, 1])
            oy = 0.5 * (bounds[cell, 2] + bounds[cell, 3])
            # Room for h to grow since the last step without looking again.
            reach = bounds[cell, 4] * (1.0 if fixed else 1.05)
            while True:
                index, shift = find_candidates(
                    bounds[cell], reach, False, pos, h, grids, order, start, bounds, low, width, periodic
                )
                n = len(index)
                cx, cy, cm = np.empty(n), np.zeros(n), np.empty(n)
                for k in range(n):
                    cx[k] = pos[index[k], 0] + (shift[k, 0] - ox)
                    if dim == 2:
                        cy[k] = pos[index[k], 1] + (shift[k, 1] - oy)
                    cm[k] = mass[index[k]]
                missing = 0.0
                for i in members:
                    x, y = pos[i, 0] - ox, (pos[i, 1] - oy if dim == 2 else 0.0)
                    if fixed:
                        rho[i], _ = density_sums(kernel, dim, x, y, h[i], cx, cy, cm)
                        gradh[i] = 1.0
                        continue
                    new, density_i, omega = solve_h(kernel, dim, x, y, mass[i], h[i], eta, h_most, reach, cx, cy, cm)
                    if density_i < 0.0:
                        missing = max(missing, support * new)
                    else:
                        h[i], rho[i], gradh[i] = new, density_i, omega
                if missing == 0.0:
                    break
                reach = 1.2 * missing
            if shear:
                cvx, cvy = np.empty(n), np.zeros(n)
                for k in range(n):
                    cvx[k] = vel[index[k], 0]
                    if dim == 2:
                        cvy[k] = vel[index[k], 1]
                for i in members:
                    y, vy = 0.0, 0.0
                    if dim == 2:
                        y, vy = pos[i, 1] - oy, vel[i, 1]
                    d, r = shear_sums(kernel, dim, pos[i, 0] - ox, y, vel[i, 0], vy, h[i], cx, cy, cm, cvx, cvy)
                    div[i], curl[i] = d / rho[i], r / rho[i]

    return density


# Columns of the packed candidates that eqs. (3-5) read.
X, Y, MASS, INV_H, NORM_H, PRESS, VX, VY, INV_RHO, SOUND, SWITCH, ENERGY, P = range(13)


@njit(inline="always")
def force_sums(
    kernel, dim, viscous, energetic, conductive, x, y, vx, vy, h, press, inv_rho_i, c_i, f_i, u_i, p_i, alpha,
    beta, receding, alpha_u, rows
):  # fmt: skip
    """Sums of one particle: acceleration, du/dt and divergence."""
    sigma, support = NORM[dim - 1][kernel], SUPPORT[kernel]
    inv_h = 1.0 / h
    gi = sigma * inv_h ** (dim + 1)
    ax, ay, rate, div = 0.0, 0.0, 0.0, 0.0
    for k in range(len(rows[X])):
        dx, dy = x - rows[X][k], y - rows[Y][k]
        r2 = dx * dx + dy * dy
        inv_r = 1.0 / math.sqrt(r2 + 1e-300)
        r = r2 * inv_r
        _, dwi = shape(kernel, dim, min(r * inv_h, support))
        inv_hj = rows[INV_H][k]
        _, dwj = shape(kernel, dim, min(r * inv_hj, support))
        dwi *= gi
        dwj *= rows[NORM_H][k]
        m = rows[MASS][k]
        force = press * dwi + rows[PRESS][k] * dwj
        if viscous or energetic:
            w = ((vx - rows[VX][k]) * dx + (vy - rows[VY][k]) * dy) * inv_r
            div += m * w * dwi
            heat = press * dwi * w
            if viscous:
                mu = min(w, 0.0)
                mean = 0.5 * (dwi + dwj)
                inv_rho = 0.5 * (inv_rho_i + rows[INV_RHO][k])
                switch = 0.5 * (f_i + rows[SWITCH][k])
                c = 0.5 * (c_i + rows[SOUND][k])
                felt = mu + receding * (w - mu)
                pi = switch * (beta * mu * mu - alpha * c * felt) * inv_rho  # eq. (5)
                force += pi * mean
                heat += 0.5 * pi * felt * mean
            if conductive:
                mean = 0.5 * (dwi + dwj)
                inv_rho = 0.5 * (inv_rho_i + rows[INV_RHO][k])
                signal = math.sqrt(abs(p_i - rows[P][k]) * inv_rho)
                heat += alpha_u * signal * (u_i - rows[ENERGY][k]) * inv_rho * mean
            if energetic:
                rate += m * heat
        ax -= m * force * dx * inv_r
        ay -= m * force * dy * inv_r
    return ax, ay, rate, -div * inv_rho_i


@functools.cache
def force_driver(kernel: int, dim: int, viscous: bool, energetic: bool, conductive: bool):
    """Compile eqs. (3-5), leaving out what the scene does not name.

    Adds to `acc` (n, d) and, for gas with energy, to `rate` (n,); writes the velocity divergence.
    """

    sigma = NORM[dim - 1][kernel]

    @njit(nogil=True, cache=True, fastmath=FAST, error_model="numpy")
    def forces(
        piece, last, pos, vel, mass, h, radius, rho, gradh, pressure, sound, switch, u, acc, rate, div, alpha,
        beta, receding, alpha_u,
        filled, grids, order, start, bounds, low, width, periodic,
    ):  # fmt: skip
        for c in range(piece, last):
            cell = filled[c]
            ox = 0.5 * (bounds[cell, 0] + bounds[cell, 1])
            oy = 0.5 * (bounds[cell, 2] + bounds[cell, 3])
            index, shift = find_candidates(
                bounds[cell], bounds[cell, 4], True, pos, radius, grids, order, start, bounds, low, width, periodic
            )
            pack = np.zeros((P + 1, len(index)))
            # Rows by themselves: loops over a row of a matrix are not vectorised.
            rows = (
                pack[0], pack[1], pack[2], pack[3], pack[4], pack[5],
                pack[6], pack[7], pack[8], pack[9], pack[10], pack[11], pack[12],
            )  # fmt: skip
            for k in range(len(index)):
                j = index[k]
                pack[X, k] = pos[j, 0] + (shift[k, 0] - ox)
                if dim == 2:
                    pack[Y, k] = pos[j, 1] + (shift[k, 1] - oy)
                pack[MASS, k] = mass[j]
                pack[INV_H, k] = 1.0 / h[j]
                pack[NORM_H, k] = sigma / h[j] ** (dim + 1)
                pack[PRESS, k] = pressure[j] / (gradh[j] * rho[j] * rho[j])
                if viscous or energetic:
                    pack[VX, k] = vel[j, 0]
                    if dim == 2:
                        pack[VY, k] = vel[j, 1]
                if viscous or conductive:
                    pack[INV_RHO, k] = 1.0 / rho[j]
                if viscous:
                    pack[SOUND, k] = sound[j]
                    pack[SWITCH, k] = switch[j] if len(switch) > 0 else 1.0
                if conductive:
                    pack[ENERGY, k] = u[j]
                    pack[P, k] = pressure[j]
            for i in order[start[cell] : start[cell + 1]]:
                y, vy = 0.0, 0.0
                if dim == 2:
                    y, vy = pos[i, 1] - oy, vel[i, 1]
                ax, ay, r, d = force_sums(
                    kernel, dim, viscous, energetic, conductive, pos[i, 0] - ox, y, vel[i, 0], vy, h[i],
                    pressure[i] / (gradh[i] * rho[i] * rho[i]),
                    1.0 / rho[i], sound[i], switch[i] if len(switch) > 0 else 1.0, u[i] if conductive else 0.0,
                    pressure[i], alpha, beta, receding, alpha_u, rows,
                )  # fmt: skip
                acc[i, 0] += ax
                if dim == 2:
                    acc[i, 1] += ay
                if energetic:
                    rate[i] += r
                if viscous or energetic:
                    div[i] = d

    return forces
