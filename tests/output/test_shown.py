"""Output of an interactive session: names of the package, texts of objects, the last snapshot of a run, fields."""

import inspect

import numpy as np
import pytest
from astropy import units as u

import discsim
from discsim.numerics.state import Dust, Gas
from discsim.output.fields.display import display_options
from discsim.output.snapshot_writer import write_snapshot

COUNT, RADII = 900, (2.0, 5.0)  # au, of an even disc
SCENE = {
    "title": "A disc of 2 au",
    "run": {"until": "10 yr"},
    "space": {"size": "20 au"},
    "units": {"length": "2 au"},
    "initial": {"kind": "disc", "mass": "0.01 Msun", "inner": "2 au", "outer": "5 au"},
    "gas": {"particles": COUNT, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
    "dust": {"particles": COUNT, "ratio": 0.01},
    "star": {"mass": "1 Msun"},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Two snapshots of an even disc, in units of 2 au."""
    folder = tmp_path_factory.mktemp("shown") / "my"
    (folder / "snapshots").mkdir(parents=True)
    share = (np.arange(COUNT) + 0.5) / COUNT
    r = np.sqrt(RADII[0] ** 2 + (RADII[1] ** 2 - RADII[0] ** 2) * share) / 2.0
    phi, one, zero = np.arange(COUNT) * np.pi * (3.0 - np.sqrt(5.0)), np.ones(COUNT), np.zeros((COUNT, 2))
    arrays = {"pos": np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1), "vel": zero, "acc": zero}
    arrays |= {"ids": np.arange(COUNT)}
    state = {"h": 0.1 * one, "density": one, "gradh": one, "pressure": 1e-3 * one, "sound_speed": 0.03 * one}
    gas = Gas(mass=1e-5 * one, **arrays, **state)
    dust = Dust(mass=1e-7 * one, species=np.zeros(COUNT, int), **arrays)
    scene = discsim.load_scene(SCENE)
    for number, time in enumerate((0.0, 1.5)):
        write_snapshot(folder / "snapshots" / f"{number:04}.h5", scene, time, gas, dust)
    return folder


@pytest.fixture(scope="module")
def snap(run):
    return discsim.read_snapshot(run)


def test_the_package_lists_its_public_names():
    names = [name for name in dir(discsim) if not name.startswith("__")]
    assert names == sorted(discsim.__all__)
    assert {"Simulation", "Snapshot", "SnapshotError", "read_snapshot", "plot"} <= set(names)
    assert all(getattr(discsim, name) is not None for name in names)


@pytest.mark.parametrize("folder", ["", "snapshots"])
def test_the_last_snapshot_of_a_run_is_read(run, folder):
    assert discsim.read_snapshot(run / folder).time == 1.5
    assert discsim.read_snapshot(str(run / "snapshots/0000.h5")).time == 0.0


def test_a_folder_without_snapshots_is_refused(tmp_path):
    with pytest.raises(discsim.SnapshotError, match="no snapshots found; give the directory of a run"):
        discsim.read_snapshot(tmp_path)


def test_objects_print_what_notebooks_show(snap):
    """Short texts with the words of the tables, and no array."""
    few = {"gas": {**SCENE["gas"], "particles": 60}, "dust": {"particles": 20, "ratio": 0.1}}
    sim = discsim.Simulation(SCENE | few)
    for shown, words in (
        (sim, ("A disc of 2 au\n", "  step       0\n", "  dust       20\n")),
        (sim.scene, ("A disc of 2 au\n", "  until      10 yr\n")),
        (snap, ("A disc of 2 au\n", "  gas         900 particles: pos, vel, mass")),
    ):
        text = repr(shown)
        assert text == str(shown) and all(word in text for word in words), text
        assert all(f">{line.split()[0]}" in shown._repr_html_() for line in text.splitlines()[1:])
    for shown, words in (
        (sim.gas, ("Gas: 60 particles\n", "  pos          (60, 2)\n")),
        (snap.gas, ("900 particles\n", "  pos          (900, 2)  length\n", "  density      (900,)  density\n")),
    ):
        assert all(word in repr(shown) for word in words), repr(shown)
        assert len(repr(shown)) < 1000 and "<table>" in shown._repr_html_()


def test_fields_and_figures_take_the_same_arguments():
    of_field = [*inspect.signature(discsim.Snapshot.field).parameters][2:]
    assert set(of_field) - {"edges"} <= set(inspect.signature(display_options).parameters)
    assert {"window", "pixels", "distance", "wavelength", "opacity"} <= set(of_field)


def test_a_map_is_that_of_the_figure(snap):
    """Emission of thin dust; the window is a text, or lengths or corners as Quantities or in units of 2 au."""
    seen = {"pixels": 40, "wavelength": "0.9 mm", "opacity": 3.5 * u.cm**2 / u.g, "distance": "100 pc"}
    maps = [
        snap.field("emission", window, **seen)
        for window in (
            "4 au", "40 mas", "0 au, 0 au, 4 au", 4 * u.au, 0.04 * u.arcsec, [0, 0, 40] * u.mas,
            2, np.float32(2), [2.0], (0, 0, 2), ([-2.0, -2.0], [2.0, 2.0]), [[-4, -4], [4, 4]] * u.au,
        )
    ]  # fmt: skip
    ax = discsim.plot.field_map(snap, "emission", window="4 au", **seen)
    drawn = np.ma.filled(ax.images[0].get_array(), np.nan)
    assert maps[0].unit == "mJy/arcsec2" and maps[0].shape == (40, 40) and np.nanmax(maps[0].value) > 0.0
    for each in maps:
        np.testing.assert_allclose(each.value, maps[0].value, rtol=1e-9)
    np.testing.assert_allclose(drawn, maps[0].value.T, rtol=1e-9)
    # In the limit of long waves B = 2 k T nu^2 / c^2: half the frequency has a quarter, and half of that by kappa.
    long = [snap.field("emission", "4 au", pixels=9, wavelength=f"{length} m").value for length in (1.0, 2.0)]
    np.testing.assert_allclose(long[1], long[0] / 8.0, rtol=1e-4)


def test_a_profile_is_between_the_radii_of_its_window(snap):
    for window in ("3 au,5 au", [3, 5] * u.au, (1.5, 2.5), np.array([1.5, 2.5])):
        ax = discsim.plot.profile(snap, "gas.surface_density", window=window)
        np.testing.assert_allclose(ax.get_xlim(), (3.0, 5.0), rtol=1e-12)  # au


def test_rings_may_have_units(snap):
    """Edges in code units, of 2 au, or as a Quantity."""
    plain = snap.field("gas.surface_density", edges=[1.2, 1.6, 2.2])
    np.testing.assert_allclose(snap.field("gas.surface_density", edges=[2.4, 3.2, 4.4] * u.au).value, plain.value)
    even = COUNT * 1e-5 * u.Msun / (np.pi * (RADII[1] ** 2 - RADII[0] ** 2) * u.au**2)
    np.testing.assert_allclose(plain.to_value("Msun/au2"), even.value, rtol=0.01)  # a particle more or less of 150


@pytest.mark.parametrize(
    "given, words",
    [
        ({"window": "4 furlong"}, 'window: "4 furlong": unknown unit'),
        ({"window": "4"}, 'window: "4" has no unit; expected a length, like "10 au"'),
        ({"window": "40 mas"}, 'window: "40 mas" is an angle, but no distance is given; give a length'),
        ({"window": "1 au,4 au"}, "window: .* is a range of radii"),
        ({"window": ([1.0, 1.0], [0.0, 2.0])}, r"window: .*; expected text like \"50 au\", or corners"),
        ({"window": "4 au", "distance": "2 yr"}, 'distance: "2 yr"; expected a value above 0 with a unit like pc'),
        ({"window": "4 au", "wavelength": "1.3"}, 'wavelength: "1.3" has no unit; expected a value above 0'),
        ({"window": "4 au", "opacity": -1 * u.cm**2 / u.g}, "opacity: .*; expected a value above 0"),
        (
            {"window": ["a", "b"]},
            r"window: \['a', 'b'\]; expected text like \"50 au\", a Quantity, or numbers in code",
        ),
        ({"window": [1 * u.au, 2 * u.au]}, 'window: .*; expected text like "50 au", a Quantity, or numbers in code'),
        ({"window": np.nan}, 'window: "nan" is out of range; expected 0, or absolute values from 1e-60 to'),
        ({"window": [[-np.inf, -1.0], [1.0, 1.0]]}, 'window: ".*" is out of range; expected 0, or absolute values'),
        ({"window": [np.nan, 1.0] * u.au}, 'window: ".*" is out of range; expected 0, or absolute values'),
        ({"window": "1e300 au"}, 'window: "1e300 au" is out of range; expected 0, or absolute values from 1e-60 to'),
        ({"window": -2}, 'window: "-2.0" is not a region of the disc; expected "R", "R1,R2" or "X,Y,R"'),
        ({"window": []}, "window: .* is not a region of the disc"),
        ({"window": np.zeros((2, 3))}, "window: .* is not a region of the plane"),
        ({"window": 5 * u.s}, 'window: "s" is a time; expected a length, like "10 au"'),
        (
            {"window": 40 * u.mas},
            'window: "40.0 mas" is an angle, but no distance is given; give a length, or add the distance',
        ),
        ({"edges": ["a"]}, r"edges: \['a'\]; expected numbers in code units, or a Quantity"),
        ({"edges": [30, 20, 10]}, r"edges: \[30, 20, 10\]; expected at least two increasing numbers"),
        ({"edges": [1.0, 1.0]}, "edges: .*; expected at least two increasing numbers"),
        ({"edges": [1.0, np.nan]}, "edges: .*; expected at least two increasing numbers"),
        ({"edges": [1.0]}, "edges: .*; expected at least two increasing numbers"),
        ({"edges": 2.0}, "edges: 2.0; expected at least two increasing numbers"),
        ({"edges": [-1.0, 2.0]}, "edges: .*; expected radii of 0 or more"),
        ({"edges": [1, 2] * u.s}, 'edges: "s" is a time; expected a length'),
        ({"pixels": 0}, "pixels: 0; expected a whole number from 1 to"),
        ({"pixels": np.int64(-3)}, "pixels: -3; expected a whole number from 1 to"),
        ({"pixels": 9.5}, "pixels: 9.5; expected a whole number from 1 to"),
        ({"pixels": True}, "pixels: True; expected a whole number from 1 to"),
        ({"distance": np.inf * u.pc}, 'distance: "inf pc" is out of range; expected 1e-60 to 1e\\+60 pc'),
        ({"distance": [1, 2] * u.pc}, "distance: .*; expected a value above 0 with a unit like pc"),
        ({"wavelength": np.nan * u.mm}, 'wavelength: "nan mm"; expected a value above 0'),
    ],
)
def test_a_wrong_argument_is_named(snap, given, words):
    """By its name in Python, without the dashes of the command line."""
    with pytest.raises(discsim.plot.PlotError, match=f"^{words}") as fault:
        snap.field("emission", **given)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    "limits", [(2, 1), "2,1", (1, 1), (0.0, np.inf), (np.nan, 1.0), 5, ("a", 2), [1, 2, 3], (0, 5e-324)]
)
def test_wrong_limits_are_named_as_in_python(snap, limits):
    with pytest.raises(discsim.plot.PlotError, match=r'^limits: ".*expected'):
        discsim.plot.field_map(snap, "toomre_q", limits=limits)
