"""discsim: 2D circumstellar discs of SPH gas and particle-in-cell dust."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
__all__ = ["SceneError", "Simulation", "load_scene", "plot", "read_snapshot"]

# For gc.set_threshold where a command starts. Imports and compiling make many objects that stay; to look through them
# for garbage over and over took a tenth of a warm start and a twelfth of a cold one. What a step makes is freed so.
RARELY = (100_000, 20, 100)

if TYPE_CHECKING:
    from discsim import plot
    from discsim.output.snapshot import read_snapshot
    from discsim.run.simulation import Simulation
    from discsim.scene import SceneError, load_scene

_HOMES = {
    "SceneError": "discsim.scene",
    "Simulation": "discsim.run.simulation",
    "load_scene": "discsim.scene",
    "read_snapshot": "discsim.output.snapshot",
}
_MODULES = ("plot",)  # with matplotlib


def __getattr__(name: str) -> Any:
    # Lazy, so that `discsim --help` and `discsim check` never import numba.
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    if name in _MODULES:
        return import_module(f"discsim.{name}")
    raise AttributeError(f"module 'discsim' has no attribute {name!r}")
