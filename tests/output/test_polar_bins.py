"""Maps and profiles of gas in polar cells, which are not smoothed as particles are."""

import numpy as np
import pytest

from discsim.formulas.polar import PolarShape, shape_of_cells
from discsim.output.bins import polar_pixels, smooth_edges
from discsim.output.cells import CellRings, polar_cell_pixels, polar_grid, square_cell_pixels

SHAPE = PolarShape(36, 130, 0.7, 2.1, False)


def centroids(shape=SHAPE):
    """Radius, azimuth and area (n,) of the cells."""
    radius, azimuth, area = shape.centroids()
    r, phi = (each.ravel() for each in np.meshgrid(radius, azimuth, indexing="ij"))
    return r, phi, np.repeat(area, shape.angles)


def density(r, phi):
    return r**-1.3 * (1.0 + 0.4 * np.cos(3.0 * phi - 2.0 * r))


def test_cells_are_known_by_their_places():
    r, phi, area = centroids()
    pos = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)
    assert polar_grid(pos)[:2] == SHAPE[:2]
    np.testing.assert_allclose(shape_of_cells(pos)[2:4], SHAPE[2:4], rtol=1e-12)
    np.testing.assert_allclose(area.sum(), np.pi * (2.1**2 - 0.7**2), rtol=1e-13)
    pos[55] *= 1.0 + 1e-6
    assert polar_grid(pos) is None
    assert polar_grid(np.random.default_rng(2).normal(size=(400, 2))) is None
    assert polar_grid(np.zeros((5, 1))) is None and polar_grid(np.empty((0, 2))) is None


def test_mass_in_rings_is_that_of_the_cells():
    r, _, area = centroids()
    rings = CellRings(SHAPE, smooth_edges((0.0, 3.0)))
    mass = area * r**-1.3
    found = rings.sum(mass)
    np.testing.assert_allclose(found.sum(), mass.sum(), rtol=1e-13)
    edges = smooth_edges((0.0, 3.0))
    middle = 0.5 * (edges[1:] + edges[:-1])
    inside = (middle > 0.75) & (middle < 2.0)
    # Cells are 0.03 wide in ln r; rings of particles at their centroids would differ by a factor of 3.
    np.testing.assert_allclose((found / rings.measure)[inside], middle[inside] ** -1.3, rtol=2e-3)
    outside = (edges[1:] < 0.7) | (edges[:-1] > 2.1)
    assert not found[outside].any()
    smooth = CellRings(SHAPE, smooth_edges((0.0, 3.0), width=0.1), width=0.1)
    np.testing.assert_allclose(smooth.sum(mass).sum(), mass.sum(), rtol=1e-6)  # Gaussians end at 3.5 widths
    assert smooth.sum(mass)[np.searchsorted(smooth_edges((0.0, 3.0), width=0.1), 0.65)] > 0.0


@pytest.mark.parametrize("log", [False, True])
def test_maps_show_the_density_of_cells_to_second_order(log):
    errors = []
    for factor in (1, 2):
        shape = SHAPE._replace(rings=36 * factor, angles=130 * factor)
        r, phi, area = centroids(shape)
        pixels = polar_cell_pixels(shape, 0.6, 2.3, 90, log)
        like = polar_pixels(np.zeros((1, 2)), 0.6, 2.3, 90, log)
        assert np.shape(pixels.measure) == like.shape
        np.testing.assert_allclose(pixels.measure, like.measure, rtol=1e-12)
        edges = np.geomspace(0.6, 2.3, 46) if log else np.linspace(0.6, 2.3, 46)
        middle = np.sqrt(edges[1:] * edges[:-1]) if log else 0.5 * (edges[1:] + edges[:-1])
        azimuth = -np.pi + (np.arange(90) + 0.5) * 2.0 * np.pi / 90
        found = pixels.sum(area * density(r, phi)) / pixels.measure
        inside = (middle > 0.75) & (middle < 2.0)
        errors.append(np.abs(found - density(middle, azimuth[:, None]))[:, inside].max())
        assert not found[:, (middle < 0.7) | (middle > 2.1)].any()
    assert errors[0] < 3e-3 and np.log2(errors[0] / errors[1]) > 1.7


def test_square_pixels_show_the_density_of_cells():
    r, phi, area = centroids()
    window = np.array([-2.3, -1.0]), np.array([1.9, 2.2])
    pixels = square_cell_pixels(SHAPE, window, 84)
    found = pixels.sum(area * density(r, phi)) / pixels.measure
    assert found.shape == (84, 64) and np.isclose(pixels.measure, 0.05**2)
    x, y = (low + 0.05 * (np.arange(n) + 0.5) for low, n in ((-2.3, 84), (-1.0, 64)))
    at, angle = np.hypot(x[:, None], y), np.arctan2(y, x[:, None])
    inside = (at > 0.75) & (at < 2.0)
    np.testing.assert_allclose(found[inside], density(at, angle)[inside], atol=3e-3)
    assert not found[(at < 0.7) | (at > 2.1)].any()
    speed = pixels.sum(area * density(r, phi) * r) / np.maximum(pixels.sum(area * density(r, phi)), 1e-300)
    np.testing.assert_allclose(speed[inside], at[inside], rtol=3e-3)


def test_exported_layers_have_the_density_of_cells(tmp_path):
    """Cells of an export that are not those of the run: their masses are right to 1%, and the sum to rounding."""
    from runs import put_out

    from discsim import Simulation, read_snapshot
    from discsim.export.layers import disc_of

    sim = Simulation({
        "run": {"until": "1 yr"},
        "space": {"size": "60 au"},
        "initial": {
            "kind": "disc", "surface_density": "1 g/cm2", "inner": "7 au", "outer": "20 au",
            "surface_density_index": 1.3, "reference_radius": "10 au",
        },
        "star": {"mass": "1.3 Msun"},
        "gas": {"method": "grid", "particles": 3000, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.07}},
    })  # fmt: skip
    put_out(sim, tmp_path / "0000.h5")
    disc = disc_of(read_snapshot(tmp_path / "0000.h5"), 37)
    gas = disc.snap.gas
    mass = disc.masses(gas.pos, gas.mass)
    np.testing.assert_allclose(mass.sum(), gas.mass.sum(), rtol=1e-13)
    unit = float(gas.radius.max()) / 2.0
    inside = (disc.radius > 0.75 * unit) & (disc.radius < 1.9 * unit)
    density = (mass / (np.pi * np.diff(disc.edges**2) / 37)[:, None])[inside]
    profile = density * (disc.radius[inside, None] / unit) ** 1.3
    # The edges of the disc cut cells of the export, and all masses are scaled to the right sum.
    np.testing.assert_allclose(profile / profile.mean(), 1.0, atol=0.005)
