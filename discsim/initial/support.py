"""Radial support of a disc: where the pressure force exceeds gravity, no rotation balances the forces.

    x = -(1/Sigma) dP/dr / g,    v_phi = v_K (1 - x)^(1/2)                                                   (1)

g: inward acceleration by gravity. v_K^2 = g r. x is positive where the pressure falls outwards, and proportional to
(H/r)^2, so that x < 1 sets an upper bound of H/r. The disc is the gas of a start, or the prescribed gas of [background]
between the radii where its dust begins. In discs with a star, the acceleration by self-gravity is approximated by twice
that of the mass within r, which is an upper bound except at the edge of a disc. Discs without a star are checked when a
run sets their velocities (`initial/balance.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from discsim.initial import start_of
from discsim.parts import Lazy
from discsim.physics import profile
from discsim.physics.centre import kepler_omega

if TYPE_CHECKING:
    from discsim.scene import Scene
    from discsim.scene.rules import Problem

growth = Lazy("discsim.physics.growth")
Array = np.ndarray
RADIUS_COUNT = 2000  # number of sample radii
MAX_UNBOUND = 1e-3  # largest mass fraction of gas with x >= 1: at an edge it falls in without effect on the disc
# A warning is given if more than the mass fraction MAX_SLOW rotates below SLOW_ROTATION v_K.
SLOW_ROTATION, MAX_SLOW = 0.9, 0.01
# Keys that set the temperature; the value of the key is ~ c_s^exponent.
TEMPERATURE_KEYS = {"aspect_ratio": 1.0, "sound_speed": 1.0, "constant": 2.0}
# Largest mass fraction of a species without balance in a run: at an inner edge self-gravity acts outwards.
MAX_FALLING = 0.1
SELF_GRAVITY_FACTOR = 2.0  # acceleration by self-gravity, divided by that of the mass within a radius


class Support(NamedTuple):
    """Radial support of a disc at n radii; all arrays (n,).

    pressure_ratio: pressure force over gravity, x of eq. (1). aspect_ratio: H/r. mass_fraction: fraction of the gas
    mass at each radius; equal fractions with [background]. keplerian2: g r^3, the squared angular momentum per mass of
    circular orbits without pressure.
    """

    radius: Array
    pressure_ratio: Array
    aspect_ratio: Array
    mass_fraction: Array
    keplerian2: Array


def radial_support(scene: Scene) -> Support | None:
    """Return the radial support of the scene's disc; None without a disc about a star, or without gas."""
    start = None if scene.initial is None else start_of(scene)
    if start is None or start.radial is None or scene.star is None:
        return None
    if scene.gas is None and scene.model.given is None:
        return None
    with np.errstate(all="ignore"):  # extreme numbers are refused when particles are made
        found = _support_of_background(scene) if scene.model.given is not None else _support_of_gas(scene)
    finite = np.isfinite(found.pressure_ratio) & np.isfinite(found.aspect_ratio)
    return Support(*(values[finite] for values in found)) if finite.any() else None


def _support_of_background(scene: Scene) -> Support:
    disc, edges = scene.model.given(scene), start_of(scene).edges
    assert edges is not None
    r = np.geomspace(*edges(scene), RADIUS_COUNT)
    pull = kepler_omega(scene, r) ** 2 * r
    aspect = disc.thermal_speed(r) / np.sqrt(pull * r)
    return Support(
        r, disc.pressure_slope(r) * aspect**2, aspect, np.full(RADIUS_COUNT, 1.0 / RADIUS_COUNT), r * (r * r * pull)
    )


def _support_of_gas(scene: Scene) -> Support:
    disc = profile.radial(scene)
    r = disc.inner + (disc.outer - disc.inner) * (np.arange(RADIUS_COUNT) + 0.5) / RADIUS_COUNT
    density = disc.surface_density(r)
    pull = kepler_omega(scene, r) ** 2 * r
    if scene.self_gravity is not None:
        pull = pull + SELF_GRAVITY_FACTOR * disc.mass_within(r) / (r * r)
    ratio = disc.pressure_acceleration(r) / pull
    if scene.table("growth") is not None and growth.gas_mass_includes_small_dust(scene):
        ratio = ratio / (1.0 + growth.small_ratio_at(scene, r, disc.dust_share))
    aspect = profile.initial_thermal_speed(scene, r, density) / np.sqrt(pull * r)
    weight = r * density
    return Support(r, ratio, aspect, weight / weight.sum(), r * (r * r * pull))


def problems(scene: Scene) -> Iterator[Problem]:
    """Yield a problem of the temperature if too much gas has no circular orbit (`_is_unbound`)."""
    found = _support_if_finite(scene)
    if found is None or not _is_unbound(scene, found):
        return
    worst = int(np.argmax(np.where(found.mass_fraction > 0.0, found.pressure_ratio, -np.inf)))
    bound = _largest_aspect_ratio(scene, found, worst)
    below = math.floor(100.0 * bound) / 100.0 if bound >= 0.1 else float(f"{0.995 * bound:.2g}")
    where = scene.units.show(found.radius[worst], "length")
    other = "".join(f", or widen background.{name}" for name in _steepening_features(scene))
    yield (
        _temperature_key(scene),
        f"H/r is {found.aspect_ratio[worst]:.3g} at r = {where}, where pressure exceeds gravity: no "
        f"circular orbit exists; lower H/r below {below:g} there{other}",
    )


def _support_if_finite(scene: Scene) -> Support | None:
    """Return the radial support of the scene's disc; None without a disc, or if numbers of the scene overflow."""
    try:
        return radial_support(scene)
    except (ArithmeticError, ValueError):  # extreme numbers, which the start itself refuses
        return None


def _is_unbound(scene: Scene, found: Support) -> bool:
    """Return whether more than the mass fraction MAX_UNBOUND of the gas has x >= 1, so that no orbit exists.

    With [background] no such gas is allowed, because dust drifts through it.
    """
    fraction = float(found.mass_fraction[found.pressure_ratio >= 1.0].sum())
    return fraction > (MAX_UNBOUND if scene.model.given is None else 0.0)


def _temperature_key(scene: Scene) -> tuple[str, ...]:
    """Return the path of the key that sets the temperature, like ("gas", "eos", "aspect_ratio")."""
    table, table_of_file = ("gas", "initial") if scene.gas is not None else ("background", "background")
    file = getattr(scene.table(table_of_file), "file", None)
    if file is not None and file.has("T"):
        return table_of_file, "file"
    eos = scene.table(table).eos
    return table, "eos", next((key for key in TEMPERATURE_KEYS if getattr(eos, key, None) is not None), "kind")


def _largest_aspect_ratio(scene: Scene, found: Support, worst: int) -> float:
    """Return the largest H/r at the radius with index `worst` for which the whole disc is in balance.

    The temperature is scaled by the same factor at all radii. found: radial support of the scene's disc.
    """
    path = _temperature_key(scene)
    if path[-1] not in TEMPERATURE_KEYS:
        return float(found.aspect_ratio[worst] / found.pressure_ratio[worst] ** 0.5)
    table = scene.table(path[0])
    value = getattr(table.eos, path[2])

    def is_balanced(factor: float) -> bool:
        eos = table.eos.model_copy(update={path[2]: value * factor ** TEMPERATURE_KEYS[path[2]]})
        cooler = scene.model_copy(update={path[0]: table.model_copy(update={"eos": eos})})
        again = radial_support(cooler)
        return again is not None and not _is_unbound(cooler, again)

    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_balanced(middle) else (low, middle)
    return float(low * found.aspect_ratio[worst])


def warnings(scene: Scene) -> Iterator[str]:
    """Yield warnings of gas that rotates far slower than Keplerian, and of prescribed gas that is Rayleigh unstable."""
    found = _support_if_finite(scene)
    if found is None:
        return
    speed = np.sqrt(np.maximum(1.0 - found.pressure_ratio, 0.0))
    slow = float(found.mass_fraction[speed < SLOW_ROTATION].sum())
    if slow > (MAX_SLOW if scene.model.given is None else 0.0):
        at = int(np.argmin(np.where(found.mass_fraction > 0.0, speed, np.inf)))
        where = scene.units.show(found.radius[at], "length")
        yield (
            f"the gas rotates at {speed[at]:.2f} times the Keplerian velocity at {where}, below {SLOW_ROTATION:g}, "
            "where the pressure falls steeply: estimates for thin discs have errors of this size; "
            f"{_pressure_remedy(scene)}"
        )
    if scene.model.given is not None:
        with np.errstate(all="ignore"):
            falls = np.flatnonzero(np.diff(found.keplerian2 * (1.0 - found.pressure_ratio)) < 0.0)  # of (r v_phi)^2
        if len(falls) > 0:
            ends = (scene.units.show(found.radius[i], "length") for i in (falls[0], falls[-1] + 1))
            yield (
                f"the angular momentum of the given gas falls outwards between {' and '.join(ends)}: such a disc "
                f"is unstable (Rayleigh's criterion), and dust has no steady drift there; {_pressure_remedy(scene)}"
            )


def _steepening_features(scene: Scene) -> list[str]:
    """Return which of the tables "gap" and "bump" of [background], which steepen the pressure, the scene has."""
    return [name for name in ("gap", "bump") if getattr(scene.background, name, None) is not None]


def _pressure_remedy(scene: Scene) -> str:
    """Return the advice that ends the warnings: how to make the pressure less steep."""
    wider = [f"widen background.{name}" for name in _steepening_features(scene)]
    return (
        f"{' and '.join(wider)}, or lower H/r" if wider else "lower H/r, or choose smoother edges and a smoother Sigma"
    )
