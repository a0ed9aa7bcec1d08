"""`discsim image`: files, messages, and a check of the FITS files by a second reader."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from typer.testing import CliRunner

from discsim.cli import app

SCENE = """
title = "Ring <b>of</b> dust \\u00e9"
units = {system = "physical"}
run = {until = "3 yr", snapshots = 1}
space = {size = "80 au", cells = 32}
initial = {kind = "disc", mass = "1e-3 Msun", inner = "4 au", outer = "20 au"}
star = {mass = "0.8 Msun"}
[gas]
particles = 1500
[gas.eos]
kind = "locally-isothermal"
aspect_ratio = 0.06
[[dust]]
particles = 700
ratio = 0.004
grain_size = "0.3 mm"
grain_density = "1.6 g/cm3"
[[dust]]
particles = 700
ratio = 0.002
grain_size = "4 mm"
grain_density = "1.6 g/cm3"
[drag]
law = "epstein"
direction = "one-way"
"""


def discsim(*words):
    """Result of a command in this process."""
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The directory of a short run with two sizes of dust."""
    home = tmp_path_factory.mktemp("sky")
    (home / "scene.toml").write_text(SCENE)
    done = discsim("run", home / "scene.toml", "-o", home / "run")
    assert done.exit_code == 0, done.output
    return home / "run"


def test_two_wavelengths_give_a_figure_two_images_and_the_spectral_index(run, tmp_path):
    words = ["--distance", "150 pc", "--wavelength", "0.9 mm", "--wavelength", "3 mm", "--inclination", "40 deg"]
    words += ["--beam", "0.06 arcsec,0.04 arcsec,20 deg", "--noise", "10 uJy", "--pixels", "160"]
    done = discsim("image", run, *words, "-o", tmp_path / "a.png")
    assert done.exit_code == 0, done.output
    names = ["a.png", "a-0.9mm.fits", "a-3mm.fits", "a-spectral_index.fits"]
    assert [Path(line).name for line in done.stdout.split()] == names
    with fits.open(tmp_path / "a-3mm.fits", checksum=True) as file:
        header = file[0].header
    assert (header["BMAJ"], header["BMIN"], header["BPA"]) == pytest.approx((0.06 / 3600, 0.04 / 3600, 20.0))
    assert header["OBJECT"] == "Ring <b>of</b> dust ?"
    assert len(header["SCENE"]) == 64 and header["NAXIS"] == 2
    checked = subprocess.run(
        [sys.executable, "-m", "astropy.io.fits.scripts.fitscheck", *(str(tmp_path / name) for name in names[1:])],
        capture_output=True, text=True,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stderr


def test_default_files_lie_in_the_plots_of_the_run(run):
    done = discsim(
        "image", run, "--distance", "150 pc", "--quantity", "residual", "--inclination", "40 deg", "--at", "0 yr"
    )
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in (run / "plots").iterdir()) == [
        "residual-0000.fits",
        "residual-0000.png",
    ]
    values = fits.getdata(run / "plots" / "residual-0000.fits")
    assert 0.0 < np.nanmax(np.abs(values)) < 0.3  # km/s: the gas is slower than Kepler by its pressure
    shutil.rmtree(run / "plots")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--distance", "150 pc", "--beam", "3 au"], "--beam: "),
        (["--distance", "3"], "--distance: "),
        (["--distance", "150 pc", "--stretch", "loud"], 'stretch: "loud"; expected one of linear, sqrt, log'),
        (["--distance", "150 pc", "--at", "7 au"], "--at: "),
        (["--distance", "150 pc", "-o", "x.jpg"], "x.jpg: unknown figure format"),
        (["--distance", "150 pc", "--opacity", "none.ecsv"], "none.ecsv: cannot be read"),
        (["--distance", "150 pc", *["--wavelength", "1 mm"] * 2], "the two maps have the same wavelength"),
        (["--distance", "150 pc", *["--wavelength", "1 mm"] * 7], "expected at most 6"),
    ],
)
def test_a_wrong_option_is_one_message_and_no_file(run, words, message):
    done = discsim("image", run, *words)
    assert done.exit_code == 2
    assert message in done.stderr and done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    assert not (run / "plots").exists()
