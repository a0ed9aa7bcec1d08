"""A run as one object: snapshots by number and time, tables, profiles in time, while the run goes on."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
from astropy import units as u
from two_sizes import EDGES, TABLES, surface_density, write_two_sizes

import discsim
from discsim.output.fields.base import FieldError, PlotError
from discsim.output.history import COLUMNS, HistoryError
from discsim.output.snapshot import Snapshot

TIMES = 0.0, 3.0, 11.0


def write_history(directory, rows=3, tail=""):
    lines = [f"{7 * k},{1.5 * k},0.25,star," + ",".join(str(k + 0.5 * n) for n in range(15)) for k in range(rows)]
    (directory / "history.csv").write_text("\n".join([",".join(COLUMNS), *lines, tail]))


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    path = write_two_sizes(tmp_path_factory.mktemp("runs") / "my", TIMES)
    write_history(path)
    return path


@pytest.fixture
def run(directory):
    return discsim.open_run(directory)


def test_snapshots_by_number_by_slice_and_in_order(run):
    assert len(run) == 3 and isinstance(run[-1], Snapshot) and run[-1].time == 11.0
    assert [snap.time for snap in run] == [*TIMES]
    later = run[1:]
    assert len(later) == 2 and later[0].time == 3.0 and [*later.times.value] == [*run.times.value[1:]]
    with pytest.raises(IndexError, match=r"no snapshot 3; the run has 3"):
        run[3]


def test_times_have_units_and_the_nearest_snapshot_is_found(run):
    year = run.units.time.to("yr")
    np.testing.assert_allclose(run.times.to_value("yr"), np.array(TIMES) * year, rtol=1e-12)
    for snap, time in zip(run, run.times, strict=True):
        assert abs(snap.quantity("time") - time).to_value("yr") < 1e-12 and run.at(time).time == snap.time
    assert run.at(f"{6.9 * year} yr").time == 3.0 and run.at(7.1 * year * u.yr).time == 11.0 and run.at(1.4).time == 0.0
    for wrong, message in (
        ("soon", 'at: "soon"'), ("3 au", 'at: "3 au"'), (3 * u.au, "at: "), (None, "at: None is not a time"),
        (np.nan, "at: nan is not a time"), ([1, 2], "at: [1, 2] is not a time"),
    ):  # fmt: skip
        with pytest.raises(PlotError) as error:
            run.at(wrong)
        assert str(error.value).startswith(message)


def test_profile_in_time_is_the_surface_density_of_one_population(run):
    """Away from the edges by five widths of the smoothing, which is at most 3% of the range; rings of a spiral: 3%."""
    profile = run.profile("dust.pebbles.surface_density", window="10 au")
    assert profile.values.shape == (3, len(profile.radius)) and profile.time.shape == (3,)
    assert profile.radius[-1] < 10 * u.au < profile.radius[-1] * 1.01
    for k, time in enumerate(TIMES):
        inner, outer = 2 * u.au * np.array(EDGES[1]) / (1 + time / 20)
        middle = 0.5 * (inner + outer)
        values = profile.values[k][np.abs(profile.radius - middle) < 0.15 * (outer - inner)]
        expected = run.units.quantity(surface_density(1, time), "density")
        np.testing.assert_allclose((values / expected).to_value(""), 1.0, rtol=0.03)
    total = (profile.values * 2 * np.pi * profile.radius).sum(axis=1) * (profile.radius[1] - profile.radius[0])
    grams = run.units.quantity(run[0].dust.mass[run[0].dust.species == 1].sum(), "mass")
    np.testing.assert_allclose((total / grams).to_value(""), 1.0, rtol=1e-3)
    assert profile.label == r"$\Sigma_\mathrm{dust}$, pebbles, 5 cm [g cm$^{-2}$]"


def test_profile_is_a_table_of_pandas_with_units(run):
    profile = run.profile("dust.0.surface_density", window="9 au")
    frame = profile.to_pandas()
    assert (frame.index.name, frame.columns.name) == ("radius [au]", "time [yr]")
    assert frame.attrs["field"] == "dust.0.surface_density" and u.Unit(frame.attrs["unit"]) == profile.values.unit
    peak = int(profile.values[1].argmax())
    row, column = frame.index[peak], frame.columns[1]
    assert row * u.au == profile.radius[peak] and column * u.yr == profile.time[1]
    assert frame.loc[row, column] == profile.values[1].value.max() > 0.0
    frame[:] = -1.0  # a copy
    assert (profile.values.value >= 0.0).any()


def test_profile_is_drawn_for_some_times_with_units(run):
    ax = run.profile("dust.0.stokes").plot()
    assert [line.get_label() for line in ax.lines] == [f"t = {time:.4g}" for time in run.times]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("r [au]", "Stokes number, 1 mm")
    assert ax.get_yscale() == "log"
    assert run.profile("gas.v_r").plot().get_yscale() == "linear"


@pytest.mark.parametrize("kind", ["map", "polar", "profile", "time"])
def test_figures_of_a_run(run, kind):
    at = None if kind == "time" else 3.2
    ax = run.plot("dust.0.surface_density", kind, at=at, window="9 au" if kind == "map" else "2 au,9 au")
    names = {"map": "x [au]", "polar": r"$\varphi$ [deg]", "profile": "r [au]", "time": "r [au]"}
    assert ax.get_xlabel() == names[kind]
    assert run.plot("gas.v_r", kind, ax=ax) is ax


def test_wrong_arguments_are_one_message(run, tmp_path):
    with pytest.raises(PlotError, match='kind: "pie" is unknown; expected one of map, polar, profile, time'):
        run.plot("gas.v_r", "pie")
    with pytest.raises(PlotError, match=r"at: kind .time. uses all snapshots"):
        run.plot("gas.v_r", "time", at="2 yr")
    with pytest.raises(FieldError, match=r"exists for several species; expected one of gas.v_r, dust.v_r"):
        run.profile("v_r")
    with pytest.raises(FieldError, match=r"expected one of 0 .1 mm., pebbles .5 cm."):
        run.profile("dust.sand.v_r")
    with pytest.raises(PlotError, match=r"no snapshots in this slice"):
        run[3:].profile("gas.v_r")
    for where in (tmp_path, tmp_path / "absent", run.files[0]):
        with pytest.raises(discsim.SnapshotError, match=r"no run found; expected a directory with scene.toml"):
            discsim.open_run(where)
    (tmp_path / "scene.toml").write_text("")
    with pytest.raises(discsim.SnapshotError, match=r"no snapshots found"):
        discsim.open_run(tmp_path)


def test_history_has_numbers_and_names(run, directory):
    pandas = pytest.importorskip("pandas")
    history = run.history
    assert isinstance(history, pandas.DataFrame) and tuple(history.columns) == COLUMNS
    assert [*history["step"]] == [0, 7, 14] and history["step"].dtype == np.int64
    assert [*history["time"]] == [0.0, 1.5, 3.0] and set(history["dt_set_by"]) == {"star"}
    assert run.companions is None


def test_history_is_a_structured_array_without_pandas(run, monkeypatch):
    monkeypatch.setattr("discsim.output.run.find_spec", lambda name: None)
    history = run.history
    assert history.dtype.names == COLUMNS and history.shape == (3,)
    assert [*history["time"]] == [0.0, 1.5, 3.0] and [*history["dt_set_by"]] == ["star"] * 3


def test_history_that_is_being_written_or_damaged(directory, tmp_path):
    shutil.copytree(directory, tmp_path / "run")
    run = discsim.open_run(tmp_path / "run")
    write_history(run.directory, rows=2, tail="21,4.5,0.2")
    assert len(run.history) == 2
    write_history(run.directory, rows=2, tail="21,4.5,0.2\n28,6.0,0.1,star,1")
    with pytest.raises(HistoryError, match=r"history.csv:4: not a row of history.csv; expected 19 entries"):
        run.history  # noqa: B018
    (run.directory / "history.csv").write_text("time\n1.0\n")
    with pytest.raises(HistoryError, match=r"history.csv:1: not the header of history.csv; expected step,time"):
        run.history  # noqa: B018


def test_companions_are_read_with_their_numbers(tmp_path):
    pytest.importorskip("pandas")
    companion = {"mass": "1 Mjup", "semi_major_axis": "5 au", "softening": 0.6}
    path = write_two_sizes(tmp_path / "run", (1.0,), TABLES | {"companion": [companion]})
    from discsim.output.companions import COLUMNS as OF_COMPANIONS

    rows = [",".join(["4", "0.75", "1", *(str(0.5 + k) for k in range(len(OF_COMPANIONS) - 3))])]
    (path / "companions.csv").write_text("\r\n".join([",".join(OF_COMPANIONS), *rows, ""]))
    found = discsim.open_run(path).companions
    assert [*found["number"]] == [1] and found["number"].dtype == np.int64 and [*found["mass"]] == [0.5]


def test_a_run_that_goes_on_shows_its_new_snapshots(directory, tmp_path):
    shutil.copytree(directory, tmp_path / "run")
    last = tmp_path / "run/snapshots/0002.h5"
    last.rename(tmp_path / "0002.h5")
    run = discsim.open_run(tmp_path / "run")
    assert len(run) == 2 and run[-1].time == 3.0
    (tmp_path / "0002.h5").rename(last)
    assert len(run) == 3 and run.at(1e3).time == 11.0 and len(run.times) == 3


def test_summary_names_the_run(run):
    show = run.units.show
    text = repr(run)
    assert text.startswith("Two sizes\n") and f"3, t = {show(0.0, 'time')} to {show(11.0, 'time')}" in text
    assert "<table>" in run._repr_html_() and run.populations == ["0", "pebbles"]
    assert run.scene.title == "Two sizes"


def test_a_run_is_opened_without_matplotlib(directory):
    code = f"import sys, discsim; r = discsim.open_run({str(directory)!r}); r[0], r.times, repr(r); "
    code += "sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
