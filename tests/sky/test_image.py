"""Images on the sky against closed forms: fluxes, beams, noise, coordinates, velocities."""

from dataclasses import replace

import numpy as np
import pytest
from astropy import constants
from astropy import units as u
from astropy.coordinates import SkyCoord
from scipy.integrate import quad
from sky_discs import SCENE, UNITS, even_positions, particles, snapshot

from discsim.output.fields.base import PlotError
from discsim.scene.units import Units
from discsim.sky.draw import figure_of

AU = 2.0  # au in a code unit of length
D = 140 * u.pc
TWO_SIZES = SCENE + '\n[[dust]]\ngrain_size = "0.2 mm"\n[[dust]]\ngrain_size = "3 mm"\n'


def planck(frequency, temperature):
    """B_nu(T) in Jy/sr, from constants of astropy."""
    x = (constants.h * frequency / (constants.k_B * temperature)).to_value("")
    return (2 * constants.h * frequency**3 / constants.c**2 / np.expm1(x) / u.sr).to(u.Jy / u.sr)


def nu(wavelength):
    return (constants.c / u.Quantity(wavelength)).to("Hz")


def power_law(r, sigma, index):
    """sigma (r / 10)^-index."""
    return sigma * (r / 10) ** -index


def power_law_disc(sigma, index, inner=8.0, outer=60.0, rings=150):
    """Dust of two sizes with half the surface density of `power_law` in g/cm2 each, radii in code units."""
    pos, area = even_positions(inner, outer, rings)
    mass = 0.5 * power_law(np.hypot(*pos.T), sigma, index) * area / UNITS.cgs("surface_density")
    both = [(pos, mass, np.zeros(len(pos), int)), (pos[::-1] * [1, -1], mass[::-1], np.ones(len(pos), int))]
    pos, mass, species = (np.concatenate(each) for each in zip(*both, strict=True))
    return snapshot(particles(pos, mass, species=species), scene=TWO_SIZES)


@pytest.mark.parametrize(
    ("inclination", "wavelength"), [("0 deg", "1.3 mm"), ("52 deg", "0.45 mm"), ("140 deg", "1.3 mm")]
)
def test_flux_of_a_thin_disc_is_its_emission_over_distance_squared(inclination, wavelength):
    """F = sum m kappa B(T) / D^2, at any inclination; optical depths are below 2e-5, which bounds the error."""
    snap = power_law_disc(3e-6, 1.2)
    sky = snap.image(
        wavelength, distance=D, inclination=inclination, opacity="2.5 cm2/g,0.7 cm2/g", temperature="90 K,10 au,0.4"
    )
    kappa = np.array([2.5, 0.7])[snap.dust.species]
    heat = 90 * u.K * (AU * snap.dust.radius / 10) ** -0.4
    each = snap.dust.mass * kappa * UNITS.cgs("mass") * u.cm**2 * planck(nu(wavelength), heat) * u.sr
    assert sky.flux.to_value("Jy") == pytest.approx((each.sum() / D**2).to_value("Jy"), rel=1e-4)


@pytest.mark.parametrize("inclination", [0.0, 60.0])
@pytest.mark.parametrize("index", [1.1, 3.4])
def test_flux_and_spectral_index_of_a_disc_that_is_thick_or_becomes_thin(inclination, index):
    """F = 2 pi cos i int [1 - exp(-tau / cos i)] B(T) r dr / D^2 within 1e-3, and the index from two wavelengths.

    The flux is that between r = 13 and 45: where an optically thick disc ends, the Gaussians of particles widen it.
    With p = 1.1 the disc is thick everywhere (tau > 20), with p = 3.4 tau falls from 56 to 0.3.
    """
    snap, cosine = power_law_disc(40.0, index, rings=195), np.cos(np.radians(inclination))
    maps = [
        snap.image(each, distance=D, inclination=f"{inclination} deg", temperature="120 K,10 au,0.45", pixels=600)
        for each in ("0.87 mm", "2.1 mm")
    ]
    for sky in maps:
        frequency = nu(sky.wavelength)
        kappa = 10 * frequency.to_value("THz")

        def ring(r, frequency=frequency, kappa=kappa):
            heat = 120 * u.K * (AU * r / 10) ** -0.45
            return r * -np.expm1(-kappa * power_law(r, 40.0, index) / cosine) * planck(frequency, heat).value

        wanted = 2 * np.pi * cosine * quad(ring, 13.0, 45.0)[0] * (AU * u.au / D).to_value("") ** 2
        offset = sky.pixel * (np.arange(600) - 299.5) * 140 / AU  # the line of nodes is the axis of x
        r = np.hypot(offset, offset[:, None] / cosine)
        assert sky.values[(r > 13) & (r < 45)].sum() == pytest.approx(wanted, rel=1e-3)
    thick = maps[0].spectral_index(maps[1]).values
    at = thick[300, 300 + round(14.0 * AU / 140 / maps[0].pixel)]  # tau > 19
    heat = 120 * u.K * (AU * 14.0 / 10) ** -0.45
    ratio = [planck(nu(sky.wavelength), heat).value for sky in maps]
    assert at == pytest.approx(np.log(ratio[0] / ratio[1]) / np.log(2.1 / 0.87), abs=2e-3)


def test_temperature_of_dust_is_that_of_gas_near_it():
    """T ~ r^-0.5 of the gas is found within 3e-4 at the places of the dust: 12 neighbours are h = 0.03 r away."""
    pos, area = even_positions(5.0, 50.0, 120)
    gas = particles(pos, area, temperature=80.0 * (np.hypot(*pos.T) / 7) ** -0.5)
    grains, _ = even_positions(8.0, 40.0, 37)
    dust = particles(grains, np.full(len(grains), 1e-9))
    with_law = snapshot(dust, gas).image(distance=D, temperature="80 K,14 au,0.5").flux.value
    assert snapshot(dust, gas).image(distance=D).flux.value == pytest.approx(with_law, rel=3e-4)


def moments(values, pixel):
    """Second moments xx, xy, yy of a map [north, west] in arcsec^2, x to the east."""
    north, west = (pixel * (np.arange(n) - 0.5 * (n - 1)) for n in values.shape)
    x, y = np.meshgrid(-west, north)
    mean = [(values * each).sum() / values.sum() for each in (x, y)]
    x, y = x - mean[0], y - mean[1]
    return np.array([(values * each).sum() / values.sum() for each in (x * x, x * y, y * y)])


def test_widths_of_beam_and_source_add_in_quadrature_along_each_direction():
    """The second moments of an image with a beam are those without one plus sigma^2 of the beam's ellipse.

    A kernel cut at 4 sigma lacks 0.3% of the second moment.
    """
    snap = power_law_disc(1e-5, 0.8, inner=9.0, outer=11.0, rings=12)
    look = {
        "distance": D,
        "inclination": "35 deg",
        "position_angle": "20 deg",
        "fov": "2 arcsec",
        "pixels": 400,
        "temperature": "20 K",
    }
    plain, seen = snap.image(**look), snap.image(beam="0.16 arcsec,0.09 arcsec,67 deg", **look)
    found = moments(seen.values, seen.pixel) - moments(plain.values, plain.pixel)
    east, north = np.sin(np.radians(67)), np.cos(np.radians(67))
    major, minor = (0.16**2 / (8 * np.log(2)), 0.09**2 / (8 * np.log(2)))
    wanted = [
        major * east**2 + minor * north**2, (major - minor) * east * north, major * north**2 + minor * east**2,
    ]  # fmt: skip
    assert found == pytest.approx(wanted, rel=0.01)
    assert seen.flux.value == pytest.approx(plain.flux.value, rel=1e-3)  # the image has all but the beam's wings


def test_noise_has_the_rms_of_a_beam_and_its_correlation():
    """rms within 2% (about 3000 beams); the correlation at a distance s is exp(-s^2 / (4 sigma^2))."""
    snap = power_law_disc(1e-12, 0.8, rings=10)
    look = {"distance": D, "temperature": "20 K", "beam": "0.07 arcsec", "fov": "4.3 arcsec", "pixels": 430}
    sky = snap.image(noise="30 uJy", seed=5, **look)
    again, other = snap.image(noise="30 uJy/beam", seed=5, **look), snap.image(noise="30 uJy", seed=6, **look)
    longer = snap.image("2 mm", noise="30 uJy", seed=5, **look)
    assert np.array_equal(sky.values, again.values)
    assert not np.allclose(sky.values, other.values) and not np.allclose(sky.values, longer.values)
    assert sky.values.std() == pytest.approx(30e-6, rel=0.02)
    shift, sigma = 4, 0.07 / 0.01 / np.sqrt(8 * np.log(2))
    correlation = (sky.values[:, shift:] * sky.values[:, :-shift]).mean() / np.square(sky.values).mean()
    assert correlation == pytest.approx(np.exp(-((shift / sigma) ** 2) / 4), abs=0.03)


def test_a_grain_is_found_at_its_right_ascension_and_declination(tmp_path):
    """A grain 40 au from the centre, seen at 55 deg: its pixel in the FITS file is that of its coordinates."""
    from astropy.io import fits
    from astropy.wcs import WCS

    pos = np.array([[12.0, 16.0]])
    snap = snapshot(particles(pos, np.array([1e-9])))
    centre = SkyCoord("04h33m39.0s", "+25d23m14s")
    sky = snap.image(
        distance=D, inclination="55 deg", position_angle="130 deg", azimuth="15 deg", temperature="20 K",
        fov="1.2 arcsec", pixels=601, position=centre,
    )  # fmt: skip
    sky.write(tmp_path / "grain.fits")
    with fits.open(tmp_path / "grain.fits", checksum=True) as file:
        file.verify("exception")
        values, header = file[0].data, file[0].header
    brightest = np.unravel_index(np.argmax(values), values.shape)
    found = WCS(header).pixel_to_world(brightest[1], brightest[0])
    x, y = pos[0] * AU / 140
    a, turn = np.radians(15), np.radians(130)
    along, across = x * np.cos(a) - y * np.sin(a), (x * np.sin(a) + y * np.cos(a)) * np.cos(np.radians(55))
    east, north = along * np.sin(turn) + across * np.cos(turn), along * np.cos(turn) - across * np.sin(turn)
    wanted = centre.spherical_offsets_by(east * u.arcsec, north * u.arcsec)
    assert found.separation(wanted).arcsec < 0.75 * sky.pixel
    assert (header["BUNIT"], header["OBJECT"]) == ("Jy/pixel", "A disc of known flux")
    assert u.Unit(header["BUNIT"]) == u.Jy / u.pix
    assert header["RESTFRQ"] == pytest.approx(nu("1.3 mm").value)


def test_radius_of_a_pixel_is_that_of_the_grain_seen_in_it():
    """Within the diagonal of a pixel in the plane of the disc, where cos 55 deg = 0.57 stretches it along one axis."""
    for pos in (np.array([[12.0, 16.0]]), np.array([[-23.0, 5.0]])):
        sky = snapshot(particles(pos, np.array([1e-9]))).image(
            distance=D, inclination="55 deg", position_angle="130 deg", azimuth="15 deg", temperature="20 K",
            fov="1.2 arcsec", pixels=400,
        )  # fmt: skip
        brightest = np.unravel_index(np.argmax(sky.values), sky.values.shape)
        stretched = sky.pixel * 140 / np.cos(np.radians(55))
        assert sky.radius[brightest].to_value("au") == pytest.approx(AU * np.hypot(*pos[0]), abs=stretched)
    np.testing.assert_allclose(sky.extent, (0.6, -0.6, -0.6, 0.6), rtol=1e-14)


@pytest.mark.parametrize("quantity", ["intensity", "velocity"])
def test_headers_pass_the_checks_of_astropy_and_have_the_keys_that_carta_reads(tmp_path, quantity):
    """Nothing to repair in the header; pixel -> sky -> pixel to 1e-7 of a pixel; the beam in degrees."""
    from astropy.io import fits
    from astropy.wcs import WCS

    pos, area = even_positions(6.0, 50.0, 30)
    gas = particles(pos, area, vel=np.zeros_like(pos), temperature=np.full(len(pos), 20.0))
    look = {"distance": D, "inclination": "37 deg", "beam": "0.2 arcsec,0.13 arcsec,-35 deg", "pixels": 64}
    sky = snapshot(particles(pos, area), gas).image(quantity=quantity, position="16h27m10s -24d19m13s", **look)
    sky.write(tmp_path / "map.fits")
    with fits.open(tmp_path / "map.fits", checksum=True) as file:
        file.verify("exception")
        header = file[0].header
    pixels, coordinates = np.random.default_rng(5).uniform(0, 63, (40, 2)), WCS(header)  # a repair is a warning
    found = coordinates.all_world2pix(coordinates.all_pix2world(pixels, 0), 0)
    np.testing.assert_allclose(found, pixels, atol=1e-7)
    assert [header[f"CTYPE{axis}"] for axis in (1, 2)] == ["RA---SIN", "DEC--SIN"]
    assert [header[f"CUNIT{axis}"] for axis in (1, 2)] == ["deg", "deg"] and header["RADESYS"] == "ICRS"
    assert header["CDELT1"] < 0.0 < header["CDELT2"]
    turn = (header["BPA"] - -35.0) % 180.0
    assert (3600 * header["BMAJ"], 3600 * header["BMIN"], min(turn, 180.0 - turn)) == pytest.approx((0.2, 0.13, 0.0))
    unit = {"intensity": u.Jy / u.beam, "velocity": u.km / u.s}[quantity]
    assert u.Unit(header["BUNIT"], format="fits") == unit
    assert ("RESTFRQ" in header) == (quantity == "intensity")


def kepler_disc():
    """Gas on circular Kepler orbits about 0.7 Msun, which is the code unit of mass."""
    pos, area = even_positions(6.0, 50.0, 90)
    x, y = pos.T
    return snapshot(gas=particles(pos, area, vel=np.hypot(x, y)[:, None] ** -1.5 * np.stack([-y, x], axis=1)))


def test_gas_recedes_along_the_position_angle_with_kepler_speed_times_sin_i():
    sky = kepler_disc().image(
        quantity="velocity", distance=D, inclination="48 deg", position_angle="70 deg", pixels=300, fov="1.2 arcsec"
    )
    r = 20.0 * AU  # au, along the major axis
    east, north = r / 140 * np.sin(np.radians(70)), r / 140 * np.cos(np.radians(70))
    row, column = round(149.5 + north / sky.pixel), round(149.5 - east / sky.pixel)
    speed = np.sqrt(constants.G * 0.7 * u.Msun / (r * u.au)).to_value("km/s")
    assert sky.values[row, column] == pytest.approx(speed * np.sin(np.radians(48)), rel=0.01)
    assert sky.values[299 - row, 299 - column] == pytest.approx(-speed * np.sin(np.radians(48)), rel=0.01)
    assert sky.unit == "km/s"


def test_kepler_orbits_have_no_residual():
    sky = kepler_disc().image(quantity="residual", distance=D, inclination="48 deg", beam="0.06 arcsec")
    assert np.nanmax(np.abs(sky.values)) < 1e-6
    assert np.isnan(sky.values).any()


def test_face_on_image_has_the_orientation_of_the_plane_of_the_scene():
    """x to the right (west) and y up (north); a clump at (20, 30) code units."""
    sky = snapshot(particles(np.array([[20.0, 30.0]]), np.array([1e-9]))).image(
        distance="100 pc", temperature="20 K", fov="2 arcsec", pixels=200
    )
    row, column = np.unravel_index(np.argmax(sky.values), sky.values.shape)
    assert column == pytest.approx(99.5 + 40, abs=1) and row == pytest.approx(99.5 + 60, abs=1)


@pytest.fixture(scope="module")
def inclined():
    snap = replace(power_law_disc(3e-6, 1.2, rings=30), time=37.0)
    seen = {"distance": D, "inclination": "41 deg", "position_angle": "17 deg", "pixels": 60, "fov": "1.8 arcsec",
            "temperature": "30 K"}  # fmt: skip
    return snap.image("0.87 mm", beam="0.2 arcsec,0.15 arcsec,30 deg", **seen), snap.image("3 mm", **seen)


def test_a_map_is_shown_in_a_few_lines(inclined):
    sky, index = inclined[0], inclined[1].spectral_index(replace(inclined[1], wavelength=2 * u.mm))
    lines = dict(line.split(maxsplit=1) for line in repr(sky).splitlines()[1:])
    assert repr(sky).startswith("A disc of known flux\n") and str(sky) == repr(sky) and len(repr(sky)) < 600
    assert lines == {
        "quantity": "intensity",
        "wavelength": "0.87 mm",
        "time": UNITS.show(37.0, "time"),
        "values": f"{sky.values.min():.4g} to {sky.values.max():.4g} Jy/beam",
        "pixels": "60 x 60 of 0.03 arcsec, [north, west]",
        "beam": "0.2 x 0.15 arcsec",
        "distance": "140 pc",
        "inclination": "41 deg, position angle 17 deg",
    }
    assert "wavelength" not in repr(index) and "beam" not in repr(index) and "spectral index" in index._repr_html_()
    nothing = replace(index, values=np.full((2, 3), np.nan), title="")
    assert repr(nothing).startswith("A map on the sky\n") and "none" in repr(nothing) and "2 x 3" in repr(nothing)


def test_a_map_is_drawn_as_the_command_draws_it_with_wavelength_and_time(inclined):
    axes = [inclined[0].draw(), figure_of(inclined[:1]).axes[0], figure_of(inclined).axes[0]]
    assert {(ax.get_xlabel(), ax.get_ylabel()) for ax in axes} == {
        (r"$\Delta$RA [arcsec]", r"$\Delta$Dec [arcsec]"),
    }
    titles = [ax.get_title().replace("\n", " ") for ax in axes]
    assert titles[0] == f"0.87 mm, {UNITS.show(37.0, 'time')}" and titles[1] == titles[2]
    assert titles[1] == titles[0] + r", 140 pc, i = 41$\degree$, PA = 17$\degree$"


def test_small_dust_in_gas_particles_is_seen():
    pos, area = even_positions(8.0, 40.0, 60)
    gas = particles(pos, area, temperature=np.full(len(pos), 33.0), small=1e-11 * area)
    flux = snapshot(gas=gas).image("2 mm", distance=D, opacity="3 cm2/g", fov="2 arcsec").flux.to_value("Jy")
    seen = 3.0 * u.cm**2 * gas.small.sum() * UNITS.cgs("mass") * planck(nu("2 mm"), 33 * u.K) * u.sr / D**2
    assert flux == pytest.approx(seen.to_value("Jy"), rel=1e-4)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"inclination": "88 deg"}, "inclination: 88 deg; expected 0 to 85 deg"),
        ({"inclination": "3 au"}, 'inclination: "3 au"; expected an angle like "30 deg"'),
        ({"position_angle": "nan deg"}, "position_angle: "),
        ({"beam": "0.001 arcsec"}, "below 3; choose a wider beam, more pixels, or a smaller fov"),
        ({"beam": "0.05 arcsec,0.06 arcsec,3 deg"}, "the second width is larger"),
        ({"beam": "1 arcsec,2 arcsec"}, "or three values"),
        ({"noise": "3 uJy"}, "noise: the noise needs a beam"),
        ({"noise": "3 K", "beam": "0.1 arcsec"}, "expected a flux density for each beam"),
        ({"noise": "3 uJy", "beam": "0.1 arcsec", "seed": -1}, "seed: -1; expected a whole number, 0 or more"),
        ({"temperature": "3 au"}, 'temperature: "3 au"; expected "20 K"'),
        ({"temperature": None}, "the snapshot has no gas with a temperature"),
        ({"temperature": lambda r: -r}, "temperature: the law gives values that are negative or not finite"),
        ({"opacity": "2 cm2/g"}, None),
        ({"opacity": "2 cm2/g,1 cm2/g,1 cm2/g"}, None),
        ({"opacity": "-2 cm2/g"}, "opacity: "),
        ({"opacity": "blue"}, 'opacity: "blue"; expected a value like "2 cm2/g"'),
        ({"distance": "3 km/s"}, "distance: "),
        ({"fov": "0 arcsec"}, "fov: "),
        ({"pixels": 1 << 20}, "pixels: 1048576; expected a whole number from 1 to 20_000"),
        ({"position": "here"}, 'position: "here"; expected right ascension and declination'),
        ({"quantity": "mass"}, 'quantity: "mass"; expected one of intensity, velocity, residual'),
        ({"quantity": "velocity"}, "the snapshot has no gas particles with velocities"),
    ],
)
def test_a_wrong_argument_is_one_message(given, message):
    snap = power_law_disc(1e-5, 0.8, rings=8)
    look = {"distance": D, "temperature": "20 K", "pixels": 64} | given
    if message is None:
        assert snap.image(**look).flux > 0
        return
    with pytest.raises(PlotError) as error:
        snap.image(**look)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_an_opacity_for_each_population_needs_as_many_values():
    with pytest.raises(PlotError, match="3 populations of dust; give one value, or one for each"):
        pos, area = even_positions(8.0, 40.0, 12)
        dust = particles(pos, 1e-9 * area, species=np.arange(len(pos)) % 3)
        snapshot(dust).image(distance=D, temperature="20 K", opacity="1 cm2/g,2 cm2/g")


def test_a_scene_in_code_units_has_no_image():
    snap = replace(power_law_disc(1e-5, 0.8, rings=8), units=Units("code"))
    with pytest.raises(PlotError, match=r"the scene is in code units, without lengths in au"):
        snap.image(distance=D)
