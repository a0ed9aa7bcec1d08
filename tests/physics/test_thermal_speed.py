"""One thermal speed c_T = sqrt(P / rho) and one H = c_T / Omega, whatever the equation of state."""

import math

import numpy as np
import pytest
from growing import disc as growing_disc
from runs import put_out
from scenes import changed

from discsim import Simulation, load_scene, read_snapshot
from discsim.output.fields.gas import aspect_ratio, surface_density
from discsim.physics.given_disc import PrescribedDisc
from discsim.preview.derived import derived_rows, gas_at_start, stopping_times

SIZE, MATERIAL, DENSITY, SOUND = 0.02, 3.0, 2.0, 0.7
KINDS = {  # with c_T^2 at DENSITY
    "isothermal": ({"sound_speed": SOUND}, SOUND**2),
    "adiabatic": ({"gamma": 1.4, "sound_speed": SOUND}, SOUND**2 / 1.4),
    "polytropic": ({"gamma": 1.7, "constant": 0.3}, 0.3 * DENSITY**0.7),
}


def box(kind, scheme="tsc", convention="kinetic", slip=1e-5, **drag):
    """Gas at rest and dust with a slip far below the speed of sound, which heats nothing."""
    return {
        "units": {"system": "code"},
        "run": {"until": 0.05},
        "space": {"dimensions": 1, "size": 1.3, "boundary": "periodic"},
        "initial": {"kind": "box", "density": DENSITY, "dust_velocity": slip},
        "gas": {"particles": 40, "eos": {"kind": kind, **KINDS[kind][0]}},
        "dust": {"particles": 40, "ratio": 0.3, "grain_size": SIZE, "grain_density": MATERIAL},
        "drag": {"law": "epstein", "scheme": scheme, "convention": convention, **drag},
    }


def epstein(kind, convention="kinetic"):
    mean = math.sqrt(8 / math.pi) if convention == "kinetic" else 1.0
    return SIZE * MATERIAL / (DENSITY * mean * math.sqrt(KINDS[kind][1]))


@pytest.mark.parametrize("convention", ["papers", "kinetic"])
@pytest.mark.parametrize("kind", KINDS)
def test_epstein_drag_has_the_thermal_speed_of_the_gas(kind, convention):
    """s rho_s / (rho v), v of the molecules: in `check`, in a snapshot's column and in how the slip decays."""
    tables, expected = box(kind, convention=convention), epstein(kind, convention)
    scene = load_scene(tables)
    assert stopping_times(scene, gas_at_start(scene))[0] == pytest.approx(expected, rel=1e-12)
    sim = Simulation(tables)
    sim.run()
    with sim.synchronised() as state:
        found = sim.effects["drag"].columns(state)["dust"]["stopping_time"]
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # of an SPH density on an even line
    slip = sim.dust.vel[:, 0] - sim.gas.vel[:, 0]
    np.testing.assert_allclose(slip, 1e-5 * math.exp(-1.3 * sim.time / expected), rtol=1e-5)


@pytest.mark.parametrize("scheme", ["idic", "idic-linear", "mk", "lab14", "esph", "emsi-ppm", "sios-ppm"])
def test_every_scheme_has_that_thermal_speed(scheme):
    """To a per cent, of schemes that are of first order in the step or smooth over h."""
    tables, expected = box("adiabatic", scheme), epstein("adiabatic")
    tables["run"] = {"until": 0.02, "timestep": 2e-4}
    if not scheme.endswith("ppm"):
        tables["dust"]["offset"] = 0.5  # a pair at one place has no line of sight
    sim = Simulation(tables)
    sim.run()
    slip = (sim.dust.vel[:, 0] - sim.gas.vel[:, 0]).mean()
    assert math.log(1e-5 / slip) == pytest.approx(1.3 * sim.time / expected, rel=0.01)
    with sim.synchronised() as state:
        found = sim.effects["drag"].columns(state)["dust"]["stopping_time"]
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_supersonic_grains_compare_with_the_thermal_speed():
    """Kwok's factor sqrt(1 + (9 pi / 128) (w / c_T)^2), of adiabatic gas that nothing heats."""
    fast = 4.0
    sim = Simulation(box("adiabatic", slip=fast, supersonic=True, heating=False))
    sim.step(1e-9)
    with sim.synchronised() as state:
        found = sim.effects["drag"].columns(state)["dust"]["stopping_time"]
    quicker = math.sqrt(1 + 9 * math.pi / 128 * fast**2 / KINDS["adiabatic"][1])
    np.testing.assert_allclose(found, epstein("adiabatic") / quicker, rtol=1e-6)  # SPH's density


def disc(eos, **drag):
    return {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": 5.0},
        "initial": {"kind": "disc", "mass": 0.01, "inner": 0.7, "outer": 1.9},
        "gas": {"particles": 900, "eos": {"aspect_ratio": 0.08, "reference_radius": 1.3, **eos}},
        "dust": {"particles": 900, "ratio": 0.1, "grain_size": 1e-4, "grain_density": 30.0},
        "star": {"mass": 1.4},
        "drag": {"law": "epstein-stokes", "mean_free_column": 1e-8, **drag},
    }


ISOTHERMAL, ADIABATIC = {"kind": "locally-isothermal"}, {"kind": "adiabatic", "gamma": 5 / 3}


SLOW = pytest.mark.slow  # a scheme's kernels compile for each law, equation of state and direction


@pytest.mark.parametrize("scheme", ["tsc", *(pytest.param(name, marks=SLOW) for name in ("idic-linear", "isph"))])
def test_gas_of_one_temperature_stops_grains_alike(scheme):
    """Stokes' regime in a disc, adiabatic or not: the volume density has H = c_T / Omega, and Re the mean speed."""
    times = []
    for eos in ISOTHERMAL, ADIABATIC:
        sim = Simulation(disc(eos, scheme=scheme))
        with sim.synchronised() as state:
            columns = sim.effects["drag"].columns(state)["dust"]
        times.append(columns["stopping_time"][np.argsort(sim.dust.ids)])
    coupled = np.isfinite(times[0])
    assert coupled.mean() > 0.9
    np.testing.assert_allclose(times[1][coupled], times[0][coupled], rtol=1e-9)  # rounding of P and its root
    epstein_alone = Simulation(disc(ADIABATIC, law="epstein", mean_free_column=None, scheme=scheme))
    with epstein_alone.synchronised() as state:
        thin = epstein_alone.effects["drag"].columns(state)["dust"]["stopping_time"]
    assert np.median(times[0][coupled]) > 2.0 * np.median(thin)  # Stokes' regime


def test_previews_of_one_temperature_agree():
    """H/r, Stokes numbers and the drift at the start, of adiabatic gas as of isothermal."""
    rows = [dict(derived_rows(load_scene(disc(eos, supersonic=True)))) for eos in (ISOTHERMAL, ADIABATIC)]
    for name in "H/r", "Stokes number", "stopping time":
        assert rows[0][name] == rows[1][name]
    starts = [Simulation(disc(eos)).dust.vel for eos in (ISOTHERMAL, ADIABATIC)]
    np.testing.assert_allclose(starts[1], starts[0], rtol=1e-12)


def test_a_polytrope_has_the_height_of_its_temperature():
    """H = sqrt(P / Sigma) / Omega as a field of a snapshot has it, not sqrt(dP/dSigma) / Omega."""
    eos = {"kind": "polytropic", "gamma": 1.8, "constant": 0.2, "aspect_ratio": None, "reference_radius": None}
    tables = changed(disc({}), gas={"eos": eos})
    at = gas_at_start(load_scene(tables))
    np.testing.assert_allclose(at.scale_height, np.sqrt(0.2 * at.density**0.8 * at.radius**3 / 1.4), rtol=1e-12)
    np.testing.assert_allclose(at.sound_speed, np.sqrt(1.8 * 0.2 * at.density**0.8), rtol=1e-12)


@pytest.mark.parametrize("gamma", [1.3, 2.2])
def test_grains_in_a_given_polytrope_have_its_thermal_speed(gamma):
    """K Sigma^(gamma - 1) at every radius, also of a disc with a bump, from a table."""
    given = {"surface_density": 0.02, "surface_density_index": 0.8, "eos": {"kind": "polytropic", "gamma": gamma}}
    given["eos"]["constant"] = 0.1
    tables = changed(disc({}), gas=None, drag={"direction": "one-way"}, background=given)
    r = np.array([0.6, 1.1, 2.3])
    for more in {}, {"bump": {"radius": 1.0, "width": 0.2, "height": 0.7}}:
        found = PrescribedDisc(load_scene(changed(tables, background=more)))
        expected = np.sqrt(0.1 * found.surface_density(r) ** (gamma - 1))
        np.testing.assert_allclose(found.thermal_speed(r), expected, rtol=1e-12)
        np.testing.assert_allclose(found.sound_speed(r), math.sqrt(gamma) * expected, rtol=1e-12)


# Cells of idic that are to hold gas and dust are others with two-way drag.
@pytest.mark.parametrize(
    ("scheme", "near"),
    [("tsc", 1e-9), pytest.param("idic-linear", 1e-9, marks=SLOW), pytest.param("idic", 0.01, marks=SLOW)],
)
@pytest.mark.parametrize("eos", [ISOTHERMAL, ADIABATIC], ids=["isothermal", "adiabatic"])
def test_small_dust_that_gas_carries_stops_no_grains(eos, scheme, near):
    """As much small dust as gas, a part of the gas particles' mass or not: molecules alone drag, in Stokes' regime."""
    keys = {"aspect_ratio": 0.1, "reference_radius": 1.0, **eos}
    times = []
    for direction in "two-way", "one-way":
        drag = {"law": "epstein-stokes", "mean_free_column": 1e-9, "scheme": scheme, "direction": direction}
        sim = Simulation(changed(growing_disc(ratio=1.0, gas=400, dust=300, drag=drag), gas={"eos": keys}))
        with sim.synchronised() as state:
            columns = sim.effects["drag"].columns(state)["dust"]
        times.append(columns["stopping_time"][np.argsort(sim.dust.ids)])
    coupled = np.isfinite(times[0]) & np.isfinite(times[1])
    assert coupled.mean() > 0.8
    np.testing.assert_allclose(times[0][coupled], times[1][coupled], rtol=near)  # rounding of the share of gas


@pytest.mark.parametrize("direction", ["two-way", "one-way"])
@pytest.mark.parametrize("eos", [ISOTHERMAL, ADIABATIC], ids=["isothermal", "adiabatic"])
def test_small_dust_makes_no_gas_colder(tmp_path, eos, direction):
    """H/r of a map with as much small dust as gas is that of the start, .1 r^(1/4); small dust has no pressure."""
    keys = {"aspect_ratio": 0.1, "reference_radius": 1.0, **eos}
    tables = changed(growing_disc(ratio=1.0, direction=direction, gas=300, dust=300), gas={"eos": keys})
    sim = Simulation(tables)
    put_out(sim, tmp_path / "start.hdf5")
    snap = read_snapshot(tmp_path / "start.hdf5")
    np.testing.assert_allclose(aspect_ratio.values(snap) * snap.gas.radius**-0.25, 0.1, rtol=1e-9)
    mass = sim.gas.mass - (sim.gas.small if direction == "two-way" else 0.0)
    np.testing.assert_allclose(np.sort(surface_density.values(snap)), np.sort(mass), rtol=1e-12)
    np.testing.assert_allclose(snap.gas.small / snap.gas.mass, 0.5 if direction == "two-way" else 1.0, rtol=1e-9)
