"""analysis/transfer.py with programs in place of RADMC-3D and MCFOST, whose results are closed forms."""

import csv
import sys
from importlib import import_module

import numpy as np
import pytest
from astropy import constants
from astropy import units as u
from astropy.modeling.models import BlackBody
from scipy.special import erf
from sky_discs import UNITS, even_positions, particles, scene_of_layers, snapshot
from transfer_readers import radmc3d_grid

FREQUENCY = (1.3 * u.mm).to("Hz", u.spectral())
KAPPA = 10 * FREQUENCY.to_value("THz") * u.cm**2 / u.g
INTENSITY = 3e-15  # erg/s/cm2/Hz/sr of the image by the program in place of RADMC-3D, face-on
RADMC3D = f"""#!{sys.executable}
import sys
from pathlib import Path
import numpy as np
with open("calls", "a") as file:
    print(*sys.argv[1:], file=file)
if sys.argv[1] == "image":
    given = dict(zip(sys.argv[2:-1:2], map(float, sys.argv[3:-1:2])))
    assert sys.argv[-1] == "nostar" and given["lambda"] == 1300
    count, side = int(given["npix"]), given["sizeau"] * 1.495978707e13
    values = {INTENSITY} * np.cos(np.radians(given["incl"])) * np.ones(count**2)
    head = [1, f"{{count}} {{count}}", 1, f"{{side / count}} {{side / count}}", 1300.0, ""]
    Path("image.out").write_text("\\n".join(map(str, [*head, *values])))
else:
    words = Path("amr_grid.inp").read_text().split()
    shape = np.array(words[7:10], int)
    r, theta, phi = np.split(np.array(words[10:], float), np.cumsum(shape + 1)[:-1])
    radius, height = np.sqrt(r[1:] * r[:-1]) / 1.495978707e13, np.abs(np.arange(shape[1]) - 0.5 * (shape[1] - 1))
    heat = 90 * (radius / 10) ** -0.6 * np.where(height < 1, 1.0, 1.5)[:, None] * np.ones((shape[2], 1, 1))
    Path("dust_temperature.dat").write_text("\\n".join(map(str, [1, heat.size, 1, *heat.ravel()])))
"""
MCFOST = f"""#!{sys.executable}
import sys
from pathlib import Path
import numpy as np
from astropy.io import fits
assert sys.argv[1:6] == ["discsim.para", "-3D", "-density_file", "density.fits.gz", "-star_bb"]
lines = Path("discsim.para").read_text().splitlines()
values = {{words: line.split() for line in lines for words in ("n_rad_in", "Rin", "eq_th") if words in line}}
assert values["eq_th"][0] == "4000" and Path("Misselt_discsim.dat").exists()
if "-img" in sys.argv:
    image = np.zeros((1, 1, 1, 7, 7), "f4")
    image[0, 0, 0, 2, 3:5] = 0.011, 0.013
    Path("data_1300").mkdir()
    fits.writeto("data_1300/RT.fits.gz", image)
else:
    n_r, n_z, n_phi = map(int, values["n_rad_in"][:3])
    inner, outer = float(values["Rin"][0]), float(values["Rin"][2])
    radius = inner * (outer / inner) ** ((np.arange(n_r) + 0.5) / n_r)
    heat = np.full((n_phi, 2 * n_z, n_r), 777.0)
    heat[:, n_z - 1 : n_z + 1] = 70 * (radius / 10) ** -0.45
    Path("data_th").mkdir()
    fits.writeto("data_th/Temperature.fits.gz", heat.astype("f4"))
"""


def temperature(radius):
    """Temperature of the gas in K by radius in au."""
    return 60.0 * (radius / 12) ** -0.3


@pytest.fixture(scope="module")
def disc():
    """Gas and a part of 1e-3 of its mass in dust, from 10 to 80 au: at most 0.011 deep at 1.3 mm."""
    pos, area = even_positions(5.0, 40.0, 60)
    r = np.hypot(*pos.T)
    density, omega2 = 2e-6 * (r / 7) ** -1.3, 1.3 / 0.7 / r**3
    heat = {"pressure": density * (0.06 * r) ** 2 * omega2, "temperature": temperature(2 * r)}
    dust = particles(pos, 1e-3 * density * area, stokes=np.full(len(pos), 0.02))
    return snapshot(dust, particles(pos, density * area, density=density, **heat), scene_of_layers("0.4 mm"))


@pytest.fixture
def compare(disc, tmp_path, monkeypatch):
    """Function that runs the script on the disc, and returns the rows of its table."""
    module = import_module("transfer")
    monkeypatch.setattr(module, "run_named", lambda given, out: [disc])
    for name, text in (("radmc3d", RADMC3D), ("mcfost", MCFOST)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)

    def run(table, *words):
        options = ["-o", str(tmp_path / "out"), "--radmc3d", str(tmp_path / "radmc3d"), "--cells", "48", *words]
        assert module.main([table, "here", *options]) == 0
        return list(csv.DictReader((tmp_path / "out" / f"here-{table}.csv").read_text().splitlines()))

    return run


def flux_of(disc, heat):
    """Flux in Jy at 140 pc of optically thin dust with temperatures (n,) in K."""
    planck = BlackBody(heat * u.K)(FREQUENCY) * u.sr
    mass = disc.dust.mass * UNITS.cgs("mass") * u.g
    return float(((mass * KAPPA * planck).sum() / (140 * u.pc) ** 2).to_value("Jy"))


def test_fluxes_are_those_of_a_thin_disc_and_of_a_uniform_image(disc, compare):
    """Ours: within 0.5%, of self-absorption. RADMC-3D's: I (side / d)^2 cos i, with the side of our image."""
    rows = compare("flux", "--inclination", "0,40", "--alpha", "2e-3")
    ours = flux_of(disc, temperature(2 * disc.dust.radius))
    side = 512 * disc.image(distance="140 pc").pixel * 140 * u.au
    for row, inclination in zip(rows, (0.0, 40.0), strict=True):
        assert (row["cells"], float(row["inclination [deg]"])) == ("48", inclination)
        assert float(row["discsim [Jy]"]) == pytest.approx(ours, rel=5e-3)
        assert float(row["cells [Jy]"]) == pytest.approx(ours, rel=8e-3)  # cells 13% of r wide
        theirs = 1e23 * INTENSITY * np.cos(np.radians(inclination)) * (side / (140 * u.pc)).to_value("") ** 2
        assert float(row["RADMC-3D [Jy]"]) == pytest.approx(theirs, rel=1e-4)
        ratio = float(row["RADMC-3D [Jy]"]) / float(row["discsim [Jy]"])
        assert float(row["difference [%]"]) == pytest.approx(100 * (ratio - 1), rel=1e-3)


def test_temperatures_are_those_of_the_cells_at_the_mid_plane(disc, compare, tmp_path):
    """Temperatures are interpolated in ln r between cells 13% of r apart: 0.1%. MCFOST's flux is without the star."""
    words = ("--mcfost", str(tmp_path / "mcfost"), "--radii", "13,31,62", "--packages", "4000")
    rows = {
        row.pop("temperature of"): [float(value) for value in row.values()] for row in compare("temperature", *words)
    }
    radii, r = np.array([13.0, 31.0, 62.0]), 2 * disc.dust.radius
    luminosity = 4 * np.pi * (2 * u.Rsun) ** 2 * constants.sigma_sb * (4000 * u.K) ** 4
    passive = ((0.05 * luminosity / (8 * np.pi * constants.sigma_sb * u.au**2)) ** 0.25).to_value("K")
    star = np.pi * ((2 * u.Rsun) / (140 * u.pc)).to_value("") ** 2 * BlackBody(4000 * u.K)(FREQUENCY) * u.sr
    wanted = {
        "RADMC-3D": (90 * (radii / 10) ** -0.6, None),
        "MCFOST": (70 * (radii / 10) ** -0.45, 0.024 - star.to_value("Jy")),
        "gas": (temperature(radii), flux_of(disc, temperature(r))),
        "passive disc": (passive * radii**-0.5, flux_of(disc, passive * r**-0.5)),
    }
    for name, (heat, flux) in wanted.items():
        assert rows[name][:3] == pytest.approx(heat, rel=2e-3, abs=0.051), name
        assert flux is None or rows[name][3] == pytest.approx(flux, rel=6e-3, abs=1e-6), name
    # a layer with H_d = H to 1%: erf(x) of its mass lies in the cells at the mid-plane, the rest is 1.5 times as hot
    edges = radmc3d_grid(tmp_path / "out/here-radmc3d-48-1")
    theta = edges[1][len(edges[1]) // 2 + 1] - np.pi / 2
    part = erf(theta / (0.06 * (radii / 2) ** 0.0) / np.sqrt(2) * np.sqrt(1.02))
    by_mass = 90 * (radii / 10) ** -0.6 * (1.5 - 0.5 * part)
    assert rows["discsim, RADMC-3D's T"][:3] == pytest.approx(by_mass, rel=5e-3)
    whole = flux_of(disc, 90 * (r / 10) ** -0.6 * (1.5 - 0.5 * part[0]))
    assert rows["discsim, RADMC-3D's T"][3] == pytest.approx(whole, rel=8e-3, abs=1e-6)


def test_cells_of_an_optically_thick_export_shine_as_black_bodies(disc, tmp_path):
    """tau above 60: B(T) cos i times the area of the disc, or up to that of the grid with 4 more rings at each edge."""
    module, opacity = import_module("transfer"), "2e5 cm2/g"
    options = {"alpha": 1.0, "cells": 48, "opacity": opacity, "temperature": "31 K"}
    folder = module.exported(disc, "radmc3d", tmp_path / "thick", **options)
    r, _, _ = radmc3d_grid(folder)
    whole, bare = (np.pi * (hi**2 - lo**2) for lo, hi in ((r[0], r[-1]), (r[4], r[-5])))
    planck = (BlackBody(31 * u.K)(FREQUENCY) * u.sr).to_value("Jy") * np.cos(np.radians(75))
    limits = [planck * area / (140 * u.pc).to_value("cm") ** 2 for area in (bare, whole)]
    assert limits[0] * (1 - 1e-9) < module.flux_of_cells(folder, 75.0) < limits[1]


def test_what_is_there_is_not_computed_again(compare, tmp_path):
    calls = [compare("temperature", "--packages", "300") and (tmp_path / "out/here-radmc3d-48-1/calls").read_text()]
    calls += [compare("temperature", "--packages", "300") and (tmp_path / "out/here-radmc3d-48-1/calls").read_text()]
    assert [text.count("mctherm nphot_therm 300") for text in calls] == [1, 1]


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("no-such-program", "--radmc3d no-such-program: program not found; give its path"),
        ("false", "false: ended with status 1; "),
    ],
)
def test_a_program_that_is_missing_or_fails_is_one_message(disc, tmp_path, monkeypatch, capsys, program, message):
    module = import_module("transfer")
    monkeypatch.setattr(module, "run_named", lambda given, out: [disc])
    words = ["flux", "here", "-o", str(tmp_path / "out"), "--cells", "16", "--radmc3d", program]
    assert module.main(words) == 2
    said = capsys.readouterr()
    assert message in said.err and said.err.count("\n") == 1 and not said.out
    assert not list(tmp_path.glob("out/*.csv"))
