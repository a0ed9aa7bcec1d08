"""discsim: 2D circumstellar discs of SPH gas and particle-in-cell dust.

The public names are `Simulation`, `analysis_script`, `load_scene`, `open_run`, `read_snapshot`, `register`, `simulate`,
`Snapshot`, `SceneError`, `SnapshotError` and the modules `export` and `plot`. Each is imported at its first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from discsim.version import __version__ as __version__

__all__ = [
    "SceneError", "Simulation", "Snapshot", "SnapshotError", "analysis_script", "export", "load_scene", "open_run",
    "plot", "read_snapshot", "register", "simulate",
]  # fmt: skip

if TYPE_CHECKING:
    from discsim import export, plot
    from discsim.effects.registration import register
    from discsim.output.run import open_run
    from discsim.output.snapshot import Snapshot, SnapshotError, read_snapshot
    from discsim.run.simulate import simulate
    from discsim.run.simulation import Simulation
    from discsim.scene import SceneError, load_scene
    from discsim.shipped import analysis_script

_MODULE_OF_NAME = {
    "SceneError": "discsim.scene",
    "Simulation": "discsim.run.simulation",
    "Snapshot": "discsim.output.snapshot",
    "SnapshotError": "discsim.output.snapshot",
    "analysis_script": "discsim.shipped",
    "load_scene": "discsim.scene",
    "open_run": "discsim.output.run",
    "read_snapshot": "discsim.output.snapshot",
    "register": "discsim.effects.registration",
    "simulate": "discsim.run.simulate",
}


def __getattr__(name: str) -> Any:
    # Import at first use, so that `discsim --help` and `discsim check` do not import numba.
    if name in _MODULE_OF_NAME:
        return getattr(import_module(_MODULE_OF_NAME[name]), name)
    if name in ("export", "plot"):
        return import_module(f"discsim.{name}")
    raise AttributeError(f"module 'discsim' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
