"""A snapshot or a checkpoint in parts: files in a folder "parts", each with a run of the rows of its particles, and
beside the folder a small master that opens as one file does, with virtual datasets over these rows.

    snapshots/0003.h5   snapshots/parts/0003.0.h5   snapshots/parts/0003.1.h5 ...

The master gets its name last. Parts of a file that takes the place of another have a number in their names that no
part there has, and are removed once no master names them: a kill leaves parts too many at most.
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
from discsim.output.files import PARTS, keep_names, written
from discsim.userfiles import copy_plain

# Groups of a snapshot and of a checkpoint whose arrays have a row a particle.
DIVIDED = (
    "PartType0", "PartType3", "discsim/OpenStep/gas", "discsim/OpenStep/dust",
    "arrays/gas", "arrays/dust", "arrays/own_acc",
)  # fmt: skip


def stem_of(path: Path, before: Path | None) -> str:
    """What the names of the parts of a new file at `path` begin with; makes their folder. Raises OSError."""
    folder = path.parent / PARTS
    folder.mkdir(exist_ok=True)
    keep_names(path.parent)
    if before is None:
        return path.stem
    numbers = (part.name.partition(".")[0].rpartition("-")[2] for part in folder.glob(f"{path.stem}-*"))
    return f"{path.stem}-{1 + max((int(number) for number in numbers if number.isdecimal()), default=0)}"


class Part:
    """The part number `number` of a new file at `path`, and of the first one also what else that file holds.

    made: a text that other files do not have.
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
        """As `hdf5.create`, a file of the rows here: they are put down, the rest is kept for the master."""
        content = io.BytesIO()
        with hdf5.new(content) as file:
            yield file
            with hdf5.new(self._rest) as rest:
                _take_rest(file, rest)
            self.lengths = {stored.name: len(stored) for stored in _divided(file)}
            file.attrs["discsim"], file.attrs[hdf5.MADE] = np.bytes_("part of a file"), np.bytes_(self.made)
        hdf5.put_down(self.file, content)

    def join(self, path: Path, before: Path | None, lengths: Sequence[dict[str, int]]) -> None:
        """Put down the master, of the first part and as many as there are `lengths`, those of each. Raises OSError."""
        files = [self._named(number) for number in range(len(lengths))]
        with h5py.File(self._rest, "r+") as file:
            with h5py.File(self.file, "r") as first:
                for stored in _divided(first):
                    _join(file, stored, files, [length[stored.name] for length in lengths])
            file.attrs[hdf5.NAMES] = [np.bytes_(os.fsencode(_beside(one))) for one in files]
            file.attrs[hdf5.MADE] = np.bytes_(self.made)
        hdf5.seal(self._rest)
        hdf5.put_down(path, self._rest, before)

    def discard(self) -> None:
        """Remove it, where the others or the master could not be written."""
        with suppress(OSError):
            self.file.unlink(missing_ok=True)


def _beside(part: Path) -> str:
    return f"{PARTS}/{part.name}"


def _divided(file: h5py.File) -> Iterator[h5py.Dataset]:
    for group in DIVIDED:
        if group in file:
            yield from file[group].values()


def _take_rest(group: h5py.Group, into: h5py.Group) -> None:
    """Move what is not divided."""
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
    """One dataset of the parts in `files`, of which the first has `stored`."""
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
    """Remove the parts that no file in `folder` names; none where one cannot be read, which may name any."""
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
    with suppress(OSError):  # there are others
        parts.rmdir()


def copy(path: Path, target: Path, to: Path, made: list[Path]) -> None:
    """Copy a file of whatever kind to `to`, which is to be named `target`, and its parts to beside that.

    made: gets the parts that were not there before, and their folder, each before it is made.
    """
    if (path.parent / PARTS).is_dir() and h5py.is_hdf5(path):
        with hdf5.opened(path) as file:
            parts = hdf5.parts_of(file)
        for part in parts:
            other = target.parent / PARTS / part.name
            made += [each for each in (other.parent, other) if not os.path.lexists(each)]
            other.parent.mkdir(exist_ok=True)
            with written(other) as temporary:
                copy_plain(part, temporary)
    copy_plain(path, to)
