"""Import of astropy's units and constants that also works without a readable home directory, as in containers.

astropy searches the home directory for its configuration at import, and raises an exception if the search fails. In
that case this module imports astropy with an empty configuration.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NAMED = ("ASTROPY_CONFIG_DIR", "XDG_CONFIG_HOME")  # environment variables with the configuration directory
PLACES = ("", ".config", ".config/astropy", ".astropy", ".astropy/config")  # searched in the home directory otherwise


@contextmanager
def _readable_configuration() -> Iterator[None]:
    """Point astropy to an empty configuration directory if the usual directories cannot be searched."""
    if _can_be_looked_for():
        yield
        return
    before = {name: os.environ.pop(name) for name in NAMED if name in os.environ}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "astropy").mkdir()
        os.environ["XDG_CONFIG_HOME"] = folder
        try:
            yield
        finally:
            del os.environ["XDG_CONFIG_HOME"]
            os.environ.update(before)


def _can_be_looked_for() -> bool:
    """Return whether astropy can search its configuration directories without an exception."""
    named = [Path(os.environ[name]) for name in NAMED if os.environ.get(name)]
    if named:
        return all(path.is_absolute() and os.path.isdir(path) for path in named)
    try:
        home = Path.home()
    except RuntimeError:  # the user has no home directory
        return False
    for place in PLACES:
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
