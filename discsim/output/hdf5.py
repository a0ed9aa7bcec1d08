"""HDF5 files that are whole or absent, are read back once they are written, and notice a flipped bit later.

Arrays carry a fletcher32 checksum; the format of HDF5 1.10 checksums all else (attributes, indices). Rows of particles
may lie in several files, `parts.py`.
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from discsim import __version__
from discsim.output.files import command, written

_CHUNK = 1 << 16  # entries; a chunk is read and checked as a whole
_BLOCK = 1 << 24  # bytes that are read back at a time
ALL = slice(None)
_SEAL = b"\ndiscsim: sha256 of all before this line "  # at the end, before the digest: HDF5 does not read it
NAMES, MADE = "parts", "made"  # attributes: names of the parts of a master; what both of them have, and no others


@contextmanager
def create(path: str | os.PathLike[str], before: Path | None = None) -> Iterator[h5py.File]:
    """A new file that appears at `path` only when complete; an exception leaves what was there before.

    Built in memory: HDF5 itself may crash where the disk is full, a plain write raises OSError, and so does a disk that
    holds something else than was written. before: where what was there stays.
    """
    content = io.BytesIO()
    with new(content) as file:
        yield file
    put_down(path, content, before)


def new(content: io.BytesIO) -> h5py.File:
    """An empty file in memory."""
    return h5py.File(content, "w", libver=("v110", "v110"))


def put_down(path: str | os.PathLike[str], content: io.BytesIO, before: Path | None = None) -> None:
    """Have a file that was made in memory at `path`, as `create`."""
    with written(path, before=before) as temporary:
        with temporary.open("wb") as plain:
            plain.write(content.getbuffer())
            plain.flush()
            os.fsync(plain.fileno())
        if not _holds(temporary, np.frombuffer(content.getbuffer(), np.uint8)):
            raise OSError(errno.EIO, "the disk does not hold what was written", str(path))


def seal(content: io.BytesIO) -> None:
    """Append a digest of all that a file in memory holds.

    What says where virtual datasets lie has no checksum of HDF5, which may crash on a flipped bit there.
    """
    digest = hashlib.sha256(content.getbuffer()).digest()
    content.seek(0, os.SEEK_END)
    content.write(_SEAL + digest)


def _check_seal(path: Path) -> None:
    with path.open("rb") as file:
        length = file.seek(0, os.SEEK_END) - len(_SEAL) - hashlib.sha256().digest_size
        file.seek(max(length, 0))
        if file.read(len(_SEAL)) != _SEAL:
            return
        digest = file.read()
        file.seek(0)
        if hashlib.sha256(file.read(length)).digest() != digest:
            raise OSError("some of its bits are not those that were written")


def _holds(path: Path, content: np.ndarray) -> bool:
    """Whether the file at `path` has the bytes `content`; read from the disk itself where the system can do that."""
    place = 0
    with path.open("rb") as file:
        if hasattr(os, "posix_fadvise"):
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
        while block := file.read(_BLOCK):
            if not np.array_equal(np.frombuffer(block, np.uint8), content[place : place + len(block)]):
                return False
            place += len(block)
    return place == len(content)


@contextmanager
def reading(path: str | os.PathLike[str], error: type[Exception], kind: str) -> Iterator[h5py.File]:
    """The file at `path`, open for reading; whatever is wrong with it becomes one `error`."""
    try:
        _check_seal(Path(path))
        with h5py.File(path, "r") as file:
            if file.attrs.get("discsim") != np.bytes_(kind):
                raise error(f"{path}: an HDF5 file, but not a {kind} of discsim")
            for part in parts_of(file):
                if not part.exists():
                    raise error(f"{path}: its part {part} is gone; expected all its parts beside it")
            yield file
    except FileNotFoundError:
        raise error(f"{path}: no such file") from None
    except PermissionError:
        raise error(f"{path}: not readable: permission denied") from None
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as fault:
        if isinstance(fault, error):
            raise
        # Other types of exception are h5py's own surprise at what it found: nothing a reader could use.
        reason = str(fault).splitlines()[0] if isinstance(fault, OSError) else "its contents cannot be read"
        raise error(f"{path}: not a {kind}, or a damaged one: {reason}") from fault


def mark(file: h5py.File, kind: str) -> None:
    """Say what the file is, for `reading`, and which version of discsim wrote it, called how."""
    file.attrs["discsim"] = np.bytes_(kind)
    file.attrs["version"] = np.bytes_(__version__)
    file.attrs["command"] = np.bytes_(os.fsencode(command()))


def put(group: h5py.Group, name: str, array: np.ndarray) -> h5py.Dataset:
    """Store `array` under `name`, bit for bit, with its checksum."""
    array = np.atleast_1d(array)
    chunk = (min(max(len(array), 1), _CHUNK), *(max(n, 1) for n in array.shape[1:]))
    shape = array.shape if array.size else None
    # HDF5 takes a chunk longer than the array only where the array could still grow.
    room = array.shape if shape else (None,) * array.ndim
    return group.create_dataset(name, data=array, chunks=chunk, maxshape=room, fletcher32=True)


def parts_of(file: h5py.File) -> list[Path]:
    """The files that hold rows of the particles of a master; none of a file that holds all."""
    folder = Path(file.filename).parent
    return [folder / os.fsdecode(name) for name in file.attrs.get(NAMES, ())]


def read(stored: h5py.Dataset, rows: slice = ALL) -> np.ndarray:
    """Entries of a dataset, those in parts from there: HDF5 gives zeros for a part that it cannot open."""
    if not stored.is_virtual:
        return np.asarray(stored[rows])
    first, last, _ = rows.indices(len(stored))
    out = np.empty((max(last - first, 0), *stored.shape[1:]), stored.dtype)
    folder, made = Path(stored.file.filename).parent, stored.file.attrs[MADE]
    for source in stored.virtual_sources():
        (begin, *_), (end, *_) = source.vspace.get_select_bounds()
        one, other = max(first, begin), min(last, end + 1)
        if one < other:
            with _part(folder / source.file_name, made) as part:
                out[one - first : other - first] = part[source.dset_name][one - begin : other - begin]
    return out


@contextmanager
def _part(path: Path, made: str) -> Iterator[h5py.File]:
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get(MADE) != np.bytes_(made):
                raise OSError("it is of another file than this one")
            yield file
    except (OSError, KeyError, ValueError, RuntimeError) as fault:
        reason = str(fault).splitlines()[0] if isinstance(fault, OSError) else "its contents cannot be read"
        raise OSError(f"part {path}: {reason}") from fault
