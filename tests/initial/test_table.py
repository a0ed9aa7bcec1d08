"""A disc from a table of columns: its profile and balance, what is wrong with a file, a run that keeps its file."""

import numpy as np
import pytest
from runs import assert_resumes
from scenes import problems

from discsim import Simulation, load_scene
from discsim.output.snapshot_writer import write_snapshot
from discsim.physics import profile
from discsim.physics.given_disc import PrescribedDisc
from discsim.preview.derived import derived_rows, gas_at_start
from discsim.scene import SceneError

R = np.geomspace(1.0, 3.0, 60)


def table(tmp_path, text=None):
    path = tmp_path / "disc.txt"
    rows = np.stack([R, 1e-4 * R**-1.5, 0.0025 * R**-1.0, 0.02 * R], axis=1)
    body = "\n".join(" ".join(f"{x:.17g}" for x in row) for row in rows)
    path.write_text(f"# r  Sigma  T  ratio\n{body}\n" if text is None else text)
    return path


def scene(path, **tables):
    return {
        "units": {"system": "code"},
        "run": {"until": 0.1},
        "space": {"size": 8.0, "cells": 32},
        "initial": {"kind": "table", "file": str(path)},
        "gas": {"particles": 3000, "eos": {"kind": "adiabatic", "gamma": 1.4}},
        "dust": {"particles": 1000, "ratio": 0.5},
        "star": {"mass": 1.0},
        **tables,
    }


def test_power_laws_in_a_file_are_that_disc(tmp_path):
    sim = Simulation(scene(table(tmp_path)))
    mass = 2.0 * np.pi * 1e-4 * (3.0**0.5 - 1.0) / 0.5
    assert sim.gas.mass.sum() == pytest.approx(mass, rel=1e-7)  # cubics through powers, integrated in 20,000 parts
    dust = 2.0 * np.pi * 2e-6 * (3.0**1.5 - 1.0) / 1.5  # the column is the ratio, whatever dust.ratio
    assert sim.dust.mass.sum() == pytest.approx(dust, rel=1e-4)  # linear in ln r between 60 rows
    r = np.hypot(*sim.gas.pos.T)
    np.testing.assert_allclose(sim.gas.u, 0.0025 / r / 0.4, rtol=1e-9)
    speed2 = ((sim.gas.pos[:, 0] * sim.gas.vel[:, 1] - sim.gas.pos[:, 1] * sim.gas.vel[:, 0]) / r) ** 2
    np.testing.assert_allclose(speed2, 1.0 / r - 2.5 * 0.0025 / r, rtol=1e-9)  # v^2 = GM/r - (p + q) c_s^2
    below = np.histogram(r, [1.0, 1.5, 2.0, 2.5, 3.0], weights=sim.gas.mass)[0]
    edges = np.array([1.0, 1.5, 2.0, 2.5, 3.0]) ** 0.5
    np.testing.assert_allclose(below / mass, np.diff(edges) / (3.0**0.5 - 1.0), atol=0.02)  # a ring of 3000 in 40


def test_the_ratio_of_a_file_is_that_of_all_populations(tmp_path):
    """Two that share it as 5 : 3."""
    dust = [{"particles": 1000, "ratio": 0.5}, {"particles": 600, "ratio": 0.3}]
    sim = Simulation(scene(table(tmp_path), dust=dust))
    whole = 2.0 * np.pi * 2e-6 * (3.0**1.5 - 1.0) / 1.5
    held = [sim.dust.mass[sim.dust.species == k].sum() for k in range(2)]
    np.testing.assert_allclose(held, [0.625 * whole, 0.375 * whole], rtol=1e-4)  # linear in ln r between 60 rows


@pytest.mark.parametrize("mu", [0.6, 1.3])
def test_kelvins_of_a_table_are_those_of_its_molecules(tmp_path, mu):
    """c_T^2 = k_B T / (mu m_H) with a mean molecular weight of its own, of SPH gas and of a given disc."""
    r, kelvin = np.geomspace(5.0, 30.0, 40), np.geomspace(300.0, 40.0, 40)
    path = tmp_path / "disc.txt"
    rows = "\n".join(f"{x:.17g} {200 / x:.17g} {t:.17g}" for x, t in zip(r, kelvin, strict=True))
    path.write_text(f"# r [au]  Sigma [g/cm2]  T [K]\n{rows}\n")
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.05, "mean_molecular_weight": mu}
    tables = {
        "run": {"until": "1 yr"}, "space": {"size": "80 au"}, "star": {"mass": "1 Msun"},
        "initial": {"kind": "table", "file": str(path)}, "gas": {"particles": 400, "eos": eos},
    }  # fmt: skip
    sim = Simulation(tables)
    sim.step(1e-9)
    start = {"kind": "disc", "surface_density": "20 g/cm2", "inner": "6 au", "outer": "25 au"}
    beside = {
        "initial": start, "gas": None, "background": {"file": str(path), "eos": eos},
        "dust": {"particles": 400, "ratio": 0.01},
        "drag": {"law": "stokes-number", "stokes": 0.1, "direction": "one-way"},
    }  # fmt: skip
    given = PrescribedDisc(load_scene({k: v for k, v in (tables | beside).items() if v is not None}))
    unit = sim.scene.units.cgs("velocity")
    for place, speed in (
        (np.hypot(*sim.gas.pos.T), sim.gas.sound_speed),
        (r[5:-5], given.thermal_speed(r[5:-5])),
    ):
        found = np.exp(np.interp(np.log(place), np.log(r), np.log(kelvin)))
        hydrogen = 1.6735328e-24  # g
        np.testing.assert_allclose((speed * unit) ** 2, 1.380649e-16 * found / (mu * hydrogen), rtol=1e-6)


def test_given_gas_beyond_the_ends_of_its_table_goes_on_as_powers(tmp_path):
    """Power laws of radius with the slopes at the ends of the table, so that dust beyond them drifts too."""
    path, tables = table(tmp_path), scene("")
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.04}
    tables |= {"background": {"file": str(path), "eos": eos}, "dust": {"particles": 30, "ratio": 0.02}}
    tables |= {"initial": {"kind": "disc", "surface_density": 1e-4, "inner": 1.2, "outer": 2.7}}
    tables |= {"drag": {"law": "stokes-number", "stokes": 0.2, "direction": "one-way"}}
    del tables["gas"]
    given, r = PrescribedDisc(load_scene(tables)), np.array([0.3, 0.85, 3.4, 7.0])
    # Rounding of 60 logarithms and of the cubics' slopes through them.
    np.testing.assert_allclose(given.surface_density(r), 1e-4 * r**-1.5, rtol=1e-9)
    np.testing.assert_allclose(given.thermal_speed(r) ** 2, 0.0025 / r, rtol=1e-9)
    np.testing.assert_allclose(given.pressure_slope(r), 2.5, rtol=1e-9)


def test_the_pull_of_the_pressure_is_that_of_the_interpolation(tmp_path):
    rough = "r Sigma\n" + "\n".join(f"{x} {y}" for x, y in [(1, 1e-4), (1.5, 3e-4), (2, 1e-4), (3, 2e-5)])
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.05}
    sim = Simulation(scene(table(tmp_path, rough), gas={"particles": 500, "eos": eos}))
    disc, r, d = profile.radial(sim.scene), np.linspace(1.05, 2.9, 50), 1e-6

    def pressure(x):
        return disc.surface_density(x) * profile.sound_speed(sim.scene, x, x) ** 2

    expected = -(pressure(r + d) - pressure(r - d)) / (2 * d) / disc.surface_density(r)
    np.testing.assert_allclose(disc.pressure_acceleration(r), expected, rtol=1e-4, atol=1e-7)  # of differences


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "empty; expected a header"),
        ("1 2\n2 3\n", ":1: not a table header"),
        ("r Sigma\n1 1\n2 x\n", ':3: "x" is not a number'),
        ("r Sigma\n1 1\n2\n", ":3: 1 numbers; expected 2 numbers, in the columns r, Sigma"),
        ("r Sigma\n2 1\n1 1\n", ":3: r = 1 is not larger than 2"),
        ("r Sigma\n1 1\n2 0\n", ":3: Sigma = 0 is out of range"),
        ("r Sigma\n1 1\n", "1 rows; expected at least two"),
        ("r T\n1 1\n2 1\n", ":1: no column Sigma"),
        (
            "r Sigma mass\n1 1 1\n2 1 1\n",
            ':1: column "mass" is unknown; expected the columns r, Sigma, T, ratio, resolution',
        ),
        ("r Sigma resolution\n1 1 1\n2 1 0\n", ":3: resolution = 0 is out of range; expected a positive number"),
        (
            "r Sigma resolution [1/g]\n1 1 1\n2 1 1\n",
            ':1: column resolution: "1/g" is a unit, but a resolution has no unit',
        ),
        ("r [au] Sigma\n1 1\n2 1\n", ':1: column r: "au" is a unit'),
    ],
)
def test_a_bad_file_is_told_with_its_line(tmp_path, text, wrong):
    (message,) = problems(scene(table(tmp_path, text)))
    assert message.startswith("scene: initial.file: ") and wrong in message


def test_units_are_read(tmp_path):
    path = table(tmp_path, "# r [km]  Sigma [kg/m2]\n1.495978707e8 10\n2.991957414e8 5\n")
    given = scene(path, units={}, run={"until": "1 yr"}, space={"size": "8 au"}, star={"mass": "1 Msun"})
    given["gas"]["eos"] = {"kind": "isothermal", "sound_speed": "1 km/s"}
    sim = Simulation(given)
    assert sim.scene.initial.inner == pytest.approx(1.0) and sim.scene.initial.outer == pytest.approx(2.0)
    sigma = sim.units.quantity(sim.scene.initial.file.values["Sigma"], "density")
    assert sigma[0].to_value("g/cm2") == pytest.approx(1.0)


def test_circles_or_drift_as_asked(tmp_path):
    drag = {"law": "stopping-time", "t_stop": 0.1}
    for word, falls in (("balance", False), ("drift", True)):
        given = scene(table(tmp_path), drag=drag)
        given["initial"]["dust_velocity"] = word
        dust = Simulation(given).dust
        inwards = -(dust.pos * dust.vel).sum(axis=1)
        assert (inwards > 1e-5).all() if falls else (np.abs(inwards) < 1e-12).all()


def test_it_goes_on_from_a_checkpoint_to_the_bit(tmp_path):
    given = scene(table(tmp_path), drag={"law": "stopping-time", "t_stop": 0.1})
    given["gas"] |= {"viscosity": {}}
    assert_resumes(given, tmp_path / "half.h5", 0.05, 0.1)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    (moved / "profile.txt").write_bytes((tmp_path / "disc.txt").read_bytes())  # what holds the same is the same
    again = Simulation(given | {"initial": {"kind": "table", "file": str(moved / "profile.txt")}})
    again.restore(tmp_path / "half.h5")
    (moved / "profile.txt").write_text("r Sigma T ratio\n1 1 1 1\n3 1 1 1\n")
    other = Simulation(given | {"initial": {"kind": "table", "file": str(moved / "profile.txt")}})
    with pytest.raises(SceneError, match=r"the scene differs from the scene of the run in initial\.file"):
        other.restore(tmp_path / "half.h5")


def uneven(tmp_path, column, **tables):
    """A disc with a gap a tenth deep at r = 2, and a column of the resolution."""
    sigma = 1e-4 / R * (1.0 - 0.9 * np.exp(-(((R - 2.0) / 0.25) ** 2)))
    rows = "\n".join(f"{r:.17g} {s:.17g} {c:.17g}" for r, s, c in zip(R, sigma, column(R, sigma), strict=True))
    path = table(tmp_path, f"r Sigma resolution\n{rows}\n")
    eos = {"kind": "locally-isothermal", "aspect_ratio": 0.05}
    given = scene(path, gas={"particles": 12_000, "kernel": "cubic", "eos": eos, "viscosity": {}}, **tables)
    del given["dust"]
    return given


def test_a_resolution_makes_light_particles_of_the_same_disc(tmp_path):
    """Where it is 1 / Sigma particles are as far apart everywhere, and h is the same in the gap as beside it."""
    even = Simulation(uneven(tmp_path, lambda r, sigma: np.ones_like(r)))
    light = Simulation(uneven(tmp_path, lambda r, sigma: 7.0 / sigma))
    for sim in (even, light):
        sim.operators.forces()
    assert light.gas.mass.sum() == pytest.approx(even.gas.mass.sum(), rel=1e-13)
    disc = profile.radial(light.scene)
    r = np.hypot(*light.gas.pos.T)
    area = light.gas.mass / disc.surface_density(r)
    inside = (r > 1.1) & (r < 2.9)
    np.testing.assert_allclose(area[inside], np.pi * 8.0 / 12_000, rtol=0.05)  # a ring's mean, and its middle
    ring, of = np.unique(r.round(9), return_inverse=True)
    held = np.bincount(of, light.gas.mass)
    within = profile.integral(fine := np.linspace(1.0, 3.0, 20_001), disc.surface_density(fine))
    middle = np.interp(ring, fine, within)  # a ring is where it halves its particles, not its mass: .02 of it
    np.testing.assert_allclose(np.cumsum(held) - 0.5 * held, middle, atol=0.1 * held.max())
    wide = {name: [np.median(sim.gas.h[abs(np.hypot(*sim.gas.pos.T) - at) < 0.1]) for at in (1.4, 2.0)]
            for name, sim in (("even", even), ("light", light))}  # fmt: skip
    assert wide["light"][1] == pytest.approx(wide["light"][0], rel=0.1) and wide["even"][1] > 2.0 * wide["even"][0]
    # SPH's Sigma is the table's, but for what a kernel of h = .08 takes from a gap of .25: h^2 / 2 Sigma''.
    np.testing.assert_allclose(light.gas.density[inside], disc.surface_density(r[inside]), rtol=0.2)


def test_the_same_resolution_everywhere_changes_no_bit(tmp_path):
    given = uneven(tmp_path, lambda r, sigma: np.full_like(r, 3.0))
    text = (tmp_path / "disc.txt").read_text().splitlines()
    (tmp_path / "disc.txt").write_text("\n".join(line.rpartition(" ")[0] for line in text))
    plain = Simulation(given)
    same = Simulation(uneven(tmp_path, lambda r, sigma: np.full_like(r, 3.0)))
    for key in ("pos", "vel", "mass", "density"):
        np.testing.assert_array_equal(getattr(same.gas, key), getattr(plain.gas, key))


def test_unequal_particles_turn_in_balance_settle_and_go_on(tmp_path):
    def given(relax):
        found = uneven(tmp_path, lambda r, sigma: 1.0 / sigma)
        found["initial"]["relax"] = relax
        return found

    sim = Simulation(given(0.0))
    disc, r = profile.radial(sim.scene), np.hypot(*sim.gas.pos.T)
    turning = (sim.gas.pos[:, 0] * sim.gas.vel[:, 1] - sim.gas.pos[:, 1] * sim.gas.vel[:, 0]) / r
    np.testing.assert_allclose(turning**2, 1.0 / r - disc.pressure_acceleration(r) * r, rtol=1e-9)
    settled = Simulation(given(1.0)).relaxed
    assert settled.after < 0.3 * settled.before  # .24, and edges fall at once
    assert_resumes(given(0.0), tmp_path / "half.h5", 0.02, 0.04)


def test_masses_beyond_what_sph_sums_are_refused(tmp_path):
    (message,) = problems(uneven(tmp_path, lambda r, sigma: np.where(r < 2.0, 1.0, 1e13)))
    assert 'the column "resolution" varies by a factor of 1e+13; expected a factor of at most 1e+12' in message


def test_previews_know_the_masses_of_a_resolution(tmp_path):
    given = uneven(tmp_path, lambda r, sigma: 1.0 / sigma)
    sim = Simulation(given)
    np.testing.assert_allclose(gas_at_start(sim.scene).h, sim.scene.gas.eta * (np.pi * 8.0 / 12_000) ** 0.5, rtol=1e-6)
    rows = dict(derived_rows(sim.scene))
    least, most = (float(text) for text in rows["particle mass of gas"].split(" to "))
    # Of rings, which are .05 wide in a gap of .25.
    assert least == pytest.approx(sim.gas.mass.min(), rel=0.1) and most == pytest.approx(sim.gas.mass.max(), rel=0.1)
    sim.operators.forces()
    path = tmp_path / "start.h5"
    write_snapshot(path, sim.scene, 0.0, sim.gas, None)
    given["initial"] = {"kind": "snapshot", "file": str(path)}
    middle = gas_at_start(load_scene(given)).h[1]  # with half of the particles within, in the gap
    assert middle == pytest.approx(sim.scene.gas.eta * (np.pi * 8.0 / 12_000) ** 0.5, rel=0.02)  # one ring in 40
