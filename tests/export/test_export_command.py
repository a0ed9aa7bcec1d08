"""`discsim export`: folders of runs with gas and with a prescribed disc, and messages."""

import numpy as np
import pytest
from astropy import units
from transfer_readers import mcfost_density, radmc3d_binary, radmc3d_grid, radmc3d_volumes
from typer.testing import CliRunner

from discsim import read_snapshot
from discsim.cli import app

SCENE = """
title = "Dust in a prescribed disc"
units = {system = "physical"}
run = {until = "3 yr", snapshots = 1}
space = {size = "80 au", cells = 32}
initial = {kind = "disc", surface_density = "40 g/cm2", reference_radius = "7 au", inner = "4 au", outer = "20 au"}
star = {mass = "0.8 Msun"}
drag = {law = "epstein", direction = "one-way"}
dust_diffusion = {alpha = 2e-3}
[dust]
particles = 3000
ratio = 0.004
grain_size = "0.3 mm"
grain_density = "1.6 g/cm3"
[background]
surface_density = "40 g/cm2"
reference_radius = "7 au"
[background.eos]
kind = "locally-isothermal"
aspect_ratio = 0.06
temperature_index = 0.4
reference_radius = "7 au"
"""


def discsim(*words):
    """Result of a command in this process."""
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The directory of a short run of dust in a prescribed disc."""
    home = tmp_path_factory.mktemp("export")
    (home / "scene.toml").write_text(SCENE)
    done = discsim("run", home / "scene.toml", "-o", home / "run")
    assert done.exit_code == 0, done.output
    return home / "run"


def test_dust_in_a_prescribed_disc_has_the_height_of_its_alpha_and_no_files_of_gas(run, tmp_path):
    """H = 0.06 r (r / 7)^0.3 at T ~ r^-0.4, and St of the grains of the ring: within 2% of the second moment."""
    done = discsim("export", run, "--to", "radmc3d", "-o", tmp_path / "a", "--cells", 64)
    assert (done.exit_code, done.stdout) == (0, f"{tmp_path / 'a'}\n"), done.output
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert "README" in names and not {name for name in names if "gas" in name or "numberdens" in name}
    assert "2.0" in (tmp_path / "a" / "README").read_text().splitlines()[3]
    snap = read_snapshot(run)
    edges = radmc3d_grid(tmp_path / "a")
    volume = radmc3d_volumes(edges)
    mass = (radmc3d_binary(tmp_path / "a" / "dust_density.binp", volume.shape, True)[0] * volume).sum(axis=0)
    assert mass.sum() == pytest.approx(snap.dust.mass.sum() * snap.units.cgs("mass"), rel=1e-12)
    au = edges[0] / units.au.to("cm")
    ring = np.searchsorted(au, 9.0) - 1
    within = (snap.quantity("dust.pos").to_value("au") ** 2).sum(axis=1) ** 0.5
    number = snap.dust.stokes[(within > au[ring]) & (within < au[ring + 1])].mean()
    middle = np.sqrt(au[ring] * au[ring + 1])
    z = middle * np.cos(0.5 * (edges[1][1:] + edges[1][:-1]))
    found = np.sqrt((mass[:, ring] * z**2).sum() / mass[:, ring].sum())
    wanted = 0.06 * middle * (middle / 7.0) ** 0.3 * np.sqrt(2e-3 / (2e-3 + number))
    assert found == pytest.approx(wanted, rel=0.02)


def test_the_snapshot_is_the_one_nearest_to_a_time(run, tmp_path):
    done = discsim("export", run, "--to", "mcfost", "-o", tmp_path / "a", "--cells", 32, "--at", "0 yr")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "a" / "README").read_text().splitlines()[0].endswith("disc, 0")
    density, sizes, _, gas, flow = mcfost_density(tmp_path / "a" / "density.fits.gz")
    assert density.shape[0] == 1 and sizes is None and gas is None and flow is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "polaris"], '--to: "polaris"; expected one of radmc3d, mcfost'),
        (["--to", "radmc3d", "--star-radius", "2 K"], "--star-radius: "),
        (["--to", "radmc3d", "--opacity", "none.ecsv"], "none.ecsv: cannot be read"),
        (["--to", "mcfost", "--temperature", "gas"], "--temperature: used only by radmc3d"),
        (["--to", "radmc3d", "--temperature", "gas"], "the snapshot has no gas with a temperature"),
    ],
)
def test_a_wrong_option_is_one_message_and_no_folder(run, tmp_path, words, message):
    done = discsim("export", run, *words, "-o", tmp_path / "a")
    assert done.exit_code == 2
    assert message in done.stderr and done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
