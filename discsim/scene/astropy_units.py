"""Import of astropy's units and constants that also works without a readable home directory, as in containers.

At import, astropy searches the home directory for its configuration, and raises an exception if the search fails. If
the search would fail, this module imports astropy with an empty configuration.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Environment variables that name the configuration directory, and the paths in the home directory that astropy searches
# if these variables are not set.
CONFIG_VARIABLES = ("ASTROPY_CONFIG_DIR", "XDG_CONFIG_HOME")
CONFIG_PATHS = ("", ".config", ".config/astropy", ".astropy", ".astropy/config")


@contextmanager
def _readable_configuration() -> Iterator[None]:
    """Point astropy to an empty configuration directory if the usual directories cannot be searched."""
    if _can_search_configuration():
        yield
        return
    before = {name: os.environ.pop(name) for name in CONFIG_VARIABLES if name in os.environ}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "astropy").mkdir()
        os.environ["XDG_CONFIG_HOME"] = folder
        try:
            yield
        finally:
            del os.environ["XDG_CONFIG_HOME"]
            os.environ.update(before)


def _can_search_configuration() -> bool:
    """Return whether astropy can search its configuration directories without an exception."""
    named = [Path(os.environ[name]) for name in CONFIG_VARIABLES if os.environ.get(name)]
    if named:
        return all(path.is_absolute() and os.path.isdir(path) for path in named)
    try:
        home = Path.home()
    except RuntimeError:  # the user has no home directory
        return False
    for place in CONFIG_PATHS:
        try:
            os.stat(home / place / "x")
        except (FileNotFoundError, NotADirectoryError):
            pass
        except OSError:
            return False
    return True


with _readable_configuration():
    from astropy import constants, units

__all__ = ["constants", "units"]
