"""Writing of HDF5 files atomically and with checksums, and checked reading of HDF5 files of unknown origin.

A file is complete or absent. After writing, the file on disk is compared with the data in memory. Arrays have a
fletcher32 checksum; the format of HDF5 1.10 has checksums for everything else (attributes, indices).

A large snapshot or checkpoint may consist of several files (`parts.py`): the parts have the rows of particles, and the
master file has virtual datasets that refer to these rows.
"""

from __future__ import annotations

import errno
import hashlib
import io
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np

from discsim.numerics.entries import EntryError
from discsim.output import files
from discsim.output.files import command_line, replace_atomically
from discsim.printable import printable
from discsim.scene.units import clipped
from discsim.userfiles import open_plain
from discsim.version import __version__

_CHUNK = 1 << 16  # rows per chunk; HDF5 reads and checks whole chunks
_BLOCK = 1 << 24  # bytes per block when a file is verified
ALL = slice(None)
# A digest and, before it, this mark may stand at the end of a file; HDF5 ignores both.
_DIGEST_MARK = b"\ndiscsim: sha256 of all before this line "
SIZE_KEEPING_FILTERS = {h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
MAX_COMPRESSION = 1100  # largest accepted compression ratio; the deflate algorithm reaches 1032
LARGEST_CHUNK, LARGEST_ATTRIBUTE = 1 << 24, 1 << 20  # bytes
MAX_SPARSENESS = 1000  # largest accepted ratio of a file's size to its space on disk, against sparse files
PART_NAMES = "parts"  # attribute of a master: names of its parts
FILE_ID = "made"  # attribute of a master and its parts: a text that no other file has


@contextmanager
def create(path: str | os.PathLike[str], backup: Path | None = None) -> Iterator[h5py.File]:
    """Yield a new file in memory; when the block ends without an exception, write it to `path`.

    HDF5 may crash on a full disk, so it does not write to the disk itself. An existing file at `path` is replaced,
    or with `backup` renamed to `backup`; after an exception the existing file is unchanged. Raises OSError if
    writing fails, or if the bytes on disk differ from the data.
    """
    content = io.BytesIO()
    with new_in_memory(content) as file:
        yield file
    write_verified(path, content, backup)


def new_in_memory(content: io.BytesIO) -> h5py.File:
    """Return a new HDF5 file whose bytes are stored in `content`."""
    return h5py.File(content, "w", libver=("v110", "v110"))


def write_verified(path: str | os.PathLike[str], content: io.BytesIO, backup: Path | None = None) -> None:
    """Write the bytes in `content` to `path`, atomically and verified; `backup` and errors are as in `create`."""
    with replace_atomically(path, backup=backup) as temporary:
        with temporary.open("wb") as plain:
            plain.write(content.getbuffer())
            plain.flush()
            os.fsync(plain.fileno())
        if not _has_bytes(temporary, np.frombuffer(content.getbuffer(), np.uint8)):
            raise OSError(errno.EIO, "the file on disk differs from the data written", str(path))


def append_digest(content: io.BytesIO) -> None:
    """Append to the bytes in `content` their SHA-256 digest, which `open_checked` checks.

    HDF5 has no checksum for the file names in virtual datasets, and may crash on a bit error in them.
    """
    digest = hashlib.sha256(content.getbuffer()).digest()
    content.seek(0, os.SEEK_END)
    content.write(_DIGEST_MARK + digest)


def _check_digest(file: IO[bytes]) -> None:
    """Raise OSError if there is a digest at the end of a file, and it does not match the content of the file."""
    length = file.seek(0, os.SEEK_END) - len(_DIGEST_MARK) - hashlib.sha256().digest_size
    file.seek(max(length, 0))
    if file.read(len(_DIGEST_MARK)) != _DIGEST_MARK:
        return
    digest = file.read()
    file.seek(0)
    if hashlib.sha256(file.read(length)).digest() != digest:
        raise OSError("its checksum is wrong, so the file was changed after it was written")


def _has_bytes(path: Path, content: np.ndarray) -> bool:
    """Return whether the file at `path` has the bytes `content`.

    If possible, the file is read from disk, not from memory.
    """
    position = 0
    with path.open("rb") as file:
        if hasattr(os, "posix_fadvise"):
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
        while block := file.read(_BLOCK):
            if not np.array_equal(np.frombuffer(block, np.uint8), content[position : position + len(block)]):
                return False
            position += len(block)
    return position == len(content)


class CheckedDataset:
    """A dataset of numbers or truth values in a file of unknown origin; its type, shape and size are checked.

    Its rows are in the file itself or in the file's parts. `kinds` are the allowed dtype kinds of numpy, `row_shape` is
    the shape of a row (None: any shape). Raises EntryError for another type or shape, for rows in another file, for
    chunks that are too large, or if the dataset declares more rows than the file can contain.
    """

    def __init__(self, stored: h5py.Dataset, name: str, kinds: str, row_shape: tuple[int, ...] | None) -> None:
        self._stored, self.name, shape = stored, name, stored.shape
        if shape is None or len(shape) == 0 or (row_shape is not None and shape[1:] != row_shape):
            wanted = ", ".join(map(str, ("n", *(row_shape or ()))))
            raise EntryError(f"{name} has shape {shape}; expected the shape ({wanted}{',' if not row_shape else ''})")
        self.dtype, self.shape = stored.dtype, tuple(map(int, shape))
        if self.dtype.kind not in kinds or self.dtype.subdtype is not None:
            wanted = "numbers" if "f" in kinds else "truth values" if kinds == "b" else "whole numbers"
            raise EntryError(f"{name} has the type {self.dtype}; expected {wanted}")
        if stored.external:
            raise EntryError(
                f"{name} is stored in other files ({clipped(stored.external[0][0])}); "
                "expected all its rows in this file"
            )
        if not stored.is_virtual:
            self._check_size()

    def __len__(self) -> int:
        return self.shape[0]

    def _check_size(self) -> None:
        """Raise EntryError if the rows need more bytes than the file has, or if a chunk is too large."""
        stored, size = self._stored, math.prod(self.shape) * self.dtype.itemsize
        creation, stored_size = stored.id.get_create_plist(), stored.id.get_storage_size()
        filters = {creation.get_filter(number)[0] for number in range(creation.get_nfilters())}
        limit = stored_size if filters <= SIZE_KEEPING_FILTERS else MAX_COMPRESSION * stored_size
        if size > limit or stored_size > Path(stored.file.filename).stat().st_size:
            raise EntryError(
                f"{self.name} declares {len(self)} rows, {size} bytes, but the stored data has {stored_size} bytes; "
                "expected equal sizes"
            )
        if stored.chunks and math.prod(stored.chunks) * self.dtype.itemsize > max(size, LARGEST_CHUNK):
            raise EntryError(
                f"{self.name} has chunks of shape {stored.chunks}; "
                f"expected chunks of at most {max(size, LARGEST_CHUNK)} bytes"
            )

    def text(self, name: str) -> str:
        """Return an attribute as text."""
        return decode_text(attribute_of(self._stored, name), f"{self.name}@{name}")

    def read(self, rows: slice = ALL) -> np.ndarray:
        """Return the selected rows in native byte order. Raises EntryError or OSError if they cannot be read.

        Rows of virtual datasets are read from the parts directly, because HDF5 returns zeros for a missing part.
        """
        out = self._read_from_parts(rows) if self._stored.is_virtual else np.asarray(self._stored[rows])
        if out.dtype.kind == "b" and out.size and out.view(np.uint8).max() > 1:
            raise EntryError(f"{self.name} contains numbers other than 0 and 1; expected truth values")
        return out.astype(out.dtype.newbyteorder("="), copy=False)

    def _read_from_parts(self, rows: slice) -> np.ndarray:
        """Return rows of a virtual dataset from the files of its parts. Raises EntryError, OSError."""
        first, last, _ = rows.indices(len(self))
        out = np.empty((max(last - first, 0), *self.shape[1:]), self.dtype)
        master = CheckedGroup(self._stored.file)
        parts = parts_of(master)
        if not parts:
            wrong = "refers to rows in other files, but this file names no parts"
            raise EntryError(f"{self.name} {wrong}; expected an unchanged snapshot or checkpoint of discsim")
        file_id = master.text(FILE_ID)
        path, end = self._stored.name, 0
        for source in self._stored.virtual_sources():
            begin = end
            (low, *_), (high, *_) = source.vspace.get_select_bounds()
            end = high + 1
            part = Path(self._stored.file.filename).parent / source.file_name
            if low != begin or part not in parts or source.dset_name != path:
                wrong = f"{self.name} has rows in {clipped(source.file_name)}"
                raise EntryError(f"{wrong}; expected its rows in the part files that this file names")
            one, other = max(first, begin), min(last, end)
            if one < other:
                with _open_part(part, file_id) as held:
                    found = held.dataset_at(path, self.dtype.kind, self.shape[1:])
                    if len(found) != end - begin or found.dtype != self.dtype:
                        raise EntryError(f"part file {part}: {path} has {len(found)} rows; expected {end - begin} rows")
                    out[one - first : other - first] = found.read(slice(one - begin, other - begin))
        if end != len(self):
            raise EntryError(
                f"{self.name} has {len(self)} rows, but the part files have {end} rows; expected equal numbers"
            )
        return out


class CheckedGroup:
    """A group in a file of unknown origin; its methods return entries by name, checked for type and shape.

    Soft and external links are not followed. A missing entry, or one of another type, raises EntryError.
    """

    def __init__(self, group: h5py.Group) -> None:
        self._group = group

    @property
    def folder(self) -> Path:
        """The folder that contains the file."""
        return Path(self._group.file.filename).parent

    def _name(self, name: str) -> str:
        """Return the path of an entry from the root of the file, for messages."""
        return f"{self._group.name.rstrip('/')}/{name}"

    def _child(self, name: str) -> Any:
        """Return the group or dataset `name`. Raises EntryError if it is missing or a link."""
        link = self._group.get(name, getlink=True)
        if link is None:
            raise EntryError(f"{self._name(name)} is missing in the file")
        if not isinstance(link, h5py.HardLink):
            raise EntryError(f"{self._name(name)} is a link to another object or file; expected the data")
        return self._group[name]

    def __contains__(self, name: str) -> bool:
        return self._group.get(name, getlink=True) is not None

    @property
    def names(self) -> list[str]:
        """The names of the groups and datasets in this group."""
        return list(self._group.keys())

    def names_with(self, attribute: str) -> list[str]:
        """Return the names of the groups and datasets in this group that have an attribute."""
        plain = (name for name in self.names if isinstance(self._group.get(name, getlink=True), h5py.HardLink))
        return [name for name in plain if attribute in self._group[name].attrs]

    def group(self, name: str) -> CheckedGroup:
        """Return the group `name` in this group."""
        found = self._child(name)
        if not isinstance(found, h5py.Group):
            raise EntryError(f"{self._name(name)} is not a group; expected a group")
        return CheckedGroup(found)

    def dataset(self, name: str, kinds: str = "biuf", row_shape: tuple[int, ...] | None = None) -> CheckedDataset:
        """Return the dataset `name`, with a dtype kind in `kinds` and rows of shape `row_shape` (None: any shape)."""
        found = self._child(name)
        if not isinstance(found, h5py.Dataset):
            raise EntryError(f"{self._name(name)} is not a dataset; expected a dataset")
        return CheckedDataset(found, self._name(name), kinds, row_shape)

    def rows(self, name: str, count: int, kinds: str = "f", row_shape: tuple[int, ...] | None = ()) -> np.ndarray:
        """Return the array `name`, which must have `count` rows; `kinds` and `row_shape` are as in `dataset`."""
        stored = self.dataset(name, kinds, row_shape)
        if len(stored) != count:
            raise EntryError(f"{stored.name} has {len(stored)} rows; expected {count} rows, as in the other columns")
        return stored.read()

    def dataset_at(self, path: str, kinds: str, row_shape: tuple[int, ...]) -> CheckedDataset:
        """Return the dataset at a path from the root of the file."""
        *groups, name = path.strip("/").split("/")
        held = self
        for each in groups:
            held = held.group(each)
        return held.dataset(name, kinds, row_shape)

    @property
    def attributes(self) -> list[str]:
        """The names of the attributes of this group."""
        return list(self._group.attrs)

    def attribute(self, name: str) -> Any:
        """Return the attribute `name`: a number, a truth value, bytes, or an array of these."""
        return attribute_of(self._group, name)

    def number(self, name: str) -> float:
        """Return the attribute `name`, a finite number."""
        return float(self.numbers(name, ()))

    def whole(self, name: str) -> int:
        """Return the attribute `name`, a whole number."""
        found = self.attribute(name)
        if np.ndim(found) != 0 or np.asarray(found).dtype.kind not in "iu":
            raise EntryError(f"{self._name(name)} is not an integer; expected a whole number")
        return int(found)

    def numbers(self, name: str, shape: tuple[int, ...], finite: bool = True) -> np.ndarray:
        """Return the attribute `name` as floats of the given shape; with `finite`, all numbers must be finite."""
        found = np.asarray(self.attribute(name))
        if found.dtype.kind not in "biuf" or found.shape != shape or not (np.isfinite(found).all() or not finite):
            wanted = "a finite number" if shape == () else f"finite numbers of shape {shape}"
            raise EntryError(f"{self._name(name)} has a wrong value; expected {wanted}")
        return found.astype(float)

    def text(self, name: str) -> str:
        """Return the attribute `name` as text."""
        return decode_text(self.attribute(name), self._name(name))

    def texts(self, name: str) -> list[str]:
        """Return the attribute `name`, an array of texts, as a list."""
        return [decode_text(each, self._name(name)) for each in np.atleast_1d(self.attribute(name))]


def attribute_of(owner: h5py.Group | h5py.Dataset, name: str) -> Any:
    """Return an attribute of a group or dataset: numbers or bytes, of limited size. Raises EntryError."""
    where = f"{owner.name.rstrip('/')}@{name}"
    if name not in owner.attrs:
        raise EntryError(f"{where} is missing in the file")
    found = owner.attrs.get_id(name)
    if found.shape is None or found.dtype.kind not in "biufS":
        raise EntryError(f"{where} has the type {found.dtype}; expected numbers or text")
    if math.prod(found.shape) * found.dtype.itemsize > LARGEST_ATTRIBUTE:
        raise EntryError(f"{where} has shape {found.shape}; expected at most {LARGEST_ATTRIBUTE} bytes")
    return owner.attrs[name]


def decode_text(value: Any, name: str) -> str:
    """Decode bytes as UTF-8 text. Raises EntryError with the `name` of the entry if this fails."""
    if not isinstance(value, bytes):
        raise EntryError(f"{name} is not text; expected text")
    try:
        return value.decode()
    except UnicodeDecodeError:
        raise EntryError(f"{name} is not UTF-8; expected text in UTF-8") from None


@contextmanager
def open_checked(path: str | os.PathLike[str]) -> Iterator[CheckedGroup]:
    """Open a plain HDF5 file of unknown origin for reading, and yield its root group.

    Raises OSError, and for a damaged file any exception of h5py.
    """
    with open_plain(path) as plain:
        there = os.fstat(plain.fileno())
        if there.st_size > MAX_SPARSENESS * max(getattr(there, "st_blocks", math.inf) * 512, _BLOCK):
            raise OSError(
                errno.EINVAL,
                f"is a sparse file with less data on disk than its size of {there.st_size} bytes",
                os.fspath(path),
            )
        _check_digest(plain)
    with h5py.File(path, "r") as file:
        yield CheckedGroup(file)


@contextmanager
def open_file_of_kind(path: str | os.PathLike[str], error: type[Exception], kind: str) -> Iterator[CheckedGroup]:
    """Open a file of discsim for reading, and yield its root group; `kind` names the kind of file, as in messages.

    Raises `error` with a message if the file is missing, damaged or of another kind, or if one of its parts is missing.
    Exceptions in the block that come from damaged data are converted to `error` too.
    """
    try:
        with open_checked(path) as file:
            found = file.attribute("discsim") if "discsim" in file.attributes else b""
            if found == b"checkpoint" and kind.encode() != found:
                raise error(f"{path}: a checkpoint, not a snapshot; restore it with Simulation.restore")
            if found != kind.encode():
                raise error(f"{path}: not a {kind} of discsim, but another HDF5 file; use a {kind} that discsim wrote")
            for part in parts_of(file):
                if not part.exists():
                    raise error(f"{path}: the part file {part} is missing; restore all part files of this {kind}")
            yield file
    except error:
        raise
    except FileNotFoundError:
        raise error(f"{path}: file not found; use the path of an existing {kind}") from None
    except PermissionError:
        raise error(f"{path}: permission denied; make the file readable") from None
    except MemoryError as fault:
        raise error(
            f"{path}: the file needs more memory than this machine has; use a machine with more memory"
        ) from fault
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, ArithmeticError) as fault:
        raise error(f"{path}: not a {kind}, or a damaged {kind}: {_reason_text(fault)}; use another {kind}") from fault


def write_provenance(file: h5py.File, kind: str) -> None:
    """Write attributes of `file`: its kind, and the version and command line of discsim."""
    file.attrs["discsim"] = np.bytes_(kind)
    file.attrs["version"] = np.bytes_(__version__)
    file.attrs["command"] = np.bytes_(os.fsencode(command_line()))


def write_array(group: h5py.Group, name: str, array: np.ndarray) -> h5py.Dataset:
    """Store `array` bit for bit as the dataset `name` of `group`, with a checksum; return the dataset."""
    array = np.atleast_1d(array)
    chunk = (min(max(len(array), 1), _CHUNK), *(max(n, 1) for n in array.shape[1:]))
    shape = array.shape if array.size else None
    # HDF5 allows a chunk longer than the array only if the array can grow.
    stored_size = array.shape if shape else (None,) * array.ndim
    return group.create_dataset(name, data=array, chunks=chunk, maxshape=stored_size, fletcher32=True)


def parts_of(file: CheckedGroup) -> list[Path]:
    """Return the paths of the parts of a master file; [] for a file without parts. Raises EntryError."""
    if PART_NAMES not in file.attributes:
        return []
    found = [os.fsdecode(name) for name in np.atleast_1d(file.attribute(PART_NAMES)).tolist()]
    for name in found:
        folder, _, last = name.partition("/")
        if folder != files.PARTS or last in ("", ".", "..") or "/" in last or "\0" in last:
            raise EntryError(f"a part file has the name {clipped(name)}; expected a name like {files.PARTS}/0003.0.h5")
    return [file.folder / name for name in found]


@contextmanager
def _open_part(path: Path, file_id: str) -> Iterator[CheckedGroup]:
    """Open a part for reading, and yield its root group. `file_id` is the attribute FILE_ID of its master.

    Raises OSError if the part is damaged, or belongs to another master.
    """
    try:
        with open_checked(path) as file:
            if file.text(FILE_ID) != file_id:
                raise OSError(
                    "the part file belongs to another snapshot or checkpoint; "
                    "expected the part file that was written with this file"
                )
            yield file
    except (OSError, LookupError, ValueError, RuntimeError) as fault:
        raise OSError(f"part file {path}: {_reason_text(fault)}") from fault


def _reason_text(fault: Exception) -> str:
    """Return the first line of an error as printable text, or a general text for an internal error of h5py."""
    if not isinstance(fault, OSError | EntryError):
        return "the data in the file cannot be read"
    line = (getattr(fault, "strerror", None) or str(fault)).partition("\n")[0]
    return printable(line)
