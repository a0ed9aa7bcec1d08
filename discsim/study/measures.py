"""Error measures of a run by name: the error against an exact solution, or a difference from a reference run.

    profile   0.5 sum |M - M_ref| / sum M_ref, the fraction of the mass in a wrong bin;
              M: mass in a ring of a disc, or in a square of a box
    modes     max over m = 1..4 of |A_m - A_m,ref|;
              A_m = sum over rings |sum over particles M_i exp(i m phi_i)| / sum M_i, less the noise of particles
    clumps    |C - C_ref|;
              C: fraction of the mass in pixels with over CLUMP_CONTRAST times the median surface density of the ring

These measures are for one species, as in `dust-profile` or `gas-modes`. The measure `exact` is the error against the
exact solution, the larger of the errors of gas and dust.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from discsim.scene import Scene
from discsim.study.errors import RINGS, binned_masses, is_disc, measure_of, profile_errors

Array = np.ndarray
Run = dict[str, Any]
MODES = range(1, 5)
CLUMP_CONTRAST = 10.0  # smallest surface density of a clump over the median of its ring
MIN_CLUMP_PARTICLES = 8  # smallest number of particles in a pixel of a clump
PIXELS = 96  # pixels per side of the map on which clumps are found
WORDS = {
    "profile": "fraction of the {kind} mass displaced relative to the reference run",
    "modes": "largest difference in the {kind} mode amplitudes m = 1..4, relative to the axisymmetric part",
    "clumps": "difference in the {kind} mass fraction in clumps",
}


class Measure(NamedTuple):
    """A measure of the error of a run.

    name: name on the command line, such as "dust-modes". words: description. kind: species, "gas" or "dust". what:
    "profile", "modes" or "clumps". kind and what are "" for the error against the exact solution.
    """

    name: str
    words: str
    kind: str = ""
    what: str = ""

    @property
    def is_exact(self) -> bool:
        """True for the error against the exact solution."""
        return not self.what

    def error(self, run: Run, reference: Run | None) -> float:
        """Return the error of a run.

        run, reference: results of runs, from `study.runs`; `reference` may be None for the measure "exact".
        """
        if self.is_exact:
            return max(run["errors"].values())
        assert reference is not None
        found, wanted = (each[_KEYS[self.what]][self.kind] for each in (run, reference))
        if self.what == "profile":
            return profile_errors({self.kind: found}, {self.kind: wanted})[self.kind]
        return float(np.abs(np.subtract(found, wanted)).max())


_KEYS = {"profile": "profiles", "modes": "modes", "clumps": "clumps"}  # names in the results of a run


def measures_of(scene: Scene) -> dict[str, Measure]:
    """Return the measures of the error that runs of the scene have, by name; the first is the default."""
    found: list[Measure] = []
    exact = measure_of(scene)
    if exact is not None:
        found.append(Measure("exact", exact.words))
    for what in WORDS if is_disc(scene) else ("profile",):
        for kind in ("dust", "gas"):
            if getattr(scene, kind):
                found.append(Measure(f"{kind}-{what}", WORDS[what].format(kind=kind), kind, what))
    return {each.name: each for each in found}


def mean_run(runs: list[Run]) -> Run:
    """Return the mean of profiles, modes and clumps over several runs, in the form of the results of one run."""
    keys = [key for key in _KEYS.values() if key in runs[0]]
    return {
        key: {kind: np.mean([run[key][kind] for run in runs], axis=0).tolist() for kind in runs[0][key]} for key in keys
    }


def structure_of(sim: Any) -> Run:
    """Return the profiles of a simulation, and for a disc modes and clumps: lists of numbers by name and species."""
    out: Run = {"profiles": binned_masses(sim)}
    if is_disc(sim.scene):
        reach = 0.5 * min(sim.scene.space.size)
        for key, of in (("modes", mode_amplitudes), ("clumps", clump_fraction)):
            out[key] = {kind: of(p.pos, p.mass, reach) for kind, p in sim.state.species.items()}
    return out


def mode_amplitudes(pos: Array, mass: Array, reach: float) -> list[float]:
    """Return the amplitudes A_m for m in MODES, in rings within the radius `reach`.

    pos (n, 2), mass (n,): positions and masses of all particles.
    """
    radius, angle = np.hypot(*pos.T), np.arctan2(pos[:, 1], pos[:, 0])
    ring = np.minimum((radius / reach * RINGS).astype(int), RINGS)  # index RINGS: beyond `reach`, left out
    noise = np.bincount(ring, mass**2, RINGS + 1)[:RINGS]
    out = []
    for m in MODES:
        real, imaginary = (np.bincount(ring, mass * of(m * angle), RINGS + 1)[:RINGS] for of in (np.cos, np.sin))
        out.append(float(np.sqrt(np.maximum(real**2 + imaginary**2 - noise, 0.0)).sum() / max(mass.sum(), 1e-300)))
    return out


def clump_fraction(pos: Array, mass: Array, reach: float) -> list[float]:
    """Return the mass fraction in clumps within the radius `reach` as a list of one number.

    pos (n, 2), mass (n,): positions and masses of all particles.
    """
    on_map, _ = np.histogramdd(pos, bins=PIXELS, range=[(-reach, reach)] * 2, weights=mass)
    x = (np.arange(PIXELS) + 0.5) * 2.0 / PIXELS - 1.0
    ring = (np.hypot(x[:, None], x) * RINGS).astype(int)
    in_clumps, threshold = 0.0, MIN_CLUMP_PARTICLES * float(mass.mean()) if len(mass) else 0.0
    for k in range(RINGS):
        pixels = on_map[ring == k]
        usual = float(np.median(pixels)) or float(pixels.mean())  # the mean if most pixels of the ring are empty
        in_clumps += float(pixels[pixels > max(CLUMP_CONTRAST * usual, threshold)].sum())
    return [in_clumps / max(float(mass.sum()), 1e-300)]
