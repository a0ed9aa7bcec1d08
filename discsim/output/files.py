"""Atomic writing: after a crash or a power cut a file is either complete or absent.

The content is synchronised to disk before the file is renamed, and the directory after the renaming.

Only plain files are replaced or appended to. Directories, FIFOs, devices and symbolic links raise OSError: discsim
did not create them, and writing through a link could replace a file elsewhere.
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

PARTS = "parts"  # name of the folder for parts of snapshots and checkpoints (`output/parts.py`)
MAIN = Path(__file__).parents[1] / "__main__.py"  # what `python -m discsim` runs


def refuse_special(path: str | os.PathLike[str]) -> None:
    """Raise OSError if `path` exists but is no plain file."""
    with suppress(FileNotFoundError):
        mode = os.lstat(path).st_mode
        if not stat.S_ISREG(mode):
            wrong = f"is {kind_of(mode)}; expected a plain file there, or a new name"
            raise OSError(errno.EINVAL, wrong, os.fspath(path))


@contextmanager
def replace_atomically(path: str | os.PathLike[str], ending: str = "", before: Path | None = None) -> Iterator[Path]:
    """Yield a temporary path to write to; rename it to `path` when the block ends without an exception.

    `ending` is the suffix of the temporary name, for libraries that choose a format by the suffix. An existing file
    at `path` is replaced, or renamed to `before`. Raises OSError if `path` or `before` exists but is no plain file.
    """
    path = Path(path)
    for target in (path, *([before] if before is not None else [])):
        refuse_special(target)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part{ending}")
    try:
        yield temporary
        keep(temporary)  # otherwise a power cut could leave an empty file
        refuse_special(path)
        if before is not None and path.exists():
            os.replace(path, before)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):  # the first error is the one to report
            temporary.unlink(missing_ok=True)
        raise
    fsync_directory(path.parent)


def appended(path: str | os.PathLike[str], buffering: int = -1) -> Any:
    """Open a plain file for appending bytes. Raises OSError for any other kind of file."""
    refuse_special(path)
    return Path(path).open("ab", buffering)


def renamed(old: Path, new: Path) -> None:
    """Rename the file `old` to `new`, replacing `new`."""
    os.replace(old, new)
    fsync_directory(new.parent)


def fsync_directory(directory: Path) -> None:
    """Synchronise a directory to disk, if its file system supports that."""
    with suppress(OSError):
        keep(directory)


def keep(path: Path) -> None:
    """Synchronise the content of a file to disk."""
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def command() -> str:
    """Return the command line of this process, quoted for a shell, with the program as "discsim"."""
    program, *arguments = sys.argv or [""]
    ours = Path(program).name == "discsim" or Path(program) == MAIN
    return shlex.join(["discsim" if ours else program, *arguments])
