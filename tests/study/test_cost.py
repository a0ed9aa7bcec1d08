"""Errors of runs against their exact solutions, and studies of what accuracy costs."""

import csv
import json
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from typer.testing import CliRunner

from discsim import Simulation, load_scene
from discsim.cli import app
from discsim.run.simulation import PhysicsError
from discsim.scene import SceneError
from discsim.study.cost import Study
from discsim.study.costfigure import cost_figure
from discsim.study.errors import drifts, measure_of, profile_errors, totals
from discsim.study.findings import _order_cells, cost_of_error, fall_of_error, fitted_power
from discsim.study.points import Point, StudyError, Varied, points_by_line
from discsim.study.runs import one_run

WAVE = """
[units]
system = "code"
[run]
until = 0.1
[space]
dimensions = 1
size = 1.0
boundary = "periodic"
[initial]
kind = "wave"
[gas]
particles = 60
[gas.eos]
kind = "isothermal"
sound_speed = 1.0
[dust]
particles = 60
ratio = 1.0
[drag]
law = "constant"
K = 500.0
"""


@pytest.fixture
def wave(tmp_path):
    path = tmp_path / "wave.toml"
    path.write_text(WAVE)
    return path


# Errors

# Setup, changes that make it small, the error that it may have; but for the box, whose error is rounding,
# a bound is some times what is seen.
SMALL = {
    "dusty_wave": (["gas.particles=100", "dust.particles=100", "gas.smoothing_length=0.03"], 2e-3),
    "oblique_wave": (["gas.particles=900", "dust.particles=900", "gas.smoothing_length=0.06", "run.until=0.1"], 0.04),
    "dusty_shock": (["gas.particles=200", "dust.particles=200", "gas.smoothing_length=0.02"], 0.1),
    "dusty_box": ([], 1e-10),
    "settling": (["gas.particles=100", "dust.particles=100"], 0.01),
    "sheet": (["gas.particles=1024", "space.cells=32", "run.until=0.2"], 0.02),
    "gresho": (["gas.particles=900", "run.until=0.3"], 0.1),
    "sedov": (["gas.particles=2500", "initial.radius=0.06"], 0.1),
}


@pytest.mark.parametrize("setup", SMALL)
def test_a_run_is_near_its_exact_solution_and_a_wrong_one_is_not(setup):
    changes, bound = SMALL[setup]
    sim = Simulation(load_scene(f"setups/{setup}.toml", changes))
    measure = measure_of(sim.scene)
    before = totals(sim)
    sim.run()
    errors = measure.errors(sim)
    assert set(errors) <= set(sim.state.species) and 0.0 < max(errors.values()) < bound
    if sim.scene.space.boundary == "periodic":
        assert drifts(before, totals(sim))["momentum"] < 1e-9
    # Half the velocities, at the places of half the time.
    sim.state.time *= 0.5
    for p in sim.state.species.values():
        p.vel[:] *= 0.5
    assert max(measure.errors(sim).values()) > 2 * bound


def test_scenes_without_an_exact_solution():
    for name, changes in {
        "dusty_disc": [],
        "dusty_wave": ['drag.direction="one-way"'],
        "dusty_shock": ['drag.direction="one-way"', "drag.heating=false"],
    }.items():
        assert measure_of(load_scene(f"setups/{name}.toml", changes)) is None


def test_mass_elsewhere():
    reference = {"gas": [1.0, 1.0, 0.0], "dust": [0.5, 0.0, 0.5]}
    assert profile_errors({"gas": [1.0, 0.5, 0.5], "dust": [0.5, 0.0, 0.5]}, reference) == {"gas": 0.25, "dust": 0.0}


# What varies


def test_keys_and_values_are_read():
    assert Varied.from_text("a.b=1,2") == Varied(("a.b",), ("1", "2"))
    assert Varied.from_text("a.x,b.y = 1, 2") == Varied(("a.x", "b.y"), ("1", "2"))
    assert Varied.from_text('a.v=[1, 0],[0, 1],"x, y"').values == ("[1, 0]", "[0, 1]", '"x, y"')
    assert Varied.from_text('s=1 au,"2.5 au",1_000').numbers == (1.0, 2.5, 1000.0)
    assert Varied.from_text("s=mk,tsc").numbers is None
    both = Varied.from_text("a.x,b.y=1:0.5,2:0.25")
    assert both.settings("2:0.25") == {"a.x": "2", "b.y": "0.25"} and both.numbers == (1.0, 2.0)
    assert Varied.from_text("a.x,b.y=1,2").settings("2") == {"a.x": "2", "b.y": "2"}


@pytest.mark.parametrize(
    "text, words",
    [
        (text, "not a key with values; expected table.key=a,b,c, like drag.scheme=mk,tsc")
        for text in ("a.b", "a.b=", "=1", "a.b=1,,2", ",=1")
    ]
    + [
        ("a.b=1,1", "1 occurs twice; give each value once"),
        ("a.b=1:2", "1:2 has a wrong number of values; give one value"),
        ("a,b,c=1:2", "1:2 has a wrong number of values; give 3 values, one per key, or one value for all keys"),
    ],
)
def test_what_cannot_be_read_is_told(text, words):
    with pytest.raises(StudyError) as error:
        Varied.from_text(text)
    assert str(error.value) == f"--vary {text}: {words}"


@given(st.lists(st.text("abc123._-", min_size=1), min_size=1, max_size=5, unique=True))
def test_any_plain_values_come_back(values):
    assert Varied.from_text("table.key=" + ",".join(values)).values == tuple(values)


# Orders and prices


def line(errors, seconds):
    runs = [[{"cpu": cpu, "updates": 10 * cpu, "steps": 1}] for cpu in seconds]
    return [Point({"n": str(k)}, run, {"gas": error}) for k, (run, error) in enumerate(zip(runs, errors, strict=True))]


def test_price_is_read_off_a_power_law():
    """error = 1 / cpu^2: exactly between the points, extrapolated from them, the cheapest where all are good enough."""
    points = line([1.0, 0.25, 0.0625], [1.0, 2.0, 4.0])
    cpu = lambda point: point.cpu  # noqa: E731
    assert cost_of_error(points, 0.1, cpu) == (pytest.approx(0.1**-0.5), False)
    assert cost_of_error(points, 0.001, cpu) == (pytest.approx(0.001**-0.5), True)
    assert cost_of_error(points, 2.0, cpu) == (1.0, False)
    assert cost_of_error(points[:1], 0.1, cpu) is None
    assert cost_of_error(line([0.100, 0.099], [1.0, 4.0]), 0.01, cpu) is None  # cpu ~ error^-138
    # A dearer run that is worse is no part of the line.
    assert cost_of_error([*points, *line([0.5], [8.0])], 0.1, cpu) == (pytest.approx(0.1**-0.5), False)


def test_power_of_a_line():
    assert fitted_power([1.0, 2.0, 4.0], [3.0, 0.75, 0.1875]) == pytest.approx(-2.0)
    assert fitted_power([1.0, 1.0], [3.0, 0.75]) is None
    assert fitted_power([0.5, 0.5 * (1.0 + 2.0**-52)], [3.0, 0.75]) is None  # rounding is no line


def test_an_error_that_hardly_changes_predicts_no_cost():
    """Neither a flat line nor one whose scatter is as large as its slope; a steep one does, to the slope."""
    cpu, axis = [1.0, 2.1, 4.3, 8.7], Varied(("n",), ("3", "7", "15", "31"))

    def cells(errors):
        points = line(errors, cpu)
        for point, n in zip(points, axis.values, strict=True):
            point.settings["n"] = n
        return list(_order_cells(axis, points))

    assert fall_of_error(cpu, [0.3 * c**-1.7 for c in cpu]) == pytest.approx(1.7)
    # Not a power law, but more accurate each time.
    assert fall_of_error(cpu[:3], [3.5e-4, 4.9e-5, 2e-5]) > 1.0
    flat, noisy = [0.0162, 0.0160, 0.0161, 0.0159], [0.06, 0.016, 0.07, 0.02]
    for errors in (flat, noisy):
        assert fall_of_error(cpu, errors) is None
        order, half, *goals = cells(errors)
        # Extrapolated costs of 1% and 0.1% are left out; the cost of 10% is that of a run.
        assert order and half == "" and goals == ["1", "10", "", "", "", ""]
    order, half, *goals = cells([0.3 * c**-1.7 for c in cpu])
    assert half == "costs 1.5 times" and goals[4].startswith("~")  # 2^(1 / 1.7)


@pytest.mark.parametrize("other", [{}, {"drag.scheme": "idic"}])
def test_the_figure_tells_scene_measure_and_key_and_keeps_its_numbers_in_the_frame(tmp_path, monkeypatch, other):
    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *arguments, **named: drawn.append(figure))
    points = line([0.071, 0.0032, 4.3e-4], [0.013, 0.17, 2.9])
    for point, n in zip(points, ("60", "240", "123456789"), strict=True):
        point.settings = {"gas.particles": n, **other}
    axis = Varied(("gas.particles",), ("60", "240", "123456789"))
    study = SimpleNamespace(
        points=points, axis=axis, exact_error="heights of the grains", reference=None, title="Grains in a layer",
        lines=lambda: points_by_line(points, axis), front=lambda: points,
    )  # fmt: skip
    cost_figure(study, tmp_path / "cost.png")
    axes = drawn[0].axes[0]
    FigureCanvasAgg(drawn[0]).draw()
    assert axes.get_title() == "Grains in a layer" and axes.get_ylabel() == "error: heights of the grains"
    legend = axes.get_legend()
    assert legend.get_title().get_text() == "numbers at the points: gas.particles"
    assert legend.get_texts()[0].get_text() == ("scheme = idic" if other else "runs")
    assert [text.get_text() for text in axes.texts] == ["60", "123456789"]
    for text in axes.texts:
        box = text.get_window_extent()
        assert axes.bbox.x0 < box.x0 and box.x1 < axes.bbox.x1


# Studies


def rows_of(directory):
    with (directory / "cost.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def invoke(*arguments):
    return CliRunner().invoke(app, ["cost", *map(str, arguments)])


def test_a_study_makes_table_figure_and_findings(wave, tmp_path):
    out = tmp_path / "study"
    vary = ["--vary", "drag.scheme=idic,tsc", "--vary", "gas.particles,dust.particles=40,80"]
    done = invoke(wave, *vary, "--repeat", 2, "-o", out)
    assert done.exit_code == 0, done.output
    rows = rows_of(out)
    assert [(row["drag.scheme"], row["gas.particles"], row["dust.particles"], row["runs"]) for row in rows] == [
        (scheme, n, n, "2") for scheme in ("idic", "tsc") for n in ("40", "80")
    ]
    errors = [float(row["error"]) for row in rows]
    assert errors[2] < errors[0] / 10 and errors[3] < errors[1] / 10  # a staircase against none
    for row in rows:
        assert float(row["error"]) == max(float(row["error_gas"]), float(row["error_dust"]))
        assert int(row["updates"]) == 2 * int(row["gas.particles"]) * int(row["steps"])
        assert float(row["cpu_least"]) <= float(row["cpu_seconds"]) <= float(row["cpu_most"])
        assert float(row["momentum"]) < 1e-9 and row["energy"] == "" and row["status"] == "done"
    best = min(rows, key=lambda row: float(row["error"]))
    assert best["front"] == "1"
    assert (out / "cost.png").stat().st_size > 10_000
    for words in ("particle velocities compared with the exact wave", "0.1: ", "0.001: ", "extrapolated from"):
        assert words in done.output and words in (out / "cost.log").read_text()
    assert f"runs {out / 'runs.jsonl'}\nlog {out / 'cost.log'}\n" in done.output
    (head,) = [line.split() for line in done.output.splitlines() if "CPU s " in line]
    assert head[-1] == "momentum"  # the energy of isothermal gas is not conserved


def test_a_study_goes_on_where_it_stopped(wave, tmp_path):
    out, vary = tmp_path / "study", ["--vary", "gas.particles,dust.particles=30,40"]
    assert invoke(wave, *vary, "-o", out).exit_code == 0
    kept = (out / "runs.jsonl").read_text().splitlines()
    (out / "runs.jsonl").write_text("\n".join([*kept[:2], kept[2][:40]]))  # as a crash leaves it
    for _ in range(2):  # what is added after it can be read again
        assert invoke(wave, "--vary", "gas.particles,dust.particles=30,40,50", "-o", out).exit_code == 0
    assert [json.loads(text)["settings"]["gas.particles"] for text in kept[1:]] == ["30", "40"]
    assert [row["gas.particles"] for row in rows_of(out)] == ["30", "40", "50"]
    # The first run was not made again.
    assert rows_of(out)[0]["cpu_seconds"] == str(json.loads(kept[1])["cpu"])
    other = invoke(wave, *vary, "--set", "drag.K=5", "-o", out)
    assert other.exit_code == 2 and "another scene" in other.output


def test_parallel_runs_find_the_same_errors(wave, tmp_path):
    vary = ["--vary", "gas.particles,dust.particles=30,40"]
    for name, more in (("one", []), ("two", ["--parallel", 2])):
        assert invoke(wave, *vary, *more, "-o", tmp_path / name).exit_code == 0
    assert [r["error"] for r in rows_of(tmp_path / "one")] == [r["error"] for r in rows_of(tmp_path / "two")]


@pytest.mark.parametrize(
    "vary, words",
    [
        ("drag.scheme=tsc,tsk", 'did you mean "tsc"'),
        ("drag.scheme=tsc,tsk", "(with scheme = tsk)"),
        ("drag.schem=tsc,mk", 'did you mean "scheme"'),
        ("gas.partcles=60,480", "--vary gas.partcles=60: gas.partcles: unknown key"),
        ("gas.particles", "expected table.key=a,b,c"),
    ],
)
def test_wrong_studies_end_in_a_message_and_write_nothing(wave, tmp_path, vary, words):
    done = invoke(wave, "--vary", vary, "-o", tmp_path / "study")
    assert done.exit_code == 2 and words in done.output and "Traceback" not in done.output
    assert not (tmp_path / "study").exists()


def test_without_an_exact_solution_the_finest_run_is_the_measure(wave, tmp_path):
    study = Study(
        wave, [Varied.from_text("gas.particles,dust.particles=30,60")], 1, tmp_path / "s", ['drag.direction="one-way"']
    )
    study.make("wave", 1)
    first, finest = rows_of(tmp_path / "s")
    assert finest["status"] == "reference" and finest["error"] == "" and 0.0 < float(first["error"]) < 0.5
    assert "gas.particles = 60, dust.particles = 60 (no exact solution)" in (tmp_path / "s" / "cost.log").read_text()


def test_the_measure_is_the_run_with_most_particle_updates_not_with_most_steps(wave, tmp_path):
    """Five times fewer particles at an eighth of the Courant factor take more steps, and fewer updates."""
    varied = Varied.from_text("gas.particles,dust.particles,run.courant=30:30:0.05,150:150:0.4")
    Study(wave, [varied], 1, tmp_path / "s", ['drag.direction="one-way"']).make("wave", 1)
    few, many = rows_of(tmp_path / "s")
    assert int(few["steps"]) > int(many["steps"]) and int(few["updates"]) < int(many["updates"])
    assert many["status"] == "reference" and few["status"] == "done"


def test_what_the_physics_stops_is_told_and_left_out(wave, tmp_path, monkeypatch):
    step = Simulation.step

    def fail(sim, *arguments):
        if sim.scene.gas.particles == 40:
            raise PhysicsError("gas particle 7 is not finite")
        return step(sim, *arguments)

    monkeypatch.setattr(Simulation, "step", fail)
    study = Study(wave, [Varied.from_text("gas.particles,dust.particles=30,40")], 2, tmp_path / "s")
    study.make("wave", 1)
    good, bad = rows_of(tmp_path / "s")
    assert good["status"] == "done" and "gas particle 7 is not finite" in bad["status"] and bad["error"] == ""


FAULTS = {
    "refused at the start: no balance": SceneError(["no balance"]),
    "stopped by a numerical failure: not finite": PhysicsError("not finite"),
    "ended by ValueError: two lines": ValueError("two\n lines"),
    "ended by MemoryError": MemoryError(),
    "ended by IndexError": IndexError("list index out of range"),
    "ended by TypeError": TypeError("'NoneType' object is not subscriptable"),
    "ended by FileNotFoundError": FileNotFoundError("gone"),
    "ended by ZeroDivisionError": ZeroDivisionError("division by zero"),
}


def failing(monkeypatch, fault, with_particles, where="__init__"):
    """Let simulations of so many particles raise `fault` in a method."""
    own = getattr(Simulation, where)

    def fail(sim, *arguments, **named):
        scene = arguments[0] if where == "__init__" else sim.scene
        if with_particles is None or scene.gas.particles == with_particles:
            raise fault
        return own(sim, *arguments, **named)

    monkeypatch.setattr(Simulation, where, fail)


@pytest.mark.parametrize("where", ["__init__", "evolve"])
@pytest.mark.parametrize("words", FAULTS)
def test_a_run_that_raises_anything_is_told_and_left_out(wave, tmp_path, monkeypatch, words, where):
    failing(monkeypatch, FAULTS[words], 40, where)
    done = invoke(wave, "--vary", "gas.particles,dust.particles=30,40", "-o", tmp_path / "s")
    assert done.exit_code == 0 and "Traceback" not in done.output, done.output
    good, bad = rows_of(tmp_path / "s")
    assert good["status"] == "done" and bad["status"].startswith(words) and bad["error"] == ""
    assert words in done.output


@pytest.mark.parametrize("words", ["refused at the start: no balance", "ended by TypeError"])
def test_where_every_run_fails_one_message_says_so(wave, tmp_path, monkeypatch, words):
    failing(monkeypatch, FAULTS[words], None)
    done = invoke(wave, "--vary", "gas.particles,dust.particles=30,40", "-o", tmp_path / "s")
    assert done.exit_code == 2 and done.stderr.count("\n") == 1
    assert "no run completed; the run with gas.particles = 30" in done.stderr and words in done.stderr


def test_a_real_start_that_is_refused_is_left_out(tmp_path):
    """A cubic kernel with so wide an h leaves forces in a layer, which is refused while the start is made."""
    few = ["--set", "gas.particles=40", "--set", "dust.particles=10", "--set", "run.until=0.05"]
    done = invoke("settling", *few, "--vary", "gas.kernel,gas.eta=wendland-c4:2,cubic:2.2", "-o", tmp_path / "s")
    assert done.exit_code == 0, done.output
    assert [row["status"].partition(":")[0] for row in rows_of(tmp_path / "s")] == ["done", "refused at the start"]


def test_an_error_that_is_not_finite_is_no_result(wave, tmp_path, monkeypatch):
    measure = measure_of(load_scene(wave))
    monkeypatch.setattr(
        "discsim.study.errors.measure_of", lambda scene: measure._replace(errors=lambda sim: {"gas": float("nan")})
    )
    assert "without a finite error" in one_run(wave, [], [])["stopped"]
