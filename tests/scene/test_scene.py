"""A scene is read right, or every fault of it is told with its place and the nearest right word."""

import math
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from astropy import constants
from astropy import units as u
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scenes import DISC, write

from discsim.physics.grains import epstein_stopping_time
from discsim.scene import Scene, SceneError, load_scene, tomltext
from discsim.scene.fields import models_in
from discsim.scene.tables import TABLES
from discsim.scene.units import UnitError, Units, parse_quantity

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


@pytest.mark.parametrize("kernel, eta", [("cubic", 2.0), ("quintic", 2.0), ("quintic-h", 6.0), ("wendland-c4", 2.0)])
def test_eta_follows_the_kernel(kernel, eta):
    assert load_scene(changed(WAVE, gas={"kernel": kernel})).gas.eta == eta
    assert load_scene(changed(WAVE, gas={"kernel": kernel, "eta": 1.7})).gas.eta == 1.7


def test_the_kernel_of_a_disc(tmp_path):
    def gas(*overrides):
        found = load_scene(write(tmp_path, DISC), overrides).gas
        return found.kernel, found.eta

    assert gas() == ("quintic", 1.1)
    assert gas("gas.eta=1.2") == ("cubic", 1.2)
    assert gas("gas.kernel=cubic") == ("cubic", 1.345)
    assert gas("gas.smoothing_length=1 au")[0] == "cubic"


def test_drag_cell_defaults_to_h_in_1d_and_2h_in_2d(tmp_path):
    assert load_scene(WAVE).drag.cell == 1.0
    assert load_scene(changed(WAVE, space={"dimensions": 2})).drag.cell == 2.0
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


# Faults, each with its place.


def assert_matches(messages, pattern):
    start, _, end = pattern.partition("*")
    assert any(m.startswith(start) and m.endswith(end.strip()) for m in messages), messages


FAULTS = [
    # (what to replace in DISC, by what, line, start of the message * its end)
    ("[self_gravity]", "[self_gravty]", 29, 'self_gravty: unknown table;* did you mean "self_gravity"?'),
    ("particles = 100_000", "partikles = 100_000", 16, 'gas.partikles: unknown key;* mean "particles"?'),
    ("particles = 100_000", "", 15, "gas.particles: missing (number of SPH particles)"),
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
    ('size = "260 au"', 'size = "150 au"', 8, "space.size: the grid is smaller than the disc*"),
    ("particles = 100_000", "particles = 0", 16, "gas.particles: 0 are no particles; expected*"),
    ("particles = 100_000", "particles = 1_000_000_000_000", 16, "gas.particles: 1000000000000 is absurd*"),
    ("particles = 100_000", "particles = 10.5", 16, "gas.particles: 10.5 is not a whole number"),
    ("particles = 100_000", 'kernel = "cubik"\nparticles=1', 16, 'gas.kernel: "cubik" is unknown* "cubic"?'),
    ('law = "epstein"', 'law = "epstien"', 32, 'drag.law: "epstien" is unknown* did you mean "epstein"?'),
    ('law = "epstein"', 'law = "epstein"\nscheme = "idc"', 33, 'drag.scheme: "idc" is unknown* "idic"?'),
    ('law = "epstein"', 'law = "epstein"\nstokes = 1', 33, "drag.stokes: goes with law *"),
    ('law = "epstein"', 'law = "constant"', 31, 'drag.K: missing; law "constant" needs it'),
    ('law = "epstein"', 'law = "epstein"\nheating = true', 33, "drag.heating: the gas is *"),
    ('law = "epstein"', 'law = "epstein"\nheating = "yes"', 33, 'drag.heating: "yes" is neither*'),
    ("cells = 512", "dimensions = true", 9, "space.dimensions: true is not a number*"),
    ('grain_size = "1 cm"', "", 22, 'dust.grain_size: missing; drag.law "epstein" needs it'),
    ('kind = "disc"', 'kind = "disk"', 11, 'initial.kind: "disk" is unknown* did you mean "disc"?'),
    ('kind = "disc"', "", 10, "initial.kind: missing; expected one of*"),
    ('kind = "disc"', 'kind = "disc"\noffset = 1', 12, 'initial.offset: unknown key* mean "dust.offset"?'),
    ('kind = "disc"', 'kind = "disc"\ntoomre_q = 2', 12, "initial.toomre_q: mass and toomre_q are there*"),
    ('mass = "0.1 Msun"', "", 10, "initial: the disc has no mass; expected exactly one*"),
    ('inner = "10 au"', 'inner = "0 au"', 13, 'initial.inner: "0 au" is not positive*'),
    ('inner = "10 au"', 'inner = "200 au"', 14, "initial.outer: the outer edge is not outside*"),
    ("cells = 512", 'boundary = "periodic"', 9, 'space.boundary: "periodic" does not go with a disc*'),
    ("cells = 512", "dimensions = 1", 9, "space.dimensions: 1 does not go with a disc; expected 2"),
    ("cells = 512", "dimensions = 3", 9, "space.dimensions: 3 is unknown; expected one of 1, 2"),
    ('softening = "1 au"', 'softening = "0 au"', 30, 'self_gravity.softening: "0 au" is not positive*'),
    ('softening = "1 au"', 'softening = "1 K"', 30, 'self_gravity.softening: "1.0 K" is not made of*'),
    ('length = "1 au"', 'length = "1 s"', 3, 'units.length: "1 s" is a time; expected a length*'),
    ('length = "1 au"', 'length = "-1 au"', 3, 'units.length: "-1 au" is not positive*'),
    ("[gas.viscosity]", "[gas.conductivity]", 21, "gas.conductivity: conducts heat, but the gas is*"),
    ("[gas.viscosity]", "[gas.viscosty]", 21, 'gas.viscosty: unknown key* did you mean "viscosity"?'),
    ('kind = "locally', 'gamma = 2\nkind = "locally', 18, 'gas.eos.gamma: unknown*; it goes with kind = "adiabatic"'),
    ("[gas.viscosity]", "[gas.viscosity]\nalpha = -1", 22, "gas.viscosity.alpha: -1 is out*at least 0"),
    ('title = "a disc"', "title = 3", 1, "title: 3 is not a text*"),
    ('until = "1060 yr"', 'until = "0 yr"', 6, 'run.until: "0 yr" is not positive*'),
    ("until =", "checkpoint_every = 10\nuntil =", 6, "run.checkpoint_every: 10 is not a wall-clock time*"),
    ("until =", 'snapshots = 3\nevery = "1 yr"\nuntil =', 7, "run.every: run.snapshots is there too*"),
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
    assert problems(tmp_path / "no.toml") == [
        f"{tmp_path / 'no.toml'}: there is no such file; expected a scene, a TOML file"
    ]
    assert problems(tmp_path) == [f"{tmp_path}: is a directory; expected a scene, a TOML file"]


RULES = [
    ({"dust": None}, "drag: there is drag, but no dust*"),
    ({"gas": None}, "drag: there is drag, but no gas*"),
    ({"gas": None, "dust": None, "drag": None}, "neither [gas] nor [dust]*"),
    ({"space": {"boundary": "open"}}, 'space.boundary: "open" does not go with a wave*'),
    ({"initial": {"kind": "shock"}}, 'space.boundary: "periodic" does not go with a shock*'),
    ({"initial": {"kind": "sheet"}, "space": {"boundary": None}}, 'space.boundary: "open" does not go*'),
    ({"initial": {"kind": "shock"}, "space": {"dimensions": 2}}, "space.dimensions: 2 does not go*"),
    ({"initial": {"direction": [0.5]}}, "initial.direction: [0.5] is not made of whole numbers"),
    ({"initial": {"direction": [0]}}, "initial.direction: all zeros*"),
    ({"initial": {"direction": [1, 1]}}, "initial.direction: [1, 1] has 2 entries; expected 1*"),
    ({"initial": {"wavenumber": 1.5}}, "initial.wavenumber: 1.5 is not a whole number"),
    ({"star": {"mass": 1}}, "star: a star needs two dimensions*"),
    ({"star": {"mass": 1}, "space": {"dimensions": 2, "size": 1}}, "star: a periodic space has no centre*"),
    ({"gas": {"eos": {"kind": "locally-isothermal", "aspect_ratio": 1}}}, "gas.eos.kind: H/r needs a star*"),
    ({"gas": {"eos": {"kind": "adiabatic", "gamma": 1.4}}}, "gas.eos: the gas has no temperature*"),
    ({"gas": {"eos": {"kind": "adiabatic", "gamma": 1}}}, "gas.eos.gamma: 1 is out of range*more than 1"),
    ({"gas": {"eos": 3}}, "gas.eos: 3 is not a table*"),
    ({"gas": {"eta": 1, "smoothing_length": 1}}, "gas.smoothing_length: gas.eta is there too*"),
    ({"dust": {"inner": 1}}, "dust.inner: a wave has no radius*"),
    ({"dust": {"grain_size": "1 cm"}}, 'dust.grain_size: "1 cm" is a text, but the scene is in code units*'),
    ({"units": {"length": "1 au"}}, "units.length: means nothing*"),
    ({"drag": {"law": "stokes-number", "K": None, "stokes": 1}}, "drag.law: t_stop = stokes / Omega needs*"),
    ({"drag": {"law": "stokes-over-density", "K": None, "stokes": 1}}, "drag.law: t_stop = (stokes / Omega)*"),
    ({"drag": {"law": "epstein", "K": 1, "stokes": 1}}, 'drag.stokes: goes with law "stokes-number" or "stokes-over*'),
    ({"drag": {"supersonic": True}}, 'drag.supersonic: law "constant" knows no speed*'),
    ({"drag": {"mean_free_column": 1}}, 'drag.mean_free_column: law "constant" has no use for it*'),
    (
        {"drag": {"law": "epstein-stokes", "K": None}, "dust": {"grain_size": 1, "grain_density": 1}},
        "drag.mean_free_column: missing; in code units*",
    ),
    ({"drag": {"law": "epstein-stokes", "K": None}}, 'dust.grain_size: missing; drag.law "epstein-stokes"*'),
    ({"drag": {"direction": "one-way", "heating": True}}, "drag.heating: one-way drag*"),
    ({"drag": {"cell": 1, "cell_length": 1}}, "drag.cell_length: drag.cell is there too*"),
    ({"drag": {"scheme": "lab14", "cell": 2}}, 'drag.cell: scheme "lab14" has no such drag cells*'),
    ({"drag": {"kernel": "double-hump"}}, 'drag.kernel: scheme "tsc" has no kernel of its own*'),
    ({"drag": {"scheme": "esph", "integration": "implicit"}}, 'drag.integration: scheme "esph" has an integration*'),
    (
        {"dust": None, "drag": None, "self_gravity": {"softening": 1, "sources": ["dust"]}},
        'self_gravity.sources: "dust" is to attract*',
    ),
    ({"self_gravity": {"softening": 1, "sources": ["gas", "gas"]}}, "self_gravity.sources: a source is*"),
    ({"self_gravity": {}}, 'self_gravity.softening: missing; kernel "plummer" needs it'),
    ({"self_gravity": {"kernel": "thin-disc"}}, 'self_gravity.thickness: missing; kernel "thin-disc" needs it'),
    ({"self_gravity": {"kernel": "thin"}}, 'self_gravity.kernel: "thin" is unknown;* mean "thin-disc"?'),
    ({"self_gravity": {"softening": 1, "thickness": 1}}, "self_gravity.thickness: nothing uses it*"),
    ({"self_gravity": {"kernel": "thin-disc", "thickness": 0}}, "self_gravity.thickness: 0 is not positive*"),
    ({"self_gravity": {"softning": 1}}, "self_gravity.softning: unknown key*"),
    ({"space": {"dimensions": 2, "size": [1, 0.3], "cells": 16}}, "space.cells: a periodic space of*"),
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
        (LAYER, {"space": {"boundary": "periodic"}}, 'space.boundary: "periodic" does not go with a settling*'),
        (LAYER, {"space": {"dimensions": 2}}, "space.dimensions: 2 does not go with a settling; expected 1"),
        (LAYER, {"initial": {"vertical_extent": 3}}, "space.size: half a side is 0.833 of initial.vertical_extent*"),
        (LAYER, {"external": None}, "external: missing; the layer's weight is -Omega^2 z*"),
        (LAYER, {"external": {"vertical_frequency": 0}}, "external.vertical_frequency: missing; the layer's weight*"),
        (LAYER, {"gas": {"eos": BLAST["gas"]["eos"]}}, 'gas.eos.kind: "adiabatic" does not go with a settling*'),
        (BLAST, {"gas": {"eos": LAYER["gas"]["eos"]}}, 'gas.eos.kind: "isothermal" does not go with a blast*'),
        (BLAST, {"gas": None, "dust": {"particles": 9, "ratio": 1}}, "initial.kind: a blast needs a table [gas]"),
        (BLAST, {"space": {"dimensions": 1}}, "space.dimensions: 1 does not go with a blast; expected 2"),
        (BLAST, {"initial": {"radius": None}}, "initial.radius: missing (within which it is put)*"),
        (BLAST, {"initial": {"radius": 0.6}}, "space.size: half a side is 0.833 of initial.radius*"),
        (VORTEX, {"space": {"boundary": "open"}}, 'space.boundary: "open" does not go with a vortex*'),
        (VORTEX, {"initial": {"radius": 0.3}}, "space.size: half a side is 0.833 of 2 initial.radius*"),
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
    assert_matches(problems(path, without=["star", "self_gravity"]), f"{path}:11: initial.kind: nothing holds*")
    assert_matches(problems(path, ["space.cells=4"]), "--set space.cells=4: space.cells: self-gravity*")
    small = problems(path, ["initial.toomre_q=2"], ["star"])
    assert_matches(small, "--set initial.toomre_q=2: initial.toomre_q: Q = c_s kappa*")


# Positions in TOML.

KEYS = st.sampled_from(["a", "b-c", "1", '"x.y"', "'q # '", '"\\""'])
PLAIN = ("1", "-1.5e3", "true", "nan", '"a # ] } , b"', "'\\'", '"\\\\"', "1979-05-27 07:32:00Z", '""', "''")
# Strings over several lines that look like something else, or end in quotes of their own.
LONG = ('"""x\n[a]\n\\"""" z"""', "'''\nq = 1\n'''", '"""a"""""', "'''a''''", '""""a" """', "''''a''''")
SCALARS = st.sampled_from((*PLAIN, *LONG))
BREAKS = st.sampled_from(["", " ", "\n", " # note ]\n", "\n\n\t"])


@st.composite
def values(draw, depth=2):
    """A value and nothing else, on one line or several."""
    kind = draw(st.sampled_from(["scalar", "scalar", "array", "inline"])) if depth else "scalar"
    if kind == "scalar":
        return draw(SCALARS)
    if kind == "array":
        entries = draw(st.lists(values(depth=depth - 1), max_size=3))
        return "[" + ",".join(draw(BREAKS) + entry + draw(BREAKS) for entry in entries) + draw(BREAKS) + "]"
    keys = draw(st.lists(KEYS, max_size=3, unique=True))
    return "{" + ", ".join(f"{key} = {draw(values(depth=depth - 1))}" for key in keys) + "}"


@st.composite
def documents(draw):
    lines = []
    for table in range(draw(st.integers(0, 4))):
        if table:
            name = draw(st.sampled_from(["t", "t.u", "t . 'v'", "w"])) + draw(st.sampled_from(["", f".n{table}"]))
            many = draw(st.booleans())
            lines.append(
                draw(BREAKS) + (f"[[{name}]]" if many else f"[{name}]") + draw(st.sampled_from(["", " # [x]"]))
            )
        for key in draw(st.lists(KEYS, max_size=3, unique=True)):
            dotted = draw(st.sampled_from([key, f"{key} . d", f"{key}.d.e"]))
            lines.append(f"{draw(BREAKS)}{dotted} = {draw(values())}{draw(st.sampled_from(['', ' # x = 1']))}")
    return "\n".join(lines) + draw(BREAKS)


def paths(value, path=()):
    if path:
        yield path
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield from paths(entry, (*path, key))


@given(documents())
def test_positions_know_every_path_that_tomllib_reads(text):
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return  # tables defined twice: another test's matter
    found = tomltext.positions(text)
    assert set(found) == set(paths(data))
    assert all(1 <= line <= text.count("\n") + 1 for line in found.values())


@given(st.lists(st.tuples(values(), BREAKS), min_size=1, max_size=6))
def test_positions_count_lines(entries):
    """Every key is on the line where its name stands: found by looking for it."""
    text = "".join(f"{space}\nkey-{i} = {value}\n" for i, (value, space) in enumerate(entries))
    found = tomltext.positions(text)
    for i in range(len(entries)):
        assert text.split("\n")[found[(f"key-{i}",)] - 1].startswith(f"key-{i} =")


@given(documents(), st.sampled_from([["t", "u", "z"], ["w", "z"], ["z"]]))
def test_edited_text_reads_as_the_edited_data(text, path):
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    if "nan" in text:
        return  # it does not equal itself
    try:
        tomltext.with_value(data, path, "new")
    except KeyError:
        return
    assert tomllib.loads(tomltext.edited(text, data, [(path, "new")], [])) == data


# Units.


def test_code_time_makes_gravity_one():
    units = Units(length_text="5.2 au", mass_text="0.3 Msun")
    in_code = constants.G.to_value(units.length**3 / units.mass / units.time**2)
    assert in_code == pytest.approx(1, rel=1e-12)  # rounding
    assert units.cgs("velocity") == pytest.approx(units.cgs("length") / units.cgs("time"), rel=1e-12)
    assert units.cgs("energy") == pytest.approx(units.cgs("mass") * units.cgs("velocity") ** 2, rel=1e-12)


def test_density_is_of_the_surface_in_2d_and_of_the_volume_in_1d():
    assert Units(dimensions=2).density.physical_type == "surface mass density"
    assert Units(dimensions=1).density.physical_type == "mass density"


def test_code_system_has_no_units():
    units = Units("code")
    assert units.length is None and units.time is None and units.cgs("energy") == 1.0
    assert units.show_time(0.5) == "0.5"
    assert Units().show_time(2 * math.pi) == "1 yr"


DIMENSIONS = (
    ("length", "pc"),
    ("mass", "kg"),
    ("time", "Myr"),
    ("velocity", "km/s"),
    ("volume_density", "g / cm3"),
    ("surface_density", "kg m-2"),
    ("acceleration", "cm/s^2"),
    ("frequency", "1/yr"),
    ("energy", "erg"),
)


@given(st.floats(1e-30, 1e30), st.sampled_from(DIMENSIONS))
def test_parsed_texts_match_astropy(value, dimension):
    name, unit = dimension
    units = Units(length_text="3 pc", mass_text="7 Mearth")
    there = units.parse(f"{value!r} {unit}", name)
    back = units.quantity(there, name).to_value(unit)
    assert back == pytest.approx(value, rel=1e-12)  # rounding
    assert units.to_code(u.Quantity(value, unit)) == pytest.approx(there, rel=1e-12)


@given(st.text(max_size=20))
def test_any_text_is_a_quantity_or_a_unit_error(text):
    try:
        quantity = parse_quantity(text)
    except UnitError as error:
        assert str(error)
    else:
        assert math.isfinite(quantity.value)


def test_stopping_time_in_both_conventions():
    grain = (1 * u.cm, 3 * u.g / u.cm**3)
    gas = (1 * u.km / u.s, 1e-10 * u.g / u.cm**3)
    papers = epstein_stopping_time(*grain, *gas, "papers")
    assert papers.to_value(u.s) == pytest.approx(3e5, rel=1e-12)  # 3 / (1e5 1e-10) s
    kinetic = epstein_stopping_time(*grain, *gas, "kinetic")
    assert (kinetic / papers).to_value("") == pytest.approx(math.sqrt(math.pi / 8), rel=1e-12)


def test_scene_type_is_public():
    assert isinstance(load_scene(WAVE), Scene)
