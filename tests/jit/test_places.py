"""Disks that are full or read-only: one message each, which names what cannot be written."""

import errno
import os
import stat
import tempfile

import pytest
from numba.core import caching
from runs import WAVE, at_step, scene_of

from discsim.jit import cache
from discsim.jit.decorators import jit
from discsim.output.history import History
from discsim.run.progress import Progress
from discsim.run.runner import run_scene


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    """Drawing takes longer than these runs."""
    monkeypatch.setattr("discsim.output.figure.last_state_figure", lambda snapshot, figure: figure.touch())


def fill_up(file):
    """Have every further write to an open file fail as on a full disk."""
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, file.fileno())
    os.close(full)


def test_a_disk_that_is_full_at_the_first_line_of_the_log(tmp_path, monkeypatch, capsys):
    def note(progress, text):
        if progress._log is not None:
            fill_up(progress._log)
        real(progress, text)

    out, real = tmp_path / "out", Progress.note
    monkeypatch.setattr(Progress, "note", note)
    assert run_scene(scene_of(tmp_path, WAVE), out, quiet=True) == 1
    message = capsys.readouterr().err
    assert message == f"{out}: cannot be written: No space left on device. There is no checkpoint yet.\n"


def test_a_disk_that_fills_within_the_history(tmp_path, monkeypatch, capsys):
    histories = []
    real = History.__init__
    monkeypatch.setattr(History, "__init__", lambda *given: real(*given) or histories.append(given[0]))
    at_step(monkeypatch, 2, lambda sim: fill_up(histories[0]._file))
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 1
    message = capsys.readouterr().err
    assert len(message.splitlines()) == 1 and "No space left on device" in message and "--resume" in message


# Compiled kernels


def test_a_full_disk_of_the_cache_is_not_the_directory_of_the_run(tmp_path, monkeypatch, capsys):
    def full(file, path):
        raise OSError(errno.ENOSPC, "No space left on device")

    @jit
    def one_more(x):
        return x + 1

    monkeypatch.setattr(caching.IndexDataCacheFile, "_open_for_write", full)
    at_step(monkeypatch, 2, lambda sim: one_more(1))
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 1
    message = capsys.readouterr().err
    place = cache.kernel_folder()
    assert message.startswith(f"{place}: compiled kernels cannot be written: No space left on device. Free disk ")
    assert place.is_dir() and "NUMBA_CACHE_DIR" in message and len(message.splitlines()) == 1


@pytest.fixture
def read_only(tmp_path, monkeypatch):
    """A file system on which nothing but the temporary directory can be written, as the kernels' folder sees it."""
    real = cache._create_folder

    def made(parent):
        if not parent.is_relative_to(tmp_path):
            raise OSError(errno.EROFS, "Read-only file system")
        return real(parent)

    monkeypatch.setattr(cache, "_create_folder", made)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cache.kernel_folder.cache_clear()
    yield
    cache.kernel_folder.cache_clear()


def test_where_no_usual_place_can_be_written_a_temporary_one_is_taken(tmp_path, read_only, capsys):
    place = tmp_path / f"discsim-kernels-{os.getuid()}"
    assert cache.kernel_folder().parent == place and cache.is_temporary()
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out") == 0
    said = [line for line in capsys.readouterr().out.splitlines() if "compiled kernels are kept" in line]
    assert len(said) == 1 and str(place) in said[0] and "NUMBA_CACHE_DIR" in said[0]


def test_a_place_that_others_may_write_is_not_taken(tmp_path, read_only):
    place = tmp_path / f"discsim-kernels-{os.getuid()}"
    place.mkdir()
    place.chmod(0o777)
    found = cache.kernel_folder().parent
    assert found != place and stat.S_IMODE(os.stat(found).st_mode) == 0o700 and cache.is_temporary()


def test_no_place_at_all_is_one_message(tmp_path, read_only, monkeypatch, capsys):
    def nowhere():
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", nowhere)
    monkeypatch.setattr("discsim.run.runner.Simulation", lambda scene, **_: cache.kernel_folder())
    assert run_scene(scene_of(tmp_path, WAVE), tmp_path / "out", quiet=True) == 1
    wanted = "no folder for compiled kernels is writable; set NUMBA_CACHE_DIR to a writable directory\n"
    assert capsys.readouterr().err == wanted and not (tmp_path / "out").exists()
