"""Starts of polar cells from snapshots of particles, of particles from those of cells, and of one grid from another."""

import numpy as np
import pytest
from runs import put_out
from scenes import problems

from discsim import Simulation, read_snapshot
from discsim.formulas.polar import FLOOR, PolarShape, shape_of_cells
from discsim.initial import regrid

MASS = 1.3  # of the star
SPH = {
    "units": {"system": "code"},
    "run": {"until": 4.0},
    "space": {"size": 8.0},
    "initial": {"kind": "disc", "surface_density": 1e-4, "inner": 0.7, "outer": 2.0, "perturbation": 0.17},
    "star": {"mass": MASS},
    "gas": {"particles": 9000, "eos": {"kind": "adiabatic", "gamma": 1.3, "aspect_ratio": 0.08}},
}
WIDE = {"method": "grid", "particles": 6000, "grid": {"inner": 0.5, "outer": 2.4}}
SHAPE = PolarShape(40, 120, 0.7, 2.0, False)


def totals(gas):
    spin = gas.pos[:, 0] * gas.vel[:, 1] - gas.pos[:, 1] * gas.vel[:, 0]
    return np.array([gas.mass.sum(), gas.mass @ spin, gas.mass @ gas.u])


def started(path, **gas):
    given = {key: value for key, value in (SPH["gas"] | gas).items() if value is not None}
    return Simulation(SPH | {"initial": {"kind": "snapshot", "file": str(path)}, "gas": given})


def in_cells(shape):
    """Arrays of gas in cells: two arms on a slope, on elliptic motion that is smooth in ln r and azimuth."""
    radius, azimuth, area = shape.centroids()
    r, phi = (each.ravel() for each in np.meshgrid(radius, azimuth, indexing="ij"))
    out = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    across = np.stack([-out[:, 1], out[:, 0]], axis=1)
    density = r**-0.7 * (1.0 + 0.3 * np.cos(2.0 * phi + 3.0 * r))
    radial, around = 0.1 * np.sin(phi), np.sqrt(MASS / r) * (1.0 + 0.02 * np.cos(phi))
    vel, mass = radial[:, None] * out + around[:, None] * across, density * np.repeat(area, shape.angles)
    more = {"u": 0.01 * (2.0 + np.cos(phi)) / r, "small": mass * 0.02 * (1.5 + np.sin(phi))}
    return {"pos": r[:, None] * out, "vel": vel, "mass": mass, "density": density, **more}


@pytest.fixture(scope="module")
def snapshots(tmp_path_factory):
    """Snapshots of a disc of particles, of one in cells that starts from it, and of particles that start from that."""
    folder, paths = tmp_path_factory.mktemp("snapshots"), {}
    sim = Simulation(SPH)
    for name, gas in (("particles", {}), ("cells", WIDE), ("again", {"particles": 7000})):
        sim = sim if name == "particles" else started(paths["particles" if name == "cells" else "cells"], **gas)
        put_out(sim, paths.setdefault(name, folder / f"{name}.h5"))
    return {name: (path, read_snapshot(path).gas) for name, path in paths.items()}


def test_totals_of_particles_in_cells_and_back(snapshots):
    before, cells, after = (totals(snapshots[name][1]) for name in ("particles", "cells", "again"))
    # Empty cells take the smallest density, FLOOR of the largest one, on about as wide an area as the disc.
    np.testing.assert_allclose(cells, before, rtol=10.0 * FLOOR)
    np.testing.assert_allclose(after, cells, rtol=1e-13)
    assert np.ptp(snapshots["again"][1].mass) == 0.0


def test_gas_of_particles_in_cells_and_back(snapshots):
    """Profiles agree, and the pattern of the perturbation within 30%, as kernels are 0.15 wide."""
    patterns = []
    for _, gas in snapshots.values():
        r, phi = np.hypot(*gas.pos.T), np.arctan2(*gas.pos.T[::-1])
        inside = (r > 1.0) & (r < 1.6)
        around = (gas.pos[:, 0] * gas.vel[:, 1] - gas.pos[:, 1] * gas.vel[:, 0]) / r
        # Balance of pressure makes the gas slower than Kepler by H^2 / r^2; kernels smooth by their width squared / 8.
        np.testing.assert_allclose(around[inside] * np.sqrt(r[inside] / MASS), 1.0, atol=0.02)
        area = np.pi * (1.6**2 - 1.0)
        assert np.isclose(gas.mass[inside].sum() / area, (1e-4 / r[inside]).mean() * 1.0, rtol=0.15)
        patterns.append([(gas.mass * inside) @ np.exp(1j * m * phi) / gas.mass[inside].sum() for m in (2, 3, 4)])
    first, *others = np.array(patterns)
    assert np.abs(first).min() > 0.005
    for other in others:
        assert np.abs(other - first).max() < 0.3 * np.abs(first).max()


def test_a_finer_grid_has_the_gas_of_a_coarser_one_to_second_order():
    errors = []
    for factor in (1, 2, 4):
        old = SHAPE._replace(rings=20 * factor, angles=60 * factor)
        new = SHAPE._replace(rings=34 * factor, angles=94 * factor)
        made, exact = regrid.cells_to_cells(old, new, in_cells(old)), in_cells(new)
        r = np.hypot(*exact["pos"].T)
        inside = (r > 0.8) & (r < 1.8)  # slopes at the edges of monotone cubics are of first order
        errors.append([np.sqrt(np.mean((made[k] / exact[k] - 1.0)[inside] ** 2)) for k in ("density", "u", "small")])
        errors[-1].append(np.abs(made["vel"] - exact["vel"])[inside].max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 1.7, (errors, orders)
    assert np.max(errors[-1]) < 0.005


def test_totals_of_another_grid_and_of_particles():
    gas = in_cells(SHAPE)
    wanted = regrid._totals(gas)
    wider = regrid.cells_to_cells(SHAPE, PolarShape(50, 100, 0.6, 2.3, True), gas)
    particles = regrid.cells_to_particles(SHAPE, gas, 5000, np.random.default_rng(4))
    for found, tolerance in ((particles, 1e-13), (wider, 1e-13)):
        for name, total in regrid._totals(found).items():
            assert np.isclose(total, wanted[name], rtol=tolerance), name
    part = regrid.cells_to_cells(SHAPE, SHAPE._replace(inner=1.0), gas)
    r = np.hypot(*gas["pos"].T)
    # A ring is cut by the new edge: its mass is a fortieth of the whole.
    for name, total in regrid._totals(part).items():
        outside = {n: v[r > 1.0] for n, v in gas.items()}
        assert np.isclose(total, regrid._totals(outside)[name], rtol=0.03)


def test_particles_follow_the_arms_of_cells():
    """Positions of particles of equal mass have the second Fourier component of the cells."""
    gas = in_cells(SHAPE)
    found = regrid.cells_to_particles(SHAPE, gas, 20_000, np.random.default_rng(4))
    for first, last in ((0.8, 1.0), (1.2, 1.4), (1.6, 1.8)):
        of = []
        for arrays in (gas, found):
            r, phi = np.hypot(*arrays["pos"].T), np.arctan2(*arrays["pos"].T[::-1])
            mass = arrays["mass"] * ((r > first) & (r < last))
            of.append((mass @ np.exp(2j * phi + 3j * r)) / mass.sum())
        assert abs(of[0]) > 0.1
        # Rings of cells and of particles at the ends of a bin are 0.02 wide, a tenth of it.
        assert abs(of[1] - of[0]) < 0.02


def test_points_of_a_particle_have_the_moments_of_its_kernel():
    points = regrid._kernel_points(2000)
    assert np.abs(points.mean(axis=0)).max() < 1e-15
    # Of Wendland C2, sum r^2 W / sum W = 5/36 in a plane.
    assert (points**2).mean() == pytest.approx(5.0 / 72.0, rel=1e-3)
    assert np.abs((points[:, 0] * points[:, 1]).mean()) < 1e-3


def test_a_linear_flow_of_particles_is_the_same_in_cells():
    """At random positions, so that each particle contributes with its velocity gradient."""
    rng, slopes = np.random.default_rng(8), np.array([[0.3, -1.1], [0.7, -0.2]])
    pos = rng.uniform(-2.2, 2.2, (6000, 2))
    made = regrid.particles_to_cells(
        SHAPE, {"pos": pos, "vel": pos @ slopes.T, "mass": np.ones(6000)}, np.full(6000, 0.2)
    )
    r = np.hypot(*made["pos"].T)
    wrong = np.abs(made["vel"] - made["pos"] @ slopes.T)[(r > 0.8) & (r < 1.9)]
    assert wrong.max() < 0.02  # the slope of the density in a cell, times its side of 0.04


def test_the_grid_of_cells_is_found_from_their_places():
    found = shape_of_cells(in_cells(SHAPE)["pos"])
    assert found[:2] == SHAPE[:2]
    np.testing.assert_allclose(found[2:4], SHAPE[2:4], rtol=1e-12)
    # Rings of which 5e-9 of the radius is the width, as in tubes at large radii.
    thin = PolarShape(200, 8, 1e6, 1e6 + 1.0, False)
    found = shape_of_cells(in_cells(thin)["pos"])
    assert found[:2] == thin[:2]
    np.testing.assert_allclose(np.subtract(found[2:4], 1e6), [0.0, 1.0], atol=1e-6)
    moved = in_cells(SHAPE)["pos"]
    moved[7] *= 1.0 + 1e-6
    with pytest.raises(ValueError, match="not in the cells"):
        shape_of_cells(moved)


def test_cells_from_particles_stay_in_balance(snapshots):
    """Radial motions remain those of the particles before, 0.1 of the sound speed."""
    sim = started(snapshots["particles"][0], **WIDE)
    sim.run(3.0)
    r = np.hypot(*sim.gas.pos.T)
    inside = (r > 1.0) & (r < 1.6)
    radial = (sim.gas.pos * sim.gas.vel).sum(axis=1) / r
    assert np.sqrt(np.mean((radial / sim.gas.sound_speed)[inside] ** 2)) < 0.2


def test_messages_of_snapshots(snapshots):
    path, _ = snapshots["particles"]
    scene = SPH | {"initial": {"kind": "snapshot", "file": str(path)}, "gas": SPH["gas"] | {"method": "grid"}}
    found = problems(scene)
    assert any("gas.grid: initial.file has SPH particles and no edges; add gas.grid.inner" in one for one in found), (
        found
    )
    away = {"inner": 3.0, "outer": 3.5}
    with pytest.raises(Exception, match="the snapshot has no gas in the polar grid"):
        started(path, **WIDE | {"grid": away})
    with pytest.raises(Exception, match="the snapshot has no gas in the polar grid"):
        started(snapshots["cells"][0], **WIDE | {"grid": away})
