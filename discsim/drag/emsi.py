"""emsi: drag in the cells of gas on a polar grid, between the gas of a cell and the dust particles in it.

Each grain is divided among the nine nearest cells. Gas and all populations of a cell relax together, exactly, with
accelerations included, and a grain is compared with the gas at its own place (equations in `kernels/drag/polar.py`).
Radial momentum and angular momentum of gas and dust are conserved in each cell. With integration = "implicit" the
relaxation is backward Euler, which is of first order at t_stop ~ dt.

The name is that of the momentum-conserving scheme in the comparison of Stoyanovskaya et al. 2018 (arXiv:1811.06522).
The polar cells, the dust particles and the exact relaxation are additions of discsim. Fluids on a fixed 1D grid have
the scheme `emsi-ppm`.
"""

from __future__ import annotations

from collections.abc import Iterator

from discsim.drag.base import NO_KERNEL, Scheme
from discsim.parts import DEFAULT_SCHEME, Lazy
from discsim.scene.rules import Draft, Problem

polar = Lazy("discsim.drag.polar")


def grid_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a scene whose gas has no polar grid."""
    if draft.gas is not None and draft.gas.method != "grid":
        wrong = 'drag.scheme "emsi" needs gas on a polar grid'
        yield ("drag", "scheme"), f'{wrong}; set gas.method = "grid", or choose drag.scheme "{DEFAULT_SCHEME}"'


UNUSED = {"the cells of the gas as drag cells": ("cell", "cell_length")} | NO_KERNEL
SCHEME = Scheme(
    lambda *given: polar.kick(*given),
    polar=True, sizes=True, unused=UNUSED, nanoseconds=300.0, rules=(grid_problems,),
)  # fmt: skip
