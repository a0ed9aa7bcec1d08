"""Export of a snapshot to codes of radiative transfer: RADMC-3D and MCFOST.

    discsim.export.write("runs/my", "radmc3d", "transfer", alpha=1e-3)

`layers.py` turns the razor-thin disc into layers with a height.
"""

from discsim.export.products import write

__all__ = ["write"]
