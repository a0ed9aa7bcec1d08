"""Figures of runs: each kind is drawn from small snapshots, scales are shared, and faults are one message."""

import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from typer.testing import CliRunner

import discsim
import discsim.plot
from discsim.cli import app
from discsim.numerics.state import Dust, Gas
from discsim.output.drawing import number_text, round_number, set_log_ticks
from discsim.output.fields.base import PlotError
from discsim.output.fields.display import display_options
from discsim.output.snapshot import snapshot_files
from discsim.output.snapshot_writer import write_snapshot
from discsim.output.sources import select_snapshots
from discsim.plot.request import Request
from discsim.scene import load_scene

COUNT = 400
DISC = {
    "title": "A disc",
    "run": {"until": "10 yr"},
    "space": {"size": "20 au"},
    "initial": {"kind": "disc", "mass": "0.01 Msun", "inner": "1 au", "outer": "3 au"},
    "gas": {"particles": COUNT, "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.05}},
    "dust": {"particles": COUNT, "ratio": 0.01},
    "star": {"mass": "1 Msun"},
    "drag": {"law": "stokes-number", "stokes": 0.1},
}
TUBE = {
    "units": {"system": "code"},
    "run": {"until": 1.0},
    "space": {"dimensions": 1, "size": 1.0},
    "initial": {"kind": "shock"},
    "gas": {"particles": COUNT, "eos": {"kind": "adiabatic", "gamma": 1.4}},
}


def gas_at(pos, mass):
    n, one = len(pos), np.ones(len(pos))
    state = {"h": one, "density": 2.0 * one, "gradh": one, "pressure": one, "sound_speed": one}
    return Gas(pos=pos, vel=0.1 * pos, acc=0 * pos, mass=mass * one, ids=np.arange(n), **state)


def write_run(directory, times=(0.0, 1.0, 2.0), heavier=1.0):
    """An even disc whose dust shrinks in time to 1 / (1 + t / 10) in radius."""
    (directory / "snapshots").mkdir(parents=True)
    r = np.sqrt(1.0 + 8.0 * (np.arange(COUNT) + 0.5) / COUNT)
    phi = np.arange(COUNT) * np.pi * (3.0 - np.sqrt(5.0))
    pos = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)
    for number, time in enumerate(times):
        at = pos / (1.0 + 0.1 * time)
        mass, species = np.full(COUNT, heavier * 1e-7), np.zeros(COUNT, int)
        dust = Dust(pos=at, vel=-0.1 * at, acc=0 * at, mass=mass, ids=np.arange(COUNT), species=species)
        extra = {"dust": {"stokes": np.full(COUNT, 0.1), "stopping_time": np.ones(COUNT)}}
        write_snapshot(
            directory / "snapshots" / f"{number:04}.h5", load_scene(DISC), time, gas_at(pos, 1e-5), dust, extra
        )
    return directory


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("runs") / "one")


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("runs") / "two", heavier=3.0)


@pytest.fixture(scope="module")
def tube(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "tube" / "snapshots"
    folder.mkdir(parents=True)
    x = np.linspace(-0.5, 0.5, COUNT)[:, None]
    for number in range(2):
        gas = gas_at(x, 1.0 / COUNT)
        gas.u = np.ones(COUNT)
        write_snapshot(folder / f"{number:04}.h5", load_scene(TUBE), 0.5 * number, gas, None)
    return folder.parent


def command(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def labels(figure):
    return {axes.get_ylabel() for axes in figure.findobj(lambda a: hasattr(a, "get_ylabel"))}


def images(figure):
    return [image for axes in figure.axes for image in axes.images]


def test_maps_share_their_colours(run, other):
    figure = Request([run, other]).figure()
    gas, _, dust, heavy = images(figure)
    assert dust.norm.vmin == heavy.norm.vmin and dust.norm.vmax == heavy.norm.vmax
    assert gas.norm.vmax > dust.norm.vmax
    assert np.nanmax(heavy.get_array()) == pytest.approx(3.0 * np.nanmax(dust.get_array()))
    assert {r"$\Sigma_\mathrm{gas}$ [g cm$^{-2}$]", r"$\Sigma_\mathrm{dust}$ [g cm$^{-2}$]", "y [au]"} <= labels(figure)
    texts = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert texts == {"1 au"}  # a quarter of 6.6 au at most
    assert figure.get_suptitle() == f"t = {discsim.read_snapshot(snapshot_files(run)[-1]).units.show(2.0, 'time')}"


def test_the_other_run_over_the_first(run, other):
    figure = Request([run, other], ["dust.surface_density"], compare=True).figure()
    ratio = images(figure)[2].get_array()
    assert ratio.count() > 1000
    np.testing.assert_allclose(ratio.compressed(), 3.0, rtol=1e-9)
    figure = Request([run, other], ["gas.v_r"], compare=True).figure()
    difference = images(figure)[2].get_array()
    assert not difference.compressed().any() and difference.count() > 1000


def test_profiles_are_of_the_times_that_are_asked_for(run):
    units = discsim.read_snapshot(snapshot_files(run)[0]).units
    texts = [units.show(time, "time") for time in (1.0, 2.0)]
    assert [each.path.stem for each in select_snapshots([run], texts)] == ["0001", "0002"]
    figure = Request([run], ["dust.surface_density"], "profile", texts).figure()
    (axes,) = figure.axes
    assert [line.get_label() for line in axes.lines] == [f"t = {text}" for text in texts]
    ends = [line.get_xdata()[np.isfinite(line.get_ydata())][-1] for line in axes.lines]
    # The edge of the dust is at 3 / 1.1 and 3 / 1.2; Gaussians of three fifths of .25 reach .5 beyond.
    assert ends[1] < ends[0] < 3.0 / 1.1 + 0.6
    middle = axes.lines[0].get_ydata()[np.argmin(np.abs(axes.lines[0].get_xdata() - 1.8))]
    expected = units.quantity(COUNT * 1e-7 * 1.1**2 / (8 * np.pi), "surface_density").to_value("g/cm2")
    assert middle == pytest.approx(expected, rel=0.03)


def test_fields_in_time_and_angle(run):
    (axes, *_) = Request([run], ["dust.surface_density"], "time").figure().axes
    (mesh,) = axes.collections
    assert mesh.get_array().shape == (3, 240)
    year = discsim.read_snapshot(snapshot_files(run)[0]).quantity("time").unit.to("yr")
    assert axes.get_ylim() == pytest.approx((0.0, 2.0 * year))
    figure = Request([run], ["gas.v_r"], "polar").figure()
    (image,) = images(figure)
    radial = np.nanmean(image.get_array(), axis=1)  # v_r = .1 r
    assert np.all(np.diff(radial[np.isfinite(radial)][20:-20:20]) > 0)


def test_particles_over_two_fields(run):
    figure = Request([run], ["gas.v_r"], "phase", against="radius").figure()
    (axes, *_) = figure.axes
    share = axes.collections[0].get_array()
    assert share.compressed().sum() == pytest.approx(1.0, abs=0.01)  # but two thousandths at each end
    done = command("plot", run, "--field", "surface_density", "--against", "radius")
    assert done.exit_code == 2 and "not a particle field" in done.stderr


def test_one_dimension(tube):
    figure = Request([tube]).figure()
    first, second = figure.axes
    assert first.get_ylabel() == r"$\rho_\mathrm{gas}$" and second.get_ylabel() == r"$v_{x,\mathrm{gas}}$"
    assert np.all(first.lines[0].get_ydata() == 2.0)  # the density that the snapshot holds
    (axes, *_) = Request([tube], ["gas.surface_density"], "time").figure().axes
    values = axes.collections[0].get_array()
    # 400 particles of 1/400 over a length of 1, but for the bins about its ends, in each of which are one or two.
    np.testing.assert_allclose(values[:, 20:-20], 1.0, rtol=0.1)
    assert values[:, 20:-20].mean() == pytest.approx(1.0, rel=0.01)


def test_angles_and_flux(run):
    display = display_options(distance="100 pc", wavelength="1.3 mm", opacity="2 cm2/g")
    figure = Request([run], ["emission"], display=display).figure()
    assert figure.axes[0].get_xlabel() == "x [arcsec]"
    left, right = figure.axes[0].get_xlim()
    assert right - left == pytest.approx(0.066, rel=0.01)  # 6.6 au at 100 pc
    title = " ".join(figure.get_suptitle().split())
    assert r"$\kappa$ = 2 cm$^2$ per g of dust" in title and "at 100 pc, F = " in title and "mJy" in title


def test_python_draws_onto_axes_that_it_gives_back(run, tube):
    axes = Figure().subplots()
    assert discsim.plot.field_map(run, "dust.stokes", ax=axes, limits="0.01,1") is axes
    assert axes.images[0].norm.vmin == 0.01 and axes.images[0].norm.vmax == 1.0
    snap = discsim.read_snapshot(snapshot_files(run)[0])
    lines = discsim.plot.profile(snap, "v_r", ax=Figure().subplots()).lines
    assert [line.get_label() for line in lines if line.get_label()[0] != "_"] == ["gas", "dust"]
    assert discsim.plot.polar_map(snap, "gas.h", ax=Figure().subplots()).images
    assert discsim.plot.phase(snap, ax=Figure().subplots()).collections
    assert discsim.plot.time_map(tube, "gas.v_x", ax=Figure().subplots()).collections
    assert ("gas.toomre_q", "", "Toomre's Q: Q = c_s Omega_K / (pi G Sigma)") in discsim.plot.fields()


def test_a_film_has_a_frame_for_each_snapshot(run, tmp_path):
    path = discsim.plot.movie(run, tmp_path / "film" / "a.gif", "dust.surface_density", window="4 au")
    with Image.open(path) as film:
        assert film.n_frames == 3
        frames = []
        for number in range(3):
            film.seek(number)
            frames.append(np.asarray(film.convert("RGB")).astype(int))
    assert np.abs(frames[0] - frames[2]).max() > 50
    # The colour bar, below the single map, is that of all.
    bar = [frame[int(0.87 * len(frame)) :] for frame in frames]
    assert np.ptp(bar[0]) > 200
    assert np.array_equal(bar[0], bar[1]) and np.array_equal(bar[0], bar[2])
    done = command("movie", tmp_path, "-o", tmp_path / "b.gif")
    assert done.exit_code == 2 and "no snapshots found" in done.stderr and not (tmp_path / "b.gif").exists()


def test_the_command_writes_into_the_run(run, other, tmp_path):
    done = command("plot", run, "--compare", other, "--field", "dust_to_gas")
    assert done.exit_code == 0, done.stderr
    path = run / "plots" / "dust_to_gas-compared.png"
    assert done.stdout.split() == [str(path)] and path.read_bytes().startswith(b"\x89PNG")
    done = command("plot", run / "snapshots" / "0001.h5", "--profile", "-o", tmp_path / "a.pdf")
    assert done.exit_code == 0 and (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    assert "gas.toomre_q" in command("plot", "--fields").stdout


@pytest.mark.parametrize(
    "arguments, words",
    [
        ([], "no run to draw; give the directory of a run, or a snapshot"),
        (["RUN", "--field", "toomreq"], 'did you mean "gas.toomre_q"?'),
        (["RUN", "--field", "dust.size"], "the grains have one size"),
        (["TUBE", "--field", "temperature"], "in code units, where gas has no temperature"),
        (["TUBE", "--polar"], "one dimension has no map"),
        (["RUN", "--polar", "--time"], "--polar and --time cannot be combined"),
        (["RUN", "--window", "3"], '--window: "3" has no unit'),
        (["RUN", "--window", "3 au,1 au", "--profile"], "R1 < R2"),
        (["TUBE", "--window", "nan"], '--window: "nan" is not a finite number; expected a length in code units'),
        (
            ["TUBE", "--profile", "--window=-inf,1"],
            '--window: "-inf" is not a finite number; expected a length in code units',
        ),
        (["RUN", "--window", "nan au"], '--window: "nan au" is not a finite number'),
        (
            ["RUN", "--window", "1e300 au"],
            '--window: "1e300 au" is out of range; expected 0, or absolute values from 1e-60 to',
        ),
        (["TUBE", "--at", "nan"], '--at: "nan" is not a finite number; expected a time in code units'),
        (["RUN", "--range", "1"], '--range: "1"; expected two numbers'),
        (["RUN", "--range", "2,1"], '--range: "2,1"; expected LOW below HIGH'),
        (["RUN", "--range", "0,inf"], '--range: "0,inf" is out of range; expected 0, or absolute values from 1e-60 to'),
        (
            ["RUN", "--profile", "--range", "1e-320,1"],
            '--range: "1e-320,1" is out of range; expected 0, or absolute values',
        ),
        (["RUN", "--at", "soon"], '--at: "soon" is not a quantity; expected a time, like "100 yr"'),
        (["RUN", "--at", "5"], '--at: "5" has no unit; expected a time, like "100 yr"'),
        (
            ["RUN", "--wavelength", "1.3"],
            '--wavelength: "1.3" has no unit; expected a value above 0 with a unit like mm',
        ),
        (["RUN", "--time", "--at", "1 yr"], "remove --at or --time"),
        (["RUN", "--distance", "140 yr"], "--distance: "),
        (["RUN", "--profile", "--distance", "140 pc"], "--distance: used only for maps"),
        (["RUN", "--opacity", "2 cm2/g"], "used only by the fields emission"),
        (["RUN", "--compare", "TUBE"], "different dimensions or units"),
        (["RUN", "--compare", "RUN", "--profile"], "used only for maps"),
        (["RUN/snapshots/0000.h5", "--time"], "needs at least two snapshots of each run"),
        (["RUN", "-o", "a.bmp"], "unknown figure format"),
        (["nothing"], "file not found"),
    ],
)
def test_faults_are_one_message(run, tube, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    given = [text.replace("RUN", str(run)).replace("TUBE", str(tube)) for text in arguments]
    done = command("plot", *given)
    assert done.exit_code == 2 and words in done.stderr
    assert done.stderr.count("\n") == 1 and done.stdout == "" and not list(tmp_path.iterdir())


def test_a_film_tells_of_its_frames_in_a_pipe_and_where_it_is(run, tmp_path):
    done = command("movie", run, "-o", tmp_path / "a.gif")
    assert done.exit_code == 0 and done.stdout == f"{tmp_path / 'a.gif'}\n"
    assert done.stderr.splitlines() == ["frame 1 of 3", "frame 3 of 3"]  # others come within the ten seconds


def test_films_without_their_library(run, tmp_path, monkeypatch):
    monkeypatch.setattr("discsim.plot.film.find_spec", lambda name: None)
    with pytest.raises(PlotError, match=r"mp4 needs imageio-ffmpeg.*pip install -e '[.]\[movie\]'"):
        discsim.plot.movie(run, tmp_path / "a.mp4")
    with pytest.raises(PlotError, match="unknown film format"):
        discsim.plot.movie(run, tmp_path / "a.avi")
    copy = shutil.copytree(run, tmp_path / "copy")
    done = command("movie", copy, "--field", "dust.surface_density", "--dpi", 40)
    assert done.exit_code == 0 and done.stdout == f"{copy / 'plots' / 'dust.surface_density-map.gif'}\n"
    assert done.stderr.splitlines()[-1].startswith(
        "the film is a gif: mp4 needs imageio-ffmpeg, which is not installed"
    )


def test_films_without_the_program_of_their_library(tmp_path, monkeypatch):
    def absent():
        raise RuntimeError("No ffmpeg exe could be found.")

    monkeypatch.setattr("discsim.plot.film.find_spec", lambda name: True)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", SimpleNamespace(get_ffmpeg_exe=absent))
    done = command("movie", tmp_path, "-o", tmp_path / "a.mp4")
    assert done.exit_code == 2 and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"{tmp_path / 'a.mp4'}: mp4 needs the program ffmpeg, which is not found; install it")


def test_importing_discsim_imports_no_matplotlib():
    code = (
        "import discsim, sys; assert 'matplotlib' not in sys.modules; discsim.plot; assert 'matplotlib' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_numbers_on_axes():
    assert [number_text(x) for x in (0.5, 0.0001, 200.0, 20000.0)] == ["0.5", "0.0001", "200", "20000"]
    assert number_text(2e-7) == r"$2\times10^{-7}$"
    assert [round_number(x) for x in (0.19, 1.0, 4.9, 75.0)] == [0.1, 1.0, 2.0, 50.0]


@pytest.mark.parametrize(
    "low, high, shown",
    [
        (0.02, 300.0, ["0.01", "0.1", "1", "10", "100", "1000"]),  # one beyond each end, which is not drawn
        (3.0, 60.0, ["1", "2", "5", "10", "20", "50", "100"]),
        (1e-7, 1.0, None),  # powers of ten, typeset
    ],
)
def test_logarithmic_axes_have_plain_numbers(low, high, shown):
    axes = Figure().add_subplot()
    axes.set(yscale="log", ylim=(low, high))
    set_log_ticks(axes.yaxis, low, high)
    texts = [label.get_text() for label in axes.get_yticklabels()]
    if shown is None:
        assert any("$" in text for text in texts)
    else:
        assert set(texts) <= set(shown) and set(shown[1:-1]) <= set(texts)
        assert not any(label.get_text() for label in axes.get_yticklabels(minor=True))
