"""Files for RADMC-3D and MCFOST, read back by readers of the tests: masses, layers, star, opacities, gas."""

import numpy as np
import pytest
from astropy import constants
from astropy import units as u
from sky_discs import UNITS, even_positions, particles, scene_of_layers, snapshot
from transfer_readers import (
    mcfost_bins,
    mcfost_density,
    mcfost_grid,
    mcfost_opacities,
    mcfost_parameters,
    mcfost_sizes,
    radmc3d_binary,
    radmc3d_grid,
    radmc3d_volumes,
    text_numbers,
)

import discsim.export
from discsim.output.fields.base import PlotError

CM = UNITS.cgs("length")
GRAM = UNITS.cgs("mass")
ALPHA = 3e-3
TWO_SIZES = scene_of_layers("0.4 mm", "7 mm")
AU2_YR = float(UNITS.in_code(1.0 * u.au**2 / u.yr, "diffusivity"))
OMEGA2 = 1.3 / 0.7  # Omega^2 r^3, G = 1


def aspect(r):
    """H / r of the gas."""
    return 0.06 * (r / 6.5) ** 0.2


def sigma(r):
    """Surface density of the gas in code units."""
    return 2e-6 * (r / 7) ** -1.3


def stokes(r, species):
    """Stokes numbers of two populations."""
    return np.array([0.02, 0.9])[species] * (r / 9) ** 0.7


def gas_of(rings=70, spacing=1.0, **arrays):
    """Gas on rings from 5 to 40 with P / Sigma = (H Omega)^2, on circular orbits with an inflow of a hundredth."""
    pos, area = even_positions(5.0, 40.0, rings, spacing)
    r = np.hypot(*pos.T)
    density, speed = sigma(r), np.sqrt(OMEGA2 / r)
    vel = (speed / r)[:, None] * (np.stack([-pos[:, 1], pos[:, 0]], axis=1) - 0.01 * pos)
    pressure = density * (aspect(r) * speed) ** 2
    heat = 55.0 * (r / 8) ** -0.4
    return particles(pos, density * area, vel=vel, density=density, pressure=pressure, temperature=heat, **arrays)


def disc(scene=TWO_SIZES, **arrays):
    """Gas, and dust of two populations with parts of 0.004 and 0.009 of its surface density."""
    pos, area = even_positions(5.0, 40.0, 60)
    r = np.hypot(*pos.T)
    both = [(pos, part * sigma(r) * area, np.full(len(pos), k)) for k, part in enumerate((0.004, 0.009))]
    pos, mass, species = (np.concatenate(each) for each in zip(*both, strict=True))
    numbers = stokes(np.hypot(*pos.T), species)
    return snapshot(particles(pos, mass, species=species, stokes=numbers), gas_of(**arrays), scene=scene)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An export for RADMC-3D, with temperatures."""
    home = tmp_path_factory.mktemp("export") / "radmc"
    options = {"opacity": "2.5 cm2/g,0.7 cm2/g", "temperature": "gas"}
    return discsim.export.write(disc(), "radmc3d", home, alpha=ALPHA, cells=96, **options)


def cells_of(folder):
    """Edges, volumes in cm3, and densities [species, phi, theta, r] of an export for RADMC-3D."""
    edges = radmc3d_grid(folder)
    volume = radmc3d_volumes(edges)
    return edges, volume, radmc3d_binary(folder / "dust_density.binp", volume.shape, several=True)


def test_masses_of_every_size_are_those_of_the_particles(folder):
    """1e-12: sums of 10^6 numbers in double precision."""
    snap, (_, volume, density) = disc(), cells_of(folder)
    for number in (0, 1):
        wanted = snap.dust.mass[snap.dust.species == number].sum() * GRAM
        assert (density[number] * volume).sum() == pytest.approx(wanted, rel=1e-12)
    number = radmc3d_binary(folder / "numberdens_h2.binp", volume.shape)[..., 0]
    mass = (number * volume).sum() * 2.8 * constants.u.cgs.value
    assert mass == pytest.approx(snap.gas.mass.sum() * GRAM, rel=1e-12)


@pytest.mark.parametrize("radius", [8.0, 14.0, 27.0])
def test_layers_have_the_density_and_the_heights_of_closed_forms(folder, radius):
    """rho(0) = Sigma / (sqrt(2 pi) H_d) with H_d = H sqrt(alpha / (alpha + St)), for gas St = 0; and <z^2> = H_d^2.

    Cells at the mid-plane are H_d / 4 wide, over which the density falls by 1% and which add 0.5% to <z^2>; the spread
    of particles over cells changes Sigma by 0.3%.
    """
    (r, theta, _), volume, density = cells_of(folder)
    gas = radmc3d_binary(folder / "numberdens_h2.binp", volume.shape)[..., 0] * 2.8 * constants.u.cgs.value
    ring = np.searchsorted(r, radius * CM) - 1
    middle = np.sqrt(r[ring] * r[ring + 1])
    at = middle / CM
    parts = (0.004, 0.009, 1.0)
    numbers = [*(stokes(at, k) for k in (0, 1)), 0.0]
    for rho, part, number in zip([*density, gas], parts, numbers, strict=True):
        height = aspect(at) * middle * np.sqrt(ALPHA / (ALPHA + number))
        surface = part * sigma(at) * UNITS.cgs("surface_density")
        column = rho[:, :, ring].mean(axis=0)
        plane = len(theta) // 2  # the cell below the mid-plane
        assert theta[plane] == pytest.approx(np.pi / 2, abs=1e-15)
        assert column[plane] == pytest.approx(surface / (np.sqrt(2 * np.pi) * height), rel=0.015)
        assert column[plane] == pytest.approx(column[plane - 1], rel=1e-9)
        z = middle * np.cos(0.5 * (theta[1:] + theta[:-1]))
        weight = column * volume[0, :, ring]
        assert np.sqrt((weight * z**2).sum() / weight.sum()) == pytest.approx(height, rel=0.01)


def test_an_arc_of_dust_stays_at_its_azimuth(tmp_path):
    """Dust within 0.1 rad about phi = 4 and r = 20 of even gas: its mean azimuth and radius to a cell."""
    rng = np.random.default_rng(3)
    r, phi = rng.uniform(19.0, 21.0, 300), 4.0 + rng.uniform(-0.1, 0.1, 300)
    pos = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)
    snap = snapshot(particles(pos, np.full(300, 1e-9), stokes=np.full(300, 0.3)), gas_of(), scene_of_layers("1 mm"))
    where = discsim.export.write(snap, "radmc3d", tmp_path / "arc", alpha=ALPHA, cells=96)
    edges, volume, density = cells_of(where)
    mass = (density[0] * volume).sum(axis=1)
    middle = 0.5 * (edges[2][1:] + edges[2][:-1])
    turned = np.angle((mass.sum(axis=1) * np.exp(1j * middle)).sum()) % (2 * np.pi)
    assert turned == pytest.approx(4.0, abs=2 * np.pi / 96)
    ring = (mass.sum(axis=0) * np.sqrt(edges[0][1:] * edges[0][:-1])).sum() / mass.sum()
    assert ring / CM == pytest.approx(20.0, rel=2 * np.pi / 96)


def test_star_wavelengths_and_opacities_are_those_given(tmp_path):
    star = {"star_radius": "1.7 Rsun", "star_temperature": "4330 K"}
    where = discsim.export.write(
        disc(), "radmc3d", tmp_path / "a", alpha=ALPHA, cells=32, opacity="2.5 cm2/g,0.7 cm2/g", **star
    )
    count, *wavelengths = text_numbers(where / "wavelength_micron.inp")
    assert count == len(wavelengths) and min(wavelengths) == pytest.approx(0.1) and max(wavelengths) >= 5e3
    form, stars, number, radius, mass, x, y, z, *rest = text_numbers(where / "stars.inp")
    assert (form, stars, number, x, y, z) == (2, 1, count, 0, 0, 0)
    assert radius == pytest.approx((1.7 * u.Rsun).to_value("cm"), rel=1e-12)
    assert mass == pytest.approx((1.3 * u.Msun).to_value("g"), rel=1e-9)
    assert rest == [*wavelengths, -4330.0]
    assert (where / "dustopac.inp").read_text().split()[:2] == ["2", "2"]
    for name, kappa in (("dust0", 2.5), ("dust1", 0.7)):
        assert name in (where / "dustopac.inp").read_text().split()
        form, count, *rows = text_numbers(where / f"dustkappa_{name}.inp")
        assert form == 1 and rows[::2] == wavelengths and count == len(wavelengths)
        assert rows[1::2] == pytest.approx([kappa] * len(wavelengths))


def test_gas_moves_and_is_as_warm_as_its_particles(folder):
    """v_phi = sqrt(G M / r), v_r = -v_phi / 100 and T ~ r^-0.4 within 6e-3: particles are 3% of r apart."""
    (r, _, _), volume, _ = cells_of(folder)
    middle = np.sqrt(r[1:] * r[:-1]) / CM
    inside = (middle > 6) & (middle < 35)
    flow = radmc3d_binary(folder / "gas_velocity.binp", volume.shape)[:, :, inside]
    speed = np.sqrt(OMEGA2 / middle[inside]) * UNITS.cgs("velocity")
    np.testing.assert_allclose(flow[..., 2] / speed, 1.0, atol=6e-3)
    np.testing.assert_allclose(flow[..., 0] / speed, -0.01, atol=1e-3)
    assert (flow[..., 1] == 0).all()
    heat = 55.0 * (middle[inside] / 8) ** -0.4
    for name, several in (("gas_temperature.binp", False), ("dust_temperature.bdat", True)):
        found = radmc3d_binary(folder / name, volume.shape, several)
        found = found[1] if several else found[..., 0]
        np.testing.assert_allclose(found[:, :, inside] / heat, 1.0, atol=6e-3)


def many_sizes():
    """A disc with grains from 30 um to 2 cm, the Stokes numbers in proportion, and small dust in the gas."""
    pos, area = even_positions(5.0, 40.0, 60)
    rng = np.random.default_rng(11)
    cm = np.exp(rng.uniform(np.log(3e-3), np.log(2.0), len(pos)))
    dust = particles(pos, 0.01 * sigma(np.hypot(*pos.T)) * area, size=cm / CM, stokes=0.6 * cm)
    gas = gas_of()
    scene = scene_of_layers("1 mm") + '[growth]\nsmall_size = "0.2 um"\n'
    return snapshot(dust, gas_of(small=2e-4 * gas.mass), scene), cm


def test_grains_of_many_sizes_are_in_bins_of_equal_ratio_and_small_dust_is_one_more(tmp_path):
    snap, cm = many_sizes()
    where = discsim.export.write(snap, "radmc3d", tmp_path / "a", alpha=ALPHA, cells=48, sizes=7)
    _, volume, density = cells_of(where)
    edges = np.geomspace(cm.min(), cm.max(), 8)
    edges[-1] *= 1.001
    wanted = [*np.histogram(cm, edges, weights=snap.dust.mass)[0], snap.gas.small.sum()]
    found = (density * volume).sum(axis=(1, 2, 3)) / GRAM
    assert found == pytest.approx(wanted, rel=1e-12)


def table_of_opacities(path):
    """kappa = 3 a^-0.5 (lambda / 1 mm)^-1.5 cm2/g (a in cm), which a table in logarithms has exactly."""
    path.write_text(
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: wavelength, unit: um, datatype: float64}\n"
        "# - {name: size, unit: cm, datatype: float64}\n# - {name: absorption, unit: cm2 / g, datatype: float64}\n"
        "wavelength size absorption\n"
        + "".join(
            f"{lam} {a} {3 * a**-0.5 * (lam / 1e3) ** -1.5}\n" for lam in (0.3, 4000.0) for a in (1e-5, 1e-2, 10.0)
        )
    )
    return str(path)


def test_opacity_of_a_bin_is_the_mean_over_the_mass_of_its_grains(tmp_path):
    table, (snap, cm) = table_of_opacities(tmp_path / "k.ecsv"), many_sizes()
    where = discsim.export.write(snap, "radmc3d", tmp_path / "a", alpha=ALPHA, cells=16, sizes=3, opacity=table)
    ends = np.geomspace(cm.min(), cm.max(), 4)
    chosen = (cm >= ends[1]) & (cm < ends[2])
    kappa = np.average(3 * cm[chosen] ** -0.5, weights=snap.dust.mass[chosen])
    rows = text_numbers(where / "dustkappa_dust1.inp")[2:]
    assert rows[[0, -2]] == pytest.approx([0.3, 4000.0])
    assert rows[1::2] == pytest.approx(kappa * (rows[::2] / 1e3) ** -1.5)


def test_mcfost_reads_the_opacity_of_every_size_in_each_of_its_bins_of_wavelength(tmp_path):
    """kappa of the table at the mean over mass of a^-0.5; a size without grains has that of its radius.

    MCFOST takes means over the points in a bin. These are in the middle of five equal parts, where rounding in single
    precision moves none into another bin. Sizes at both ends are beyond those of the grains.
    """
    table, (snap, cm) = table_of_opacities(tmp_path / "k.ecsv"), many_sizes()
    where = discsim.export.write(snap, "mcfost", tmp_path / "a", alpha=ALPHA, cells=16, sizes=6, opacity=table)
    given = mcfost_parameters(where / "discsim.para")
    radii, wavelengths, kappa = mcfost_opacities(where / "Misselt_discsim.dat")
    _, sizes, _, _, _ = mcfost_density(where / "density.fits.gz")
    np.testing.assert_allclose(radii[1:-1], sizes, rtol=1e-9)
    assert radii[0] < 0.9 * sizes[0] and radii[-1] > 1.1 * sizes[-1]
    nearest = np.abs(np.log(sizes)[:, None] - np.log(1e4 * cm)).argmin(axis=0)
    law = 3 * (wavelengths / 1e3) ** -1.5
    for k, size in enumerate(sizes):
        own = nearest == k
        mean = np.average(cm[own] ** -0.5, weights=snap.dust.mass[own]) if own.any() else (1e-4 * size) ** -0.5
        np.testing.assert_allclose(kappa[k + 1], mean * law, rtol=1e-7)
    assert "Misselt_discsim.dat" in (where / "discsim.para").read_text() and given["sizes"][2] == 6
    bins = mcfost_bins(where / "discsim.para")
    assert wavelengths[0] == pytest.approx(0.3) and wavelengths[-1] == pytest.approx(4000.0)
    assert (np.histogram(wavelengths, bins)[0] == 5).all() and np.abs(np.log(wavelengths / bins[:, None])).min() > 0.01


ALPHAS = [
    ("[dust_diffusion]\nalpha = 0.004\n", lambda r, c2: 0.004),
    ("[alpha_viscosity]\nalpha = 0.02\nindex = 0.5\n", lambda r, c2: 0.02 * (r / 3.7) ** 0.5),
    (
        "[alpha_viscosity]\nnu = '2e-4 au2/yr'\n[dust_diffusion]\n",
        lambda r, c2: 2e-4 * AU2_YR * np.sqrt(OMEGA2 / r**3) / c2,
    ),
    (
        "[alpha_viscosity]\nalpha = 0.02\n[dust_diffusion]\nD = '7e-5 au2/yr'\n",
        lambda r, c2: 7e-5 * AU2_YR * np.sqrt(OMEGA2 / r**3) / c2,
    ),
]


@pytest.mark.parametrize(("tables", "expected"), ALPHAS)
def test_turbulence_is_that_of_the_scene(tables, expected):
    """alpha of the table that moves dust, or else of the viscosity; a constant D or nu is D / (c_s H).

    Particles lie on rings 3% of r apart, so that means in cells 10% wide are off by that of 0.7% of r.
    """
    from discsim.export.layers import disc_of

    scene = TWO_SIZES.replace('outer = "80 au"', 'outer = "80 au", reference_radius = "7.4 au"') + tables
    found = disc_of(disc(scene), 64)
    c2 = aspect(found.radius) ** 2 * OMEGA2 / found.radius
    inside = (found.radius > 6) & (found.radius < 38)
    wanted = np.broadcast_to(expected(found.radius, c2), found.radius.shape)
    np.testing.assert_allclose(found.alpha[inside], wanted[inside], rtol=8e-3)


def test_mcfost_finds_the_mass_and_the_layers_of_every_size_on_its_own_grid(tmp_path):
    where = discsim.export.write(disc(), "mcfost", tmp_path / "a", alpha=ALPHA, cells=48, star_radius="1.7 Rsun")
    given = mcfost_parameters(where / "discsim.para")
    r, z, volume = mcfost_grid(given)
    density, sizes, number, gas, flow = mcfost_density(where / "density.fits.gz")
    snap = disc()
    assert density.shape == (2, *volume.shape)
    au3 = u.au.to("cm") ** 3
    np.testing.assert_allclose(sizes, [400.0, 7000.0])
    np.testing.assert_allclose(mcfost_sizes(given), sizes, rtol=1e-12)
    share = number * sizes**4  # dn/da a da is the number of grains of a size, a^3 the mass of a grain
    for k in (0, 1):
        mass = snap.dust.mass[snap.dust.species == k].sum()
        assert 2 * (density[k] * volume).sum() * au3 == pytest.approx(mass * GRAM, rel=1e-12)
        assert share[k] / share.sum() == pytest.approx(mass / snap.dust.mass.sum(), rel=1e-12)
    assert given["mass"] == pytest.approx((snap.dust.mass.sum() * UNITS.quantity(1.0, "mass")).to_value("Msun"))
    assert 2 * (gas * volume).sum() * au3 == pytest.approx(given["ratio"] * given["mass"] * u.Msun.to("g"), rel=1e-9)
    assert given["star"][:3] == pytest.approx([4000.0, 1.7, 1.3])
    for radius in (8.0, 14.0, 27.0):
        ring = np.searchsorted(r, 2 * radius) - 1
        at = 0.5 * np.sqrt(r[ring] * r[ring + 1])  # code units
        for rho, number in ((density[0], stokes(at, 0)), (density[1], stokes(at, 1)), (gas, 0.0)):
            height = 2 * aspect(at) * at * np.sqrt(ALPHA / (ALPHA + number))
            weight = rho[:, :, ring].sum(axis=0)
            middle = 0.5 * (z[ring, 1:] + z[ring, :-1])
            wide = height**2 + (z[ring, 1] - z[ring, 0]) ** 2 / 12  # the second moment of a cell is added
            assert np.sqrt((weight * middle**2).sum() / weight.sum()) == pytest.approx(np.sqrt(wide), rel=0.006)
        speed = (np.sqrt(OMEGA2 / at) * UNITS.quantity(1.0, "velocity")).to_value("m/s")
        np.testing.assert_allclose(flow[1, :, :, ring], speed, rtol=3e-3)


def test_mcfost_gets_many_sizes_at_equal_ratios(tmp_path):
    snap, cm = many_sizes()
    where = discsim.export.write(snap, "mcfost", tmp_path / "a", alpha=ALPHA, cells=16, sizes=6)
    given = mcfost_parameters(where / "discsim.para")
    _, sizes, number, _, _ = mcfost_density(where / "density.fits.gz")
    np.testing.assert_allclose(np.diff(np.log(sizes)), np.log(1e4 * cm.max() / 0.2) / 5)
    np.testing.assert_allclose(mcfost_sizes(given), sizes, rtol=1e-12)
    share = number * sizes**4 / (number * sizes**4).sum()
    nearest = np.abs(np.log(sizes)[:, None] - np.log(1e4 * cm)).argmin(axis=0)
    mass = np.bincount(nearest, snap.dust.mass, len(sizes))
    mass[0] += snap.gas.small.sum()
    np.testing.assert_allclose(share, mass / mass.sum(), rtol=1e-12, atol=1e-25)


@pytest.mark.parametrize(
    ("to", "options", "message"),
    [
        ("hyperion", {}, 'to: "hyperion"; expected one of radmc3d, mcfost'),
        ("radmc3d", {"alpha": -1.0}, "alpha: -1.0; expected a number above 0"),
        ("radmc3d", {"alpha": None}, r"alpha: missing, and the scene has no \[dust_diffusion\]"),
        ("radmc3d", {"cells": 3}, "cells: 3; expected a whole number from 8 to 2048"),
        (
            "radmc3d",
            {"cells": 2048},
            r"cells: 2048 in azimuth are [\d.e+]+ densities of 2 species; expected at most 2e\+08",
        ),
        ("mcfost", {"cells": 2048}, "cells: 2048 in azimuth are "),
        ("radmc3d", {"sizes": 2.5}, "sizes: 2.5; expected a whole number"),
        ("radmc3d", {"star_radius": "3 au/s"}, "star_radius: "),
        ("radmc3d", {"temperature": "hot"}, "temperature: "),
        ("radmc3d", {"opacity": "2 cm2/g,1 cm2/g,-3 cm2/g"}, "opacity: "),
        ("mcfost", {"opacity": "2 cm2/g,-3 cm2/g"}, "opacity: "),
        ("mcfost", {"temperature": "gas"}, "temperature: used only by radmc3d"),
        ("radmc3d", {"colour": "red"}, "colour: unknown option; expected one of alpha"),
    ],
)
def test_a_wrong_argument_is_one_message_and_leaves_nothing(tmp_path, to, options, message):
    with pytest.raises(PlotError, match=message) as caught:
        discsim.export.write(disc(), to, tmp_path / "a", **{"alpha": ALPHA, "cells": 16} | options)
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())


def test_a_folder_that_exists_is_not_touched(tmp_path):
    (tmp_path / "old").mkdir()
    with pytest.raises(PlotError, match="exists already"):
        discsim.export.write(disc(), "radmc3d", tmp_path / "old", alpha=ALPHA)
    assert not list((tmp_path / "old").iterdir())


def test_dust_without_stokes_numbers_is_refused(tmp_path):
    pos, area = even_positions(5.0, 40.0, 20)
    snap = snapshot(particles(pos, area), gas_of(), scene_of_layers("1 mm"))
    with pytest.raises(PlotError, match="no Stokes numbers"):
        discsim.export.write(snap, "radmc3d", tmp_path / "a", alpha=ALPHA)
