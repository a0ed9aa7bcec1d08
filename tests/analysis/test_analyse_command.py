"""`discsim analyse`: the scripts of analysis/ as commands, their tables with units, and their messages."""

import ast
import csv
import shutil
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from test_studies import even, gas_of, run_of
from typer.testing import CliRunner

from discsim.cli import app
from discsim.cli.analyse import SCRIPTS
from discsim.numerics.state import Dust
from discsim.output.companions import COLUMNS
from discsim.output.snapshot_writer import write_snapshot
from discsim.scene import load_scene

ROOT = Path(__file__).parents[2]
# A planet at 5.2 au in code units of 2 au and half a solar mass, with two sizes of dust.
PLANET = """
units = {length = "2 au", mass = "0.5 Msun"}
run = {until = "20 yr", snapshots = 1}
space.size = "60 au"
star.mass = "0.8 Msun"
alpha_viscosity.alpha = 0.004
initial = {kind = "disc", surface_density = "90 g/cm2", inner = "2 au", outer = "14 au"}
companion = {mass = "0.3 Mjup", semi_major_axis = "5.2 au", softening = "0.2 au"}
drag = {law = "epstein", direction = "one-way"}
[gas]
particles = 500
eos = {kind = "locally-isothermal", aspect_ratio = 0.06, temperature_index = 1.0}
[[dust]]
particles = 100
ratio = 0.01
grain_size = "3 mm"
grain_density = "1.5 g/cm3"
[[dust]]
particles = 100
ratio = 0.01
grain_size = "0.2 mm"
grain_density = "1.5 g/cm3"
"""
AXIS = 2.6  # 5.2 au in code units


def discsim(*words):
    """Result of a command in this process."""
    return CliRunner().invoke(app, ["analyse", *(str(word) for word in words)])


def lines_of(output):
    """Entries of a table by its first column, which is separated from the others by two spaces."""
    cells = [[cell for cell in line.strip().split("  ") if cell] for line in output.splitlines() if line.strip()]
    return {row[0]: [cell.strip() for cell in row[1:]] for row in cells}


def write_companions(run, rows, names=COLUMNS):
    """Write companions.csv with rows of (time, x, y, ...), other columns being 0.7."""
    with (run / "companions.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(dict.fromkeys(COLUMNS, 0.7) | {"step": 0, "number": 1} | row for row in rows)


def dust_rings(radii, mass, count=2000):
    """Dust on rings of Gaussian width 0.03: one population for each radius."""
    rng = np.random.default_rng(11)
    r = np.concatenate([radius + 0.03 * rng.standard_normal(count) for radius in radii])
    phi = rng.uniform(0, 2 * np.pi, len(r))
    pos, zero = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1), np.zeros((len(r), 2))
    species = np.repeat(np.arange(len(radii)), count)
    return Dust(
        pos=pos, vel=zero, acc=zero, mass=np.full(len(r), mass / len(r)), ids=np.arange(len(r)), species=species
    )


@pytest.fixture(scope="module")
def snapshots(tmp_path_factory):
    """Snapshots whose gas within 1.2 au of the orbit falls to 0.3, with rings of dust at 6.6 au and at 7.8 au."""
    run = tmp_path_factory.mktemp("made") / "planet"
    (run / "snapshots").mkdir(parents=True)
    (run / "scene.toml").write_text(PLANET)
    scene, pos = load_scene(run / "scene.toml"), even(40_000, 1.0, 7.0)
    for k, kept in enumerate((1.0, 0.3)):
        gas = gas_of(pos, 0.02)
        gas.mass *= np.where(np.abs(np.hypot(*pos.T) - AXIS) < 0.6, kept, 1.0)
        write_snapshot(run / "snapshots" / f"{k:04d}.h5", scene, 17.0 * k, gas, dust_rings((3.3, 3.9), 2e-4))
    return run


@pytest.fixture
def planet(snapshots, tmp_path):
    """A run with these snapshots, and a planet on a circular orbit of 5.2 au."""
    run = tmp_path / "planet"
    shutil.copytree(snapshots, run)
    write_companions(run, [{"time": t, "x": 0.0, "y": AXIS, "mass": 6e-4, "semi_major_axis": AXIS} for t in (0, 17)])
    return run


def test_a_gap_in_physical_units(planet, tmp_path):
    done = discsim("gap", planet, "-o", tmp_path / "out", "--last", "1.5")
    assert done.exit_code == 0, done.output
    table = lines_of(done.stdout)
    assert table["quantity"] == ["unit", "gas", "dust 3 mm", "dust 0.2 mm"]
    # 130 particles a ring: the minimum over 30 rings is below the mean by twice their scatter.
    assert float(table["smallest Sigma / Sigma_0 in the gap"][0]) == pytest.approx(0.3, abs=0.03)
    # q = 6e-4 / 1.6, the mass of the star in code units.
    assert float(table["formula of Kanagawa et al. (2015)"][0]) == pytest.approx(
        1 / (1 + 0.04 * (6e-4 / 1.6) ** 2 * 0.06**-5 / 0.004), rel=1e-3
    )
    unit, pebbles, sand = table["radius of the largest Sigma outside the orbit"]
    assert unit == "au"  # rings of the profile are 0.9% of the radius apart
    assert (float(pebbles), float(sand)) == pytest.approx((6.6, 7.8), rel=0.01)
    # A step at 1.2 au from the orbit, smoothed over two rings, is at one half 1% of the radius nearer to the orbit.
    edges = [table[f"{side} edge of the gap, Sigma = Sigma_0 / 2"] for side in ("inner", "outer")]
    assert [unit for unit, _ in edges] == ["au", "au"]
    assert [float(value) for _, value in edges] == pytest.approx([4.0 * 1.01, 6.4 * 0.99], rel=0.01)
    assert float(table["width of the gap over a"][0]) == pytest.approx((6.34 - 4.04) / 5.2, rel=0.02)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"planet-gap.csv", "planet-gap.png"}
    with (tmp_path / "out" / "planet-gap.csv").open(newline="") as file:
        head = next(csv.reader(file))
    # Populations are called as in fields, dust.0.surface_density.
    over = ["gas over start", "dust.0 over start", "dust.1 over start"]
    unit = "[g/cm2]"
    assert head == ["radius [au]", f"gas {unit}", f"dust.0 {unit}", f"dust.1 {unit}", *over, "pressure [g/s2]"]
    rows = np.genfromtxt(tmp_path / "out" / "planet-gap.csv", delimiter=",", skip_header=1)
    near = np.argmin(np.abs(rows[:, 0] - 9.3))
    # 0.02 of half a solar mass in equal steps of radius from 2 to 14 au; 1 Msun/au^2 is 8.885e6 g/cm2. 12% is noise.
    sigma = 8.885e6 * 0.01 / (2 * np.pi * rows[near, 0] * 12)
    assert rows[near, 1] == pytest.approx(sigma, rel=0.12)
    # c_s = 0.06 v_K, and v_K^2 = G 0.8 Msun / r; G Msun / au is 8.871e12 cm2/s2.
    assert rows[near, -1] / rows[near, 1] == pytest.approx(0.06**2 * 0.8 * 8.871e12 / rows[near, 0], rel=1e-3)


def test_a_gap_says_why_an_edge_is_missing_and_how_long_the_run_is(planet, tmp_path):
    """17 code units are 0.815 of the planet's orbits, 9.38 yr; the last half of the run has its only later snapshot."""
    orbits = 17 / (2 * np.pi * np.sqrt(AXIS**3 / (1.6 + 6e-4)))
    texts = [
        discsim("gap", planet, "-o", tmp_path / "out", "--last", last).stdout
        for last in (
            "0.4",
            "0.4 orbits",
            "0.4 orbits of the companion",
            f"{0.4 * 17 / orbits * 4 / (2 * np.pi):.6g} yr",
        )
    ]
    assert "formula" in texts[0] and texts[1] == texts[0]
    starts = [float(text.split("mean of orbits")[1].split()[0]) for text in texts]
    assert starts == pytest.approx([orbits - 0.4] * 4, abs=2e-4)  # the scene has half of the planet's mass; four digits
    assert f"the formulas are for a steady gap; this run has {orbits:.4g} orbits" in texts[0]
    assert "no edges" not in texts[0] and "no inner edge" not in texts[0]
    module = import_module("gap")
    gap = module.Gap(planet, 0.4)
    shallow = 1.9 * gap.profiles["gas"]  # 0.57 of the start
    gap.mean = lambda *_: shallow
    assert module.missing_edges(gap)[0].startswith("no edges: Sigma stays above half of Sigma_0, with 0.5")
    inner = np.where(gap.radius < gap.axis, 0.2 * gap.each["gas"][0], gap.each["gas"][1])
    gap.mean = lambda *_: inner
    (line,) = module.missing_edges(gap)  # the disc of the start begins at 2 au, the profile at 2.6 au
    assert line == "no inner edge: Sigma stays below half of Sigma_0 to r = 2.61 au, the end of the disc or profile"


@pytest.mark.parametrize(
    ("rows", "names", "message"),
    [
        ([], COLUMNS, "no rows of companions"),
        ([{"time": 0.0}], ("planets", *COLUMNS[1:]), "no rows of companions"),
        ([{"time": 0.0}, {"time": 1.0, "mass": "nan"}], COLUMNS, "companions.csv:3: mass is not finite"),
        ([{"time": 0.0}, {"time": 0.0, "number": 2}], COLUMNS, "several companions; expected one"),
        ([{"time": 0.0, "semi_major_axis": 40.0}], COLUMNS, "no gas at the orbit of the companion at the start"),
    ],
)
@pytest.mark.parametrize("command", ["gap", "torque"])
def test_a_damaged_table_of_companions_is_one_message(planet, tmp_path, monkeypatch, command, rows, names, message):
    monkeypatch.chdir(tmp_path)
    write_companions(planet, rows, names)
    done = discsim(command, planet)
    assert done.exit_code == 2 and done.stdout == ""
    assert message in done.stderr and done.stderr.startswith(f"{command}: ") and done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["planet"]


def test_torque_of_cells_and_of_particles(planet, tmp_path):
    grid = tmp_path / "grid"
    shutil.copytree(planet, grid)
    text = (grid / "scene.toml").read_text()
    (grid / "scene.toml").write_text(text.replace("[gas]", '[gas]\nmethod = "grid"'))
    period = 2 * np.pi * np.sqrt(AXIS**3 / 1.6)
    times = np.linspace(0.0, 6 * period, 61)
    rows = [{"time": t, "mass": 6e-4, "semi_major_axis": AXIS, "torque_gas": 1e-9 * np.cos(t)} for t in times]
    for each in (planet, grid):
        write_companions(each, rows)
    done = discsim("torque", grid)
    assert "gas cells " in done.stdout and "particles" not in done.stdout, done.output
    assert "grid: the error is above a third of the torque; use more cells" in done.stdout
    both = discsim("torque", grid, planet).stdout
    assert "gas particles or cells for an error of 10%" in both and "planet: the error" in both


def test_torque_has_a_line_for_each_quantity(planet):
    """Rows at the same times as in an orbit of period 2 pi (2.6^3 / 1.6)^(1/2), with a torque that rises by orbits."""
    period, q = 2 * np.pi * np.sqrt(AXIS**3 / 1.6), 6e-4 / 1.6
    times = np.linspace(0.0, 6 * period, 601)
    scene = load_scene(planet / "scene.toml")
    sigma = scene.units.parse("90 g/cm2", "surface_density") * (AXIS / scene.initial.reference_radius) ** -1.0
    unit = (q / 0.06) ** 2 * sigma * AXIS**4 * 1.6 / AXIS**3
    orbits = np.minimum((times / period).astype(int), 5)
    rows = [
        {"time": t, "mass": 6e-4, "semi_major_axis": AXIS, "torque_gas": -unit * (1.9 + 0.01 * k)}
        for t, k in zip(times, orbits, strict=True)
    ]
    write_companions(planet, rows)
    done = discsim("torque", planet, planet, "--from", "3")
    assert done.exit_code == 0, done.output
    table = lines_of(done.stdout)
    assert table["quantity"] == ["unit", "planet", "planet"] and table["whole orbits"] == ["3", "3"]
    found = table["mean torque"]
    assert float(table["mass over the thermal mass, q (H/r)^-3"][0]) == pytest.approx(q / 0.06**3, rel=1e-3)
    assert "above the thermal mass" in done.stdout and "the error is above" not in done.stdout
    years = 2.7 * period * (8 / 0.5) ** 0.5 / (2 * np.pi)  # of units of 2 au and 0.5 Msun
    for start in ("2.7 orbits", f"{years:.6g} yr"):
        assert lines_of(discsim("torque", planet, "--from", start).stdout)["mean torque"][1] == found[1]
    # Orbits 3, 4 and 5 have -1.93, -1.94 and -1.95, but for their first row.
    assert found[0] == "Gamma_0" and float(found[1]) == pytest.approx(-1.94, abs=2e-3)
    assert float(table["error by orbits"][1]) == pytest.approx(0.01 / np.sqrt(3), rel=0.1)
    assert table["error by probes"][1] == "-"


def test_two_runs_have_one_line_for_each_quantity(tmp_path, monkeypatch):
    """In code units; the same from the script, which also prints all times."""
    monkeypatch.chdir(tmp_path)
    kept = run_of(tmp_path / "kept", [even(3000, 1.0, 2.0)] * 3)
    shrunk = run_of(tmp_path / "shrunk", [even(3000, 1.0, 2.0), even(3000, 0.9, 1.8), even(3000, 0.75, 1.5)])
    done = discsim("oneway-twoway", kept, shrunk, "--within", "1.3,1.7")
    assert done.exit_code == 0, done.output
    table = lines_of(done.stdout)
    assert table["quantity"] == ["unit", "start of kept", "kept", "shrunk", "shrunk / kept"]
    assert table["r50"] == ["code units", "1.5", "1.5", "1.125", "0.75"]
    within = table["M(<1.3)"]
    # 0.3 (1.3 - 1) and 0.3 (1.3 - 0.75) / 0.75; the shares end between two of 3000 particles.
    assert [float(value) for value in within[2:4]] == pytest.approx([0.09, 0.22], abs=2e-4)
    quantities = ["r10", "r50", "r90", "M(<1.3)", "M(<1.7)", "peak at", "peak", "width", "contrast"]
    quantities += ["smoothing", "lost", "noise", "h of the gas"]
    rows = [name for name in table if not name.startswith(("Dust at", "─", "oneway_twoway", "no ", "the smoothing"))]
    assert 'finer than h of the gas: see whether the peaks compare alike with --smooth "1"' in done.stdout
    assert rows == ["quantity", *quantities] and "oneway_twoway.csv" in done.stdout
    made = (tmp_path / "oneway_twoway.csv").read_bytes()
    done = discsim("oneway-twoway", kept, shrunk, "--within", "1.3,1.7", "--times", "-o", "again")
    assert sum(line.split()[:1] in (["kept"], ["shrunk"]) for line in done.stdout.splitlines()) == 6
    assert (tmp_path / "again/oneway_twoway.csv").read_bytes() == made


RING, SPREAD = 1.47, 0.03


def ringed(kept, inner, seed):
    """A disc with Sigma ~ 1/r from `inner` to 2 and a Gaussian ring of `kept` of 9000 particles."""
    rng = np.random.default_rng(seed)
    r = np.concatenate([rng.uniform(inner, 2.0, 9000 - kept), rng.normal(RING, SPREAD, kept)])
    phi = rng.uniform(0, 2 * np.pi, len(r))
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


def test_the_height_of_a_ring_is_not_set_by_the_smoothing(tmp_path):
    """Rings of 3000 and 4000 of 9000 particles, thinner than two rings of 80, 0.055: height, width and contrast."""
    sizes = {"one": 3000, "two": 4000}
    runs = [run_of(tmp_path / name, [ringed(n, 1.0, 5)] * 2) for name, n in sizes.items()]
    done = discsim("oneway-twoway", *runs, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    table = lines_of(done.stdout)
    # Particles per radius: those of the disc over 1, and n / (2 pi)^(1/2) / SPREAD of the ring.
    per_radius = {name: (9000 - n, n / np.sqrt(2 * np.pi) / SPREAD) for name, n in sizes.items()}
    for column, (disc, peak) in zip((2, 3), per_radius.values(), strict=True):
        noise, lost = (float(table[name][column]) / 100 for name in ("noise", "lost"))
        assert 0.02 < noise < 0.06 and 0.0 < lost < 0.1
        expected = 0.3 / 9000 * (disc + peak) / (2 * np.pi * RING)
        # The largest of a few values, each with this noise.
        assert float(table["peak"][column]) == pytest.approx(expected * (1 - lost), rel=3 * noise)
        assert float(table["peak at"][column]) == pytest.approx(RING, abs=SPREAD)
        wide = 2.355 * np.hypot(SPREAD, float(table["smoothing"][column]))
        assert float(table["width"][column]) == pytest.approx(wide, rel=0.15)
        # The trough is the lowest of some 40 values, which for the disc alone have noise of 10%: 2.5 of that lower.
        assert 0.9 < float(table["contrast"][column - 1]) * disc / (disc + peak) < 1.6
    smoothing = table["smoothing"]
    assert smoothing[1:4] == [smoothing[1]] * 3 and float(smoothing[1]) < 0.5 * SPREAD
    washed = lines_of(discsim("oneway-twoway", *runs, "-o", tmp_path / "out", "--smooth", "0.055").stdout)
    assert float(washed["lost"][2]) > 18 and float(washed["peak"][2]) < 0.75 * float(table["peak"][2])


def test_no_width_at_an_edge_and_no_contrast_without_a_trough(tmp_path):
    """The densest place of a disc with Sigma ~ 1/r is its inner edge; of a ring alone both sides fall to nothing."""
    edge = run_of(tmp_path / "edge", [even(6000, 1.0, 2.0)])
    alone = run_of(tmp_path / "alone", [ringed(9000, 1.0, 8)])
    done = discsim("oneway-twoway", edge, alone, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    table = lines_of(done.stdout)
    assert table["width"][:3] == ["code units", "-", "-"] and table["contrast"] == ["-", "-", "-"]
    wide = 2.355 * np.hypot(SPREAD, float(table["smoothing"][3]))
    assert float(table["width"][3]) == pytest.approx(wide, rel=0.05)  # the noise of 9000 particles is 2%
    assert "no width (start of edge, edge): the peak is at a sharp edge of the dust" in done.stdout
    assert "no contrast (start of edge, edge, alone): there is no trough with dust next to the peak" in done.stdout
    assert "inf" not in done.stdout.split("oneway_twoway.csv")[0]


def test_dust_that_is_all_gone_has_no_peak(tmp_path):
    gone = run_of(tmp_path / "gone", [even(300, 1.0, 2.0), even(300, 4.0, 5.0)])
    kept = run_of(tmp_path / "kept", [even(300, 1.0, 2.0)] * 2)
    done = discsim("oneway-twoway", gone, kept, "-o", tmp_path / "out")
    assert done.exit_code == 0 and lines_of(done.stdout)["peak"][2] == "-"
    assert "no peak (gone): there is no dust within the radii of the start" in done.stdout
    assert "no width (start of gone, kept): " in done.stdout


def test_dust_of_several_populations_in_physical_units(planet, tmp_path):
    done = discsim("oneway-twoway", planet, planet, "-o", tmp_path / "out", "--within", "7.2")
    assert done.exit_code == 0, done.output
    table = lines_of(done.stdout)
    other = discsim("oneway-twoway", planet, planet, "-o", tmp_path / "out", "--within", "7.2 au")
    assert other.stdout == done.stdout  # a plain number is in au, not in code units of 2 au
    assert any(line.endswith(", all 2 populations together") for line in table)
    # Quantiles 0.1 and 0.9 of all dust are those of 0.2 and 0.8 of a ring: 0.84 standard deviations of 0.06 au.
    assert table["r10"][0] == "au" and float(table["r10"][1]) == pytest.approx(6.6 - 0.05, abs=0.01)
    assert float(table["r90"][1]) == pytest.approx(7.8 + 0.05, abs=0.01)
    # Half of 2e-4 code masses of half a solar mass, 332,946 Earth masses.
    assert table["M(<7.2 au)"][0] == "Mearth"
    assert float(table["M(<7.2 au)"][1]) == pytest.approx(0.5 * 2e-4 * 0.5 * 332_946, rel=1e-3)


def test_clumps_and_modes_in_time(tmp_path):
    run = run_of(tmp_path / "a", [even(500, 1.0, 2.0)] * 3)
    done = discsim("clumps", run, "--size", "0.07")
    table = lines_of(done.stdout)
    assert done.exit_code == 0 and table["amplitude"] == ["start", "end", "largest", "at time [code units]"]
    assert {f"A{m} of the {kind}" for m in range(1, 7) for kind in ("gas", "dust")} <= set(table)
    assert "0 clumps at 2 code units" in done.stdout and str(run / "clumps.csv") in done.stdout
    in_time = discsim("clumps", run, "--size", "0.07", "--times").stdout
    firsts = [line.split()[0] for line in in_time.splitlines() if len(line.split()) == 13]  # time and 12 modes
    assert firsts == ["0", "1", "2"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["gap", "none"], "none: no run found; expected a directory with scene.toml and snapshots"),
        (["torque", "none"], "companions.csv: file not found; expected the directory of a run with a companion"),
        (["torque", "dusty"], "companions.csv: file not found"),
        (["gap", "dusty"], "dusty: no [companion]; expected a run with one companion"),
        (["gap", "gas"], "gas: no run found; expected a directory with scene.toml and snapshots"),
        (["clumps", "none"], "none: file not found"),
        (["clumps", "empty"], "empty: no snapshots found"),
        (["clumps", "dusty", "--size", "9"], "--size 9: expected the radius of a clump, "),
        (["clumps", "dusty", "--size", "1e-9"], "--size 1e-09: expected the radius of a clump, "),
        (["clumps", "dusty", "--size", "1 au"], '--size: "1 au" is not a finite number'),
        (["gap", "planet", "--last", "3 au"], '--last: "3 au" is a length; expected a time'),
        (["gap", "planet", "--last", "3 orbits at 0 au"], '--last: "3 orbits at 0 au": the radius "0 au" is not pos'),
        (["torque", "planet", "--from", "2 kg"], '--from: "2 kg" is a mass; expected a time'),
        (["torque", "planet", "--from", "7 orbits"], "has 0.8163 orbits of the companion; expected at least two whole"),
        (["stress", "empty"], "empty: no run found; expected a directory with scene.toml and snapshots"),
        (["stress", "dusty"], "dusty: no self-gravitating gas in two dimensions"),
        (["oneway-twoway", "dusty"], "dusty: only one run; expected two or more directories of runs to compare"),
        (["oneway-twoway", "dusty", "none"], "none: file not found"),
        (["oneway-twoway", "dusty", "gas"], "gas: no dust in two dimensions"),
        (["oneway-twoway", "dusty", "dusty", "--smooth", "1e-9"], "--smooth 1e-9: expected 0.0004387 to 2.193"),
        (["oneway-twoway", "dusty", "dusty", "--smooth", "9 au"], '--smooth: "9 au" is not a finite number'),
        (
            ["oneway-twoway", "planet", "planet", "--within", "7 au,8 yr"],
            '--within: "8 yr" is a time; expected a length',
        ),
        (["oneway-twoway", "dusty", "planet"], "the runs have different units"),
    ],
)
def test_a_wrong_run_is_one_message_and_no_file(tmp_path, monkeypatch, planet, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    run_of(tmp_path / "dusty", [even(100, 1.0, 2.0)] * 2)
    (tmp_path / "gas/snapshots").mkdir(parents=True)
    gas = {"units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 8.0}, "star": {"mass": 1.0}}
    gas |= {"initial": {"kind": "disc", "mass": 1.0, "inner": 1.0, "outer": 2.0}}
    gas |= {"gas": {"particles": 500, "eos": {"kind": "isothermal", "sound_speed": 0.05}}}
    write_snapshot(tmp_path / "gas/snapshots/0000.h5", load_scene(gas), 0.0, gas_of(even(100, 1.0, 2.0), 1.0), None)
    before = set(tmp_path.rglob("*"))
    done = discsim(*words)
    assert done.exit_code == 2 and done.stdout == ""
    assert message in done.stderr and done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "words",
    [
        ["gap", "x", "--last", "0 yr"],
        ["stress", "x", "--orbits", "nan"],
        ["torque", "x", "--from", "-1 yr"],
        ["torque"],
    ],
)
def test_a_wrong_option_has_the_usage_of_the_command(words):
    done = discsim(*words)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"usage: discsim analyse {words[0]} ")
    assert f"discsim analyse {words[0]}: error: " in done.stderr


def test_a_full_or_wrong_target_leaves_no_part_of_a_file(tmp_path):
    run = run_of(tmp_path / "a", [even(500, 1.0, 2.0)] * 2)
    (tmp_path / "oneway_twoway.csv").symlink_to(tmp_path / "elsewhere")
    done = discsim("oneway-twoway", run, run, "-o", tmp_path)
    assert done.exit_code == 1 and done.stderr.count("\n") == 1
    assert "oneway_twoway.csv: cannot be read or written: is a symbolic link" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"a", "oneway_twoway.csv"}


def test_the_list_of_commands_fits_a_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    listed = discsim("--help").stdout.split("Commands:")[1]
    assert [line.split()[0] for line in listed.strip().splitlines()] == list(SCRIPTS) and "..." not in listed


@pytest.mark.parametrize("name", SCRIPTS)
def test_each_script_has_a_help_and_needs_no_other_script(name):
    """So that a copy runs, and the one in a wheel."""
    script, _ = SCRIPTS[name]
    done = discsim(name, "--help")
    assert done.exit_code == 0 and done.stdout.startswith(f"usage: discsim analyse {name} ")
    assert f"discsim analyse {name} DIR" in done.stdout and f"python analysis/{script}.py" in done.stdout
    nodes = [*ast.walk(ast.parse((ROOT / f"analysis/{script}.py").read_text()))]
    modules = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    modules |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    outside = {module.split(".")[0] for module in modules} - set(sys.stdlib_module_names)
    assert outside <= {"discsim", "numpy", "scipy", "matplotlib"}
    assert import_module(script).__file__ == str(ROOT / f"analysis/{script}.py")


def test_a_wheel_has_the_scripts_of_the_commands():
    included = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    scripts = {f"analysis/{script}.py" for script, _ in SCRIPTS.values()}
    included = {path: to for path, to in included["force-include"].items() if path.startswith("analysis")}
    assert included == {path: f"discsim/{path}" for path in scripts}
