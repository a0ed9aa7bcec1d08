"""Atomic writing: after a crash or a power cut a file is either complete or absent.

The content is synchronised to disk before the file is renamed, and the directory after the renaming.

Only plain files are replaced or appended to. For directories, FIFOs, devices and symbolic links, functions raise
OSError: discsim did not create them, and writing through a link could replace a file elsewhere.
"""

from __future__ import annotations

import errno
import os
import shlex
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from discsim.userfiles import kind_of

PARTS = "parts"  # name of the folder with the parts of snapshots and checkpoints (`output/parts.py`)
MAIN = Path(__file__).parents[1] / "__main__.py"  # the program that `python -m discsim` runs


def refuse_special(path: str | os.PathLike[str]) -> None:
    """Raise OSError if `path` exists but is not a plain file."""
    with suppress(FileNotFoundError):
        mode = os.lstat(path).st_mode
        if not stat.S_ISREG(mode):
            wrong = f"is {kind_of(mode)}; choose the name of a plain file or of a new file"
            raise OSError(errno.EINVAL, wrong, os.fspath(path))


@contextmanager
def replace_atomically(path: str | os.PathLike[str], ending: str = "", backup: Path | None = None) -> Iterator[Path]:
    """Yield a temporary path, where the block writes a file; rename the file to `path` at the end of the block.

    After an exception the temporary file is removed instead. `ending` is the suffix of the temporary path, for
    libraries that choose a format by the suffix. An existing file at `path` is replaced, or with `backup` renamed to
    `backup`. Raises OSError if `path` or `backup` exists but is not a plain file.
    """
    path = Path(path)
    for target in (path, *([backup] if backup is not None else [])):
        refuse_special(target)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part{ending}")
    try:
        yield temporary
        fsync_file(temporary)  # otherwise a power cut could leave an empty file
        refuse_special(path)
        if backup is not None and path.exists():
            os.replace(path, backup)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):  # the first error is the one to report
            temporary.unlink(missing_ok=True)
        raise
    fsync_directory(path.parent)


def open_to_append(path: str | os.PathLike[str], buffering: int = -1) -> Any:
    """Open a plain file for appending bytes. Raises OSError for any other kind of file."""
    refuse_special(path)
    return Path(path).open("ab", buffering)


def rename_file(old: Path, new: Path) -> None:
    """Rename the file `old` to `new`, and synchronise the folder of `new` to disk. A file at `new` is replaced."""
    os.replace(old, new)
    fsync_directory(new.parent)


def fsync_directory(directory: Path) -> None:
    """Synchronise the entries of a directory to disk, if the file system supports this."""
    with suppress(OSError):
        fsync_file(directory)


def fsync_file(path: Path) -> None:
    """Synchronise the content of a file to disk."""
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def command_line() -> str:
    """Return the command line of this process, quoted for a shell; discsim's own program is called "discsim"."""
    program, *arguments = sys.argv or [""]
    is_discsim = Path(program).name == "discsim" or Path(program) == MAIN
    return shlex.join(["discsim" if is_discsim else program, *arguments])
