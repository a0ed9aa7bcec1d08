"""Potential of a disc on a grid by FFT, phi(x) = int Sigma(x') w(|x - x'|) d^2x', with one of two kernels (G = 1):

    plummer     w(d) = -1 / sqrt(d^2 + softening^2)                      w_k = -2 pi exp(-k softening) / k        (1)
    thin-disc   w(d) = -exp(x) K_0(x) / (2 sqrt(pi) H), x = d^2 / 8H^2   w_k = -2 pi exp(k^2 H^2) erfc(kH) / k     (2)

Plummer: the field of a razor-thin disc at the height softening (Binney & Tremaine 2008, eq. 5.161). Thin-disc: source
and target columns are stratified, rho = Sigma exp(-z^2 / 2H^2) / (sqrt(2 pi) H), and the field is the mean over the
target column (Rendon Restrepo et al. 2025, arXiv:2506.10812). As z - z' is Gaussian with variance 2H^2, w is the mean
of -1 / sqrt(d^2 + (z - z')^2), and w_k that of -2 pi exp(-k |z - z'|) / k. Thickness reduces long waves by the factor 1
- 2kH / sqrt(pi), as a softening of 2H / sqrt(pi) = 1.13 H does. Thickness reduces short waves by 1 / (sqrt(pi) kH), as
in three dimensions. No softening reproduces both.

Open edges: the grid is padded to twice its sides, so that the cyclic convolution is the sum over all pairs of
nodes (Hockney & Eastwood 1988, ch. 6). Rows of padding alone are not transformed. Half of each column is padding, so
its even and odd modes are two transforms of half the length. Periodic: phi_k is Sigma_k w_k, and phi_0 = 0.

Rows and columns are transformed by one-dimensional FFTW_ESTIMATE plans in batches of fixed size, which give the same
bits on any number of threads.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pyfftw
from scipy.fft import dctn, next_fast_len
from scipy.special import erfcx, gamma, k0e, k1e

from discsim.kernels.gravity.poisson import (
    TILE,
    load_columns,
    load_halves,
    load_rows,
    multiply_columns,
    multiply_halves,
    rows_to_tiles,
    store_columns,
    store_halves,
    store_rows,
    tiles_to_rows,
)
from discsim.numerics import thread_pool, threads
from discsim.numerics.threads import parallel_for

Array = np.ndarray
EVERYTHING = slice(None)
ROWS = 16  # rows in a batch, which one execution of a plan transforms; few enough to stay in the cache


@dataclass(frozen=True)
class Plummer:
    """Kernel (1): the field of a razor-thin disc at the height `softening`."""

    softening: float
    self_distance: ClassVar[float] = 0.0  # distance between a node and itself in `potential`, in cells

    def potential(self, distance: Array) -> Array:
        """Return the potential of a unit mass."""
        return -1 / np.hypot(distance, self.softening)  # eq. (1)

    def pull(self, distance: Array) -> Array:
        """Return the attraction between unit masses, divided by their distance."""
        return np.hypot(distance, self.softening) ** -3

    def potential_transform(self, k: Array) -> Array:
        """Return the transform of `potential` at the wavenumbers k."""
        return -2 * np.pi * np.exp(-k * self.softening) / k


@dataclass(frozen=True)
class ThinDisc:
    """Kernel (2): the mean over height in a Gaussian disc of constant `thickness` H; infinite at distance 0."""

    thickness: float
    # w ~ ln d near 0. With this distance in place of 0 the sum over the nodes of a square lattice is the integral over
    # a smooth density to fourth order: -ln self_distance = ln(2 pi)/2 + beta'(0), from the lattice sum 4 zeta(s)
    # beta(s) of |n|^-2s.
    self_distance: ClassVar[float] = 2 * np.sqrt(np.pi) / gamma(0.25) ** 2

    def potential(self, distance: Array) -> Array:
        """Return the potential of a unit mass."""
        return -k0e(distance**2 / (8 * self.thickness**2)) / (2 * np.sqrt(np.pi) * self.thickness)  # eq. (2)

    def pull(self, distance: Array) -> Array:
        """Return the attraction between unit masses, divided by their distance; four correct digits at 1e6 H."""
        x = distance**2 / (8 * self.thickness**2)
        return (k1e(x) - k0e(x)) / (8 * np.sqrt(np.pi) * self.thickness**3)

    def potential_transform(self, k: Array) -> Array:
        """Return the transform of `potential` at the wavenumbers k."""
        return -2 * np.pi * erfcx(k * self.thickness) / k


Kernel = Plummer | ThinDisc


class Poisson:
    """Solver for the potential on a grid of `shape` (nx, ny) with square cells of side `cell`; G = 1.

    A sheet that varies only along x has ny = 1. border: number of nodes beyond each open edge at which the potential is
    computed too. For the outermost of these nodes, the distance of mass at the opposite edge is two cells too small.
    Raises ValueError for a sheet with open edges, and for a periodic grid with a border.
    """

    def __init__(self, shape: tuple[int, int], cell: float, kernel: Kernel, periodic: bool, border: int = 0) -> None:
        if not periodic and 1 in shape:
            raise ValueError('self-gravity with open boundaries needs two dimensions; set space.boundary = "periodic"')
        if periodic and border:
            raise ValueError(f"a periodic grid has no nodes beyond its edges; expected border = 0, not {border}")
        self.shape, self.border = shape, border
        padded = padded_shape(shape, periodic)
        if periodic:
            transform = periodic_transform(padded, cell, kernel)
        else:  # the kernel is even along x and along y, so that a cosine transform suffices
            transform = even_first(dctn(open_kernel(padded, cell, kernel), type=1))
        self._kernel = transform / (padded[0] * padded[1])
        # Modes along y; the last tile is padded with zeros.
        self._tiles = np.empty((tiles_of(padded), shape[0] + 2 * border, TILE), complex)
        self._workers = Workers(padded, periodic, border)

    def solve(self, surface_density: Array, out: Array | None = None) -> Array:
        """Return the potential (nx + 2 border, ny + 2 border) of `surface_density` (nx, ny).

        out: array for the result; None: a new one.
        """
        nx, ny = self.shape
        potential = np.empty((nx + 2 * self.border, ny + 2 * self.border)) if out is None else out
        tiles, each = self._tiles, self._workers.run_batches
        each(lambda worker, batch: worker.forward(surface_density, batch * ROWS, tiles), -(-nx // ROWS))
        each(lambda worker, tile: worker.convolve(tiles, tile, self._kernel), len(tiles))
        # Border nodes before the first node are the last rows of the cyclic convolution.
        rows = -(-len(potential) // ROWS)
        each(lambda worker, batch: worker.backward(tiles, batch * ROWS, potential, self.border), rows)
        return potential


class Workers:
    """One set of FFTW plans for each thread, made when first needed, for a grid of `padded` shape (nx, ny)."""

    def __init__(self, padded: tuple[int, int], periodic: bool, border: int) -> None:
        self._arguments = padded, periodic, border
        self._workers: list[Worker] = []

    def run_batches(self, work: "Callable[[Worker, int], None]", batches: int) -> None:
        """Call `work(worker, batch)` for each batch index from 0 to `batches` - 1, on several threads.

        A thread uses any worker that is free. The results do not depend on the choice of the worker.
        """
        while len(self._workers) < thread_pool.number_of_threads():  # on this thread, as FFTW's planner is serial
            self._workers.append(Worker(*self._arguments))

        def part(first: int, last: int) -> None:
            worker = self._workers.pop()
            try:
                for batch in range(first, last):
                    work(worker, batch)
            finally:
                self._workers.append(worker)

        # In a light loop a node takes 25% of the time of a particle.
        nodes = math.prod(self._arguments[0])
        parallel_for(part, batches, least=max(1, batches * 4 * threads.MIN_CHUNK_CHEAP // nodes))


class Worker:
    """FFTW plans and buffers of one thread.

    `forward` and `backward` transform a batch of ROWS rows along y. `convolve` transforms a tile of TILE modes along x.
    """

    def __init__(self, padded: tuple[int, int], periodic: bool, border: int) -> None:
        nx, ny = padded
        self.border = border
        count = ny // 2 + 1
        # The backward plan has separate rows, as the padding of the forward ones must stay 0.
        self.rows, self.rows_back = pyfftw.zeros_aligned((ROWS, ny)), pyfftw.zeros_aligned((ROWS, ny))
        self.spectra = pyfftw.zeros_aligned((ROWS, -(-count // TILE) * TILE), complex)
        spectra = self.spectra[:, :count]
        self.along_y = _make_plan(self.rows, spectra, "FFTW_FORWARD")
        self.back_along_y = _make_plan(spectra, self.rows_back, "FFTW_BACKWARD", "FFTW_DESTROY_INPUT")
        self.columns = Columns(nx) if periodic else PaddedColumns(nx, border)

    def forward(self, surface_density: Array, first: int, tiles: Array) -> None:
        """Transform the batch of rows of `surface_density` from `first` on along y, and store the result in `tiles`."""
        load_rows(surface_density, first, self.rows)
        self.along_y.execute()
        rows_to_tiles(self.spectra, first, tiles)

    def convolve(self, tiles: Array, number: int, kernel: Array) -> None:
        """Convolve tile `number` of `tiles` along x with the transformed kernel (ky, kx), in place."""
        self.columns.convolve(tiles[number], kernel, number * TILE)

    def backward(self, tiles: Array, first: int, potential: Array, shift: int) -> None:
        """Transform the rows of `tiles` from `first` on back along y, and store the result in `potential`.

        The rows are one batch. Row i of the tiles becomes row i + shift of the potential.
        """
        tiles_to_rows(tiles, first, self.spectra)
        self.back_along_y.execute()
        store_rows(self.rows_back, first, shift, self.border, potential)


class Columns:
    """Convolution along x, on a periodic grid with nx rows."""

    def __init__(self, nx: int) -> None:
        self.length = nx
        self._make_plans(TILE)

    def _make_plans(self, columns: int) -> None:
        """Make buffers and plans for this number of columns of `length`."""
        # Rows at distances of a power of two would map to the same cache lines and slow a transpose.
        shape = columns, self.length + 4
        self.given, self.modes = pyfftw.zeros_aligned(shape, complex), pyfftw.zeros_aligned(shape, complex)
        self.parts = self.modes.view(float)  # real and imaginary, in turn
        given, modes = self.given[:, : self.length], self.modes[:, : self.length]
        self.forth, self.back = _make_plan(given, modes, "FFTW_FORWARD"), _make_plan(modes, given, "FFTW_BACKWARD")

    def convolve(self, tile: Array, kernel: Array, first: int) -> None:
        """Convolve the columns of `tile` (nx, TILE), modes along y, with the transformed kernel (ky, kx), in place.

        first: row of the kernel for the first column.
        """
        load_columns(tile, self.given)
        self.forth.execute()
        multiply_columns(self.parts, kernel, first, self.length)
        self.back.execute()
        store_columns(self.given, tile)


class PaddedColumns(Columns):
    """Convolution along x, on an open grid with `padded` rows, half of which are padding.

    Even and odd modes are separate transforms. With FFTW_ESTIMATE plans two transforms of 2^11 numbers take 60% of the
    time of one of 2^12 (2026-11).
    """

    def __init__(self, padded: int, border: int) -> None:
        self.length, self.border = padded // 2, border
        self.wave = np.exp(-1j * np.pi / self.length * np.arange(self.length))
        self._make_plans(2 * TILE)
        self.halves, self.parts = (each.reshape(2, TILE, -1) for each in (self.given, self.parts))

    def convolve(self, tile: Array, kernel: Array, first: int) -> None:
        """Convolve the columns of `tile` (nx + 2 border, TILE), modes along y, with the kernel (ky, kx), in place.

        The border rows before the first node come last. first: row of the kernel for the first column.
        """
        nx = len(tile) - 2 * self.border
        load_halves(tile, nx, self.wave, self.halves)
        self.forth.execute()
        multiply_halves(self.parts, kernel, first, self.length)
        self.back.execute()
        store_halves(self.halves, nx, self.border, self.wave, tile)


def _make_plan(source: Array, target: Array, direction: str, *flags: str) -> pyfftw.FFTW:
    return pyfftw.FFTW(source, target, axes=(1,), direction=direction, flags=("FFTW_ESTIMATE", *flags), threads=1)


def padded_shape(shape: tuple[int, int], periodic: bool) -> tuple[int, int]:
    """Return the shape (nx, ny) of the Fourier transform for a grid of `shape`; with open edges it is larger."""
    # At least twice as many, so that no pair of nodes interacts across the edge; even, so that the kernel has a middle.
    return shape if periodic else (2 * next_fast_len(shape[0], real=True), 2 * next_fast_len(shape[1], real=True))


def tiles_of(padded: tuple[int, int]) -> int:
    """Return the number of tiles, of TILE columns each, that hold the modes along y of a `padded` grid (nx, ny)."""
    return -(-(padded[1] // 2 + 1) // TILE)


def even_first(transform: Array) -> Array:
    """Return a transform (ky, kx) with the columns of even kx first, then the columns of odd kx."""
    return np.concatenate([transform[:, ::2], transform[:, 1::2]], axis=1)


def open_kernel(padded: tuple[int, int], cell: float, kernel: Kernel, some: slice = EVERYTHING) -> Array:
    """Return the kernel w times cell^2 at separations (y, x) from 0 to half the padded sides.

    some: slice of the separations along x to compute.
    """
    x, y = (cell * np.arange(n // 2 + 1) for n in padded)
    distance = np.hypot(x[some], y[:, None])
    distance[0, x[some] == 0.0] = kernel.self_distance * cell
    return cell**2 * kernel.potential(distance)


def periodic_transform(padded: tuple[int, int], cell: float, kernel: Kernel, some: slice = EVERYTHING) -> Array:
    """Return the transform w_k of the kernel at the wavenumbers (ky, kx) of the grid; w_k is 0 at k = 0.

    some: slice of the wavenumbers ky to compute.
    """
    kx, ky = (2 * np.pi * np.fft.rfftfreq(n, cell) for n in padded)
    k = np.hypot(kx, ky[some, None])
    k[ky[some] == 0.0, 0] = np.inf
    return kernel.potential_transform(k)
