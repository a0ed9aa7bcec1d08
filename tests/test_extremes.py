"""Extreme scenes: each is refused with one message, before anything is made of it, or runs."""

import os

import numpy as np
import pytest
from typer.testing import CliRunner

from discsim import SceneError, Simulation, cli
from discsim.formulas.smoothing import SMOOTHING
from discsim.kernels.sph.smoothing import KERNELS, NORM, shape
from discsim.preview.check import report
from discsim.preview.forecast import memory_warnings
from discsim.run.simulation import PhysicsError
from discsim.scene import load_scene
from discsim.study.errors import totals

ISOTHERMAL = {"kind": "isothermal", "sound_speed": 0.05}
CODE = {"system": "code"}


def disc(initial=None, gas=None, **tables):
    start = {"kind": "disc", "mass": 0.01, "inner": 1.0, "outer": 2.0} | (initial or {})
    out = {
        "units": CODE, "run": {"until": 1.0}, "space": {"size": 6.0}, "star": {"mass": 1.0}, "initial": start,
        "gas": {"particles": 300, "eos": ISOTHERMAL} | (gas or {}),
    }  # fmt: skip
    return out | tables


def wave(gas=None, run=None, **initial):
    return {
        "units": CODE, "run": {"until": 0.1} | (run or {}),
        "space": {"dimensions": 1, "size": 1.0, "boundary": "periodic"}, "initial": {"kind": "wave"} | initial,
        "gas": {"particles": 100, "eos": {"kind": "isothermal", "sound_speed": 1.0}} | (gas or {}),
    }  # fmt: skip


def layer(particles, extent):
    return {
        "units": CODE, "run": {"until": 1.0}, "space": {"dimensions": 1, "size": 2.0 * extent},
        "initial": {"kind": "settling"}, "external": {"vertical_frequency": 2.0},
        "gas": {"particles": particles, "eos": {"kind": "isothermal", "sound_speed": 2.0}},
    }  # fmt: skip


def polytrope(gamma):
    return {"eos": {"kind": "polytropic", "gamma": gamma, "constant": 0.1}}


def nested(depth):
    out = {"x": 1}
    for _ in range(depth):
        out = {"x": out}
    return out


DUST = {"particles": 50, "ratio": 0.1}
REFUSED = {
    "snapshots": (wave(run={"snapshots": 1e9}), "run.snapshots: 1000000000.0 is out of range; expected at most 1e+06"),
    "every": (wave(run={"every": 1e-9}), "run.every: the interval gives 1e+08 snapshots until run.until; expected"),
    "deep": (wave(gas=nested(3000)), "gas.x.x.x.x.x.x.x.x: nested too deeply"),
    "steep": (disc({"surface_density_index": 1e12}), "initial.surface_density_index: the index 1e+12"),
    "steep and warm": (
        disc(gas={"eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1, "temperature_index": -1e9}}),
        "gas.eos.temperature_index: the index -1e+09 makes powers of the radius"),
    "huge": (disc({"mass": 1e99}), "initial.mass: 1e+99 is out of range; expected 0, or an absolute value"),
    "many digits": (wave(gas={"particles": 10**5000}), "gas.particles: inf is not a finite number"),
    "gamma of 1": (
        disc(gas=polytrope(1)), 'gas.eos.gamma: gamma = 1 is isothermal gas; set kind = "isothermal" and '
                                'sound_speed'),
    "gamma of 1e3": (disc(gas=polytrope(1e3)), "gas.eos.gamma: 1000.0 is out of range; expected at most 100"),
    "Q of gamma = 3": (
        disc({"toomre_q": 2.0, "mass": None}, polytrope(3)), "initial.toomre_q: Toomre Q of a polytropic disc"),
    "dust beyond": (disc(dust=DUST | {"inner": 2.0}), "dust.inner: the dust begins beyond initial.outer"),
    "dust in the hole": (disc(dust=DUST | {"outer": 0.9}), "dust.outer: the dust ends inside initial.inner"),
    "tapers": (
        disc({"inner_taper": 0.3, "outer_taper": 0.8}),
        "initial.outer_taper: the tapers are 1.1 times as wide as the disc; expected a factor of at most 1"),
    "wave": (wave(amplitude=1), "initial.amplitude: 1 is out of range; expected less than 1"),
    "trough": (wave(amplitude=-1.5), "initial.amplitude: -1.5 is out of range; expected more than -1"),
    "steps beyond all": (wave(run={"courant": 1e9}), "run.courant: 1000000000.0 is out of range; expected at most 100"),
    "all are neighbours": (wave({"eta": 1e9}), "gas.eta: 1000000000.0 is out of range; expected at most 30"),
    "wider than space": (
        wave({"smoothing_length": 7.0}), "gas.smoothing_length: the length is 7 times space.size"),
    "lone particles": (
        wave({"kernel": "quintic-h", "eta": 1.4}), 'gas.eta: 1.4 leaves a particle of kernel "quintic-h" without'),
    "layer": (layer(150, 4.0), "gas.particles: 150 particles are too few for a layer that reaches to 4 scale "
                               "heights*choose at least 2989"),
    "thick layer": (layer(150, 40.0), "initial.vertical_extent: a layer 80 scale heights thick has practically "
                                      "no gas at its ends"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case):
    scene, words = REFUSED[case]
    with pytest.raises(SceneError) as caught:
        load_scene(scene)
    (problem,) = caught.value.problems
    first, _, rest = words.partition("*")
    assert problem.startswith(f"scene: {first}") and rest in problem
    assert len(problem) < 400


def test_deep_keys_of_a_file_and_of_the_command_line(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("run" + ".a" * 3000 + " = 1\n")
    with pytest.raises(SceneError, match=r"scene\.toml:1: run\.a\.a.*: nested too deeply"):
        load_scene(path)
    with pytest.raises(SceneError, match=r"^--set run\.a\.a.*\.\.\.: nested too deeply; expected table\.key=value$"):
        load_scene(wave(), ["run" + ".a" * 3000 + "=1"])


@pytest.mark.parametrize(
    "override, words",
    [
        ("units.length=1e99 au", 'units.length: "1e99 au" is 1.5e+112 cm; expected 1e-20 to 1e+40'),
        ("units.mass=1e-99 g", 'units.mass: "1e-99 g" is 1e-99 g; expected 1e-40 to 1e+60'),
        (
            "initial.mass=1e99 Msun",
            'initial.mass: "1e99 Msun" is out of range; expected 0, or an absolute value from 1e-60 to',
        ),
    ],
)
def test_units_out_of_reach(override, words):
    with pytest.raises(SceneError) as caught:
        load_scene("setups/gas_disc.toml", [override])
    assert words in caught.value.problems[0]


LONG = "x" * 5000
KEYS = ["run.until", "gas.particles", "gas.kernel", "gas.eos.kind", "gas.eos", "space.size", "units.length"]


@pytest.mark.parametrize("key", [*KEYS, LONG, f"gas.{LONG}"])
@pytest.mark.parametrize("value", [LONG, "1 " + LONG, "[" + "1," * 3000 + "1]", "9" * 4000])
def test_messages_repeat_little_of_a_value(key, value):
    with pytest.raises(SceneError) as caught:
        load_scene(disc(units={}), [f"{key}={value}"])
    for problem in caught.value.problems:
        assert LONG[:81] not in problem and "1, 1, 1" * 13 not in problem and "9" * 81 not in problem


@pytest.mark.parametrize(
    "written, number", [(".09", 0.09), ("5.", 5.0), ("+.1", 0.1), ("1_000", 1000), ("09", 9.0), (".5e1", 5.0)]
)
def test_numbers_as_people_write_them(written, number):
    assert load_scene(wave(), [f"run.until={written}"]).run.until == number


def test_until_as_people_write_it(tmp_path):
    path = tmp_path / "wave.toml"
    path.write_text(load_scene(wave()).text)
    done = CliRunner().invoke(cli.app, ["run", str(path), "--until", ".0009", "-o", str(tmp_path / "out"), "--quiet"])
    assert done.exit_code == 0
    assert "until = 0.0009" in (tmp_path / "out" / "scene.toml").read_text()


def test_more_memory_than_there_is(tmp_path):
    path, out = tmp_path / "disc.toml", tmp_path / "out"
    path.write_text(load_scene(disc()).text)
    words = r"memory: the run needs about 466 GiB, and this machine has [\d.]+ GiB; choose fewer particles or cells"
    large = load_scene(path, ["gas.particles=1e9"])
    with pytest.raises(SceneError, match=words):
        Simulation(large)
    (line,) = (line for line in report(large).splitlines() if "memory: " in line)
    assert "466 GiB" in line
    done = CliRunner().invoke(cli.app, ["run", str(path), "--set", "gas.particles=1e9", "-o", str(out), "--quiet"])
    assert done.exit_code == 2 and "466 GiB" in done.output + done.stderr and not out.exists()


def test_memory_of_a_line_and_of_a_grid(monkeypatch):
    assert list(memory_warnings(load_scene(wave()))) == []
    (line,) = memory_warnings(load_scene(wave({"particles": 10**10})))
    assert "4.66e+03 GiB" in line
    # 65536^2 cells of gravity, with their transforms.
    (line,) = memory_warnings(load_scene(disc(self_gravity={"softening": 0.1}), ["space.cells=65536"]))
    assert float(line.split("about ")[1].split()[0]) > 200
    monkeypatch.setattr(os, "sysconf", lambda name: 2**20)
    assert list(memory_warnings(load_scene(wave({"particles": 10**9}))))[0:] == []


@pytest.mark.parametrize("amplitude", [0.9, 0.999, -0.99, -0.999999])
def test_a_steep_wave_is_laid_as_it_is_asked_for(amplitude):
    """The mass to the left of a particle is that of 1 + A sin(2 pi x): to Newton's last step."""
    x = np.sort(Simulation(wave(amplitude=amplitude)).gas.pos[:, 0])
    left = x + amplitude * (1.0 - np.cos(2.0 * np.pi * x)) / (2.0 * np.pi)
    spacing = np.diff(left)
    np.testing.assert_allclose(spacing, 0.01, rtol=1e-9)


@pytest.mark.parametrize("dim", [1, 2])
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_least_eta_is_that_of_a_lone_particle(kernel, dim):
    """rho = m W(0) / h^d and h = eta (m / rho)^(1/d) agree at any h."""
    alone = (NORM[dim - 1][KERNELS[kernel]] * shape.py_func(KERNELS[kernel], dim, 0.0)[0]) ** (1 / dim)
    least = SMOOTHING[kernel].least_eta[dim - 1]
    assert least == pytest.approx(alone, rel=2e-3) and least > alone * (1 - 1e-9)


@pytest.mark.parametrize("gamma", [0.5, 5 / 3, 3.0])
def test_thermal_energy_of_a_polytrope_is_the_work_done_on_it(gamma):
    """A standing wave swings between energy of motion and of heat; the sum stays, to the square of the step."""
    eos = {"kind": "polytropic", "gamma": gamma, "constant": 1.0 / gamma}  # a sound speed of 1
    sim = Simulation(wave({"eos": eos}, amplitude=0.05))
    sim.gas.vel[:] = 0.0
    motions, energies = [], []
    for time in (0.0, 0.1, 0.2, 0.3):
        sim.run(until=time)
        motions.append(float(0.5 * (sim.gas.mass * sim.gas.vel[:, 0] ** 2).sum()))
        energies.append(totals(sim)["energy"])
    assert np.ptp(motions) > 1e-4
    assert np.ptp(energies) < 0.01 * np.ptp(motions)  # twice the heat would be as large as the motion itself


@pytest.mark.parametrize("scheme", ["mk", "esph"])
def test_explicit_drag_without_end_is_told(scheme):
    tables = wave() | {
        "dust": {"particles": 100, "ratio": 1.0},
        "drag": {"law": "stopping-time", "t_stop": 1e-12, "scheme": scheme, "direction": "one-way"},
    }
    with pytest.raises(PhysicsError, match=rf'"{scheme}" would need [\de.+]+ explicit substeps .* like "tsc"'):
        Simulation(tables).step()


def test_drag_cells_far_below_the_spacing():
    """There are four a particle at most, in a periodic line as in an open one: not an array of empty ones."""
    ends = []
    for length in (1e-3, 1e-12):
        tables = wave() | {
            "dust": {"particles": 100, "ratio": 1.0},
            "drag": {"law": "stopping-time", "t_stop": 0.1, "scheme": "idic", "cell_length": length},
        }
        sim = Simulation(tables)
        sim.step()
        ends.append(sim.dust.vel)
    np.testing.assert_array_equal(*ends)
