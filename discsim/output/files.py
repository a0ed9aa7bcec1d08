"""Files that are whole or absent, also after a power cut: on the disk before they get their name, and the name too."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PARTS = "parts"  # the folder of files that belong to others beside it, `parts.py`
MAIN = Path(__file__).parents[1] / "__main__.py"  # what `python -m discsim` runs


@contextmanager
def written(path: str | os.PathLike[str], ending: str = "", before: Path | None = None) -> Iterator[Path]:
    """Where to write what appears at `path` once it is complete; an exception leaves what was there before.

    ending: of the name beside it, for who tells a format by that. before: where what was there stays.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part{ending}")
    try:
        yield temporary
        keep(temporary)  # else a power cut may leave the new name with no content
        if before is not None and path.exists():
            os.replace(path, before)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):  # as of a disk that is gone: the first fault is the one to tell
            temporary.unlink(missing_ok=True)
        raise
    keep_names(path.parent)


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
