"""astropy's units and constants, also where the user's home directory cannot be found or read, as in containers.

astropy looks for its configuration in the home directory while it is imported, and ends with an exception where that
cannot be done. Then it is imported with an empty configuration.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NAMED = ("ASTROPY_CONFIG_DIR", "XDG_CONFIG_HOME")  # variables that name the place of the configuration
PLACES = ("", ".config", ".config/astropy", ".astropy", ".astropy/config")  # else, in the home directory


@contextmanager
def _readable_configuration() -> Iterator[None]:
    """Name an empty configuration meanwhile, where the usual one cannot be looked for."""
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
    named = [Path(os.environ[name]) for name in NAMED if os.environ.get(name)]
    if named:
        return all(path.is_absolute() and os.path.isdir(path) for path in named)
    try:
        home = Path.home()
    except RuntimeError:  # the system does not know the user
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
