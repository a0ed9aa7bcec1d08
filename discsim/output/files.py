"""Files that are whole or absent, also after a power cut: on the disk before they get their name, and the name too.

Only plain files are replaced or appended to. What else has a name, a directory, FIFO, device or symbolic link, is not
ours to remove, and writing through a link could replace a file elsewhere.
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

PARTS = "parts"  # the folder of files that belong to others beside it, `parts.py`
MAIN = Path(__file__).parents[1] / "__main__.py"  # what `python -m discsim` runs


def refuse_special(path: str | os.PathLike[str]) -> None:
    """Raise OSError where a file cannot take the place of what is at `path`: that exists and is no plain file."""
    with suppress(FileNotFoundError):
        mode = os.lstat(path).st_mode
        if not stat.S_ISREG(mode):
            wrong = f"is {kind_of(mode)}; expected a plain file there, or a new name"
            raise OSError(errno.EINVAL, wrong, os.fspath(path))


@contextmanager
def written(path: str | os.PathLike[str], ending: str = "", before: Path | None = None) -> Iterator[Path]:
    """Where to write what appears at `path` once it is complete; an exception leaves what was there before.

    ending: of the name beside it, for who tells a format by that. before: where what was there stays. Raises OSError
    where either exists and is no plain file.
    """
    path = Path(path)
    for target in (path, *([before] if before is not None else [])):
        refuse_special(target)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part{ending}")
    try:
        yield temporary
        keep(temporary)  # else a power cut may leave the new name with no content
        refuse_special(path)
        if before is not None and path.exists():
            os.replace(path, before)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):  # as of a disk that is gone: the first fault is the one to tell
            temporary.unlink(missing_ok=True)
        raise
    keep_names(path.parent)


def appended(path: str | os.PathLike[str], buffering: int = -1) -> Any:
    """A plain file of bytes, open for appending. Raises OSError for any other."""
    refuse_special(path)
    return Path(path).open("ab", buffering)


def renamed(old: Path, new: Path) -> None:
    """Put the file `old` in the place of `new`."""
    os.replace(old, new)
    keep_names(new.parent)


def keep_names(directory: Path) -> None:
    """Have the names in a directory on the disk, where its file system can be asked for that."""
    with suppress(OSError):
        keep(directory)


def keep(path: Path) -> None:
    """Have what a file holds on the disk."""
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def command() -> str:
    """The command line of this process, as a shell takes it."""
    program, *arguments = sys.argv or [""]
    ours = Path(program).name == "discsim" or Path(program) == MAIN
    return shlex.join(["discsim" if ours else program, *arguments])
