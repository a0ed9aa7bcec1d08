"""table: a disc whose Sigma(r) is a column of a file (`scene/columns.py`).

T(r), dust-to-gas ratio and resolution may be further columns. Particles are on rings (`rings.py`) from the first to the
last radius of the file. The number of gas particles per mass is proportional to the column resolution. Velocities
balance the forces (`balance.py`). The pressure force is -(1/Sigma) dP/dr = -(c_s^2 / r) d ln P / d ln r, from the
interpolated columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from discsim.initial import balance, disc
from discsim.initial.base import Array, SamplePoints
from discsim.initial.user_arrays import MAX_MASS_RATIO
from discsim.parts import EOS
from discsim.physics import profile
from discsim.physics.centre import kepler_omega
from discsim.physics.eos import eos_of
from discsim.scene.columns import ColumnsFile
from discsim.scene.fields import Length

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Draft, Problem

MAX_DIFFERENCE = 0.05  # a warning is given if H/r from the column T differs from that of gas.eos by a larger fraction


class TableDisc(balance.BalanceKeys):
    """A disc whose Sigma(r), T(r) and dust-to-gas ratio are columns of a file."""

    kind: Literal["table"] = "table"
    file: ColumnsFile = Field(
        description="text file with columns r and Sigma; optional columns: T (replaces the temperature of gas.eos), "
        "ratio (total dust-to-gas ratio, divided among populations by dust.ratio), resolution (relative number of gas "
        "particles per mass); units in the header: "
        '"# r [au]  Sigma [g/cm2]  T [K]  ratio"'
    )
    reference_radius: Length = Field(
        1.0, gt=0, description="radius of quoted orbital periods, and of the Sigma_ref of drag laws"
    )

    inner_taper: ClassVar[float] = 0.0
    outer_taper: ClassVar[float] = 0.0

    @property
    def inner(self) -> float:
        return self.file.inner

    @property
    def outer(self) -> float:
        return self.file.outer

    @property
    def sets_temperature(self) -> bool:
        return self.file.has("T")


def thermal_speed(scene: Scene, r: Array) -> Array | None:
    """Return sqrt(P / Sigma) (n,) at radii (n,) from the column T; None if there is no such column."""
    file: Any = scene.initial.file
    if not file.has("T"):
        return None
    return np.sqrt(file.speed2(r, scene.gas.eos.mean_molecular_weight, scene.units.cgs("velocity")))


def radial(scene: Scene) -> profile.Radial:
    """Return the radial profiles of the disc, interpolated in the columns of the file."""
    file: Any = scene.initial.file

    def surface_density(r: Array) -> Array:
        return np.where((r >= file.inner) & (r <= file.outer), file.value("Sigma", r), 0.0)

    def pressure_acceleration(r: Array) -> Array:
        speed2 = profile.sound_speed(scene, r, file.value("Sigma", r)) ** 2
        cooler = -file.slope("T", r) if file.has("T") else eos_of(scene).temperature_slope(scene.gas.eos)
        out = speed2 / r * (cooler - file.slope("Sigma", r))
        # No rotation balances a decline of Sigma over a length below H = c_s / Omega. The bound is that of a taper.
        steepest = np.sqrt(speed2) * kepler_omega(scene, r) if scene.star else np.inf
        return np.clip(out, -steepest, steepest)

    def dust_share(r: Array) -> Array:
        return file.ratio(r) / sum(population.ratio for population in scene.dust or ())

    return profile.Radial(
        file.inner,
        file.outer,
        surface_density,
        pressure_acceleration,
        mass_within=lambda r: profile.integral(r, surface_density(r)),
        dust_share=dust_share if file.has("ratio") else None,
        resolution=partial(file.value, "resolution") if file.uneven else None,
    )


def reference_density(scene: Scene) -> float:
    """Return Sigma at `initial.reference_radius`, from the file."""
    start: Any = scene.initial
    return float(start.file.value("Sigma", np.array([start.reference_radius]))[0])


def sample_points(scene: Scene) -> SamplePoints:
    """Return sample points at both edges and in the middle of the disc."""
    file: Any = scene.initial.file
    radius = np.array([file.inner, 0.5 * (file.inner + file.outer), file.outer])
    names = [scene.units.show(r, "length") for r in radius]
    return SamplePoints(names, file.value("Sigma", radius), radius, relative_mass=relative_mass(scene, radius))


def sample_all_gas(scene: Scene) -> tuple[SamplePoints, Array]:
    """Return sample points at radii from edge to edge, and relative gas masses r Sigma (n,)."""
    file: Any = scene.initial.file
    r = np.linspace(file.inner, file.outer, profile.SAMPLES)
    density = file.value("Sigma", r)
    return SamplePoints([], density, r, relative_mass=relative_mass(scene, r)), r * density


def relative_mass(scene: Scene, r: Array) -> Array | None:
    """Return the mass of a gas particle at the radii r (n,), divided by the mean mass; None if all masses are equal."""
    profiles = radial(scene)
    if profiles.resolution is None:
        return None
    at = np.linspace(profiles.inner, profiles.outer, profile.SAMPLES)
    density = profiles.surface_density(at)
    number = profile.integral(at, density * profiles.resolution(at))[-1]
    return number / profile.integral(at, density)[-1] / profiles.resolution(r)


def warnings(scene: Scene) -> Iterator[str]:
    """Yield the warnings of a disc, and one if the column T contradicts `gas.eos.aspect_ratio`."""
    yield from disc.warnings(scene)
    file, gas = scene.initial.file, scene.gas
    if gas is None or not file.has("T") or getattr(gas.eos, "aspect_ratio", None) is None or scene.star is None:
        return
    r = file.values["r"]
    of_scene = eos_of(scene).table_thermal_speed(scene, r)
    ratio = thermal_speed(scene, r) / of_scene
    worst = int(np.argmax(np.abs(np.log(ratio))))
    if abs(ratio[worst] - 1.0) > MAX_DIFFERENCE:
        yield (
            f"T of initial.file makes H/r {ratio[worst]:.3g} times that of gas.eos at "
            f"{scene.units.show(r[worst], 'length')}, and the run uses T: remove the column T, or change gas.eos"
        )


def temperature_column_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if the file has a column T, but the equation of state does not use it."""
    if not draft.initial.sets_temperature or not draft.gas:
        return
    kinds = [name for name in EOS if EOS[name].takes_temperature]
    if draft.eos_kind not in kinds:
        words = " or ".join(f'"{kind}"' for kind in kinds)
        wrong = f'the file has a column T, but gas.eos.kind "{draft.eos_kind}" does not use it'
        yield ("initial", "file"), f"{wrong}; set gas.eos.kind = {words}, or remove the column T"


def resolution_column_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem if masses of gas particles would differ by more than the factor MAX_MASS_RATIO."""
    file = draft.initial.file
    if draft.gas and file.has("resolution"):
        times = file.values["resolution"].max() / file.values["resolution"].min()
        if times > MAX_MASS_RATIO:
            wrong = f'the column "resolution" varies by a factor of {times:.3g}'
            need = f"expected a factor of at most {MAX_MASS_RATIO:g}, for accurate SPH sums"
            yield ("initial", "file"), f"{wrong}; {need}"


def ratio_column_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem for each dust population that would have no mass by the column ratio."""
    for i, dust in enumerate(draft.dust or ()):
        inner = max(dust.inner or 0.0, draft.initial.inner)
        outer = min(dust.outer or np.inf, draft.initial.outer)
        file = draft.initial.file
        if file.has("ratio") and inner < outer and not file.ratio(np.geomspace(inner, outer, 1000)).any():
            yield (
                ("dust", i),
                'the column "ratio" is 0 everywhere between the edges of this dust; expected a positive ratio',
            )


START = disc.disc_start(
    TableDisc,
    sample_points,
    radial,
    thermal_speed=thermal_speed,
    rules=(
        disc.edge_problems,
        disc.centre_problems,
        disc.dust_edge_problems,
        temperature_column_problems,
        ratio_column_problems,
        resolution_column_problems,
        balance.relaxation_problems,
    ),
    samples_of_all_gas=sample_all_gas,
    reference_density=reference_density,
    warnings=warnings,
)
