"""Where numba keeps compiled kernels, where neither the sources nor the user's home can be written (as in containers).

numba's own places come first: NUMBA_CACHE_DIR, beside the sources, the user's cache directory. Without any of them it
refuses to load a kernel.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

from numba import config
from numba.core.caching import CompileResultCacheImpl

place = ""  # where they are
temporary = False  # whether that stands in for numba's own


class CacheError(Exception):
    """No directory for compiled kernels can be written."""


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
    config.CACHE_DIR = place  # type: ignore[attr-defined]


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
