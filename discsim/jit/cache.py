"""Cache of compiled kernels on disk, in a folder that processes share.

numba calls a locator for the cache folder of a function and a stamp of its source (NUMBA_CACHE_LOCATOR_CLASSES in
numba's manual). numba's own locators stamp a function with the file that defines it. They would load old machine code
after a change of a called function in another file. Here the stamp is a hash of all files that kernels are made from,
and is part of the folder's name. Only kernels of discsim are cached this way.

Two processes that add specialisations of one kernel at the same time could choose the same file name. A process
therefore locks the folder from just before numba writes until numba's compiler lock is released.
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
from collections.abc import Iterator
from contextlib import contextmanager, suppress
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
SOURCES = ("jit", "kernels", "formulas")  # folders of the package whose functions kernels call
KEPT, KEPT_FOR = 8, 86400.0  # folders of other sources kept: the last ones used, and all used within a day [s]
PRIVATE = "discsim-kernels-"  # prefix of the directory among temporary files
LONGEST_WAIT = 60.0  # for the lock [s]; after that a process writes without it

config: Any = numba.config


class CacheError(Exception):
    """Error that no folder for compiled kernels can be written."""


@cache
def stamp() -> str:
    """Return a hash of the kernels' sources and of the libraries that compile them."""
    made = hashlib.sha256(repr((sys.version, numba.__version__, llvmlite.__version__, numpy.__version__)).encode())
    for file in sorted(file for name in SOURCES for file in (PACKAGE / name).rglob("*.py")):
        content = file.read_bytes()
        made.update(f"{file.relative_to(PACKAGE)} {len(content)} ".encode() + content)
    return made.hexdigest()[:20]


@cache
def folder() -> Path:
    """Return the folder of compiled kernels, and create it if it is missing.

    It is in the first of these that can be written: NUMBA_CACHE_DIR, the package's own `__pycache__`, the user's
    cache directory, a private directory among temporary files.

    Raises
    ------
    CacheError
        If none of them can be written.
    """
    given = [Path(config.CACHE_DIR)] if config.CACHE_DIR else []
    for parent in (*given, PACKAGE / "__pycache__", platformdirs.user_cache_path("discsim")):
        with suppress(OSError):
            return _made(parent)
    try:
        return _made(_private())
    except OSError:
        wanted = "set NUMBA_CACHE_DIR to a directory that can be written"
        raise CacheError(f"there is no place for compiled kernels: {wanted}") from None


def is_temporary() -> bool:
    """Return whether the folder is a temporary one because none of the usual folders can be written."""
    return folder().parent.name.startswith(PRIVATE)


def _made(parent: Path) -> Path:
    """Return the folder within a directory, created if missing and tested for writing. Raises OSError."""
    path = parent / f"kernels-{stamp()}"
    new = not path.is_dir()
    path.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=path).close()
    os.utime(path)  # used now
    if new:
        sweep(path)
    return path


def sweep(path: Path) -> None:
    """Remove folders next to `path` that were compiled from other sources, except recently used ones."""
    used = []
    for other in path.parent.glob("kernels-*"):
        with suppress(OSError):  # another process may remove it first
            used.append((other.stat().st_mtime, other))
    for when, other in sorted(used, reverse=True)[KEPT + 1 :]:
        if other != path and when < time.time() - KEPT_FOR:
            shutil.rmtree(other, ignore_errors=True)


def _private() -> Path:
    """Return this user's own directory among temporary files.

    It is the same for every run, or a new one if others can write there. numba runs any code in its cache: no other
    user may have written there. Raises OSError.
    """
    path = Path(tempfile.gettempdir()) / f"{PRIVATE}{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    found = path.lstat()
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return path if ours and os.access(path, os.W_OK) else Path(tempfile.mkdtemp(prefix=PRIVATE))


class Locator(InTreeCacheLocator):
    """Cache locator of kernels for numba: one folder for all, named after their sources."""

    @classmethod
    def from_function(cls, py_func, py_file):
        return cls(py_func, py_file)

    def get_cache_path(self) -> str:
        return str(folder())

    def get_source_stamp(self) -> str:
        return stamp()

    def get_disambiguator(self) -> str:
        """Return a text of line and folder that distinguishes functions in files of the same name."""
        where = os.path.dirname(os.path.abspath(self._py_file))
        return f"{self._lineno}-{hashlib.sha256(where.encode()).hexdigest()[:8]}"

    def ensure_cache_path(self) -> None:
        """Create the folder and take the lock: numba calls this method just before it writes."""
        super().ensure_cache_path()
        lock.take()


class FolderLock(event.Listener):
    """Lock on the folder, from `take` until the thread leaves numba's compiler lock."""

    def __init__(self) -> None:
        self._held: filelock.BaseFileLock | None = None
        self._thread = self._depth = 0
        self._listens = False

    def take(self) -> None:
        if not self._listens:
            event.register("numba:compiler_lock", self)
            self._listens = True
        file = filelock.FileLock(folder() / "lock", thread_local=False)
        with suppress(OSError, NotImplementedError):  # file systems without locks, and the end of the longest wait
            file.acquire(timeout=LONGEST_WAIT)
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


@contextmanager
def located() -> Iterator[None]:
    """Cache functions that are decorated within this context by `Locator`; restore numba's setting afterwards."""
    before = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = f"{Locator.__module__}.{Locator.__qualname__}"
    try:
        yield
    finally:
        config.CACHE_LOCATOR_CLASSES = before
