"""Cache of compiled kernels on disk, in a folder that processes share.

numba asks a locator class for the cache folder of a function and for a stamp, a text that changes when the function's
source changes (NUMBA_CACHE_LOCATOR_CLASSES in numba's manual). The stamps of numba's own locators depend only on the
file that defines the function. After a change of a called function in another file, numba would load old machine code.
The stamp used here is a hash of all source files of kernels, and is part of the folder's name. Only kernels of discsim
are cached this way.

Two processes that compile new specialisations of one kernel at the same time could choose the same file name. A process
therefore locks the folder from just before numba writes to it until numba's compiler lock is released.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import sys
import tempfile
import threading
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import filelock
import llvmlite
import numba
import numpy
import platformdirs
from numba.core import event
from numba.core.caching import InTreeCacheLocator

PACKAGE = Path(__file__).parents[1]
SOURCES = ("jit", "kernels", "formulas")  # folders of the package that contain kernels and the functions they call
# Folders of other source versions that are kept: the last eight that were used, and all that were used within a day.
FOLDERS_KEPT, SECONDS_KEPT = 8, 86400.0
PRIVATE_PREFIX = "discsim-kernels-"  # prefix of a user's own folder in the system's directory of temporary files
LOCK_TIMEOUT = 60.0  # seconds that a process waits for the lock; it then writes without the lock
LOCATOR = f"{__name__}.Locator"

config: Any = numba.config


class CacheError(Exception):
    """Error: none of the possible folders for compiled kernels can be written."""


@cache
def source_hash() -> str:
    """Return a hash of the kernels' source files and of the versions of Python, numba, llvmlite and numpy."""
    digest = hashlib.sha256(repr((sys.version, numba.__version__, llvmlite.__version__, numpy.__version__)).encode())
    for file in sorted(file for name in SOURCES for file in (PACKAGE / name).rglob("*.py")):
        content = file.read_bytes()
        digest.update(f"{file.relative_to(PACKAGE)} {len(content)} ".encode() + content)
    return digest.hexdigest()[:20]


@cache
def kernel_folder() -> Path:
    """Return the folder of compiled kernels, and create it if it is missing.

    Its parent is the first of these directories that can be written: NUMBA_CACHE_DIR, the `__pycache__` of the package,
    the user's cache directory, a private directory in the system's directory of temporary files.

    Raises
    ------
    CacheError
        If none of these directories can be written.
    """
    given = [Path(config.CACHE_DIR)] if config.CACHE_DIR else []
    for parent in (*given, PACKAGE / "__pycache__", platformdirs.user_cache_path("discsim")):
        with suppress(OSError):
            return _create_folder(parent)
    try:
        return _create_folder(_private_directory())
    except OSError:
        cure = "set NUMBA_CACHE_DIR to a writable directory"
        raise CacheError(f"no folder for compiled kernels is writable; {cure}") from None


def is_temporary() -> bool:
    """Return whether the kernel folder is a temporary one, because none of the usual directories can be written."""
    return kernel_folder().parent.name.startswith(PRIVATE_PREFIX)


def _create_folder(parent: Path) -> Path:
    """Return the kernel folder in `parent`, and create it if it is missing; raise OSError if it cannot be written."""
    path = parent / f"kernels-{source_hash()}"
    new = not path.is_dir()
    path.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=path).close()
    os.utime(path)  # marks the folder as used now, for `remove_old_folders`
    if new:
        remove_old_folders(path)
    return path


def remove_old_folders(path: Path) -> None:
    """Remove the kernel folders next to `path` that belong to other source versions and were not used recently."""
    last_used = []
    for other in path.parent.glob("kernels-*"):
        with suppress(OSError):  # another process may remove it first
            last_used.append((other.stat().st_mtime, other))
    for seconds, other in sorted(last_used, reverse=True)[FOLDERS_KEPT + 1 :]:
        if other != path and seconds < time.time() - SECONDS_KEPT:
            shutil.rmtree(other, ignore_errors=True)


def _private_directory() -> Path:
    """Return a directory in the system's directory of temporary files that only this user can write.

    numba executes the machine code in its cache, so no other user may be able to write to the directory. All runs of
    a user share one directory; if it belongs to, or can be written by, another user, a new one is made. Raises OSError.
    """
    path = Path(tempfile.gettempdir()) / f"{PRIVATE_PREFIX}{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    status = path.lstat()
    is_safe = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022
    return path if is_safe and os.access(path, os.W_OK) else Path(tempfile.mkdtemp(prefix=PRIVATE_PREFIX))


class Locator(InTreeCacheLocator):
    """Cache locator for numba: all kernels are in one folder, whose name contains the hash of their sources."""

    @classmethod
    def from_function(cls, py_func, py_file):
        return cls(py_func, py_file)

    def get_cache_path(self) -> str:
        return str(kernel_folder())

    def get_source_stamp(self) -> str:
        return source_hash()

    def get_disambiguator(self) -> str:
        """Return a text that differs for functions of the same name in files of the same name."""
        directory = os.path.dirname(os.path.abspath(self._py_file))
        return f"{self._lineno}-{hashlib.sha256(directory.encode()).hexdigest()[:8]}"

    def ensure_cache_path(self) -> None:
        """Create and lock the folder. numba calls this method just before it writes a file."""
        super().ensure_cache_path()
        lock.acquire()


class FolderLock(event.Listener):
    """Lock on the kernel folder, held from `acquire` until the calling thread releases numba's compiler lock."""

    def __init__(self) -> None:
        self._held: filelock.BaseFileLock | None = None
        self._thread = self._depth = 0
        self._is_registered = False

    def acquire(self) -> None:
        """Lock the folder; do nothing where file locks do not work, or if the lock is not free within LOCK_TIMEOUT."""
        if not self._is_registered:
            event.register("numba:compiler_lock", self)
            self._is_registered = True
        file = filelock.FileLock(kernel_folder() / "lock", thread_local=False)
        with suppress(OSError, NotImplementedError):  # OSError: also a timeout
            file.acquire(timeout=LOCK_TIMEOUT)
            self._held, self._thread, self._depth = file, threading.get_ident(), 0

    def on_start(self, event: event.Event) -> None:
        if self._held is not None and threading.get_ident() == self._thread:
            self._depth += 1

    def on_end(self, event: event.Event) -> None:
        if self._held is None or threading.get_ident() != self._thread:
            return
        self._depth -= 1
        if self._depth < 0:
            self._held.release()
            self._held = None


lock = FolderLock()
