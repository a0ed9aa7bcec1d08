"""Directory of a run: checks of its contents, copies of input files, and a lock against other processes."""

from __future__ import annotations

import errno
import os
import socket
import stat
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from discsim.output.files import PARTS, fsync_directory, replace_atomically
from discsim.parts import Lazy
from discsim.printable import UserError
from discsim.scene import Scene, tomltext
from discsim.scene.loading import files_of
from discsim.userfiles import read_plain, system_message

try:
    import fcntl
except ImportError:  # a system without flock
    fcntl = None

parts = Lazy("discsim.output.parts")  # imports h5py
CHECKPOINTS = ("checkpoint.h5", "checkpoint_before.h5")  # files of the last checkpoint, and of the one before it
RUN_FILES = ("scene.toml", *CHECKPOINTS, "snapshots")
# Errors of flock on file systems without locks.
FLOCK_UNSUPPORTED = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)
# Errors of open on a link, a directory or a socket in place of a lock.
NOT_A_PLAIN_FILE = (errno.ELOOP, errno.EISDIR, errno.ENXIO)
LOCK_MESSAGE = (
    "is not a plain file, but runs use the name for their lock file; remove what has this name, "
    "or use another directory"
)

_locks: set[int] = set()  # descriptors of the locks that this process holds


def _close_inherited_locks() -> None:
    """Close lock files inherited by a fork: a child that outlives its killed parent must not keep the locks."""
    while _locks:
        os.close(_locks.pop())


if fcntl is not None:
    os.register_at_fork(after_in_child=_close_inherited_locks)


class DirectoryError(UserError):
    """Error for a directory that a run cannot use; the message gives the reason."""


def directory_fault(directory: Path, resume: bool) -> str | None:
    """Return why a run cannot write to `directory`; None if it can."""
    try:
        nearest = next(parent for parent in (directory, *directory.absolute().parents) if parent.exists())
        if not nearest.is_dir():
            return f"{directory}: {nearest} is a file; choose another directory with -o"
        if not os.access(nearest, os.W_OK | os.X_OK):
            return f"{directory}: {nearest} is not writable; expected a writable directory"
        left = [name for name in RUN_FILES if (directory / name).exists()]
    except OSError as error:
        return f"{directory}: {error.strerror}; expected a writable directory"
    begun = ended_before_checkpoint(directory)
    if resume and not {*CHECKPOINTS} & {*left} and not begun:
        return f"{directory}: there is no checkpoint.h5 to resume from; give the directory of an earlier run"
    if left and not resume:
        holds = f"{directory}: already contains a run ({', '.join(left)})"
        if begun:
            return (
                f"{holds}, without a checkpoint; choose another directory, or add --resume to restart the run "
                "from the beginning"
            )
        way_on = ", or add --resume" if {*CHECKPOINTS} & {*left} else ""
        return f"{holds}; choose another directory{way_on}"
    return None


def require_usable_directory(directory: Path, resume: bool) -> None:
    """Raise DirectoryError if a run cannot write to `directory`."""
    fault = directory_fault(directory, resume)
    if fault:
        raise DirectoryError(fault)


def read_scene_file(directory: Path) -> bytes:
    """Return the contents of scene.toml in the directory of an earlier run. Raises DirectoryError."""
    path = directory / "scene.toml"
    try:
        return read_plain(path)
    except OSError as fault:
        remedy = "restore the scene of the run, or use another directory"
        raise DirectoryError(f"{system_message(fault, 'read', path)}; {remedy}") from None


def copy_input_files(scene: Scene, directory: Path, made: list[Path]) -> Scene:
    """Copy the input files named in a scene into `directory`, so that the run needs no files from elsewhere.

    Parameters
    ----------
    scene
        Scene as it was loaded.
    directory
        Directory of the run.
    made
        List to which the path of each new file is appended before the file is made. After an exception the caller has
        to remove these files.

    Returns
    -------
    Scene
        Scene that names the copies.

    Raises
    ------
    OSError
        A copy cannot be written.
    UserError
        A file cannot be read.
    """
    data: dict[str, Any] = tomllib.loads(scene.text)
    values: list[tuple[list[str], str]] = []
    update: dict[str, Any] = {}
    for table, key, file in files_of(dict(scene)):
        path = directory / f"{table}{file.path.suffix}"
        if file.path != path.absolute():
            made += [] if os.path.lexists(path) else [path]
            with replace_atomically(path) as temporary:
                parts.copy(file.path, path, temporary, made)
        values.append(([table, key], path.name))
        tomltext.set_value(data, [table, key], path.name)
        update[table] = scene.table(table).model_copy(update={key: replace(file, path=path.absolute())})
    if not values:
        return scene
    return scene.model_copy(update={**update, "text": tomltext.edit(scene.text, data, values, [])})


def remove_copies(made: list[Path]) -> None:
    """Remove the files and folders `made` by `copy_input_files` for a run that did not begin."""
    for path in reversed(made):
        with suppress(OSError):  # the fault that stopped the run is reported instead
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink(missing_ok=True)


def ended_before_checkpoint(directory: Path) -> bool:
    """Return whether `directory` has a run that stopped before its first checkpoint.

    Such a run has a scene.toml, no checkpoint, and at most the first snapshot.
    """
    if any((directory / name).exists() for name in CHECKPOINTS) or not (directory / "scene.toml").exists():
        return False
    return {path.name for path in directory.glob("snapshots/*.h5")} <= {"0000.h5"}


@contextmanager
def locked_directory(directory: Path) -> Iterator[bool]:
    """Lock `directory` against other processes within the context.

    Yield True, or False if the file system has no locks. The directory is made if absent, and removed at the end if it
    is still empty. The lock is released even if the process is killed. Raises DirectoryError if another process holds
    the lock, and OSError.
    """
    absent = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    directory.mkdir(parents=True, exist_ok=True)
    for folder in absent:
        fsync_directory(folder.parent)
    path = directory / ".lock"
    file = _lock_file(path)
    try:
        yield file is not None
    finally:
        with suppress(OSError):  # the disk may be gone; the end of the process releases the lock anyway
            if file in _locks:
                _locks.remove(file)
                path.unlink(missing_ok=True)
                os.close(file)
            for folder in absent:
                folder.rmdir()  # fails for a folder with files; a run that wrote nothing leaves no folder


def _lock_file(path: Path) -> int | None:
    """Lock the file at `path`, and return its descriptor; None if the file system has no locks.

    The process writes its number and host into the file, for messages of other processes.
    """
    while fcntl is not None:
        file, is_ours = _open_lock_file(path)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_file_at(file, path):
                if is_ours:
                    os.ftruncate(file, 0)
                    os.write(file, f"process {os.getpid()} on {socket.gethostname()} since {time.ctime()}".encode())
                _locks.add(file)
                return file
            os.close(file)  # its holder ended and removed it after we had opened it
        except OSError as fault:
            holder = os.read(file, 200).decode(errors="replace") or "another process"
            os.close(file)
            if isinstance(fault, BlockingIOError):
                remedy = "use another directory, or wait until that run has ended"
                raise DirectoryError(f"{path.parent}: another run uses this directory ({holder}); {remedy}") from None
            if fault.errno not in FLOCK_UNSUPPORTED:
                raise
            path.unlink(missing_ok=True)
            break
    return None


def _open_lock_file(path: Path) -> tuple[int, bool]:
    """Open the lock file at `path`; return its descriptor, and whether the file can be written.

    A lock file of another user may be read-only, but it can still be locked. A link is not followed, as its target
    would be emptied. Raises DirectoryError, OSError.
    """
    flags = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        file, is_ours = os.open(path, os.O_RDWR | os.O_CREAT | flags, 0o666), True
    except PermissionError:
        try:
            file, is_ours = os.open(path, os.O_RDONLY | flags), False
        except PermissionError:
            remedy = "use another directory, or remove the file after that user's run has ended"
            raise DirectoryError(f"{path}: this lock belongs to another user and cannot be opened; {remedy}") from None
    except OSError as fault:
        if fault.errno not in NOT_A_PLAIN_FILE:
            raise
        raise DirectoryError(f"{path}: {LOCK_MESSAGE}") from None
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise DirectoryError(f"{path}: {LOCK_MESSAGE}")
    return file, is_ours


def _is_file_at(file: int, path: Path) -> bool:
    """Return whether the descriptor `file` refers to the file that is now at `path`."""
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def remove_partial_files(directory: Path) -> None:
    """Remove half-written files of killed runs from `directory`. The caller must hold the lock of the directory."""
    folders = directory, directory / "snapshots"
    for folder in (*folders, *(folder / PARTS for folder in folders)):
        for part in (*folder.glob(".*.part"), *folder.glob(".*.part.png")):
            part.unlink()
