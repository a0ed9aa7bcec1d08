"""Every fault of a scene is told with its place and the nearest right word."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import DISC, WAVE, assert_matches, changed, problems, write

from discsim.scene import SceneError, load_scene
from discsim.scene.fields import models_in
from discsim.scene.tables import TABLES

FAULTS = [
    # (what to replace in DISC, by what, line, start of the message * its end)
    ("[self_gravity]", "[self_gravty]", 29, 'self_gravty: unknown table;* did you mean "self_gravity"?'),
    ("particles = 100_000", "partikles = 100_000", 16, 'gas.partikles: unknown key;* mean "particles"?'),
    ("particles = 100_000", "", 15, "gas.particles: missing (number of SPH particles, or of cells of a polar grid)"),
    ('until = "1060 yr"', "", 5, 'run.until: missing * expected a time, like "100 yr"'),
    ('outer = "100 au"', 'outer = "100 Msun"', 14, 'initial.outer: "100 Msun" is a mass; expected a length*'),
    ('outer = "100 au"', "outer = 100", 14, 'initial.outer: 100 has no unit; a length needs a unit*'),
    ('outer = "100 au"', 'outer = "100"', 14, 'initial.outer: "100" has no unit*'),
    ('outer = "100 au"', 'outer = "100 aux"', 14, 'initial.outer: "100 aux": unknown unit "aux"* mean "au"?'),
    ('mass = "0.1 Msun"', 'mass = "-0.1 Msun"', 12, 'initial.mass: "-0.1 Msun" is not positive*'),
    ("ratio = 0.01", "ratio = -0.01", 24, "dust.ratio: -0.01 is not positive; expected more than 0"),
    ("ratio = 0.01", "ratio = nan", 24, "dust.ratio: nan is not a finite number"),
    ("ratio = 0.01", "ratio = true", 24, "dust.ratio: true is not a number*"),
    ("ratio = 0.01", 'ratio = "0.01"', 24, 'dust.ratio: "0.01" is not a number*'),
    ('size = "260 au"', 'size = "-260 au"', 8, 'space.size: "-260 au" is not positive*'),
    ('size = "260 au"', 'size = "inf au"', 8, 'space.size: "inf au" is not a finite number'),
    ('size = "260 au"', 'size = "150 au"', 8, "space.size: space is smaller than the disc*"),
    ("particles = 100_000", "particles = 0", 16, "gas.particles: 0 is too small; expected*"),
    ("particles = 100_000", "particles = 1_000_000_000_000", 16, "gas.particles: 1000000000000 is too large*"),
    ("particles = 100_000", "particles = 10.5", 16, "gas.particles: 10.5 is not a whole number"),
    ("particles = 100_000", 'kernel = "cubik"\nparticles=1', 16, 'gas.kernel: "cubik" is unknown* "cubic"?'),
    ('law = "epstein"', 'law = "epstien"', 32, 'drag.law: "epstien" is unknown* did you mean "epstein"?'),
    ('law = "epstein"', 'law = "epstein"\nscheme = "idc"', 33, 'drag.scheme: "idc" is unknown* "idic"?'),
    ('law = "epstein"', 'law = "epstein"\nstokes = 1', 33, "drag.stokes: used only with drag.law *"),
    ('law = "epstein"', 'law = "constant"', 31, 'drag.K: missing, but required by drag.law = "constant"'),
    ('law = "epstein"', 'law = "epstein"\nheating = true', 33, "drag.heating: gas with gas.eos.kind *"),
    ('law = "epstein"', 'law = "epstein"\nheating = "yes"', 33, 'drag.heating: "yes" is neither*'),
    ("cells = 512", "dimensions = true", 9, "space.dimensions: true is not a number*"),
    ('grain_size = "1 cm"', "", 22, 'dust.grain_size: missing, but required by drag.law = "epstein"'),
    ('kind = "disc"', 'kind = "disk"', 11, 'initial.kind: "disk" is unknown* did you mean "disc"?'),
    ('kind = "disc"', "", 10, "initial.kind: missing; expected one of*"),
    ('kind = "disc"', 'kind = "disc"\noffset = 1', 12, 'initial.offset: unknown key* mean "dust.offset"?'),
    ('kind = "disc"', 'kind = "disc"\ntoomre_q = 2', 12, "initial.toomre_q: mass and toomre_q are both given*"),
    ('mass = "0.1 Msun"', "", 10, "initial: no mass of the disc is given; give exactly one*"),
    ('inner = "10 au"', 'inner = "0 au"', 13, 'initial.inner: "0 au" is not positive*'),
    ('inner = "10 au"', 'inner = "200 au"', 14, "initial.outer: the outer edge is not larger*"),
    ("cells = 512", 'boundary = "periodic"', 9, 'space.boundary: "periodic" is not possible with initial.kind = '
                                                '"disc"*'),
    ("cells = 512", "dimensions = 1", 9, 'space.dimensions: 1 is not possible with initial.kind = "disc"; expected 2'),
    ("cells = 512", "dimensions = 3", 9, "space.dimensions: 3 is unknown; expected one of 1, 2"),
    ('softening = "1 au"', 'softening = "0 au"', 30, 'self_gravity.softening: "0 au" is not positive*'),
    ('softening = "1 au"', 'softening = "1 K"', 30, 'self_gravity.softening: "1.0 K" has a unit*'),
    ('length = "1 au"', 'length = "1 s"', 3, 'units.length: "1 s" is a time; expected a length*'),
    ('length = "1 au"', 'length = "-1 au"', 3, 'units.length: "-1 au" is not positive*'),
    (
        "[gas.viscosity]", '[gas.viscosity]\nswitch = "balsara"\npairs = "reconstructed"', 22,
        'gas.viscosity.switch: "balsara" removes viscosity from shear*keep switch or pairs',
    ),
    ("[gas.viscosity]", "[gas.conductivity]", 21, "gas.conductivity: conductivity needs an energy equation*"),
    ("[gas.viscosity]", "[gas.viscosty]", 21, 'gas.viscosty: unknown key* did you mean "viscosity"?'),
    ('kind = "locally', 'gamma = 2\nkind = "locally', 18, 'gas.eos.gamma: unknown*only with kind = "adiabatic"'),
    ("[gas.viscosity]", "[gas.viscosity]\nalpha = -1", 22, "gas.viscosity.alpha: -1 is out*at least 0"),
    ('title = "a disc"', "title = 3", 1, "title: 3 is not text*"),
    ('until = "1060 yr"', 'until = "0 yr"', 6, 'run.until: "0 yr" is not positive*'),
    ("until =", "checkpoint_every = 10\nuntil =", 6, "run.checkpoint_every: 10 is not a wall-clock time*"),
    ("until =", 'snapshots = 3\nevery = "1 yr"\nuntil =', 7, "run.every: run.snapshots is also given*"),
]  # fmt: skip


@pytest.mark.parametrize("old, new, line, message", FAULTS)
def test_fault_in_a_file(tmp_path, old, new, line, message):
    assert old in DISC
    path = write(tmp_path, DISC.replace(old, new, 1))
    assert_matches(problems(path), f"{path}:{line}: {message}")


def test_all_faults_together(tmp_path):
    text = DISC.replace("[star]", "[stars]").replace('"1 cm"', '"1 yr"').replace("0.05", "nan")
    path = write(tmp_path, text)
    found = problems(path)
    assert_matches(found, f'{path}:27: stars: unknown table* did you mean "star"?')
    assert_matches(found, f'{path}:25: dust.grain_size: "1 yr" is a time; expected a length, like "10 au"')
    assert_matches(found, f"{path}:19: gas.eos.aspect_ratio: nan is not a finite number")
    assert len(found) == 3  # the star that was meant is not missed by the drag as well


@pytest.mark.parametrize(
    "text, message",
    [
        ("", ":1: the scene is empty"),
        ("# nothing\n\n", ":1: the scene is empty"),
        ("[run]\nuntil = = 3\n", ":2: not valid TOML"),
        ("[run]\nuntil = 3\n[run]\n", ":3: not valid TOML"),
        ('[run]\nuntil = "3\n', ":2: not valid TOML"),
        ("[run]\nuntil", ":2: not valid TOML"),
        ("x = " + "[" * 100_000, ":1: not valid TOML"),
        ("x = " + "1" * 5000, ":1: not valid TOML"),
        (b"[run]\n\xff\n", ":2: byte 0xff at offset 6 is not UTF-8"),
        (b"PK\x03\x04\x00\x00\xfe", ":1: byte 0xfe at offset 6 is not UTF-8"),
    ],
)
def test_text_that_is_no_scene(tmp_path, text, message):
    path = write(tmp_path, text)
    (found,) = problems(path)
    assert found.startswith(f"{path}{message}")


def test_byte_order_mark_and_windows_lines_are_read(tmp_path):
    path = write(tmp_path, b"\xef\xbb\xbf" + DISC.replace("\n", "\r\n").encode())
    assert load_scene(path).title == "a disc"
    path = write(tmp_path, DISC.replace("ratio = 0.01", "ratio = 0").replace("\n", "\r\n"))
    assert_matches(problems(path), f"{path}:24: dust.ratio*")


def test_file_that_is_not_there(tmp_path):
    assert problems(tmp_path / "no.toml") == [f"{tmp_path / 'no.toml'}: file not found; give a scene file (TOML)"]
    assert problems(tmp_path) == [f"{tmp_path}: is a directory; give a scene file (TOML)"]


RULES = [
    ({"dust": None}, "drag: drag needs dust*"),
    ({"gas": None}, "drag: drag needs gas*"),
    ({"gas": None, "dust": None, "drag": None}, "there is neither [gas] nor [dust]*"),
    ({"space": {"boundary": "open"}}, 'space.boundary: "open" is not possible with initial.kind = "wave"*'),
    ({"initial": {"kind": "shock"}}, 'space.boundary: "periodic" is not possible with initial.kind = "shock"*'),
    ({"initial": {"kind": "sheet"}, "space": {"boundary": None}}, 'space.boundary: "open" is not possible*'),
    ({"initial": {"kind": "shock"}, "space": {"dimensions": 2}}, "space.dimensions: 2 is not possible*"),
    ({"initial": {"direction": [0.5]}}, "initial.direction: [0.5] is not a list of whole numbers"),
    ({"initial": {"direction": [0]}}, "initial.direction: there are 0 wavelengths*"),
    ({"initial": {"direction": [1, 1]}}, "initial.direction: [1, 1] has 2 values; expected 1*"),
    ({"initial": {"wavenumber": 1.5}}, "initial.wavenumber: 1.5 is not a whole number"),
    ({"star": {"mass": 1}}, "star: a star is possible only in two dimensions*"),
    ({"star": {"mass": 1}, "space": {"dimensions": 2, "size": 1}}, "star: a star is not possible in a periodic space*"),
    ({"gas": {"eos": {"kind": "locally-isothermal", "aspect_ratio": 1}}}, "gas.eos.kind: H/r needs a star*"),
    ({"gas": {"eos": {"kind": "adiabatic", "gamma": 1.4}}}, "gas.eos: no temperature at the start*"),
    ({"gas": {"eos": {"kind": "adiabatic", "gamma": 1}}}, "gas.eos.gamma: 1 is out of range*more than 1"),
    ({"gas": {"eos": 3}}, "gas.eos: 3 is not a table*"),
    ({"gas": {"eta": 1, "smoothing_length": 1}}, "gas.smoothing_length: gas.eta is also given*"),
    ({"dust": {"inner": 1}}, 'dust.inner: initial.kind = "wave" has no radius*'),
    ({"dust": {"grain_size": "1 cm"}}, 'dust.grain_size: "1 cm" is text, but the scene is in code units*'),
    ({"units": {"length": "1 au"}}, "units.length: not used with*"),
    ({"drag": {"law": "stokes-number", "K": None, "stokes": 1}}, "drag.law: t_stop = stokes / Omega needs*"),
    ({"drag": {"law": "stokes-over-density", "K": None, "stokes": 1}}, "drag.law: t_stop = (stokes / Omega)*"),
    ({"drag": {"law": "epstein", "K": 1, "stokes": 1}}, 'drag.stokes: used only with drag.law = "stokes-number" or '
                                                        '"stokes-over*'),
    ({"drag": {"supersonic": True}}, 'drag.supersonic: drag.law "constant" has no supersonic correction*'),
    ({"drag": {"mean_free_column": 1}}, 'drag.mean_free_column: not used with drag.law = "constant"*'),
    (
        {"drag": {"law": "epstein-stokes", "K": None}, "dust": {"grain_size": 1, "grain_density": 1}},
        'drag.mean_free_column: missing, but required by drag.law = "epstein-stokes" in code units*',
    ),
    ({"drag": {"law": "epstein-stokes", "K": None}}, 'dust.grain_size: missing, but required by drag.law*'),
    ({"drag": {"direction": "one-way", "heating": True}}, "drag.heating: one-way drag*"),
    ({"drag": {"cell": 1, "cell_length": 1}}, "drag.cell_length: drag.cell is also given*"),
    ({"drag": {"scheme": "lab14", "cell": 2}}, 'drag.cell: scheme "lab14" has no drag cells*'),
    ({"drag": {"kernel": "double-hump"}}, 'drag.kernel: scheme "tsc" has no drag kernel*'),
    ({"drag": {"scheme": "esph", "integration": "implicit"}}, 'drag.integration: scheme "esph" has a fixed time '
                                                              'integration*'),
    (
        {"dust": None, "drag": None, "self_gravity": {"softening": 1, "sources": ["dust"]}},
        'self_gravity.sources: "dust" is listed, but there is no*',
    ),
    ({"self_gravity": {"softening": 1, "sources": ["gas", "gas"]}}, "self_gravity.sources: a name occurs twice*"),
    ({"self_gravity": {}}, 'self_gravity.softening: missing, but required by*"plummer"; add a length'),
    ({"self_gravity": {"kernel": "thin-disc"}}, 'self_gravity.thickness: missing, but required by*'),
    ({"self_gravity": {"kernel": "thin"}}, 'self_gravity.kernel: "thin" is unknown;* mean "thin-disc"?'),
    ({"self_gravity": {"softening": 1, "thickness": 1}}, 'self_gravity.thickness: used only with*'),
    ({"self_gravity": {"kernel": "thin-disc", "thickness": 0}}, "self_gravity.thickness: 0 is not positive*"),
    ({"self_gravity": {"softning": 1}}, "self_gravity.softning: unknown key*"),
    ({"space": {"dimensions": 2, "size": [1, 0.3], "cells": 16}}, "space.cells: the sides of the periodic space*"),
    ({"space": {"dimensions": 2, "size": [1, 0.5]}}, "space.cells: missing*"),
]  # fmt: skip


@pytest.mark.parametrize("change, message", RULES)
def test_rule_between_tables(change, message):
    assert_matches(problems(changed(WAVE, **change)), f"scene: {message}")


LAYER = {
    "units": {"system": "code"},
    "run": {"until": 1},
    "space": {"dimensions": 1, "size": 5},
    "initial": {"kind": "settling"},
    "gas": {"particles": 100, "eos": {"kind": "isothermal", "sound_speed": 1}},
    "external": {"vertical_frequency": 1},
}
BLAST = {
    "units": {"system": "code"},
    "run": {"until": 1},
    "space": {"size": 1},
    "initial": {"kind": "blast", "radius": 0.1},
    "gas": {"particles": 100, "eos": {"kind": "adiabatic", "gamma": 1.4}},
}
VORTEX = changed(BLAST, space={"boundary": "periodic"}, initial={"kind": "vortex"})


@pytest.mark.parametrize(
    "scene, change, message",
    [
        (
            LAYER,
            {"space": {"boundary": "periodic"}},
            'space.boundary: "periodic" is not possible with initial.kind = "settling"*',
        ),
        (
            LAYER,
            {"space": {"dimensions": 2}},
            'space.dimensions: 2 is not possible with initial.kind = "settling"; expected 1',
        ),
        (
            LAYER,
            {"initial": {"vertical_extent": 3}},
            "space.size: the space is too small: half a side is 0.833 times initial.vertical_extent*",
        ),
        (LAYER, {"external": None}, "external: a settling layer needs vertical gravity*"),
        (
            LAYER,
            {"external": {"vertical_frequency": 0}},
            "external.vertical_frequency: a settling layer needs*",
        ),
        (
            LAYER,
            {"gas": {"eos": BLAST["gas"]["eos"]}},
            'gas.eos.kind: "adiabatic" is not possible with initial.kind = "settling"*',
        ),
        (
            BLAST,
            {"gas": {"eos": LAYER["gas"]["eos"]}},
            'gas.eos.kind: "isothermal" is not possible with initial.kind = "blast"*',
        ),
        (
            BLAST,
            {"gas": None, "dust": {"particles": 9, "ratio": 1}},
            'initial.kind: "blast" needs gas; add a table [gas]*',
        ),
        (
            BLAST,
            {"space": {"dimensions": 1}},
            'space.dimensions: 1 is not possible with initial.kind = "blast"; expected 2',
        ),
        (
            BLAST,
            {"initial": {"radius": None}},
            "initial.radius: missing (radius of the region that receives the energy)*",
        ),
        (
            BLAST,
            {"initial": {"radius": 0.6}},
            "space.size: the space is too small: half a side is 0.833 times initial.radius*",
        ),
        (
            VORTEX,
            {"space": {"boundary": "open"}},
            'space.boundary: "open" is not possible with initial.kind = "vortex"*',
        ),
        (
            VORTEX,
            {"initial": {"radius": 0.3}},
            "space.size: the space is too small: half a side is 0.833 times 2 initial.radius*",
        ),
    ],
)
def test_starts_name_what_they_need(scene, change, message):
    load_scene(scene)
    assert_matches(problems(changed(scene, **change)), f"scene: {message}")


@pytest.mark.parametrize("typo", ["runn", "spce", "inital", "gass", "dusty"])
def test_a_mistyped_table_is_one_fault(typo):
    right = {"runn": "run", "spce": "space", "inital": "initial", "gass": "gas", "dusty": "dust"}[typo]
    scene = {typo if name == right else name: table for name, table in WAVE.items()}
    if typo == "spce":  # the dimension is then unknown, as is the boundary
        scene["initial"] = {"kind": "wave"}
    (message,) = problems(scene)
    assert message.startswith(f"scene: {typo}: unknown table") and message.endswith(f'did you mean "{right}"?')


def test_a_mistyped_key_is_one_fault():
    assert len(problems(changed(WAVE, gas={"particles": None, "partikles": 600}))) == 1
    assert len(problems(changed(WAVE, gas={"particles": None, "colour": 600}))) == 2


JUNK = st.one_of(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    st.just(10**400) | st.sampled_from(["1 au", "-1 Msun", "nan yr", "1 mag", "1 degC", "epstein", "wave"]),
    st.lists(st.integers() | st.text(max_size=3), max_size=3),
    st.dictionaries(st.sampled_from(["kind", "mass", "x"]), st.integers() | st.text(max_size=3), max_size=2),
)


@settings(max_examples=200)
@given(st.sampled_from([WAVE, tomllib.loads(DISC)]), st.data(), JUNK)
def test_any_value_anywhere_gives_a_scene_or_a_scene_error(scene, data, junk):
    table = data.draw(st.sampled_from(sorted(scene)))
    models = models_in(TABLES.get(table))
    keys = sorted({key for model in models for key in model.model_fields})
    key = data.draw(st.sampled_from(["", *keys]))
    value = junk if not key or not isinstance(scene[table], dict) else {**scene[table], key: junk}
    try:
        load_scene({**scene, table: value})
    except SceneError as error:
        assert all(": " in problem for problem in error.problems)


def test_disc_without_a_centre_and_grid_too_small_for_gravity(tmp_path):
    path = write(tmp_path, DISC)
    assert_matches(
        problems(path, without=["star", "self_gravity"]), f"{path}:11: initial.kind: no gravity binds the disc*"
    )
    assert_matches(
        problems(path, ["space.cells=4"]), "--set space.cells=4: space.cells: there are too few cells for self-gravity*"
    )
    small = problems(path, ["initial.toomre_q=2"], ["star"])
    assert_matches(small, "--set initial.toomre_q=2: initial.toomre_q: Q = c_s kappa*")
