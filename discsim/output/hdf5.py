"""HDF5 files that are whole or absent, and that notice a flipped bit.

Arrays carry a fletcher32 checksum; the format of HDF5 1.10 checksums all else (attributes, indices).
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager

import h5py
import numpy as np

from discsim import __version__
from discsim.output.files import written

_CHUNK = 1 << 16  # entries; a chunk is read and checked as a whole


@contextmanager
def create(path: str | os.PathLike[str]) -> Iterator[h5py.File]:
    """A new file that appears at `path` only when complete; an exception leaves what was there before.

    Built in memory: HDF5 itself may crash where the disk is full, a plain write raises OSError.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", libver=("v110", "v110")) as file:
        yield file
    with written(path) as temporary, temporary.open("wb") as plain:
        plain.write(content.getbuffer())
        plain.flush()
        os.fsync(plain.fileno())  # else a power cut may leave the new name with no content


@contextmanager
def reading(path: str | os.PathLike[str], error: type[Exception], kind: str) -> Iterator[h5py.File]:
    """The file at `path`, open for reading; whatever is wrong with it becomes one `error`."""
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("discsim") != np.bytes_(kind):
                raise error(f"{path}: an HDF5 file, but not a {kind} of discsim")
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
    """Say what the file is, for `reading`, and which version of discsim wrote it."""
    file.attrs["discsim"] = np.bytes_(kind)
    file.attrs["version"] = np.bytes_(__version__)


def put(group: h5py.Group, name: str, array: np.ndarray) -> h5py.Dataset:
    """Store `array` under `name`, bit for bit, with its checksum."""
    array = np.atleast_1d(array)
    chunk = (min(max(len(array), 1), _CHUNK), *(max(n, 1) for n in array.shape[1:]))
    shape = array.shape if array.size else None
    # HDF5 takes a chunk longer than the array only where the array could still grow.
    room = array.shape if shape else (None,) * array.ndim
    return group.create_dataset(name, data=array, chunks=chunk, maxshape=room, fletcher32=True)
