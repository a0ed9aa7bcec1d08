"""Discs that cannot turn in balance: refused where they are read, with the radius and the bound on H/r."""

import re

import growing
import numpy as np
import pytest
from typer.testing import CliRunner

from discsim import Simulation
from discsim.cli import app
from discsim.initial import support
from discsim.preview.warnings import warnings
from discsim.scene import SceneError, load_scene

MASS, REFERENCE = 0.7, 2.0
TAPERS = {"inner_taper": 0.5, "outer_taper": 0.6}


def eos(aspect, index=0.5):
    return {
        "kind": "locally-isothermal", "aspect_ratio": aspect, "temperature_index": index,
        "reference_radius": REFERENCE,
    }  # fmt: skip


def disc(aspect, index=0.5, initial=None, **tables):
    start = {"kind": "disc", "surface_density": 1e-3, "inner": 1.0, "outer": 3.0, "surface_density_index": 1.3}
    return {
        "units": {"system": "code"},
        "run": {"until": 1.0, "snapshots": 1},
        "space": {"size": 8.0},
        "star": {"mass": MASS},
        "initial": start | (initial or {}),
        "gas": {"particles": 1000, "eos": eos(aspect, index)},
    } | tables


def given(aspect, **background):
    """Dust in a given disc."""
    tables = disc(aspect) | {"dust": {"particles": 100, "ratio": 0.01}}
    tables["drag"] = {"law": "stokes-number", "stokes": 0.1, "direction": "one-way"}
    del tables["gas"]
    return tables | {"background": {"surface_density": 1.0, "eos": eos(aspect)} | background}


def refused(tables):
    with pytest.raises(SceneError) as caught:
        load_scene(tables)
    (line,) = str(caught.value).splitlines()
    return line


@pytest.mark.parametrize("index", [0.5, 1.0, -0.2])
def test_the_bound_of_a_power_law_is_told_where_it_is_reached(index):
    """v_phi^2 = v_K^2 (1 - (p + q) (H/r)^2), H/r ~ r^((1 - q) / 2): a bound of (p + q)^(-1/2) at the worst radius."""
    line = refused(disc(1.1, index))
    worst, slope = (3.0 if index < 1.0 else None), 1.3 + index
    found = re.search(r"gas.eos.aspect_ratio: H/r is ([\d.]+) at r = ([\d.]+), .* lower H/r below ([\d.]+) there", line)
    assert found, line
    aspect, radius, bound = map(float, found.groups())
    assert worst is None or radius == pytest.approx(worst, rel=2e-3)
    assert aspect == pytest.approx(1.1 * (radius / REFERENCE) ** (0.5 * (1.0 - index)), rel=5e-3)
    assert bound == pytest.approx(slope**-0.5, abs=0.011)
    at_reference = bound * (REFERENCE / radius) ** (0.5 * (1.0 - index))
    load_scene(disc(0.999 * at_reference, index))


@pytest.mark.parametrize(("direction", "small"), [("two-way", 0.17), ("one-way", 0.0)])
def test_pressure_pushes_gas_that_carries_small_dust_less(direction, small):
    """x = (p + q) (H/r)^2 over 1 + the ratio of small dust, which has no pressure and shares the gas's motion."""
    tables = growing.disc(ratio=0.4, growth={"small_ratio": 0.17}, direction=direction)
    tables["initial"]["surface_density_index"] = 1.2
    found = support.radial_support(load_scene(tables))
    # Rounding: of a power law the slope is exact.
    np.testing.assert_allclose(found.pressure_ratio, 1.7 * 0.01 * found.radius**0.5 / (1.0 + small), rtol=1e-12)


@pytest.mark.parametrize("aspect, taken", [(0.5, True), (0.9, False)])
def test_a_taper_lowers_the_bound(aspect, taken):
    """There Sigma falls over H: x = (p + q) h^2 + h, below 1 for h < .52 where p + q = 1.8; H/r ~ r^(1/4)."""
    if taken:
        load_scene(disc(0.9 * aspect, initial=TAPERS))
        return
    bound = float(re.search(r"lower H/r below ([\d.]+)", refused(disc(aspect, initial=TAPERS)))[1])
    assert 0.5 < bound < 0.56
    load_scene(disc(0.98 * bound * (REFERENCE / 3.0) ** 0.25, initial=TAPERS))


def test_every_start_in_balance_refuses_what_none_is(tmp_path):
    table = tmp_path / "disc.txt"
    r = np.linspace(1.0, 3.0, 40)
    np.savetxt(table, np.stack([r, 1e-3 / r], axis=1), header="r  Sigma")
    viscous = {"alpha_viscosity": {"alpha": 0.01}}
    starts = [
        {"kind": "table", "file": str(table), "reference_radius": REFERENCE},
        {"kind": "steady", "surface_density": 1e-3, "inner": 1.0, "outer": 3.0, "reference_radius": REFERENCE},
        {"kind": "viscous-ring", "radius": 2.0, "mass": 1e-3, "tau": 0.02},
    ]
    for start in starts:
        tables = disc(1.2) | ({} if start["kind"] == "table" else viscous)
        assert "no circular orbit exists; lower H/r below" in refused(tables | {"initial": start}), start
        load_scene(disc(0.1) | ({} if start["kind"] == "table" else viscous) | {"initial": start})


def test_sound_speeds_and_polytropes_are_named_as_they_are_given():
    isothermal = {"particles": 1000, "eos": {"kind": "isothermal", "sound_speed": 0.9}}
    assert refused(disc(0.1, gas=isothermal)).startswith("scene: gas.eos.sound_speed: H/r is")
    polytrope = {"particles": 1000, "eos": {"kind": "polytropic", "constant": 900.0, "gamma": 1.8}}
    assert refused(disc(0.1, gas=polytrope)).startswith("scene: gas.eos.constant: H/r is")


def test_a_given_disc_is_refused_anywhere():
    assert refused(given(1.0)).startswith("scene: background.eos.aspect_ratio: H/r is 1.1")
    line = refused(given(0.1, gap={"radius": 2.0, "width": 0.05, "depth": 0.99}))
    assert re.search(r"at r = (1\.9\d*),", line) and line.endswith("there, or widen background.gap")
    assert warnings(load_scene(given(0.1, gap={"radius": 2.0, "width": 0.4, "depth": 0.5}))) == []


def test_gas_that_turns_slowly_beside_a_gap_is_told():
    """x = h^2 times the slope of ln P, 39% beside it: v_phi = (1 - .39)^(1/2) = .78 of v_K, and r v_phi falls there."""
    slow, falls = warnings(load_scene(given(0.1, gap={"radius": 2.0, "width": 0.1, "depth": 0.9})))
    found = re.match(r"the gas rotates at ([\d.]+) times the Keplerian velocity at ([\d.]+), below 0.9", slow)
    x = np.linspace(1.5, 2.5, 200_001)
    density = x**-1.0 * (1 - 0.9 * np.exp(-0.5 * ((x - 2) / 0.1) ** 2))
    pressure = density * 0.01 * MASS / REFERENCE * (x / REFERENCE) ** -0.5
    push = -np.gradient(pressure, x) / density / (MASS / x**2)
    assert float(found[1]) == pytest.approx((1 - push.max()) ** 0.5, abs=0.01)
    assert float(found[2]) == pytest.approx(x[push.argmax()], rel=2e-3)
    assert falls.startswith("the angular momentum of the given gas falls outwards between")
    assert all("widen background.gap" in line for line in (slow, falls))


def test_unbound_grains_are_refused_or_told():
    free = disc(0.1) | {"dust": {"particles": 100, "ratio": 0.01}, "radiation_pressure": {"beta": 1.2}}
    del free["gas"]
    assert "radiation_pressure.beta: beta = 1.2 is at least 1, so grains have no circular orbit" in refused(free)
    load_scene(free | {"radiation_pressure": {"beta": 0.97}})
    (line,) = warnings(load_scene(given(0.05) | {"radiation_pressure": {"beta": 1.2}}))
    assert line.startswith("radiation_pressure.beta = 1.2: grains with beta >= 1 are unbound")
    orbit = {"dust": {"pos": [[1.0, 0.0]], "vel": [[0.0, 1.0]], "mass": [1e-6]}}
    Simulation({key: table for key, table in free.items() if key != "initial"}, particles=orbit)


def test_self_gravity_holds_what_the_star_does_not():
    """Pressure beyond the star's pull in a disc of 4 times its mass; in one of a tenth of it nothing turns."""
    heavy = disc(0.8, initial={"surface_density": None, "mass": 2.8}, self_gravity={"softening": 0.1})
    heavy["initial"].pop("surface_density")
    load_scene(heavy)
    light = disc(0.8, initial={"mass": 0.07}, self_gravity={"softening": 0.1})
    light["initial"].pop("surface_density")
    assert "no circular orbit exists" in refused(light)


def test_what_is_left_without_balance_is_refused_by_the_start():
    """A disc that its own gravity alone is to hold, and too hot for that."""
    tables = disc(0.1, gas={"particles": 1000, "eos": {"kind": "isothermal", "sound_speed": 1.3}})
    tables["initial"] = {"kind": "disc", "mass": 1.0, "inner": 0.5, "outer": 3.0, "surface_density_index": 1.0}
    tables |= {"self_gravity": {"softening": 0.1}}
    del tables["star"]
    scene = load_scene(tables)
    with pytest.raises(SceneError, match=r"of the gas mass has no circular orbit near r = "):
        Simulation(scene)


def test_check_and_run_refuse_with_the_line_and_write_nothing(tmp_path):
    path = tmp_path / "hot.toml"
    path.write_text(
        '[units]\nsystem = "code"\n[run]\nuntil = 1.0\n[space]\nsize = 8.0\n[star]\nmass = 0.7\n[initial]\n'
        'kind = "disc"\nsurface_density = 1e-3\ninner = 1.0\nouter = 3.0\n[gas]\nparticles = 1000\n[gas.eos]\n'
        'kind = "locally-isothermal"\naspect_ratio = 1.0\nreference_radius = 2.0\n'
    )
    for command in (["check", str(path)], ["run", str(path), "-o", str(tmp_path / "out")]):
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 2 and done.stderr.startswith(f"{path}:18: gas.eos.aspect_ratio: H/r is"), done.stderr
    assert not (tmp_path / "out").exists()


def test_cold_discs_are_far_from_the_bound():
    """x = (p + q) h^2 with p + q = 1.8 and H/r of .1 at radius 2, 1.5^(1/4) as much at 3."""
    found = support.radial_support(load_scene(disc(0.1)))
    assert found.pressure_ratio.max() == pytest.approx(1.8 * 0.01 * 1.5**0.5, rel=1e-3)
    assert found.mass_fraction.sum() == pytest.approx(1.0, rel=1e-12)
