"""Scenes as text and as tables, written with changes, and what is wrong with them."""

import pytest

from discsim.scene import SceneError, load_scene

DISC = """\
title = "a disc"
[units]
length = "1 au"               # line 3
mass = "1 Msun"
[run]
until = "1060 yr"
[space]
size = "260 au"
cells = 512
[initial]
kind = "disc"
mass = "0.1 Msun"
inner = "10 au"
outer = "100 au"
[gas]
particles = 100_000
[gas.eos]
kind = "locally-isothermal"
aspect_ratio = 0.05
reference_radius = "10 au"
[gas.viscosity]               # artificial
[dust]
particles = 200_000
ratio = 0.01
grain_size = "1 cm"
grain_density = "3 g/cm3"
[star]
mass = "1 Msun"
[self_gravity]
softening = "1 au"
[drag]
law = "epstein"
"""


def write(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


WAVE = {
    "units": {"system": "code"},
    "run": {"until": 0.5},
    "space": {"dimensions": 1, "size": 1, "boundary": "periodic"},
    "initial": {"kind": "wave"},
    "gas": {"particles": 600, "eos": {"kind": "isothermal", "sound_speed": 1}},
    "dust": {"particles": 600, "ratio": 1},
    "drag": {"law": "constant", "K": 500},
}


def changed(scene, **tables):
    """A copy with keys of tables changed; None removes a key, and a table."""
    copy = {name: dict(table) for name, table in scene.items()}
    for name, table in tables.items():
        if table is None:
            copy.pop(name)
        else:
            copy[name] = {k: v for k, v in {**copy.get(name, {}), **table}.items() if v is not None}
    return copy


def problems(source, *arguments, **keywords):
    with pytest.raises(SceneError) as caught:
        load_scene(source, *arguments, **keywords)
    assert str(caught.value) == "\n".join(caught.value.problems)
    return caught.value.problems


def assert_matches(messages, pattern):
    start, _, end = pattern.partition("*")
    assert any(m.startswith(start) and m.endswith(end.strip()) for m in messages), messages
