"""A scene is read right, and changed as the command line asks."""

import math
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from astropy import units as u
from pydantic import ValidationError
from scenes import DISC, WAVE, assert_matches, changed, problems, write

from discsim.drag.width import in_lengths
from discsim.scene import Scene, load_scene

# What a scene becomes.


def test_disc_in_code_units(tmp_path):
    scene = load_scene(write(tmp_path, DISC))
    # G M_sun / au^3 gives one year as 2 pi code times, to the 2e-5 by which the sidereal year differs.
    year = 2 * math.pi
    assert scene.run.until == pytest.approx(1060 * year, rel=1e-4)
    assert (scene.initial.inner, scene.initial.outer, scene.space.size) == (10.0, 100.0, (260.0, 260.0))
    assert scene.star.mass == 1.0
    grain = (3 * u.g / u.cm**3).to_value(u.Msun / u.au**3)
    assert scene.dust[0].grain_density == pytest.approx(grain, rel=1e-12)
    assert scene.gas.viscosity.alpha == 1.0 and scene.gas.viscosity.beta == 2.0
    assert scene.external is None and scene.gas.conductivity is None
    assert scene.effects == ("gas", "gas.viscosity", "dust", "star", "self_gravity", "drag")
    assert scene.text == DISC


def test_scene_is_frozen():
    scene = load_scene(WAVE)
    with pytest.raises(ValidationError):
        scene.gas.particles = 3
    with pytest.raises(ValidationError):
        scene.gas = None


def test_text_of_a_dict_reads_as_the_same_scene(tmp_path):
    scene = load_scene(WAVE)
    again = load_scene(write(tmp_path, scene.text))
    assert again.model_dump(exclude={"text", "path", "units"}) == scene.model_dump(exclude={"text", "path", "units"})


def test_dict_may_hold_quantities_and_numpy_numbers(tmp_path):
    data = tomllib.loads(DISC)
    data["initial"]["outer"] = 100 * u.au
    data["space"]["size"] = np.array([260.0, 260.0]) * u.au
    data["gas"]["particles"] = np.int64(100_000)
    scene = load_scene(data)
    assert scene.initial.outer == 100.0 and scene.space.size == (260.0, 260.0)
    assert "100.0 AU" in scene.text


@pytest.mark.parametrize(
    "kernel, eta", [("cubic", 2.0), ("quintic", 2.0), ("quintic-h", 6.0), ("wendland-c2", 2.0), ("wendland-c4", 2.0)]
)
def test_eta_follows_the_kernel(kernel, eta):
    assert load_scene(changed(WAVE, gas={"kernel": kernel})).gas.eta == eta
    assert load_scene(changed(WAVE, gas={"kernel": kernel, "eta": 1.7})).gas.eta == 1.7


def test_the_kernel_of_a_disc(tmp_path):
    def gas(*overrides):
        found = load_scene(write(tmp_path, DISC), overrides).gas
        return found.kernel, found.eta

    assert gas() == ("wendland-c2", 1.7)
    assert gas("gas.eta=1.2") == ("cubic", 1.2)
    assert gas("gas.kernel=cubic") == ("cubic", 1.345)
    assert gas("gas.smoothing_length=1 au")[0] == "cubic"


def test_drag_cell_defaults_to_h_in_1d_and_2h_in_2d(tmp_path):
    assert in_lengths(load_scene(WAVE)) == 1.0
    assert in_lengths(load_scene(changed(WAVE, space={"dimensions": 2}))) == 2.0
    as_length = load_scene(write(tmp_path, DISC), ["drag.cell=3 au"]).drag
    assert (as_length.cell, as_length.cell_length) == (None, 3.0)


def test_heating_follows_the_gas():
    warm = {"particles": 600, "eos": {"kind": "adiabatic", "gamma": 1.4, "sound_speed": 1}}
    assert load_scene(WAVE).drag.heating is False
    assert load_scene(changed(WAVE, gas=warm)).drag.heating is True
    assert load_scene(changed(WAVE, gas=warm, drag={"direction": "one-way"})).drag.heating is False


def test_vectors_have_one_entry_a_dimension():
    assert load_scene(WAVE).initial.direction == (1.0,)
    flat = changed(WAVE, space={"dimensions": 2}, initial={"velocity": 3}, external={"dust": [0, 2]})
    scene = load_scene(flat)
    assert scene.initial.direction == (1.0, 0.0)
    assert scene.initial.velocity == (3.0, 0.0)
    assert scene.external.gas == (0.0, 0.0) and scene.external.dust == (0.0, 2.0)


def test_populations_of_dust_are_always_a_tuple(tmp_path):
    assert len(load_scene(WAVE).dust) == 1
    two = DISC.replace("[dust]", "[[dust]]") + '[[dust]]\nparticles = 5\nratio = 1\ngrain_size = "1 mm"\n'
    path = write(tmp_path, two + 'grain_density = "1 g/cm3"\n')
    assert [dust.particles for dust in load_scene(path).dust] == [200_000, 5]
    assert load_scene(path, ["dust.1.ratio=3"]).dust[1].ratio == 3.0
    assert '"dust" is a list' in problems(path, ["dust.ratio=3"])[0]
    (message,) = problems(path, ["dust.1.ratio=-3"])
    assert message.startswith("--set dust.1.ratio=-3: dust.1.ratio: -3 is not positive")


def test_polytropic_constant_has_the_unit_that_gamma_asks_for(tmp_path):
    eos = 'kind = "polytropic"\ngamma = 2\nconstant = "5 cm4 / (g s2)"\n'
    text = DISC.replace('kind = "locally-isothermal"\naspect_ratio = 0.05\nreference_radius = "10 au"\n', eos)
    scene = load_scene(write(tmp_path, text))
    units = scene.units
    # P = constant Sigma^2: in cgs and in code units the same pressure.
    sigma = 7.0
    pressure = scene.gas.eos.constant * sigma**2 * units.cgs("pressure")
    assert pressure == pytest.approx(5 * (sigma * units.cgs("surface_density")) ** 2, rel=1e-12)


def test_own_particles_need_no_initial_table():
    assert load_scene(changed(WAVE, initial=None), own_particles=True).initial is None
    assert "missing table [initial]" in problems(changed(WAVE, initial=None))[0]


def test_scene_imports_nothing_slow():
    slow = "{'numba', 'pyfftw', 'h5py', 'scipy', 'matplotlib', 'rich'}"
    code = f"import sys, discsim.cli, discsim.preview.check, discsim.scene; print({slow} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


# Changes from the command line.


def test_overrides_keep_the_comments(tmp_path):
    scene = load_scene(
        write(tmp_path, DISC),
        ["run.until=1 yr", 'gas.kernel="quintic"', "gas.particles=1e5"],
        ["dust", "drag"],
    )
    assert scene.run.until == pytest.approx(2 * math.pi, rel=1e-4)
    assert scene.gas.kernel == "quintic" and scene.dust is None and scene.drag is None
    assert "# line 3" in scene.text and "[drag]" not in scene.text
    assert load_scene(write(tmp_path, scene.text)).run == scene.run


def test_without_takes_a_table_inside_a_table(tmp_path):
    scene = load_scene(write(tmp_path, DISC), without=["gas.viscosity"])
    assert scene.gas.viscosity is None and "viscosity" not in scene.text


@pytest.mark.parametrize(
    "override, message",
    [
        ("drg.law=epstein", '--set drg.law=epstein: drg: unknown table; * did you mean "drag"?'),
        ("gas.kernl=cubic", '--set gas.kernl=cubic: gas.kernl: unknown key; * did you mean "kernel"?'),
        (
            "gas.kernel=cubik",
            '--set gas.kernel=cubik: gas.kernel: "cubik" is unknown; * did you mean "cubic"?',
        ),
        ("nonsense", "--set nonsense: not an assignment; expected table.key=value*"),
        ("gas.particles.x=3", "--set gas.particles.x=3: gas.particles is not a table"),
        ("run.until=nan", "--set run.until=nan: run.until: nan has no unit; a time needs a unit*"),
    ],
)
def test_wrong_override(tmp_path, override, message):
    assert_matches(problems(write(tmp_path, DISC), [override]), message)


def test_wrong_without(tmp_path):
    (message,) = problems(write(tmp_path, DISC), without=["self-gravity"])
    assert message.startswith("--without self-gravity: unknown table")
    assert message.endswith('did you mean "self_gravity"?')


def test_scene_type_is_public():
    assert isinstance(load_scene(WAVE), Scene)
