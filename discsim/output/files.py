"""Files that are whole or absent."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written(path: str | os.PathLike[str], ending: str = "") -> Iterator[Path]:
    """Where to write what appears at `path` once it is complete; an exception leaves what was there before.

    ending: of the name beside it, for who tells a format by that.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part{ending}")
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
