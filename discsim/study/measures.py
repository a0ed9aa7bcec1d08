"""What runs without an exact solution are compared by: profiles, mode amplitudes and the mass in clumps, by name.

    profile   0.5 sum |m - m_ref| / sum m_ref    mass m in rings of a disc or squares of a box: what is elsewhere
    modes     max over m = 1..4 of |A_m - A_ref|,  A_m = sum over rings |sum m exp(i m phi)| / sum m, noise taken off
    clumps    |C - C_ref|,  C: share of the mass where the surface density is CLUMPED times the ring's median

Each is of one species: `dust-profile`, `gas-modes`. `exact` is the error against the exact solution, of the worse
species.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from discsim.scene import Scene
from discsim.study.errors import RINGS, measure_of, profile_errors, profiles

Array = np.ndarray
Run = dict[str, Any]
MODES = range(1, 5)
CLUMPED = 10.0  # times the median of its ring is a clump's surface density
FEW = 8  # particles: what a pixel of a clump holds at least
PIXELS = 96  # a side of the map that clumps are looked for on
WORDS = {
    "profile": "mass of the {kind} elsewhere than in the finer run",
    "modes": "largest difference of the {kind}'s amplitudes m = 1..4, over the axisymmetric part",
    "clumps": "difference of the {kind}'s share of mass in clumps",
}


class Measure(NamedTuple):
    """A measure by its name on the command line, with its words; `kind` is the species ("" of the exact solution)."""

    name: str
    words: str
    kind: str = ""
    what: str = ""

    @property
    def exact(self) -> bool:
        return not self.what

    def error(self, run: Run, reference: Run | None) -> float:
        """The error of a run, as `study.runs` has it; without an exact solution against a `reference`."""
        if self.exact:
            return max(run["errors"].values())
        assert reference is not None
        found, wanted = (each[_KEYS[self.what]][self.kind] for each in (run, reference))
        if self.what == "profile":
            return profile_errors({self.kind: found}, {self.kind: wanted})[self.kind]
        return float(np.abs(np.subtract(found, wanted)).max())


_KEYS = {"profile": "profiles", "modes": "modes", "clumps": "clumps"}  # in the runs that are kept


def measures_of(scene: Scene) -> dict[str, Measure]:
    """The measures that a scene has, by name; the first is the usual one."""
    found: list[Measure] = []
    exact = measure_of(scene)
    if exact is not None:
        found.append(Measure("exact", exact.words))
    disc = scene.centred and scene.space.dimensions == 2
    for what in WORDS if disc else ("profile",):
        for kind in ("dust", "gas"):
            if getattr(scene, kind):
                found.append(Measure(f"{kind}-{what}", WORDS[what].format(kind=kind), kind, what))
    return {each.name: each for each in found}


def mean_of(runs: list[Run]) -> Run:
    """What is seen of several runs, on the average."""
    keys = [key for key in _KEYS.values() if key in runs[0]]
    return {
        key: {kind: np.mean([run[key][kind] for run in runs], axis=0).tolist() for kind in runs[0][key]} for key in keys
    }


def seen(sim: Any) -> Run:
    """Profiles of a simulation; of a disc modes and clumps too. Each by species, as lists of numbers."""
    out: Run = {"profiles": profiles(sim)}
    if sim.scene.centred and sim.scene.space.dimensions == 2:
        reach = 0.5 * min(sim.scene.space.size)
        for key, of in (("modes", amplitudes), ("clumps", clumped)):
            out[key] = {kind: of(p.pos, p.mass, reach) for kind, p in sim.state.species.items()}
    return out


def amplitudes(pos: Array, mass: Array, reach: float) -> list[float]:
    """A_m for MODES. pos (n, 2), mass (n,)."""
    radius, angle = np.hypot(*pos.T), np.arctan2(pos[:, 1], pos[:, 0])
    ring = np.minimum((radius / reach * RINGS).astype(int), RINGS)  # what is beyond is the last one, left out
    noise = np.bincount(ring, mass**2, RINGS + 1)[:RINGS]
    out = []
    for m in MODES:
        real, imaginary = (np.bincount(ring, mass * of(m * angle), RINGS + 1)[:RINGS] for of in (np.cos, np.sin))
        out.append(float(np.sqrt(np.maximum(real**2 + imaginary**2 - noise, 0.0)).sum() / max(mass.sum(), 1e-300)))
    return out


def clumped(pos: Array, mass: Array, reach: float) -> list[float]:
    """The share of the mass in clumps, as a list of one. pos (n, 2), mass (n,)."""
    on_map, _ = np.histogramdd(pos, bins=PIXELS, range=[(-reach, reach)] * 2, weights=mass)
    x = (np.arange(PIXELS) + 0.5) * 2.0 / PIXELS - 1.0
    ring = (np.hypot(x[:, None], x) * RINGS).astype(int)
    held, few = 0.0, FEW * float(mass.mean()) if len(mass) else 0.0
    for k in range(RINGS):
        pixels = on_map[ring == k]
        usual = float(np.median(pixels)) or float(pixels.mean())  # of a ring most of which is empty
        held += float(pixels[pixels > max(CLUMPED * usual, few)].sum())
    return [held / max(float(mass.sum()), 1e-300)]
