"""emsi-ppm: gas and dust as fluids on a fixed 1D grid; the slip relaxes implicitly, momentum is exact.

Each stage of a step (`discsim/numerics/ppm.py`) ends with the relaxation of every cell from its velocities at the
start of the step. The changes by advection and pressure are accelerations inside the relaxation, a = (v* - v^n) / dt:

    ds/dt = a_d - a_g - (1 + eps) s / t_stop,   s = u - v
    rho_g v = (rho_g v)* + J,   rho_d u = (rho_d u)* - J,   J = rho_g rho_d / (rho_g + rho_d) (s* - s)

v^n is the velocity before the step, and a star marks values after the fluxes of the stage. The solution is the exact
exponential, or backward Euler with integration = "implicit". The fluxes thus include the inertia of the dust, and the
step is of second order at any stiffness. With frictional heat, the total energy of a cell is conserved.

This is the momentum-conserving scheme in the comparison of Stoyanovskaya et al. 2018 (arXiv:1811.06522), as far as its
abstract describes it: drag implicit in both velocities. The accelerations inside the relaxation, the stages and the
exponential are additions of discsim.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from discsim.drag.base import NO_CELLS, NO_KERNEL, Array, DragLaw, Scheme
from discsim.drag.published.fixed_grid import RULES
from discsim.parts import Lazy

if TYPE_CHECKING:
    from discsim.numerics.ppm import Tube

kernels, ppm = Lazy("discsim.kernels.fluid1d.drag"), Lazy("discsim.numerics.ppm")


def advance(law: DragLaw, tube: Tube, cells: Array, dt: float, heating: bool) -> Array:
    """Return the fluids after dt, as `Scheme.advance`."""
    now = cells
    for part in ppm.STAGES:
        after = tube.add_fluxes(cells, now, part * dt)
        kernels.relax_together(
            law.code, law.grains[0], tube.thermal_speed(now), cells, now, after, part * dt, law.exponential,
            tube.adiabatic, heating,
        )  # fmt: skip
        now = after
    return now


SCHEME = Scheme(advance=advance, unused=NO_CELLS | NO_KERNEL, rules=RULES)
