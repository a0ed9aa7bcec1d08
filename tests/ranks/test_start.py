"""Ranks that have no particles of a start have the effects of the one that has made it."""

import pickle
import tomllib
from importlib.util import find_spec

import numpy as np
import pytest
from runs import DISC

from discsim.run.start import begin
from discsim.scene import load_scene
from setups import SETUPS

if find_spec("mpi4py") is None:
    pytest.skip("needs mpi4py: pip install -e '.[mpi]'", allow_module_level=True)

from discsim.ranks.start import begin_without_particles, shared_data

pytestmark = pytest.mark.ranks

FEW = ["gas.particles=300", "dust.particles=300"]


def plain(value):
    """What can be compared of an attribute: numbers, texts and arrays, however deep; of all else its type."""
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape, value.tobytes()
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [plain(entry) for entry in value]
    return value if isinstance(value, int | float | str | None) else type(value)


def known(effect):
    """Its attributes; of what is room for results (a leading underscore) nothing."""
    return {key: plain(value) for key, value in vars(effect).items() if not key.startswith("_")}


def few(path):
    text = path.read_text()
    tables = [setting for setting in FEW if f"[{setting.partition('.')[0]}]" in text]
    return load_scene(path, tables)


@pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.stem)
def test_effects_without_particles_know_the_same(path):
    assert_same_without_particles(few(path))


def test_what_the_particles_have_told_is_passed_on():
    """Damping, towards velocities that hang on the pull of the disc."""
    zones = {"damping": {"inner": [0.5, 0.7], "outer": [1.8, 2.0]}}
    assert_same_without_particles(load_scene(tomllib.loads(DISC) | zones))


def assert_same_without_particles(scene):
    one = begin(scene, to_restore=True)
    other = begin_without_particles(scene, pickle.loads(pickle.dumps(shared_data(one))))
    assert one.effects.keys() == other.effects.keys()
    for name, effect in one.effects.items():
        assert known(effect) == known(other.effects[name]), name
    for name, p in one.state.species.items():
        empty = other.state.species[name]
        assert empty.count == 0 and p.arrays().keys() == empty.arrays().keys()
        for key, array in p.arrays().items():
            assert array[:0].shape == getattr(empty, key).shape and array.dtype == getattr(empty, key).dtype
    assert one.state.subcycle_clock == other.state.subcycle_clock and one.state.time == other.state.time
    assert one.state.grid == other.state.grid
