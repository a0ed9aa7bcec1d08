"""Orientation of a disc on the sky, and projection of its particles.

A disc is turned counter-clockwise by an azimuth a, inclined by i about its line of nodes, the axis x', and turned on
the sky so that this line has the position angle PA, from north to east:

    x' = x cos a - y sin a,    y' = x sin a + y cos a                                 (1)
    east  = x' sin PA + y' cos i cos PA                                               (2)
    north = x' cos PA - y' cos i sin PA
    v_los = v_y' sin i                                                                (3)

A positive line-of-sight velocity v_los is away from the observer. With this sign PA is the position angle of the
receding half of the major axis, if the disc rotates counter-clockwise in the plane of the scene. For i < 90 deg it
then also rotates counter-clockwise on the sky; for i > 90 deg, clockwise. The side with y' > 0 is the far one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from discsim.output.fields.base import PlotError
from discsim.scene.units import UnitError, clipped, parse_quantity

Array = np.ndarray
EDGE_ON = 5.0  # degrees from 90 within which a disc without height cannot be shown


@dataclass(frozen=True)
class Orientation:
    """Angles of a disc on the sky in radians: inclination, position angle, azimuth."""

    inclination: float
    position_angle: float
    azimuth: float

    def on_sky(self, pos: Array) -> tuple[Array, Array]:
        """Return the offsets (n,) to the east and to the north of positions (n, 2) in the disc, eq. (2)."""
        along, across = self._to_nodes(pos)
        across = across * math.cos(self.inclination)
        sine, cosine = math.sin(self.position_angle), math.cos(self.position_angle)
        return along * sine + across * cosine, along * cosine - across * sine

    def radius(self, east: Array, north: Array) -> Array:
        """Return the radii in the disc of offsets to the east and to the north, the inverse of eq. (2)."""
        sine, cosine = math.sin(self.position_angle), math.cos(self.position_angle)
        return np.hypot(east * sine + north * cosine, (east * cosine - north * sine) / math.cos(self.inclination))

    def line_of_sight(self, vel: Array) -> Array:
        """Return the velocities (n,) away from the observer of velocities (n, 2) in the disc, eq. (3)."""
        return self._to_nodes(vel)[1] * math.sin(self.inclination)

    def _to_nodes(self, vector: Array) -> tuple[Array, Array]:
        """Return the components (n,) of vectors (n, 2) along the line of nodes and across it, eq. (1)."""
        sine, cosine = math.sin(self.azimuth), math.cos(self.azimuth)
        x, y = vector.T
        return x * cosine - y * sine, x * sine + y * cosine


def orientation_of(inclination: Any, position_angle: Any, azimuth: Any, prefix: str = "") -> Orientation:
    """Return the orientation for three angles, each a text like "30 deg" or a Quantity. Raises PlotError.

    prefix: precedes the names of arguments in messages.
    """
    i = angle(inclination, f"{prefix}inclination")
    degrees = math.degrees(i)
    if not 0.0 <= degrees <= 180.0 or abs(degrees - 90.0) < EDGE_ON:
        raise PlotError(
            f"{prefix}inclination: {degrees:g} deg; expected 0 to {90 - EDGE_ON:g} deg, or {90 + EDGE_ON:g} to 180 deg "
            "for a disc that rotates clockwise on the sky; nearer to 90 deg a disc without height cannot be seen"
        )
    dash = "-" if prefix else "_"
    return Orientation(i, angle(position_angle, f"{prefix}position{dash}angle"), angle(azimuth, f"{prefix}azimuth"))


def angle(given: Any, name: str) -> float:
    """Return an angle in radians from a text like "30 deg" or a Quantity. Raises PlotError."""
    expected = 'an angle like "30 deg"'
    try:
        value = given if hasattr(given, "unit") else parse_quantity(str(given), expected)
    except UnitError as error:
        raise PlotError(f"{name}: {error}") from None
    if np.ndim(value.value) or not value.unit.is_equivalent("deg") or not np.isfinite(value.value):
        raise PlotError(f'{name}: "{clipped(str(given))}"; expected {expected}')
    return float(value.to_value("rad"))
