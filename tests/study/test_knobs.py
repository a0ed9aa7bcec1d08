"""The knobs that a scene has, and the keys that their points set."""

from pathlib import Path

import pytest
from test_cost import WAVE

from discsim import load_scene
from discsim.parts import SCHEMES
from discsim.study.knobs import Knobs
from discsim.study.points import StudyError, Varied


def knobs_of(source, varied=(), keep=(), **more):
    def load(settings):
        return load_scene(source, [f"{key}={value}" for key, value in settings.items()])

    return Knobs(load, [Varied.from_text(text) for text in varied], keep, **more)


def point(knobs, **rungs):
    named = {knob.name.replace(" ", "_").replace(".", "_"): k for k, knob in enumerate(knobs.all)}
    out = [0] * len(knobs.all)
    for name, rung in rungs.items():
        out[named[name]] = rung
    return tuple(out)


def names(knobs):
    return [knob.name for knob in knobs.all]


@pytest.fixture(scope="module")
def twin():
    return knobs_of("setups/twin_twoway.toml")


@pytest.fixture(scope="module")
def wave():
    return knobs_of("setups/dusty_wave.toml")


def test_a_scene_has_the_knobs_of_what_it_has(twin, wave):
    both = ["drag.scheme", "gas.kernel", "gas.precision", "particles", "dust particles", "run.courant"]
    assert names(twin) == ["gas.method", *both, "space.cells", "drag.cell", "neighbours"]
    assert names(wave) == [*both, "drag.cell", "neighbours"]  # cells of drag in 1D are none of the grid's
    assert names(knobs_of("setups/gas_disc.toml")) == [
        "gas.method",
        "gas.kernel",
        "gas.precision",
        "particles",
        "run.courant",
        "neighbours",
    ]
    assert names(knobs_of("setups/star_dust.toml")) == ["particles", "run.courant"]


def test_schemes_are_those_of_the_registry_that_go_with_the_scene(twin):
    words = twin.all[1].words
    assert words[0] == "" and set(words[1:]) < set(SCHEMES)
    assert "idic-linear" in words and "emsi-ppm" not in words  # fluids on a 1D grid


def test_points_set_keys(twin, wave):
    assert twin.settings(point(twin)) == {}
    assert twin.settings(point(twin, particles=-2)) == {"gas.particles": "25000", "dust.particles": "25000"}
    found = twin.settings(point(twin, particles=-2, dust_particles=-2, run_courant=2, space_cells=-2))
    assert found["dust.particles"] == "12500" and found["space.cells"] == "256"
    assert float(found["run.courant"]) == pytest.approx(0.6 / 2**0.5, rel=1e-3)
    # A fixed smoothing length goes with the spacing, so that neighbours stay.
    coarse = wave.settings(point(wave, particles=-2))
    assert coarse == {"gas.particles": "300", "dust.particles": "300", "gas.smoothing_length": "0.02"}
    # In one dimension it is a whole number of them.
    assert wave.settings(point(wave, neighbours=2)) == {"gas.smoothing_length": "0.02"}
    together = wave.settings(point(wave, particles=-3, neighbours=-2))
    assert int(together["gas.particles"]) * float(together["gas.smoothing_length"]) == pytest.approx(3.0, rel=1e-6)


def test_a_kernel_brings_its_own_eta(twin):
    cubic = twin.all[2].words.index("cubic")
    assert twin.settings(point(twin, gas_kernel=cubic)) == {"gas.kernel": "cubic"}
    found = twin.settings(point(twin, gas_kernel=cubic, neighbours=2))
    assert float(found["gas.eta"]) == pytest.approx(1.25 * 1.345, rel=1e-3)


def test_what_does_not_go_together_is_no_point(twin):
    pairs = twin.all[1].words.index("mk")
    assert twin.settings(point(twin, drag_scheme=pairs)) == {"drag.scheme": "mk"}
    assert twin.settings(point(twin, drag_scheme=pairs, drag_cell=2)) is None  # no such cells


def test_the_method_of_the_gas_takes_its_own_keys_along():
    """Particles of quiet gas on a grid, and cells as particles."""
    for setup, word in (("ring_twoway", "grid"), ("planet_gap_grid", "sph")):
        knobs = knobs_of(f"setups/{setup}.toml")
        before = knobs.base.scene
        found = knobs.settings(point(knobs, gas_method=1, particles=-2))
        assert found["gas.particles"] == str(before.gas.particles // 2)
        gas = knobs.load(found).gas
        assert gas.method == word and gas.quiet is None and gas.grid is None
        assert gas.eos == before.gas.eos


def test_units_stay(tmp_path):
    path = tmp_path / "scene.toml"
    text = Path("setups/twin_twoway.toml").read_text()
    path.write_text(text.replace('direction = "two-way"', 'direction = "two-way"\ncell = "2 au"'))
    knobs = knobs_of(path)
    assert knobs.settings(point(knobs, drag_cell=2)) == {"drag.cell": '"1 au"'}


def test_populations_of_dust_go_together(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        WAVE.replace("[dust]", "[[dust]]").replace("[drag]", "[[dust]]\nparticles = 120\nratio = 0.1\n[drag]")
    )
    knobs = knobs_of(path)
    found = knobs.settings(point(knobs, dust_particles=-1))
    assert found == {"dust.0.particles": "42", "dust.1.particles": "85"}


def test_a_user_gives_and_keeps_knobs():
    knobs = knobs_of("setups/dusty_wave.toml", ["drag.integration=implicit"], ["drag.scheme", "particles"])
    assert names(knobs)[0] == "drag.integration" and not {"drag.scheme", "particles"} & set(names(knobs))
    assert knobs.settings(point(knobs, drag_integration=1)) == {"drag.integration": "implicit"}
    both = knobs_of("setups/dusty_wave.toml", ["drag.scheme=tsc,idic"])
    assert both.all[0].words == ("", "idic")  # the scene's own is no other value
    with pytest.raises(StudyError, match="all values equal the value of the scene"):
        knobs_of("setups/dusty_wave.toml", ["drag.scheme=tsc"])
    with pytest.raises(StudyError, match=r'did you mean "drag\.scheme"'):
        knobs_of("setups/dusty_wave.toml", keep=["drag.schem"])
    with pytest.raises(StudyError, match="no key is left"):
        knobs_of("setups/star_dust.toml", keep=["particles", "run.courant"])


def test_a_search_begins_with_few_particles(twin, wave):
    assert twin.settings(twin.start())["gas.particles"] == "3125"
    assert wave.settings(wave.start())["gas.particles"] == "75"
    few = knobs_of("setups/dusty_wave.toml", ["gas.particles=500"])  # particles are the user's
    assert few.start() == (0,) * len(few.all)
