"""Directory of a run: its contents, and the lock that admits one process."""

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
CHECKPOINTS = ("checkpoint.h5", "checkpoint_before.h5")  # the last one, and the one before it
LEFT_BY_A_RUN = ("scene.toml", *CHECKPOINTS, "snapshots")
# Errors of flock on file systems without locks.
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)
# Errors of open on a link, a directory or a socket in place of a lock.
NO_LOCK_FILE = (errno.ELOOP, errno.EISDIR, errno.ENXIO)
NO_LOCK = (
    "is not a plain file, but runs use this name for their lock; expected another directory, or this entry removed"
)

_locks: set[int] = set()  # descriptors of the locks that this process holds


def _let_go() -> None:
    """Close inherited locks, as a child that outlives its killed parent must not keep them."""
    while _locks:
        os.close(_locks.pop())


if fcntl is not None:
    os.register_at_fork(after_in_child=_let_go)


class DirectoryError(UserError):
    """Directory that a run cannot use as it is; the message says why."""


def directory_fault(directory: Path, resume: bool) -> str | None:
    """Return why a run cannot write to `directory`; None if it can."""
    try:
        nearest = next(parent for parent in (directory, *directory.absolute().parents) if parent.exists())
        if not nearest.is_dir():
            return f"{directory}: {nearest} is a file; expected a directory"
        if not os.access(nearest, os.W_OK | os.X_OK):
            return f"{directory}: {nearest} is not writable; expected a writable directory"
        left = [name for name in LEFT_BY_A_RUN if (directory / name).exists()]
    except OSError as error:
        return f"{directory}: {error.strerror}; expected a writable directory"
    begun = only_begun(directory)
    if resume and not {*CHECKPOINTS} & {*left} and not begun:
        return f"{directory}: there is no checkpoint.h5 to resume from; expected the directory of an earlier run"
    if left and not resume:
        holds = f"{directory}: already contains a run ({', '.join(left)})"
        if begun:
            return (
                f"{holds}, without a checkpoint; expected another directory, or --resume, which restarts it "
                "from the beginning"
            )
        way_on = ", or --resume" if {*CHECKPOINTS} & {*left} else ""
        return f"{holds}; expected another directory{way_on}"
    return None


def refuse_directory(directory: Path, resume: bool) -> None:
    """Raise DirectoryError if a run cannot write to a directory."""
    fault = directory_fault(directory, resume)
    if fault:
        raise DirectoryError(fault)


def scene_there(directory: Path) -> bytes:
    """Return the contents of the scene file that a run has left in a directory. Raises DirectoryError."""
    path = directory / "scene.toml"
    try:
        return read_plain(path)
    except OSError as fault:
        wanted = "expected the scene of the run, or another directory"
        raise DirectoryError(f"{system_message(fault, 'read', path)}; {wanted}") from None


def with_own_files(scene: Scene, directory: Path, made: list[Path]) -> Scene:
    """Copy the files that a scene names into `directory`, so that the run there needs nothing else.

    Parameters
    ----------
    scene
        Scene as it was loaded.
    directory
        Directory of the run.
    made
        Receives the paths that were absent before, each before its file is made. After an exception the caller has to
        remove them.

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
        tomltext.with_value(data, [table, key], path.name)
        update[table] = scene.table(table).model_copy(update={key: replace(file, path=path.absolute())})
    if not values:
        return scene
    return scene.model_copy(update={**update, "text": tomltext.edited(scene.text, data, values, [])})


def remove_copies(made: list[Path]) -> None:
    """Remove the copies of a run that did not begin, and the folder that was made for their parts."""
    for path in reversed(made):
        with suppress(OSError):  # the fault that ended the run is reported instead
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink(missing_ok=True)


def only_begun(directory: Path) -> bool:
    """Return whether the run there ended before its first checkpoint, with the start as its only snapshot."""
    if any((directory / name).exists() for name in CHECKPOINTS) or not (directory / "scene.toml").exists():
        return False
    return {path.name for path in directory.glob("snapshots/*.h5")} <= {"0000.h5"}


@contextmanager
def held(directory: Path) -> Iterator[bool]:
    """Lock `directory` against other processes, and yield False if it cannot be locked.

    The directory is made if it is absent. The lock ends with its process, however the process ends. Raises
    DirectoryError if another process holds the lock, and OSError.
    """
    absent = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    directory.mkdir(parents=True, exist_ok=True)
    for folder in absent:
        fsync_directory(folder.parent)
    path = directory / ".lock"
    file = _locked(path)
    try:
        yield file is not None
    finally:
        with suppress(OSError):  # the disk may be gone; the end of the process releases the lock anyway
            if file in _locks:
                _locks.remove(file)
                path.unlink(missing_ok=True)
                os.close(file)
            for folder in absent:  # empty ones alone: a run that wrote nothing leaves nothing
                folder.rmdir()


def _locked(path: Path) -> int | None:
    """Return the descriptor of the locked file at `path`, which names this process; None if nothing can be locked."""
    while fcntl is not None:
        file, is_ours = _opened(path)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_at(file, path):
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
                wanted = "expected another directory, or wait until that run has ended"
                raise DirectoryError(f"{path.parent}: another run uses this directory ({holder}); {wanted}") from None
            if fault.errno not in NO_LOCKS:
                raise
            path.unlink(missing_ok=True)
            break
    return None


def _opened(path: Path) -> tuple[int, bool]:
    """Return a descriptor of the lock at `path`, and whether the file can be written. Raises DirectoryError, OSError.

    A lock that a run of another user has left behind can be held as well. A link is not followed, as its target would
    be emptied.
    """
    flags = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        file, is_ours = os.open(path, os.O_RDWR | os.O_CREAT | flags, 0o666), True
    except PermissionError:
        try:
            file, is_ours = os.open(path, os.O_RDONLY | flags), False
        except PermissionError:
            wanted = "expected another directory, or remove the file after that user's run has ended"
            raise DirectoryError(f"{path}: this lock belongs to another user and cannot be opened; {wanted}") from None
    except OSError as fault:
        if fault.errno not in NO_LOCK_FILE:
            raise
        raise DirectoryError(f"{path}: {NO_LOCK}") from None
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise DirectoryError(f"{path}: {NO_LOCK}")
    return file, is_ours


def _is_at(file: int, path: Path) -> bool:
    """Return whether an open file is still the one at `path`."""
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def sweep(directory: Path) -> None:
    """Remove half-written files of killed runs. The caller has to hold the directory's lock."""
    places = directory, directory / "snapshots"
    for folder in (*places, *(place / PARTS for place in places)):
        for part in (*folder.glob(".*.part"), *folder.glob(".*.part.png")):
            part.unlink()
