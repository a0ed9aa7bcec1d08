"""Small files that a user names or a run has left: plain files of a bounded size, whose faults have words.

A FIFO would be waited for without end, and a device read without end; neither is opened.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
import stat
from pathlib import Path

from discsim.printable import UserError

LARGEST_TEXT = 2**26  # bytes of a text: a history of a million rows has as many
KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a directory",
    stat.S_IFLNK: "a symbolic link",
}
NO_HANDLES = (errno.EMFILE, errno.ENFILE)


def open_plain(path: str | os.PathLike[str]) -> io.BufferedReader:
    """Open a plain file for reading.

    Parameters
    ----------
    path
        File; a symbolic link is followed.

    Raises
    ------
    OSError
        The file cannot be opened, or is a directory, FIFO, socket or device.
    """
    _refuse_odd(os.stat(path).st_mode, path)
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # never waits, should a FIFO have taken its place
    try:
        _refuse_odd(os.fstat(file).st_mode, path)
    except OSError:
        os.close(file)
        raise
    return os.fdopen(file, "rb")


def read_plain(path: str | os.PathLike[str], most: int = LARGEST_TEXT) -> bytes:
    """Read a plain file of at most `most` bytes. Raises OSError."""
    with open_plain(path) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, f"is larger than {most >> 20} MiB", str(path))
    return content


def read_text(path: str | os.PathLike[str], errors: str = "strict", most: int = LARGEST_TEXT) -> str:
    """Read a plain file of UTF-8, with the line breaks of Unix. Raises OSError, UnicodeDecodeError."""
    return read_plain(path, most).decode("utf-8", errors).replace("\r\n", "\n")


def copy_plain(path: Path, to: Path) -> None:
    """Copy a plain file. Raises UserError where it cannot be read, OSError where the copy cannot be written."""
    try:
        source = open_plain(path)
    except OSError as fault:
        raise UserError(system_message(fault, "read", path)) from None
    with source, to.open("wb") as target:
        shutil.copyfileobj(source, target, 1 << 20)  # a fault of `copyfile` names the source on a full disk


def system_message(fault: OSError, verb: str, path: Path | str) -> str:
    """Words for a refusal by the system: "PATH: cannot be written: no space left on device".

    Parameters
    ----------
    fault
        Exception of the system.
    verb
        Participle of what was to be done with the file.
    path
        File for the message, where the exception names none.
    """
    if fault.errno in NO_HANDLES:
        return "too many files are open for this process; expected a higher limit, as by: ulimit -n 1024"
    reason = (fault.strerror or str(fault)).partition("\n")[0]
    return f"{fault.filename or path}: cannot be {verb}: {reason}"


def kind_of(mode: int) -> str:
    """The kind of what is no plain file, in words."""
    return KINDS.get(stat.S_IFMT(mode), "of an unknown kind")


def _refuse_odd(mode: int, path: str | os.PathLike[str]) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "is a directory, no plain file", str(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"is {kind_of(mode)}, no plain file", str(path))
