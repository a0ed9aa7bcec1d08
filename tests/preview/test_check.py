"""What `discsim check` says of a scene: derived numbers, and warnings, each with its number and its cure."""

import re

import pytest
from scenes import DISC, write
from two_sizes import TABLES
from typer.testing import CliRunner

from discsim import Simulation
from discsim.cli import app
from discsim.preview.check import report
from discsim.preview.derived import derived_rows, grid_bytes
from discsim.preview.warnings import warnings
from discsim.scene import load_scene
from setups import SETUPS

SHEET = """\
units.system = "code"
[run]
until = 1
[space]
size = [1, 0.5]
cells = 32
boundary = "periodic"
[initial]
kind = "sheet"
[gas]
particles = 512
eos = {kind = "isothermal", sound_speed = 0.5}
[self_gravity]
softening = 0.01
"""


def check(path):
    return CliRunner().invoke(app, ["check", str(path)])


def test_check_shows_effects_and_numbers(tmp_path):
    done = check(write(tmp_path, DISC))
    assert done.exit_code == 0, done.stderr
    for words in ("a disc", "time       0.1592 yr", "gas.viscosity", "law epstein", "512 x 512 cells"):
        assert words in done.stdout


def test_derived_numbers_of_a_disc(tmp_path):
    rows = dict(derived_rows(load_scene(write(tmp_path, DISC))))
    # Sigma = M / (2 pi r_out (1 - r_in/r_out) r) for p = 1: 0.1 Msun / (2 pi 90 au r) = 157.1 g/cm2 at 10 au.
    assert rows["surface density of the gas"] == "157.1 g/cm2, 28.57 g/cm2, 15.71 g/cm2"
    # Q = (H/r) M / (pi Sigma r^2) = 0.05 * 9 * 2 = 0.9 of M/M_d = 10 at 10 au.
    assert rows["Toomre Q"] == "9, 2.51, 1.6"
    # St = (pi/2) s rho_s / Sigma of molecules with their mean speed: 4.712 / 157.1.
    assert rows["Stokes number"] == "0.03, 0.165, 0.3"
    assert rows["formula of the stopping time"].endswith("St = (pi/2) s rho_s / Sigma")
    assert rows["orbital period"].startswith("31.62 yr")  # 10^1.5
    assert rows["particle mass of dust"] == "0.001665 Mearth"  # 1e-3 Msun / 2e5


def test_populations_have_their_names_or_sizes():
    """Masses are 1% and 2% of the gas's 0.01 Msun; the Stokes numbers of 1 mm and 5 cm grains differ by a factor 50."""
    huge = TABLES["dust"][1] | {"grain_size": "90 m", "name": "1 km"}
    scene = load_scene(TABLES | {"dust": [*TABLES["dust"], huge], "dust_diffusion": {"alpha": 0.003}})
    rows, names = dict(derived_rows(scene)), ("dust 1 mm", 'dust "pebbles"', 'dust "1 km"')
    assert [rows[f"mass of {name}"] for name in names] == ["0.0001 Msun", "0.0002 Msun", "0.0002 Msun"]
    numbers = [float(rows[f"Stokes number of {name}"].split(",")[0]) for name in names]
    assert numbers[1] / numbers[0] == pytest.approx(50.0, rel=0.01)  # three digits
    for start in ("particle mass", "stopping time", "diffusion coefficient", "diffusion time over H"):
        assert {f"{start} of {name}" for name in names} <= set(rows)
    assert [line.partition(":")[0] for line in warnings(scene) if ": St = " in line] == ['dust "1 km"']
    columns = {line.index("Msun") for line in report(scene).splitlines() if line.startswith("  mass of dust")}
    assert len(columns) == 1


def test_the_number_of_grid_cells_that_a_collapse_needs_is_enough(tmp_path):
    path = write(tmp_path, DISC)
    (line,) = [line for line in warnings(load_scene(path, ["space.cells=8"])) if "collapsing region" in line]
    enough = int(re.search(r"raise space.cells from 8 to (\d+)$", line)[1])
    for cells, count in ((enough, 0), (enough - 1, 1)):
        found = warnings(load_scene(path, [f"space.cells={cells}"]))
        assert len([line for line in found if "collapsing region" in line]) == count


def test_toomre_q_is_the_least_of_the_disc(tmp_path):
    text = DISC.replace('mass = "0.1 Msun"', "toomre_q = 1.7")
    rows = dict(derived_rows(load_scene(write(tmp_path, text))))
    assert rows["Toomre Q"].split(", ")[-1] == "1.7"


def test_check_of_every_start(tmp_path):
    sheet = load_scene(write(tmp_path, SHEET))
    assert dict(derived_rows(sheet))["particle mass of gas"] == "0.0009766"  # 1 * 1 * 0.5 / 512
    assert dict(derived_rows(sheet))["grid"] == "32 x 16 cells of 0.03125"
    # density, potential, two gradients; 32 x 9 complex numbers; a quadrant of 17 x 9 of the kernel.
    assert grid_bytes(sheet, [32, 16]) == 8 * (4 * 32 * 16 + 2 * 32 * 9 + 17 * 9)
    shock = """
    units.system = "code"
    run.until = 0.2
    space = {dimensions = 1, size = 1}
    initial.kind = "shock"
    gas = {particles = 600, eos = {kind = "adiabatic", gamma = 1.4}}
    """
    rows = dict(derived_rows(load_scene(write(tmp_path, shock))))
    assert rows["sound speed"] == "1.183, 1.058"  # sqrt(1.4), sqrt(1.4 .1/.125)
    box = """
    units.system = "code"
    run.until = 0.2
    space = {dimensions = 1, size = 2, boundary = "periodic"}
    initial = {kind = "box", density = 3}
    dust = {particles = 10, ratio = 0.5}
    """
    assert dict(derived_rows(load_scene(write(tmp_path, box))))["particle mass of dust"] == "0.3"
    assert check(write(tmp_path, box)).exit_code == 0


# Warnings

THIN = ["self_gravity.kernel=thin-disc", "self_gravity.thickness=1 au"]
WARNINGS = [
    # h/H ~ N^-1/2 r^-3/4: .64 at 10 au for 1e5 particles; a tenth of the mass is within 19 au.
    (
        ["gas.kernel=cubic", "gas.particles=50000"],
        "h/H = 0.9 at 10 au, and above 0.5 for 13% of the gas, more than 10%: raise gas.particles to about 6.2e+04",
    ),
    (
        ["gas.kernel=cubic", "gas.particles=20000"],
        "h/H = 1.4 at 10 au, above 1: raise gas.particles to about 6.2e+04",
    ),
    (["space.cells=128"], "self_gravity.softening = 1 au is 0.49 grid cells, below 1: raise space.cells to 260"),
    # Q is 2.5 at 55 au, where H is 4.2 au, and 9 at 10 au, where self-gravity does nothing.
    (
        ["self_gravity.softening=5 au"],
        "self_gravity.softening = 5 au is 1.2 H at 55 au, above 1 H: lower self_gravity.softening to 4.211 au",
    ),
    ([*THIN, "space.cells=128"], "self_gravity.thickness = 1 au is 0.49 grid cells, below 1: raise space.cells to 260"),
    (
        [*THIN, "self_gravity.thickness=10 au"],
        "self_gravity.thickness = 10 au is 1.1 H at 100 au, above 1 H: lower self_gravity.thickness to 8.891 au",
    ),
    (THIN, 'self_gravity.softening is not used with self_gravity.kernel = "thin-disc": remove the key'),
    (["dust.grain_size=1 m"], "dust: St = 30 at 100 au, above 10"),
    (
        ["gas.kernel=cubic", "drag.scheme=idic-linear", "dust.ratio=1"],
        "7.3 gas particles in a drag cell at 100 au, below 8: raise gas.particles by a factor of 1.1, or "
        "drag.cell by 1.05",
    ),
    (
        ["gas.kernel=cubic", "drag.scheme=idic-linear", "dust.ratio=1"],
        "14.6 dust particles in a drag cell at 100 au, below 30: raise dust.particles by a factor of 2.06, or "
        "drag.cell by 1.43",
    ),
]


@pytest.mark.parametrize("overrides, start", WARNINGS)
def test_warning_has_its_number_and_its_cure(tmp_path, overrides, start):
    found = warnings(load_scene(write(tmp_path, DISC), overrides))
    assert any(line.startswith(start) for line in found), found


def test_a_length_of_another_kernel_changes_no_number(tmp_path):
    """`softening` beside kernel "thin-disc", in a disc that falls apart: steps and errors are those without it."""
    text = DISC.replace('mass = "0.1 Msun"', "toomre_q = 0.7")
    assert 'softening = "1 au"' in text
    scene = write(tmp_path, text.replace('softening = "1 au"', 'kernel = "thin-disc"\nthickness = "1.3 au"'))
    alone = report(load_scene(scene)).splitlines()
    both = report(load_scene(scene, ["self_gravity.softening=0.02 au"])).splitlines()
    echoed, more = [line.strip() for line in both if line not in alone]
    assert echoed.startswith("self_gravity ") and "softening 0.02 au" in echoed
    assert more == 'self_gravity.softening is not used with self_gravity.kernel = "thin-disc": remove the key'


# A scene that earns a warning, how it starts, and one that does not.
PAIRS = [
    (["run.timestep=3 yr"], "run.timestep = 3 yr is 1.6 times the sound limit at 10 au", ["run.timestep=1 yr"]),
    (["space.size=210 au"], "space.size leaves 0.05 of the disc's radius as margin", ["space.size=231 au"]),
    (["gas.particles=1000"], "the smallest collapsing mass at 100 au has", []),
    (["space.cells=8"], "the smallest collapsing region at 100 au is 2.8 grid cells wide", []),
    (['drag.scheme="mk"'], 'drag.scheme "mk" is explicit: at 10 au its time steps are', ["dust.grain_size=10 m"]),
    (['drag.scheme="mk"'], "h is 27 times c_s t_stop at 10 au, above 1", ["dust.grain_size=10 m"]),
    (['drag.scheme="lab14"'], "h is", ['drag.scheme="reconstructed"']),
    # Dust placed evenly has no shot noise.
    (
        ["dust.ratio=1", "dust.particles=70000", "dust.placement=random"],
        "3.19 dust particles in a drag cell at 10 au, below 9",
        ["dust.ratio=1", "dust.particles=70000"],
    ),
]


@pytest.mark.parametrize("earns, start, does_not", PAIRS)
def test_a_warning_is_earned(tmp_path, earns, start, does_not):
    path = write(tmp_path, DISC)
    words = start.split(" at ")[0].rstrip("0123456789. ")
    assert any(line.startswith(start) for line in warnings(load_scene(path, earns))), warnings(load_scene(path, earns))
    kept = [text for text in earns if "scheme" in text and "scheme" not in "".join(does_not)]
    found = warnings(load_scene(path, [*kept, *does_not]))
    assert not any(line.startswith(words[:20]) for line in found), found


def test_a_midplane_in_a_periodic_space_earns_a_warning():
    """At the start of the space, it does not pull what is next to it through the other end."""
    tables = {
        "units": {"system": "code"}, "run": {"until": 1.0},
        "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"}, "initial": {"kind": "wave"},
        "gas": {"particles": 100, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
    }  # fmt: skip
    assert warnings(load_scene(tables)) == []
    (line,) = warnings(load_scene(tables | {"external": {"vertical_frequency": 1.0}}))
    assert line.startswith("external.vertical_frequency attracts to z = 0")


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_the_setups_greet_nobody_with_a_warning(path):
    assert warnings(load_scene(path)) == []


def test_noise_is_no_matter_where_damping_gives_the_flow():
    """It has more alpha than is asked for at the inner edge, which is in a zone of [damping]."""
    path = next(path for path in SETUPS if path.stem == "ring_twoway")
    noisy = ["gas.quiet=false", "gas.kernel=cubic", "gas.particles=20000"]
    assert not any("noise have alpha" in line for line in warnings(load_scene(path, noisy)))
    (line,) = (line for line in warnings(load_scene(path, noisy, without=["damping"])) if "noise have alpha" in line)
    assert "noise have alpha" in line and "at 0.4" in line


def test_no_warning_without_a_reason(tmp_path):
    fine = [
        "gas.particles=1e6",
        "dust.particles=4e6",
        "dust.ratio=1",
        "drag.cell=3",
        "self_gravity.softening=0.51 au",
    ]
    fine.append("gas.eos.aspect_ratio=0.06")
    assert warnings(load_scene(write(tmp_path, DISC), fine)) == []


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("scheme", ["tsc", "idic-linear"])
def test_four_heavy_grains_want_cells_of_their_own(dimensions, scheme):
    """Of the kinetic energy of dust that meets as much gas at rest a half is left, but .53 and more in cells of h.

    The cure that is told makes it right.
    """
    tables = {
        "units": {"system": "code"},
        "run": {"until": 0.1},
        "space": {"dimensions": dimensions, "size": 1.0, "boundary": "periodic"},
        "initial": {"kind": "box", "dust_velocity": [1.0, 0.0][:dimensions]},
        "gas": {"particles": 900, "eos": {"kind": "isothermal", "sound_speed": 1.0}},
        "dust": {"particles": 4, "ratio": 1.0},
        "drag": {"law": "constant", "K": 50.0, "scheme": scheme, "cell": dimensions},
    }
    told = [line for line in warnings(load_scene(tables)) if "dust particles in a drag cell everywhere" in line]
    assert len(told) == 1
    times = float(told[0].partition("drag.cell by ")[2].split()[0])

    def left():
        sim = Simulation(tables)
        sim.run()
        return float((sim.dust.mass @ sim.dust.vel**2).sum() + (sim.gas.mass @ sim.gas.vel**2).sum())

    assert left() > 0.53
    tables["drag"]["cell"] *= times
    # exp(-10) of the slip is left; cells that lie unevenly about four grains leave the rest.
    assert left() == pytest.approx(0.5, abs=0.003)
    evenly = {**tables, "dust": {"particles": 900, "ratio": 1.0}}
    assert not any("drag cell" in line for line in warnings(load_scene(evenly)))
