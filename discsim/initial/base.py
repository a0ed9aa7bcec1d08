"""What an initial condition is, whatever its kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from discsim.scene.fields import Table
from discsim.scene.rules import Rule


@dataclass(frozen=True)
class Start:
    """An initial condition: the keys of `[initial]` with its kind, and what makes its particles.

    particles(scene): arrays by species, pos, vel (n, dimensions), mass (n,), and where it matters density (n,) (a first
    guess for h), u (n,), species and immobile (n,). settle(state, effects): velocities, once forces are known.
    """

    keys: type[Table]
    particles: Callable[[Any], dict[str, dict[str, Any]]]
    settle: Callable[[Any, dict[str, Any]], None] | None = None
    rules: tuple[Rule, ...] = ()  # what a scene with this start must have
