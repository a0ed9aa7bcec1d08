"""Where numba keeps compiled kernels.

numba's own places come first: NUMBA_CACHE_DIR, beside the sources, the user's cache directory. Without any of them (as
in containers, where neither the sources nor the user's home can be written) it refuses to load a kernel.

Within its place, kernels are kept in a directory named after a hash of all that they are made from. numba itself only
looks at the file of a function, and would go on with old machine code where a function that it calls has changed in
another.

A kernel has one index of its variants, of which it is told in no way that another process is about to write it too: of
two that compile at once one is lost, or is found under the name of the other. Here they wait for each other.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar

import llvmlite
import numba
import numpy
from numba.core import caching
from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile, InTreeCacheLocator

try:
    import fcntl
except ImportError:  # no POSIX: no locks
    fcntl = None

config: Any = numba.config
LOCATORS: list[Any] = list(CompileResultCacheImpl._locator_classes)  # of numba, by what comes first

KEPT, KEPT_FOR = 8, 86400.0  # directories of other sources: the last ones used, and all used within a day (s)

place = ""  # where they are
temporary = False  # whether that stands in for numba's own


class CacheError(Exception):
    """No directory for compiled kernels can be written."""


class Locator(InTreeCacheLocator):
    """Of functions of the files in `sources`: the directory `name` within the place that numba finds for the first."""

    sources: ClassVar[tuple[str, ...]] = ()
    name = ""
    found: ClassVar[dict[str, str]] = {}  # by NUMBA_CACHE_DIR

    @classmethod
    def from_function(cls, py_func, py_file):
        if os.path.dirname(os.path.abspath(py_file)) not in cls.sources:
            return None
        if config.CACHE_DIR not in cls.found:
            path = cls._directory(py_func, os.path.join(cls.sources[0], os.path.basename(py_file)))
            if not path:
                return None
            cls.found[config.CACHE_DIR] = path
        return cls(py_func, py_file)

    @classmethod
    def _directory(cls, py_func, py_file) -> str:
        for other in LOCATORS:
            locator = other.from_function(py_func, py_file)
            if locator is not None:
                path = Path(locator.get_cache_path()) / cls.name
                new = not path.is_dir()
                try:
                    path.mkdir(exist_ok=True)
                except OSError:
                    continue
                with suppress(OSError):
                    os.utime(path)  # used now
                if new:
                    sweep(path)
                return str(path)
        return ""

    def get_cache_path(self) -> str:
        return self.found[config.CACHE_DIR]


class CacheFile(IndexDataCacheFile):
    """Variants of a kernel, to which one process at a time adds."""

    def save(self, key, data):
        with alone(self._cache_path):
            super().save(key, data)


@contextmanager
def alone(directory: str) -> Iterator[None]:
    """What no other process does in a directory meanwhile, where its file system has locks."""
    with open(os.path.join(directory, "lock"), "w") as file:
        if fcntl is not None:
            with suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_EX)
        yield


def follow(sources: Path, target: str) -> None:
    """Let kernels in the files of a directory, and of the formulas beside it, be kept by what they are.

    target: the processors that they are compiled for.
    """
    made = hashlib.sha256(repr((sys.version, numba.__version__, llvmlite.__version__, numpy.__version__)).encode())
    made.update(target.encode())
    directories = (sources, sources.parent / "formulas")
    for file in (file for directory in directories for file in sorted(directory.glob("*.py"))):
        content = file.read_bytes()
        made.update(f"{file.name} {len(content)} ".encode() + content)
    Locator.sources = tuple(os.path.abspath(directory) for directory in directories)
    Locator.name = f"kernels-{made.hexdigest()[:20]}"
    CompileResultCacheImpl._locator_classes = [Locator, *LOCATORS]
    caching.IndexDataCacheFile = CacheFile  # type: ignore[misc]


def sweep(path: Path) -> None:
    """Remove what was compiled from other sources, but for `KEPT` and what a run may still add to."""
    used = []
    for other in path.parent.glob("kernels-*"):
        with suppress(OSError):  # another process sweeps too
            used.append((other.stat().st_mtime, other))
    for when, other in sorted(used, reverse=True)[KEPT + 1 :]:
        if other != path and when < time.time() - KEPT_FOR:
            shutil.rmtree(other, ignore_errors=True)


def ensure(kernel: Callable) -> None:
    """See to it that numba has a place for compiled functions of the file of `kernel`. Raises CacheError."""
    global place, temporary
    place = _found(kernel)
    if place:
        return
    try:
        place, temporary = str(_temporary()), True
    except OSError:
        wanted = "set NUMBA_CACHE_DIR to a directory that can be written"
        raise CacheError(f"there is no place for compiled kernels: {wanted}") from None
    os.environ["NUMBA_CACHE_DIR"] = place  # for the processes that this one starts
    config.CACHE_DIR = place


def _found(kernel: Callable) -> str:
    try:
        return CompileResultCacheImpl(kernel).locator.get_cache_path()
    except RuntimeError:
        return ""


def _temporary() -> Path:
    """This user's own directory, the same for every run; a new one where somebody else has made it. Raises OSError.

    numba trusts what it finds in a cache: nobody else may have written there.
    """
    path = Path(tempfile.gettempdir()) / f"discsim-kernels-{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    found = path.lstat()
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return path if ours and os.access(path, os.W_OK) else Path(tempfile.mkdtemp(prefix="discsim-kernels-"))
