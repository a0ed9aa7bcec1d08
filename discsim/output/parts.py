"""Snapshots and checkpoints in several files, the parts, so that every MPI rank writes its own particles.

Each part is a file in the folder "parts" with a contiguous range of the particles' rows. A small master file next to
the folder has all other data, and virtual datasets that refer to the rows in the parts. The master opens like a single
file.

    snapshots/0003.h5   snapshots/parts/0003.0.h5   snapshots/parts/0003.1.h5 ...

The parts are written first, and the master last. If the master replaces an older one, the new parts have other names
than the old parts. Therefore a killed run leaves intact files, and perhaps parts to which no master refers;
`remove_unused_parts` removes these parts.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np

from discsim.output import hdf5
from discsim.output.files import PARTS, fsync_directory, replace_atomically
from discsim.userfiles import copy_plain

# Groups of snapshots and checkpoints whose arrays have one row per particle.
DIVIDED_GROUPS = (
    "PartType0", "PartType3", "discsim/OpenStep/gas", "discsim/OpenStep/dust",
    "arrays/gas", "arrays/dust", "arrays/own_acc",
)  # fmt: skip


def create_stem(path: Path, backup: Path | None) -> str:
    """Create the folder for the parts of a new master at `path`; return the stem of their names. Raises OSError.

    If the master replaces an older one (`backup` is not None), the stem ends in a number that no other part has.
    """
    folder = path.parent / PARTS
    folder.mkdir(exist_ok=True)
    fsync_directory(path.parent)
    if backup is None:
        return path.stem
    numbers = (part.name.partition(".")[0].rpartition("-")[2] for part in folder.glob(f"{path.stem}-*"))
    return f"{path.stem}-{1 + max((int(number) for number in numbers if number.isdecimal()), default=0)}"


class Part:
    """One of the files, called parts, to which a new master file at `path` refers.

    The process with part 0 also writes the master. `stem` is the result of `create_stem`, and `number` the index of the
    part. `file_id` is a text that only this master and its parts have. `lengths` has the number of rows in this part by
    dataset.
    """

    def __init__(self, path: Path, stem: str, number: int, file_id: str) -> None:
        self.folder, self.stem, self.file_id = path.parent / PARTS, stem, file_id
        self.file = self._path_of(number)
        self.lengths: dict[str, int] = {}
        self._rest = io.BytesIO()  # data of the master without the rows of particles

    def _path_of(self, number: int) -> Path:
        return self.folder / f"{self.stem}.{number}.h5"

    @contextmanager
    def create(self, path: str | os.PathLike[str], backup: Path | None = None) -> Iterator[h5py.File]:
        """Yield a new file in memory; at the end of the block, write its rows of particles to this part.

        All other data are kept in memory for `write_master`. The arguments, which are those of `hdf5.create`, are not
        used.
        """
        content = io.BytesIO()
        with hdf5.new_in_memory(content) as file:
            yield file
            with hdf5.new_in_memory(self._rest) as rest:
                _move_undivided(file, rest)
            self.lengths = {stored.name: len(stored) for stored in _divided_datasets(file)}
            file.attrs["discsim"], file.attrs[hdf5.FILE_ID] = np.bytes_("part of a file"), np.bytes_(self.file_id)
        hdf5.write_verified(self.file, content)

    def write_master(self, path: Path, backup: Path | None, lengths: Sequence[dict[str, int]]) -> None:
        """Write the master of all parts to `path`; `backup` is as in `hdf5.create`. Call this for part 0 only.

        `lengths` are the attributes `lengths` of all parts. Raises OSError.
        """
        files = [self._path_of(number) for number in range(len(lengths))]
        with h5py.File(self._rest, "r+") as file:
            with h5py.File(self.file, "r") as first:
                for stored in _divided_datasets(first):
                    _create_virtual(file, stored, files, [length[stored.name] for length in lengths])
            file.attrs[hdf5.PART_NAMES] = [np.bytes_(os.fsencode(_relative_path(one))) for one in files]
            file.attrs[hdf5.FILE_ID] = np.bytes_(self.file_id)
        hdf5.append_digest(self._rest)
        hdf5.write_verified(path, self._rest, backup)

    def discard(self) -> None:
        """Remove the file of this part; called if another part or the master could not be written."""
        with suppress(OSError):
            self.file.unlink(missing_ok=True)


def _relative_path(part: Path) -> str:
    """Return the path of a part relative to its master."""
    return f"{PARTS}/{part.name}"


def _divided_datasets(file: h5py.File) -> Iterator[h5py.Dataset]:
    """Yield the datasets of `file` whose rows are divided among the parts."""
    for group in DIVIDED_GROUPS:
        if group in file:
            yield from file[group].values()


def _move_undivided(group: h5py.Group, into: h5py.Group) -> None:
    """Move attributes, groups and datasets from `group` to the group `into` of another file.

    Groups in DIVIDED_GROUPS stay in `group`; `into` gets empty groups of the same names.
    """
    for name, value in group.attrs.items():
        into.attrs[name] = value
    for name, item in list(group.items()):
        if item.name[1:] in DIVIDED_GROUPS:
            into.create_group(name)
        elif any(path.startswith(f"{item.name[1:]}/") for path in DIVIDED_GROUPS):
            _move_undivided(item, into.create_group(name))
        else:
            group.copy(item, into, name)
            del group[name]


def _create_virtual(file: h5py.File, stored: h5py.Dataset, files: Sequence[Path], lengths: Sequence[int]) -> None:
    """Create a virtual dataset in the master `file`, which consists of the rows of a dataset in all parts.

    `stored` is the dataset in the first part, from which name, type and attributes are copied. `files` are the paths of
    the parts, and `lengths` the number of rows in each part.
    """
    wide = stored.shape[1:]
    if sum(lengths) == 0:
        joined = hdf5.write_array(file, stored.name, np.empty((0, *wide), stored.dtype))
    else:
        layout, begin = h5py.VirtualLayout((sum(lengths), *wide), stored.dtype), 0
        for one, length in zip(files, lengths, strict=True):
            if length > 0:
                layout[begin : begin + length] = h5py.VirtualSource(_relative_path(one), stored.name, (length, *wide))
            begin += length
        joined = file.create_virtual_dataset(stored.name, layout)
    for name, value in stored.attrs.items():
        joined.attrs[name] = value


def remove_unused_parts(folder: Path) -> None:
    """Remove the parts to which no master file in `folder` refers.

    If a master cannot be read, nothing is removed, because it may refer to any part.
    """
    parts = folder / PARTS
    if not parts.is_dir():
        return
    named: set[str] = set()
    for path in folder.glob("*.h5"):
        try:
            with hdf5.open_checked(path) as file:
                named.update(part.name for part in hdf5.parts_of(file))
        except (OSError, LookupError, ValueError, RuntimeError):
            return
    for part in parts.glob("*.h5"):
        if part.name not in named:
            part.unlink()
    with suppress(OSError):  # the folder still has parts
        parts.rmdir()


def copy(path: Path, target: Path, temporary: Path, created: list[Path]) -> None:
    """Copy the file at `path` to the path `temporary`, which the caller later renames to `target`.

    The parts of the file are copied to the folder of parts next to `target`. The paths of the new parts and of their
    folder are appended to `created` before they are created, so that the caller can remove them after a failure.
    """
    if (path.parent / PARTS).is_dir() and h5py.is_hdf5(path):
        with hdf5.open_checked(path) as file:
            parts = hdf5.parts_of(file)
        for part in parts:
            other = target.parent / PARTS / part.name
            created += [each for each in (other.parent, other) if not os.path.lexists(each)]
            other.parent.mkdir(exist_ok=True)
            with replace_atomically(other) as temporary_part:
                copy_plain(part, temporary_part)
    copy_plain(path, temporary)
