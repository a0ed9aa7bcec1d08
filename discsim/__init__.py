"""discsim: 2D circumstellar discs of SPH gas and particle-in-cell dust.

The public names are `Simulation`, `load_scene`, `read_snapshot`, `register`, `Snapshot`, `SceneError`, `SnapshotError`
and the module `plot`. Each is imported at its first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from discsim.version import __version__ as __version__

__all__ = ["SceneError", "Simulation", "Snapshot", "SnapshotError", "load_scene", "plot", "read_snapshot", "register"]

if TYPE_CHECKING:
    from discsim import plot
    from discsim.effects.registration import register
    from discsim.output.snapshot import Snapshot, SnapshotError, read_snapshot
    from discsim.run.simulation import Simulation
    from discsim.scene import SceneError, load_scene

_MODULE_OF_NAME = {
    "SceneError": "discsim.scene",
    "Simulation": "discsim.run.simulation",
    "Snapshot": "discsim.output.snapshot",
    "SnapshotError": "discsim.output.snapshot",
    "load_scene": "discsim.scene",
    "read_snapshot": "discsim.output.snapshot",
    "register": "discsim.effects.registration",
}


def __getattr__(name: str) -> Any:
    # Import at first use, so that `discsim --help` and `discsim check` do not import numba.
    if name in _MODULE_OF_NAME:
        return getattr(import_module(_MODULE_OF_NAME[name]), name)
    if name == "plot":
        return import_module("discsim.plot")
    raise AttributeError(f"module 'discsim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
