"""Snapshots and checkpoints in parts: files in a folder "parts", each with a contiguous range of particle rows.

Next to the folder is a small master file with virtual datasets over these rows. It opens like a single file.

    snapshots/0003.h5   snapshots/parts/0003.0.h5   snapshots/parts/0003.1.h5 ...

The master is renamed into place last. If a file replaces another, the names of its parts get a new number. Parts
that no master names are removed: a killed run leaves superfluous parts at most.
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
DIVIDED = (
    "PartType0", "PartType3", "discsim/OpenStep/gas", "discsim/OpenStep/dust",
    "arrays/gas", "arrays/dust", "arrays/own_acc",
)  # fmt: skip


def stem_of(path: Path, before: Path | None) -> str:
    """Return the first part of the names of a new file's parts, and create their folder. Raises OSError."""
    folder = path.parent / PARTS
    folder.mkdir(exist_ok=True)
    fsync_directory(path.parent)
    if before is None:
        return path.stem
    numbers = (part.name.partition(".")[0].rpartition("-")[2] for part in folder.glob(f"{path.stem}-*"))
    return f"{path.stem}-{1 + max((int(number) for number in numbers if number.isdecimal()), default=0)}"


class Part:
    """Part number `number` of a new file at `path`; part 0 also provides the rest of the file for the master.

    `made` is a text that is unique to the file.
    """

    def __init__(self, path: Path, stem: str, number: int, made: str) -> None:
        self.folder, self.stem, self.made = path.parent / PARTS, stem, made
        self.file = self._named(number)
        self.lengths: dict[str, int] = {}  # rows here, by dataset
        self._rest = io.BytesIO()

    def _named(self, number: int) -> Path:
        return self.folder / f"{self.stem}.{number}.h5"

    @contextmanager
    def create(self, path: str | os.PathLike[str], before: Path | None = None) -> Iterator[h5py.File]:
        """Yield a file like `hdf5.create`: particle rows are written to this part, the rest is kept for the master."""
        content = io.BytesIO()
        with hdf5.new(content) as file:
            yield file
            with hdf5.new(self._rest) as rest:
                _take_rest(file, rest)
            self.lengths = {stored.name: len(stored) for stored in _divided(file)}
            file.attrs["discsim"], file.attrs[hdf5.MADE] = np.bytes_("part of a file"), np.bytes_(self.made)
        hdf5.write_verified(self.file, content)

    def join(self, path: Path, before: Path | None, lengths: Sequence[dict[str, int]]) -> None:
        """Write the master over all parts. Raises OSError.

        `lengths` has for each part the numbers of rows by dataset. Called for part 0 only.
        """
        files = [self._named(number) for number in range(len(lengths))]
        with h5py.File(self._rest, "r+") as file:
            with h5py.File(self.file, "r") as first:
                for stored in _divided(first):
                    _join(file, stored, files, [length[stored.name] for length in lengths])
            file.attrs[hdf5.NAMES] = [np.bytes_(os.fsencode(_beside(one))) for one in files]
            file.attrs[hdf5.MADE] = np.bytes_(self.made)
        hdf5.seal(self._rest)
        hdf5.write_verified(path, self._rest, before)

    def discard(self) -> None:
        """Remove this part, after a failure to write another part or the master."""
        with suppress(OSError):
            self.file.unlink(missing_ok=True)


def _beside(part: Path) -> str:
    """Return the path of a part relative to its master."""
    return f"{PARTS}/{part.name}"


def _divided(file: h5py.File) -> Iterator[h5py.Dataset]:
    """Yield the datasets whose rows are divided among parts."""
    for group in DIVIDED:
        if group in file:
            yield from file[group].values()


def _take_rest(group: h5py.Group, into: h5py.Group) -> None:
    """Move attributes and all groups that are not divided into another file."""
    for name, value in group.attrs.items():
        into.attrs[name] = value
    for name, item in list(group.items()):
        if item.name[1:] in DIVIDED:
            into.create_group(name)
        elif any(path.startswith(f"{item.name[1:]}/") for path in DIVIDED):
            _take_rest(item, into.create_group(name))
        else:
            group.copy(item, into, name)
            del group[name]


def _join(file: h5py.File, stored: h5py.Dataset, files: Sequence[Path], lengths: Sequence[int]) -> None:
    """Create the dataset of the master over the parts `files`; `stored` is the dataset of the first part."""
    wide = stored.shape[1:]
    if sum(lengths) == 0:
        joined = hdf5.put(file, stored.name, np.empty((0, *wide), stored.dtype))
    else:
        layout, begin = h5py.VirtualLayout((sum(lengths), *wide), stored.dtype), 0
        for one, length in zip(files, lengths, strict=True):
            if length > 0:
                layout[begin : begin + length] = h5py.VirtualSource(_beside(one), stored.name, (length, *wide))
            begin += length
        joined = file.create_virtual_dataset(stored.name, layout)
    for name, value in stored.attrs.items():
        joined.attrs[name] = value


def tidy(folder: Path) -> None:
    """Remove the parts that no file in `folder` names.

    Nothing is removed if one of the files cannot be read, as it may name any part.
    """
    parts = folder / PARTS
    if not parts.is_dir():
        return
    named: set[str] = set()
    for path in folder.glob("*.h5"):
        try:
            with hdf5.opened(path) as file:
                named.update(part.name for part in hdf5.parts_of(file))
        except (OSError, LookupError, ValueError, RuntimeError):
            return
    for part in parts.glob("*.h5"):
        if part.name not in named:
            part.unlink()
    with suppress(OSError):  # the folder still has parts
        parts.rmdir()


def copy(path: Path, target: Path, to: Path, made: list[Path]) -> None:
    """Copy a file to `to`, which is to become `target`, and its parts to the folder of parts next to `target`.

    New parts and their folder are appended to `made` before they are created, so that the caller can remove them.
    """
    if (path.parent / PARTS).is_dir() and h5py.is_hdf5(path):
        with hdf5.opened(path) as file:
            parts = hdf5.parts_of(file)
        for part in parts:
            other = target.parent / PARTS / part.name
            made += [each for each in (other.parent, other) if not os.path.lexists(each)]
            other.parent.mkdir(exist_ok=True)
            with replace_atomically(other) as temporary:
                copy_plain(part, temporary)
    copy_plain(path, to)
