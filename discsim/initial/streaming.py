"""streaming: gas and dust in the steady drift of a shearing box, with a growing wave of the streaming instability.

Particles are on triangular lattices, or dust at random (`dust.placement`). Velocities are those of the drift of
Nakagawa, Sekiya & Hayashi (1986) and of the fastest growing mode with the given numbers of wavelengths along radius and
height (`exact/streaming.py`). Particles are displaced so that densities are those of the mode. The modes linA and linB
of Youdin & Johansen (2007) have K = 2 pi waves eta r / side of 30 and 6.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from discsim.exact import streaming
from discsim.initial.base import Array, Arrays, SamplePoints, Start
from discsim.initial.lattice import sample_uniform_gas, triangular_points, uniform_particles
from discsim.initial.measure import ErrorMeasure, Simulated
from discsim.numerics.totals import totals
from discsim.parts import LAWS
from discsim.physics.shear import has_mode, mean_box
from discsim.scene.fields import Count, Density, Number, Table
from discsim.scene.rules import Draft, Problem, missing_tables

if TYPE_CHECKING:
    from discsim.scene import Scene


class Streaming(Table):
    """Gas and dust of a shearing box in steady drift, with a growing wave."""

    kind: Literal["streaming"] = "streaming"
    density: Density = Field(1.0, gt=0, description="mean density of the gas")
    amplitude: Number = Field(
        1e-4, ge=0, lt=0.5, description="relative amplitude of the density of the first dust population; 0: no wave"
    )
    wavelengths: tuple[Count, Count] = Field((1, 1), description="number of wavelengths along radius and height")


def wave_vector(scene: Scene) -> Array:
    """Return the wave vector (2,) of the start."""
    return 2.0 * np.pi * np.array(scene.initial.wavelengths) / np.array(scene.space.size)


def _box_of(scene: Scene) -> streaming.Box:
    return mean_box(scene, scene.initial.density, [dust.ratio for dust in scene.dust or ()])


def particles(scene: Scene) -> dict[str, Arrays]:
    start, box, k = scene.initial, _box_of(scene), wave_vector(scene)
    out = uniform_particles(scene, start.density, triangular_points)
    amplitudes = np.zeros((len(box.ratios) + 1, 4), complex)
    if start.amplitude > 0.0:
        amplitudes = start.amplitude * streaming.fastest_mode(box, *k).amplitudes
    drift = streaming.drift(box)
    for name, arrays in out.items():
        row = arrays["species"] + 1 if name == "dust" else np.zeros(len(arrays["mass"]), np.int64)
        wave = amplitudes[row] * np.exp(1j * (arrays["pos"] @ k))[:, None]
        velocity = wave[:, 1:].real
        arrays["vel"][:, 0] = drift[row, 0] + velocity[:, 0]
        arrays["vel"][:, 1] = velocity[:, 2]
        arrays["across"] = drift[row, 1] + velocity[:, 1]
        # A displacement xi changes the density by -div xi.
        arrays["pos"] += np.outer((1j * wave[:, 0]).real, k / (k @ k))
        arrays["pos"] %= np.array(scene.space.size)
    return out


def sample_points(scene: Scene) -> SamplePoints:
    return sample_uniform_gas(scene.initial.density)


def mode_amplitude(scene: Scene, sim: Simulated) -> complex:
    """Return the present amplitude of the growing mode of the start, relative to that of exact growth without phase.

    The amplitude is the density amplitude of the first dust population in the mode. Other modes with the same wave
    vector do not contribute.
    """
    box, k = _box_of(scene), wave_vector(scene)
    mode, drift = streaming.fastest_mode(box, *k), streaming.drift(box)
    found = np.zeros_like(mode.amplitudes)
    for name, p in sim.state.species.items():
        for row in range(1, len(drift)) if name == "dust" else (0,):
            own = np.full(p.count, True) if row == 0 else p.arrays()["species"] == row - 1
            found[row] = _amplitudes(p, own, drift[row], k)
    return complex((mode.left * found).sum())


def _amplitudes(p: Any, own: Array, drift: Array, k: Array) -> Array:
    """Return the amplitudes (4,) of exp(i k.x): relative density, and deviations of the velocity from `drift`.

    own (n,): mask of the particles of a species.
    """
    weight, phase = np.where(own, p.mass, 0.0), p.pos @ k
    values = [np.ones_like(weight), p.vel[:, 0] - drift[0], p.across - drift[1], p.vel[:, 1]]
    columns = [weight * v * wave for v in values for wave in (np.cos(phase), -np.sin(phase))]
    *sums, mass = totals(np.stack([*columns, weight], axis=1)).tolist()
    return 2.0 * (np.array(sums[::2]) + 1j * np.array(sums[1::2])) / mass


def measure(scene: Scene) -> ErrorMeasure | None:
    """Return the `ErrorMeasure` of the growth rate; None if the scene has no growing mode."""
    if scene.initial.amplitude == 0.0 or not has_mode(scene) or not scene.gas or not scene.dust:
        return None

    def errors(sim: Simulated) -> dict[str, float]:
        rate = streaming.fastest_mode(_box_of(scene), *wave_vector(scene)).rate.real
        found = np.log(abs(mode_amplitude(scene, sim)) / scene.initial.amplitude) / sim.time if sim.time > 0.0 else rate
        return {"": float(abs(found - rate) / abs(rate))}

    return ErrorMeasure("growth rate since the start compared with the exact mode", errors)


def _box_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of a scene without shearing box, gas or dust, and of drag without a known growing mode."""
    reasons = {"shearing_box": "this start is that of a shearing box", "gas": "this start needs gas"}
    yield from missing_tables(draft, ("initial", "kind"), reasons)
    if draft.initial.amplitude == 0.0:
        return
    where = ("initial", "amplitude")
    if not draft.has("dust") or not draft.has("drag"):
        yield where, "the wave needs dust and drag; add [dust] and [drag], or set initial.amplitude = 0"
    elif draft.drag and (draft.drag.direction == "one-way" or LAWS[draft.drag.law].uniform_time is None):
        wrong = 'the growing mode is known for two-way drag with drag.law = "stopping-time"'
        yield where, f"{wrong}; change [drag], or set initial.amplitude = 0"


START = Start(
    Streaming,
    particles,
    sample_points,
    dimensions=(2,),
    eos=("isothermal",),
    rules=(_box_problems,),
    measure=measure,
    exact_effects=("shearing_box",),
)
