"""Files in parts: they hold what one file holds, are whole or absent, and a part that is not what it was is noticed."""

import errno
import os
import shutil
from itertools import pairwise

import h5py
import numpy as np
import pytest
from deaths import left_by_kills
from runs import assert_same_arrays, assert_same_content, errors_of

from discsim import read_snapshot
from discsim.numerics.state import Dust, Gas
from discsim.output import open_step, parts
from discsim.output.checkpoint import CheckpointError, check_checkpoint, read_checkpoint, write_checkpoint
from discsim.output.snapshot import SnapshotError
from discsim.output.snapshot_writer import extent_of, write_snapshot
from discsim.run.checkpoints import Checkpoints
from discsim.run.directory import CHECKPOINTS, copy_input_files, remove_partial_files
from discsim.run.runner import run_scene
from discsim.scene import SceneError, load_scene

SCENE = load_scene(
    {
        "units": {"system": "code"},
        "run": {"until": 1.0},
        "space": {"size": 6},
        "initial": {"kind": "disc", "mass": 0.05, "inner": 0.5, "outer": 2.0},
        "gas": {
            "particles": 50,
            "eos": {"kind": "locally-isothermal", "aspect_ratio": 0.1, "reference_radius": 1},
        },
        "dust": {"particles": 70, "ratio": 0.1},
        "star": {"mass": 1},
    }
)
NUMBER = 3


def particles(ids, stream):
    """Gas and dust of these ids, those of the gas before those of the dust."""
    count = {"gas": ids, "dust": ids + 1000}
    made = {}
    for name, kind in (("gas", Gas), ("dust", Dust)):
        n = len(ids)
        arrays = {"pos": stream.normal(size=(n, 2)), "vel": stream.normal(size=(n, 2)), "mass": stream.uniform(1, 2, n)}
        more = ("h", "density", "gradh", "pressure", "sound_speed") if name == "gas" else ()
        arrays |= {key: stream.uniform(1, 2, n) for key in more}
        if name == "dust":
            arrays["species"] = np.zeros(n, np.int64)
        made[name] = kind(**arrays, acc=np.zeros((n, 2)), ids=count[name])
    return made


def divided(made, number=NUMBER):
    """Runs of the particles by ids; the second has none."""
    ends = np.linspace(0, len(made["gas"].ids), number).astype(int)
    edges = [0, *ends[1:2], *ends[1:2], *ends[2:]]
    for first, last in pairwise(edges):
        share = {name: p.copy() for name, p in made.items()}
        for p in share.values():
            for name, array in p.arrays().items():
                setattr(p, name, array[first:last])
        yield share


def in_parts(path, shares, fill, before=None, made="abc"):
    """As ranks do it: `fill(share, into)` writes that share."""
    stem = parts.create_stem(path, before)
    written = [parts.Part(path, stem, number, made) for number in range(len(shares))]
    for part, share in zip(written, shares, strict=True):
        fill(share, part.create)
    written[0].write_master(path, before, [part.lengths for part in written])


def put_snapshot(share, into, path, extent=None):
    step = open_step.OpenStep(0.5, 3, {name: {"vel": 2.0 * p.vel} for name, p in share.items()})
    write_snapshot(path, SCENE, 0.5, share["gas"], share["dust"], {}, None, step, extent, into)


@pytest.fixture
def both(tmp_path):
    """A snapshot as one file and in parts."""
    made = particles(np.arange(50), np.random.default_rng(3))
    made["gas"].pos[7] = [5.0, -9.0]  # off the grid
    one, other = tmp_path / "one" / "0003.h5", tmp_path / "other" / "0003.h5"
    for path in (one, other):
        path.parent.mkdir()
    put_snapshot(made, write_snapshot.__defaults__[-1], one)
    extent = extent_of(SCENE, made["gas"], made["dust"], None)
    in_parts(other, [*divided(made)], lambda share, into: put_snapshot(share, into, other, extent))
    return one, other


def test_the_master_opens_as_the_one_file(both, tmp_path, monkeypatch):
    """Wherever it is read from, also once the folder has moved."""
    monkeypatch.chdir("/")
    moved = tmp_path / "moved"
    shutil.move(both[1].parent, moved)
    with h5py.File(both[0]) as one, h5py.File(moved / "0003.h5") as other:
        assert other["PartType3/Coordinates"].is_virtual
        assert_same_content(one, other)
    assert (moved / "0003.h5").stat().st_size < both[0].stat().st_size
    assert sorted(os.listdir(moved / "parts")) == ["0003.0.h5", "0003.1.h5", "0003.2.h5"]


def test_readers_of_ours_find_the_same(both):
    one, other = (read_snapshot(path) for path in both)
    for name, species in one.species.items():
        assert_same_arrays(vars(species), vars(other.species[name]))
        assert_same_arrays(one.open_step.arrays[name], other.open_step.arrays[name])
    assert one.time == other.time and np.array_equal(one.upper, other.upper)


def test_a_part_that_is_gone_or_of_another_file_is_refused(both):
    path = both[1]
    part = path.parent / "parts" / "0003.2.h5"
    with h5py.File(part, "r+") as file:
        file.attrs["made"] = np.bytes_("xyz")
    with pytest.raises(
        SnapshotError, match=r"part file .*0003\.2\.h5: the part file belongs to another " r"snapshot or checkpoint"
    ):
        read_snapshot(path)
    part.unlink()
    with pytest.raises(SnapshotError, match=r"0003\.h5: the part file .*/parts/0003\.2\.h5 is missing; restore"):
        read_snapshot(path)
    with pytest.raises(SnapshotError, match=r"0003\.0\.h5: not a snapshot of discsim, but another HDF5 file"):
        read_snapshot(path.parent / "parts" / "0003.0.h5")


@pytest.mark.parametrize("name", ["0003.h5", "parts/0003.0.h5", "parts/0003.2.h5"])
def test_no_flipped_bit_and_no_cut_goes_unseen(both, name):
    """HDF5 itself gives zeros where it cannot open a part."""
    path, stream, caught = both[1].parent / name, np.random.default_rng(4), 0
    whole, content = read_snapshot(both[0]), path.read_bytes()
    for place in stream.integers(0, len(content), 20):
        wrong = bytearray(content)
        wrong[place] ^= 1 << int(stream.integers(8))
        path.write_bytes(wrong if place % 4 else content[:place])
        try:
            found = read_snapshot(both[1])
        except SnapshotError as fault:
            caught += 1
            assert "\n" not in str(fault) and str(both[1]) in str(fault)
        else:
            for species in whole.species:
                assert_same_arrays(vars(whole.species[species]), vars(found.species[species]))
    assert caught > 3  # the rest is room for more


def test_where_rows_lie_is_known_to_the_bit(both):
    """The heap that says so has no checksum of HDF5, which crashes on some of these bits."""
    content = both[1].read_bytes()
    for place in range(content.index(b"GCOL"), content.index(b"GCOL") + 48):
        wrong = bytearray(content)
        wrong[place] ^= 1
        both[1].write_bytes(wrong)
        with pytest.raises(SnapshotError, match="its checksum is wrong"):
            read_snapshot(both[1])


GROUPS = ("gas", "dust", "own_acc", "ledger", "scene")


def put_checkpoint(path, number, before):
    """A checkpoint in parts of four rows each, whose values and arrays tell its number."""

    def fill(k, into):
        rows = np.arange(4.0 * k, 4.0 * k + 4.0) + 100 * number
        groups = {"gas": {"mass": rows}, "dust": {}, "own_acc": {"gas": np.empty((0, 2))}}
        groups |= {"ledger": {"lost": np.array([1.0])}, "scene": {"text": np.frombuffer(b"a", np.uint8)}}
        write_checkpoint(path, groups, {"number": number}, before, into)

    in_parts(path, range(NUMBER), fill, before, made=f"checkpoint {number}")
    parts.remove_unused_parts(path.parent)


def test_each_checkpoint_keeps_its_parts_while_it_is_there(tmp_path):
    path, before = tmp_path / "checkpoint.h5", tmp_path / "checkpoint_before.h5"
    for number in range(5):
        put_checkpoint(path, number, before)
        for file, of in ((path, number), (before, number - 1)):
            if of >= 0:
                groups, values = read_checkpoint(file)
                assert values == {"number": of} and {*groups} == {*GROUPS}
                assert np.array_equal(groups["gas"]["mass"], np.arange(12.0) + 100 * of)
                assert groups["own_acc"]["gas"].shape == (0, 2) and check_checkpoint(file)[1] == values
        assert len(os.listdir(tmp_path / "parts")) == NUMBER * min(number + 1, 2)
    path.unlink()
    before.unlink()
    parts.remove_unused_parts(tmp_path)
    assert [*tmp_path.iterdir()] == []


def test_a_kill_at_any_moment_leaves_a_checkpoint(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    path, before = (out / name for name in CHECKPOINTS)
    for number in range(2):
        put_checkpoint(path, number, before)
    found = []
    for left in left_by_kills(lambda: put_checkpoint(path, 2, before), out, tmp_path / "left"):
        checkpoints = Checkpoints(left)
        values = checkpoints.newest()[1]
        remove_partial_files(left)  # as a run does that goes on
        checkpoints.keep_chosen()
        parts.remove_unused_parts(left)
        groups, again = read_checkpoint(left / path.name)
        assert again == values and np.array_equal(groups["gas"]["mass"], np.arange(12.0) + 100 * values["number"])
        found.append(values["number"])
    assert found == sorted(found) and {*found} == {1, 2} and len(found) > 7


@pytest.mark.parametrize("of", [1, 2, 5, 12, 20])
def test_shares_of_rows(tmp_path, of):
    put_checkpoint(tmp_path / "a.h5", 0, None)
    shares = [read_checkpoint(tmp_path / "a.h5", (number, of))[0] for number in range(of)]
    assert np.array_equal(np.concatenate([share["gas"]["mass"] for share in shares]), np.arange(12.0))
    assert np.ptp([len(share["gas"]["mass"]) for share in shares]) <= 1
    assert all(len(share["ledger"]["lost"]) == 1 for share in shares)


def test_a_checkpoint_with_a_damaged_part_is_noticed_before_a_run_goes_on(tmp_path):
    put_checkpoint(tmp_path / "a.h5", 0, None)
    part = tmp_path / "parts" / "a.1.h5"
    content = part.read_bytes()
    place = content.index(np.arange(4.0, 8.0).tobytes())
    part.write_bytes(content[:place] + b"\x01" + content[place + 1 :])
    with pytest.raises(CheckpointError, match=r"a\.h5: not a checkpoint, or a damaged checkpoint: part .*a\.1\.h5"):
        check_checkpoint(tmp_path / "a.h5")


def test_parts_that_no_file_names_are_removed(tmp_path):
    """Those of a write that was killed; not where a file cannot be read, which may name them."""
    put_checkpoint(tmp_path / "a.h5", 0, None)
    left = tmp_path / "parts" / "b.0.h5", tmp_path / "parts" / ".b.1.h5.77.part"
    for path in left:
        path.write_bytes(b"")
    content = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "a.h5").write_bytes(content[:100])
    parts.remove_unused_parts(tmp_path)
    assert len([*(tmp_path / "parts").iterdir()]) == NUMBER + 2
    (tmp_path / "a.h5").write_bytes(content)
    remove_partial_files(tmp_path)
    parts.remove_unused_parts(tmp_path)
    assert sorted(os.listdir(tmp_path / "parts")) == ["a.0.h5", "a.1.h5", "a.2.h5"]


def begun_with(path):
    """A scene that begins with a snapshot."""
    tables = {"units": {"system": "code"}, "run": {"until": 1.0}, "space": {"size": 20}, "star": {"mass": 1}}
    gas = {"eos": {"kind": "isothermal", "sound_speed": 0.1}}
    start = {"kind": "snapshot", "file": str(path)}
    return load_scene(tables | {"initial": start, "dust": {"ratio": 0.1}, "gas": gas})


def test_a_run_that_begins_with_a_snapshot_has_its_parts_too(both, tmp_path):
    scene = begun_with(both[1])
    out = tmp_path / "out"
    out.mkdir()
    own = copy_input_files(scene, out, [])
    shutil.rmtree(both[1].parent)
    assert own.initial.file.path.parent == out
    assert np.array_equal(read_snapshot(own.initial.file.path).gas.pos, read_snapshot(both[0]).gas.pos)
    parts.remove_unused_parts(out)
    assert len(os.listdir(out / "parts")) == NUMBER


@pytest.mark.parametrize("written", range(NUMBER + 1))
def test_copies_on_a_full_disk_leave_nothing(both, tmp_path, monkeypatch, capsys, written):
    """Neither the parts before the one that finds no room, nor a folder for them; the master comes last."""
    scene, replace, left = begun_with(both[1]), os.replace, [written]

    def full(old, new):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(new))
        replace(old, new)

    monkeypatch.setattr("discsim.output.files.os.replace", full)
    assert run_scene(scene, tmp_path / "new/out", quiet=True) == 1
    name = "initial.h5" if written == NUMBER else f"parts/0003.{written}.h5"
    assert f"{tmp_path}/new/out/{name}: cannot be written: No space left" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_start_in_parts_that_is_refused_leaves_what_was_there(both, tmp_path, monkeypatch, capsys):
    def refused(*given, **more):
        raise SceneError(["scene: gas: falls in"])

    monkeypatch.setattr("discsim.run.runner.Simulation", refused)
    assert run_scene(begun_with(both[1]), tmp_path / "new", quiet=True) == 2
    assert errors_of(capsys.readouterr().err) == ["scene: gas: falls in"] and not (tmp_path / "new").exists()
    (tmp_path / "here/parts").mkdir(parents=True)
    (tmp_path / "here/initial.h5").symlink_to("absent")
    assert run_scene(begun_with(both[1]), tmp_path / "here", quiet=True) == 1
    assert sorted(path.name for path in (tmp_path / "here").rglob("*")) == ["initial.h5", "parts"]
