"""Deposit, gather and gradient on the grid."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from discsim import load_scene
from discsim.kernels.common.grid import BAND, cell_of
from discsim.numerics.batches import bounds_of
from discsim.numerics.grid import Grid
from discsim.numerics.layout import leaf_side_and_counts

OPEN = Grid((-1.0, -0.5), 1 / 16, (32, 16), periodic=False)
PERIODIC = Grid((0.0, 0.0), 1 / 16, (32, 16), periodic=True)
LINE = Grid((0.0, 0.0), 1 / 16, (32, 1), periodic=True)
ROUNDING = 1e-13  # a few hundred sums of numbers of order one


def particles(grid, count=5000, seed=1):
    """Positions whose nodes are all on the grid, and masses."""
    rng = np.random.default_rng(seed)
    margin = 0.0 if grid.periodic else 0.5
    dimensions = 1 if grid.shape[1] == 1 else 2
    along = np.array(grid.shape[:dimensions])
    nodes = margin + (along - 2 * margin) * rng.random((count, dimensions))
    return np.array(grid.origin[:dimensions]) + grid.cell * nodes, rng.random(count)


def cell_size(pos, grid):
    return grid.cell ** pos.shape[1]


@pytest.mark.parametrize("grid", [OPEN, PERIODIC, LINE])
def test_deposit_keeps_the_mass(grid):
    pos, mass = particles(grid)
    assert grid.deposit(pos, mass).sum() * cell_size(pos, grid) == pytest.approx(mass.sum(), rel=ROUNDING)


def test_deposit_keeps_the_centre_of_mass():
    pos, mass = particles(OPEN)
    share = OPEN.deposit(pos, mass) * OPEN.cell**2 / mass.sum()
    centre = [(share.sum(axis=1) * OPEN.nodes(0)).sum(), (share.sum(axis=0) * OPEN.nodes(1)).sum()]
    np.testing.assert_allclose(centre, np.average(pos, axis=0, weights=mass), atol=ROUNDING)


def test_deposit_is_cloud_in_cell():
    pos = np.array([[OPEN.nodes(0)[9] + 0.25 * OPEN.cell, OPEN.nodes(1)[3] + 0.5 * OPEN.cell]])
    density = OPEN.deposit(pos, np.array([8.0])) * OPEN.cell**2
    np.testing.assert_allclose(density[9:11, 3:5], [[3, 3], [1, 1]], rtol=ROUNDING)
    assert np.count_nonzero(density) == 4


def test_deposit_adds_to_what_is_there():
    pos, mass = particles(OPEN)
    both = OPEN.deposit(pos[1000:], mass[1000:], out=OPEN.deposit(pos[:1000], mass[:1000]))
    np.testing.assert_allclose(both, OPEN.deposit(pos, mass), rtol=0, atol=ROUNDING * both.max())


@pytest.mark.parametrize("cells", [1, 3, 64, 65, 300])
def test_any_number_of_rows_fits_the_strips(cells):
    grid = Grid((0.0, 0.0), 1.0, (cells, 7), periodic=True)
    x, y = np.meshgrid(np.arange(4 * cells) / 4, np.arange(28) / 4, indexing="ij")
    pos = np.stack([x.ravel(), y.ravel()], axis=1) + 0.1
    np.testing.assert_allclose(grid.deposit(pos, np.full(len(pos), 1 / 16)), 1.0, rtol=ROUNDING)


@pytest.mark.parametrize("grid", [OPEN, PERIODIC, LINE])
def test_gather_is_the_transpose_of_the_deposit(grid):
    pos, mass = particles(grid)
    field = np.random.default_rng(2).random(grid.shape)
    on_nodes = (grid.deposit(pos, mass) * field).sum() * cell_size(pos, grid)
    assert (mass * grid.gather(field, pos)).sum() == pytest.approx(on_nodes, rel=ROUNDING)


@pytest.mark.parametrize("grid", [OPEN, PERIODIC, LINE])
def test_what_is_pulled_is_what_is_gathered(grid):
    """Up to the last nodes of a periodic box, beyond which the first ones are next."""
    pos, _ = particles(grid)
    field = np.random.default_rng(4).normal(size=(*grid.shape, 2))
    places = pos, pos[:7], pos[:0]  # of some species
    accelerations = [np.zeros(each.shape) for each in places]
    found = grid.pull(field, zip(places, accelerations, strict=True))
    expected = grid.gather(field if pos.shape[1] == 2 else field[:, :, :1], pos).reshape(pos.shape)
    for acc, (strongest, missing) in zip(accelerations, found, strict=True):
        np.testing.assert_allclose(acc, -expected[: len(acc)], atol=ROUNDING)
        assert strongest == pytest.approx(np.linalg.norm(acc, axis=1).max(initial=0.0)) and missing == 0


def test_gather_is_exact_for_linear_fields():
    pos, _ = particles(OPEN)
    x, y = np.meshgrid(OPEN.nodes(0), OPEN.nodes(1), indexing="ij")
    field = np.stack([1 + 2 * x - 3 * y, 4 * y - x], axis=2)
    expected = np.stack([1 + 2 * pos[:, 0] - 3 * pos[:, 1], 4 * pos[:, 1] - pos[:, 0]], axis=1)
    np.testing.assert_allclose(OPEN.gather(field, pos), expected, atol=ROUNDING)


def test_periodic_positions_wrap():
    pos, mass = particles(PERIODIC)
    sides = np.array(PERIODIC.shape) * PERIODIC.cell
    shifts = np.random.default_rng(3).integers(-2, 3, pos.shape)
    wrapped = PERIODIC.deposit(pos + shifts * sides, mass)
    # Adding two sides of length 2 costs the weights two or three bits.
    np.testing.assert_allclose(wrapped, PERIODIC.deposit(pos, mass), rtol=1e-11)


def test_the_edges_of_a_periodic_box():
    edges = np.array([[0.0, 0.0], [2.0, 1.0], [-1e-18, -1e-18], [2 - 1e-16, 1 - 1e-16]])
    density = PERIODIC.deposit(edges, np.ones(4)) * PERIODIC.cell**2
    corners = density[np.ix_([0, -1], [0, -1])]
    np.testing.assert_allclose(corners, 1.0, atol=ROUNDING)
    just_below_a_node = np.full((1, 2), np.nextafter(PERIODIC.cell / 2, 0))
    assert PERIODIC.deposit(just_below_a_node, np.ones(1))[0, 0] * PERIODIC.cell**2 == pytest.approx(1)


def test_particles_off_the_grid_are_found_and_left_out():
    half = OPEN.cell / 2
    inside = np.array([[-1 + half, -0.5 + half], [1 - 1.01 * half, 0.0]])
    outside = np.array([[-1.0, 0.0], [0.0, 0.5], [0.0, np.nan], [np.inf, 0.0], [1 - half / 2, 0.0]])
    pos = np.concatenate([outside, inside])
    np.testing.assert_array_equal(OPEN.outside(pos), np.arange(5))
    assert OPEN.deposit(pos, np.ones(7)).sum() * OPEN.cell**2 == pytest.approx(2, rel=ROUNDING)
    np.testing.assert_allclose(OPEN.gather(np.ones(OPEN.shape), pos), [0, 0, 0, 0, 0, 1, 1])


def test_an_open_grid_covers_its_space():
    """Sides of 16 and of 10.4 cells: the short one is rounded up, so that nobody in the space is without a cell."""
    scene = load_scene({
        "units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": [4.0, 2.6], "cells": 16},
        "dust": {"particles": 1, "ratio": 1.0},
    }, own_particles=True)  # fmt: skip
    grid = Grid.from_scene(scene, 100)
    assert grid.shape == (16, 11) and grid.origin == (-2.0, -1.375)


@pytest.mark.parametrize("boundary", ["periodic", "open"])
def test_drag_cells_of_a_line_are_at_most_four_a_particle(boundary):
    """However fine they are asked for: a billion of them would fill the memory, and be empty."""
    side, (number,) = leaf_side_and_counts(1e-9, 1 / 16, (16,), boundary == "periodic", 64)
    assert number == 256 and side == pytest.approx(1 / 256, rel=1e-12)


def test_no_particle_is_outside_a_periodic_box_but_one_that_is_nowhere():
    pos = np.array([[-50.0, 3.0], [np.nan, 0.5], [1e300, np.inf]])
    np.testing.assert_array_equal(PERIODIC.outside(pos), [1, 2])


def test_gradient_is_exact_for_quartics_up_to_the_edges():
    x, y = np.meshgrid(OPEN.nodes(0), OPEN.nodes(1), indexing="ij")
    gradient = OPEN.gradient(x**4 - x**2 * y**2 + y**3)
    # Differences of numbers of order one over a cell of 1/16.
    np.testing.assert_allclose(gradient[:, :, 0], 4 * x**3 - 2 * x * y**2, atol=100 * ROUNDING)
    np.testing.assert_allclose(gradient[:, :, 1], 3 * y**2 - 2 * x**2 * y, atol=100 * ROUNDING)


@pytest.mark.parametrize("axis", [0, 1])
def test_periodic_gradient_is_of_fourth_order(axis):
    errors = []
    for cells in (16, 32):
        grid = Grid((0.0, 0.0), 1 / cells, (cells, cells), periodic=True)
        wave = 2 * np.pi * grid.nodes(axis)
        field = np.sin(wave)[:, None] * np.ones(cells) if axis == 0 else np.sin(wave) * np.ones((cells, 1))
        exact = 2 * np.pi * np.cos(wave)
        got = grid.gradient(field)
        errors.append(np.abs(got[:, :, axis] - (exact[:, None] if axis == 0 else exact)).max())
        assert np.abs(got[:, :, 1 - axis]).max() < 100 * ROUNDING
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.05)  # the next order is (k cell)^2 ~ .15 of a fifth


@pytest.mark.parametrize("shape", [(1, 1), (2, 1), (3, 2), (4, 9)])
def test_small_periodic_grids(shape):
    grid = Grid((0.0, 0.0), 1.0, shape, periodic=True)
    np.testing.assert_allclose(grid.gradient(np.ones(shape)), 0, atol=1e-15)
    density = grid.deposit(np.array([[0.2, 0.7], [3.3, -1.0]]), np.array([1.0, 2.0]))
    assert density.sum() == pytest.approx(3)


def test_an_open_grid_too_small_for_a_gradient():
    with pytest.raises(ValueError, match="at least 5 cells"):
        Grid((0.0, 0.0), 1.0, (4, 8), periodic=False).gradient(np.zeros((4, 8)))


def scene(size, cells=None, boundary="open", kind="disc"):
    space = SimpleNamespace(size=size, cells=cells, boundary=boundary, dimensions=len(size))
    centred = kind in ("disc", "shock") if kind else boundary == "open"
    return SimpleNamespace(space=space, initial=kind and SimpleNamespace(kind=kind), centred=centred)


def test_grid_of_a_disc_is_centred():
    grid = Grid.from_scene(scene((260.0, 130.0), 512), 0)
    assert grid == Grid((-130.0, -65.0), 260 / 512, (512, 256), False)


def test_grid_of_a_periodic_box_starts_at_zero():
    grid = Grid.from_scene(scene((1.0, 2.0), 64, "periodic", "box"), 0)
    assert grid == Grid((0.0, 0.0), 1 / 32, (32, 64), True)


def test_grid_of_a_shock_tube():
    assert Grid.from_scene(scene((2.0,), 10, "open", "shock"), 0) == Grid((-1.0, 0.0), 0.2, (10, 1), False)


@pytest.mark.parametrize(("boundary", "origin"), [("open", (-1.0, -1.0)), ("periodic", (0.0, 0.0))])
def test_grid_of_own_particles(boundary, origin):
    assert Grid.from_scene(scene((2.0, 2.0), 8, boundary, None), 0).origin == origin


def test_cells_follow_the_number_of_particles():
    assert Grid.from_scene(scene((1.0, 1.0)), 300_000).shape == (512, 512)
    assert Grid.from_scene(scene((1.0,), None, "periodic", "wave"), 600).shape == (512, 1)
    assert Grid.from_scene(scene((1.0, 1.0)), 0).shape == (8, 8)


def test_sides_that_do_not_fit_a_periodic_box():
    with pytest.raises(ValueError, match=r"space\.size: 10 square cells .* 5\.5 along another"):
        Grid.from_scene(scene((1.0, 0.55), 10, "periodic", "box"), 0)


def test_cell_of():
    assert [cell_of(x, -1.0, 4.0, 8, False) for x in (-1.0, 0.99, 1.0, -1.01, np.nan)] == [0, 7, -1, -1, -1]
    assert [cell_of(x, 0.0, 4.0, 8, True) for x in (2.0, -0.01, -1e-18, 6.1, np.nan)] == [0, 7, 0, 0, -1]


@pytest.mark.parametrize("grid", [OPEN, PERIODIC, LINE])
@pytest.mark.parametrize("ordered", [False, True])
def test_extent_is_that_of_the_first_nodes(grid, ordered):
    """In each band of rows, of particles in the order of space or none; with some beyond an edge, or the last node of a
    period.
    """
    fine = replace(grid, cell=grid.cell / 8, shape=(8 * grid.shape[0], 8 * grid.shape[1] if grid is not LINE else 1))
    pos, _ = particles(grid, 4000)
    if ordered:
        pos = pos[np.argsort(fine.sort_keys(pos)[0])]
    dim = pos.shape[1]
    pos[7] = np.array(fine.origin[:dim]) + (np.array(fine.shape[:dim]) - 0.25) * fine.cell
    s = (pos - fine.origin[:dim]) * (1.0 / fine.cell) - 0.5
    if fine.periodic:
        s %= np.array(fine.shape[:dim])
    first, last = s.astype(int), np.array(fine.shape[:dim]) - (0 if fine.periodic else 1)
    on = np.all((s >= 0) & (s < last), axis=1)
    x, y = first[on, 0], first[on, 1] if dim == 2 else np.zeros(on.sum(), int)
    found = fine.extent(pos, bounds_of(pos))
    assert (found.low, found.high, found.off) == (x.min(), x.max(), np.count_nonzero(~on))
    assert found.off > 0 or fine.periodic
    assert len(found.least) == len(found.most) == -(-fine.shape[0] // BAND)
    for band, ends in enumerate(zip(found.least, found.most, strict=True)):
        here = y[x // BAND == band]
        assert ends == ((here.min(), here.max()) if len(here) else (fine.shape[1], -1))


@pytest.mark.parametrize("grid", [OPEN, PERIODIC, LINE])
def test_deposit_by_pieces_is_that_of_rows_in_that_order(grid):
    """To the last bit; with rows in no piece left out."""
    pos, mass = particles(grid, 3000)
    first, last = np.array([2000, 40, 2990, 0]), np.array([2900, 1500, 2991, 7])
    rows = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
    found = grid.deposit(pos, mass, pieces=(first, last))
    np.testing.assert_array_equal(found, grid.deposit(pos[rows], mass[rows]))
    assert not np.array_equal(found, grid.deposit(pos[np.sort(rows)], mass[np.sort(rows)]))  # the order counts
