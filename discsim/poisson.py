"""Potential of a razor-thin sheet on a grid by FFT, with the Plummer kernel -G / sqrt(r^2 + softening^2).

Open edges: the grid is padded to twice its sides, so that the cyclic convolution is the sum over all pairs of
nodes (Hockney & Eastwood 1988, ch. 6); rows that are only padding are never transformed. Periodic: the sheet
phi_k = -2 pi G Sigma_k exp(-k softening) / k (Binney & Tremaine 2008, eq. 5.161, at height = softening),
phi_0 = 0.

Rows go through one-dimensional FFTW_ESTIMATE plans in batches of fixed size: the same bits on any number of
threads.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pyfftw
from scipy.fft import dctn, next_fast_len

from discsim.kernels.poisson import load_columns, multiply_columns, store_columns

Array = np.ndarray
BATCH = 16  # rows that a plan transforms at once


class Poisson:
    """Solver for one grid of `shape` (nx, ny), square cells of side `cell` and one softening; G = 1.

    A sheet that varies along x only has ny = 1. Raises ValueError for such a sheet with open edges.
    """

    def __init__(self, shape: tuple[int, int], cell: float, softening: float, periodic: bool, threads: int) -> None:
        if not periodic and 1 in shape:
            raise ValueError("self-gravity with open boundaries needs two dimensions; make the box periodic")
        self.shape = shape
        padded = shape if periodic else (_padded(shape[0]), _padded(shape[1]))
        kernel = _periodic_kernel if periodic else _open_kernel
        self._kernel = kernel(padded, cell, softening) / (padded[0] * padded[1])
        self._half = np.empty((shape[0], padded[1] // 2 + 1), complex)
        self._workers = [_Worker(padded) for _ in range(threads)]
        self._pool = ThreadPoolExecutor(threads)

    def solve(self, surface_density: Array) -> Array:
        """Potential (nx, ny) of `surface_density` (nx, ny), both at the nodes."""
        potential = np.empty(self.shape)
        rows, columns = self._half.shape
        self._share(lambda worker, first: worker.forward(surface_density, first, self._half), rows)
        self._share(lambda worker, first: worker.convolve(self._half, first, self._kernel), columns)
        self._share(lambda worker, first: worker.backward(self._half, first, potential), rows)
        return potential

    def _share(self, work: "Callable[[_Worker, int], None]", count: int) -> None:
        # The workers take batches from one iterator; a batch gives the same numbers whoever takes it.
        batches = iter(range(0, count, BATCH))

        def take(worker: "_Worker") -> None:
            for first in batches:
                work(worker, first)

        if len(self._workers) == 1:
            take(self._workers[0])
        else:
            list(self._pool.map(take, self._workers))


class _Worker:
    """Plans and their buffers for one thread; `forward`, `convolve` and `backward` treat one batch."""

    def __init__(self, padded: tuple[int, int]) -> None:
        nx, ny = padded
        self.rows = pyfftw.zeros_aligned((BATCH, ny))
        self.spectra = pyfftw.zeros_aligned((BATCH, ny // 2 + 1), complex)
        self.columns = _columns(nx)
        self.modes = _columns(nx)
        # Backward plans have buffers of their own: what pads the forward ones must stay 0.
        self.rows_back = pyfftw.zeros_aligned((BATCH, ny))
        self.columns_back = _columns(nx)
        self.along_y = _plan(self.rows, self.spectra, "FFTW_FORWARD")
        self.along_x = _plan(self.columns, self.modes, "FFTW_FORWARD")
        self.back_along_x = _plan(self.modes, self.columns_back, "FFTW_BACKWARD")
        self.back_along_y = _plan(self.spectra, self.rows_back, "FFTW_BACKWARD", "FFTW_DESTROY_INPUT")

    def forward(self, surface_density: Array, first: int, half: Array) -> None:
        batch = surface_density[first : first + BATCH]
        self.rows[: len(batch), : batch.shape[1]] = batch
        self.along_y.execute()
        half[first : first + BATCH] = self.spectra[: len(batch)]

    def convolve(self, half: Array, first: int, kernel: Array) -> None:
        load_columns(half, first, self.columns)
        self.along_x.execute()
        multiply_columns(self.modes, kernel, first)
        self.back_along_x.execute()
        store_columns(self.columns_back, first, half)

    def backward(self, half: Array, first: int, potential: Array) -> None:
        batch = potential[first : first + BATCH]
        self.spectra[: len(batch)] = half[first : first + BATCH]
        self.back_along_y.execute()
        batch[:] = self.rows_back[: len(batch), : batch.shape[1]]


def _columns(length: int) -> Array:
    # Rows a power of two apart would share their place in the cache, and a transpose wait for it.
    return pyfftw.zeros_aligned((BATCH, length + 4), complex)[:, :length]


def _plan(source: Array, target: Array, direction: str, *flags: str) -> pyfftw.FFTW:
    return pyfftw.FFTW(source, target, axes=(1,), direction=direction, flags=("FFTW_ESTIMATE", *flags), threads=1)


def _padded(count: int) -> int:
    # At least 2 count, so that no pair of nodes meets around the edge; even, so that the kernel has a middle.
    return 2 * next_fast_len(count, real=True)


def _open_kernel(padded: tuple[int, int], cell: float, softening: float) -> Array:
    """Transform (ky, kx) of -cell^2 / sqrt(r^2 + softening^2), even along both axes: a cosine transform."""
    x, y = (cell * np.arange(n // 2 + 1) for n in padded)
    separation = np.sqrt(x**2 + y[:, None] ** 2 + softening**2)
    return dctn(-(cell**2) / separation, type=1)


def _periodic_kernel(padded: tuple[int, int], cell: float, softening: float) -> Array:
    """-2 pi exp(-k softening) / k at the grid's wavenumbers (ky, kx), and 0 at k = 0."""
    kx, ky = (2 * np.pi * np.fft.rfftfreq(n, cell) for n in padded)
    k = np.hypot(kx, ky[:, None])
    k[0, 0] = np.inf
    return -2 * np.pi * np.exp(-k * softening) / k
