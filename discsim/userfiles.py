"""Reading and copying of plain files from users or runs, with a size limit for text, and messages for errors.

FIFOs and devices are refused before they are opened: reading them could block, or never end.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
import stat
from pathlib import Path

from discsim.printable import UserError

LARGEST_TEXT = 2**26  # largest text file in bytes: about a history of a million rows
KIND_NAMES = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a directory",
    stat.S_IFLNK: "a symbolic link",
}
TOO_MANY_OPEN = (errno.EMFILE, errno.ENFILE)


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
    _refuse_special(os.stat(path).st_mode, path)
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # does not block if the path has become a FIFO
    try:
        _refuse_special(os.fstat(file).st_mode, path)
    except OSError:
        os.close(file)
        raise
    return os.fdopen(file, "rb")


def read_plain(path: str | os.PathLike[str], most: int = LARGEST_TEXT) -> bytes:
    """Return the content of a plain file. Raises OSError if the file cannot be read or has more than `most` bytes."""
    with open_plain(path) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, f"is larger than {most >> 20} MiB", str(path))
    return content


def read_text(path: str | os.PathLike[str], errors: str = "strict", most: int = LARGEST_TEXT) -> str:
    """Return the text of a plain UTF-8 file, with Unix line breaks.

    errors: treatment of invalid bytes, as in `bytes.decode`. most: largest allowed size in bytes. Raises OSError as
    `read_plain`, and UnicodeDecodeError.
    """
    return read_plain(path, most).decode("utf-8", errors).replace("\r\n", "\n")


def copy_plain(path: Path, to: Path) -> None:
    """Copy the plain file `path` to `to`. Raises UserError if `path` cannot be read, and OSError for faults of `to`."""
    try:
        source = open_plain(path)
    except OSError as fault:
        raise UserError(system_message(fault, "read", path)) from None
    with source, to.open("wb") as target:
        shutil.copyfileobj(source, target, 1 << 20)  # on a full disk, errors of `copyfile` name the source


def system_message(fault: OSError, verb: str, path: Path | str) -> str:
    """Return a message about an OSError, such as "PATH: cannot be written: No space left on device".

    Parameters
    ----------
    fault
        Exception of the system.
    verb
        Past participle of the failed action, like "written".
    path
        File to name in the message if the exception names none.

    Returns
    -------
    str
        One line without a full stop at the end.
    """
    if fault.errno in TOO_MANY_OPEN:
        return "too many open files in this process; raise the limit, for example: ulimit -n 1024"
    reason = (fault.strerror or str(fault)).partition("\n")[0]
    return f"{fault.filename or path}: cannot be {verb}: {reason}"


def kind_of(mode: int) -> str:
    """Return the kind of a file that is not plain, such as "a FIFO", from its `st_mode`."""
    return KIND_NAMES.get(stat.S_IFMT(mode), "a file of unknown type")


def _refuse_special(mode: int, path: str | os.PathLike[str]) -> None:
    """Raise OSError unless `mode`, the `st_mode` of the file at `path`, is that of a plain file."""
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "is a directory, not a plain file", str(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"is {kind_of(mode)}, not a plain file", str(path))
