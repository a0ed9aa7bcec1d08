"""Drag laws, which determine the stopping time: their parameters from a scene, and their rules.

Formulas are in `formulas/laws.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas import laws as formulas
from discsim.parts import LAWS, Lazy
from discsim.physics import profile
from discsim.physics.grains import epstein_stopping_time, mean_free_column, typical_size
from discsim.scene.rules import Draft, Problem, Rule, missing_tables, quoted, starts_where

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.drag.laws")
Array = np.ndarray


@dataclass(frozen=True)
class StoppingTimeLaw:
    """Drag law: a law of the stopping time t_stop.

    Attributes
    ----------
    form : int
        Form of the law, a constant of `formulas/laws.py`. Several laws may share a form.
    value : callable (scene, population)
        Returns the main parameter of a dust population: K, t_stop, St or, for Epstein's law, t_stop c_s rho_g.
    key : str
        Key of [drag] that the law needs. Giving the key is an error with laws that need another key.
    of_grains : bool
        Whether the law depends on grain size and grain density.
    orbits : tuple of int
        Numbers of space dimensions in which the law needs an orbital frequency.
    formula : callable (scene), optional
        Returns the formula of t_stop as text, for previews.
    rules : tuple of Rule
        Additional rules for a scene with this law.
    uniform_rate : callable (scene, population, rho_g), optional
        Returns eps / t_stop in uniform gas and dust. None if keys of the scene do not determine this rate.
    uniform_time : callable (scene, population), optional
        Returns t_stop. None if t_stop depends on the gas.
    """

    form: int
    value: Callable[[Scene, Any], float]
    key: str = ""
    of_grains: bool = False
    orbits: tuple[int, ...] = ()
    formula: Callable[[Scene], str] | None = None
    rules: tuple[Rule, ...] = ()
    uniform_rate: Callable[[Scene, Any, float], float] | None = None
    uniform_time: Callable[[Scene, Any], float] | None = None

    @property
    def needs_mean_free_path(self) -> bool:
        """Whether the stopping time depends on the mean free path of the gas, and then also on the slip."""
        return self.form == formulas.EPSTEIN_STOKES


class SceneLaw:
    """Parameters of a scene's drag law for kernels.

    code: form of the law, a constant of `formulas/laws.py`. nonlinear: whether the stopping time depends on the slip.
    populations: number of dust populations. several: True with several populations, else None. grains
    (populations, 5): parameters of each population; VALUE to THERMAL of `formulas/laws.py` are the column indices.
    typical (populations,): mean grain size, or 1 if the law does not depend on size.
    """

    def __init__(self, scene: Scene):
        drag = scene.drag
        law: StoppingTimeLaw = LAWS[drag.law]
        self.code = law.form
        self.nonlinear = drag.supersonic or law.needs_mean_free_path
        self.populations = len(scene.dust or ())
        self.several = True if self.populations > 1 else None  # None: kernels compile no branch for it
        self.grains = np.array([_grain_parameters(scene, law, population) for population in scene.dust or ()])
        self.typical = np.array([typical_size(dust) if law.of_grains else 1.0 for dust in scene.dust or ()])

    def rows(self, species: Array, size: Array) -> Array:
        """Return the parameters (n, 5) of grains. species (n,): populations of the grains. size (n,): grain sizes."""
        rows = self.grains[species]
        rows[:, [formulas.VALUE, formulas.SIZE]] *= (size / self.typical[species])[:, None]
        return rows

    def stopping_time(self, population: int, density: Array, sound: Array, omega: Array, ratio: float) -> Array:
        """Return the stopping time (n,) of the dust population with the index `population` at zero slip.

        density, sound, omega (n,): density, thermal speed and orbital frequency of the gas. ratio: dust-to-gas mass
        ratio of the population.
        """
        ratios = np.full(len(density), ratio)
        return kernels.stopping_times(self.code, self.grains[population], ratios, density, sound, omega)


def _grain_parameters(scene: Scene, law: StoppingTimeLaw, population: Any) -> list[float]:
    """Return the parameters of a dust population, a row of `SceneLaw.grains`."""
    value, faster = law.value(scene, population), formulas.KWOK * scene.drag.supersonic
    if not law.needs_mean_free_path:
        return [value, faster, 0.0, 0.0, 0.0]
    size = typical_size(population)
    return [value, faster, size, mean_free_column(scene), size * population.grain_density / value]


def stopping_times(scene: Scene, density: Array, sound: Array | None, omega: Array | None) -> list[Array]:
    """Return the stopping time (n,) of each population at zero slip.

    density, sound, omega (n,): density, thermal speed and orbital frequency of the gas; sound and omega are None if the
    scene does not define them. The list is empty if the scene has no drag, or if the law needs a value that is None.
    The code is not compiled, and suitable only for small n.
    """
    if scene.drag is None:
        return []
    law: StoppingTimeLaw = LAWS[scene.drag.law]
    if (omega is None and scene.space.dimensions in law.orbits) or (sound is None and law.of_grains):
        return []
    unknown = np.full(len(density), np.nan)
    points = np.transpose([density, unknown if sound is None else sound, 0.0 * density if omega is None else omega])
    return [
        np.array([formulas.stopping_time(law.form, grain, population.ratio, *point) for point in points])
        for grain, population in zip(SceneLaw(scene).grains, scene.dust or (), strict=True)
    ]


def _epstein_value(scene: Scene, population: Any) -> float:
    """Return t_stop c_s rho_g of Epstein's law, which depends only on the grain."""
    convention = scene.drag.convention
    return epstein_stopping_time(typical_size(population), population.grain_density, 1.0, 1.0, convention)


def _value_of_key(key: str) -> Callable[[Scene, Any], float]:
    """Return a function for `StoppingTimeLaw.value` that returns the key `key` of [drag]."""
    return lambda scene, population: getattr(scene.drag, key)


def _given_time(scene: Scene, population: Any) -> float:
    """Return the stopping time in the scene: `dust.t_stop` of the population, or `drag.t_stop`."""
    return scene.drag.t_stop if population.t_stop is None else population.t_stop


def _stokes_at_reference(scene: Scene, population: Any) -> float:
    """Return the parameter t_stop c_s rho_g of grains with the Stokes number drag.stokes at the reference density."""
    return scene.drag.stokes * profile.reference_density(scene) / math.sqrt(2 * math.pi)


def _epstein_formula(scene: Scene) -> str:
    """Return the formula of Epstein's stopping time as text."""
    kinetic = scene.drag.convention == "kinetic"
    time = "sqrt(pi/8) s rho_s / (c_s rho_g)" if kinetic else "s rho_s / (c_s rho_g)"
    if scene.space.dimensions == 1:
        return time
    return f"{time}, St = {'(pi/2)' if kinetic else 'sqrt(2 pi)'} s rho_s / Sigma"


def _stokes_formula(scene: Scene) -> str:
    """Return the formula of the stopping time with Stokes drag of large grains as text."""
    return f"{_epstein_formula(scene)}; longer where the mean free path is below 4 s / 9"


def _grain_problems(draft: Draft) -> Iterator[Problem]:
    """Yield problems of dust without the grain size or density that the law needs."""
    for i, dust in enumerate(draft.dust or ()):
        for key in ("grain_size", "grain_density"):
            if getattr(dust, key) is None:
                yield ("dust", i, key), f'missing, but required by drag.law = "{draft.drag.law}"; add this key'


def _height_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a 2D scene without a star, in which volume densities are not defined."""
    if draft.dimensions == 2 and not draft.has("star"):
        wrong = "rho_g = Sigma / (sqrt(2 pi) H) with H = c_s / Omega needs a star"
        yield ("drag", "law"), f"{wrong}; add a table [star]"


def _time_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a population without a stopping time."""
    if draft.drag.t_stop is None:
        for i, dust in enumerate(draft.dust or ()):
            if dust.t_stop is None:
                yield ("dust", i, "t_stop"), f'missing, but required by drag.law = "{draft.drag.law}"; add this key'


def _column_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a missing drag.mean_free_column, which has no default in code units."""
    if draft.drag.mean_free_column is None and draft.in_code_units:
        wrong = f'missing, but required by drag.law = "{draft.drag.law}" in code units'
        yield ("drag", "mean_free_column"), f"{wrong}; add this key"


def _orbit_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a constant Stokes number without a star."""
    yield from missing_tables(draft, ("drag", "law"), {"star": "t_stop = stokes / Omega needs a star"})


def _disc_problems(draft: Draft) -> Iterator[Problem]:
    """Yield a problem of a Stokes number at a reference density in a scene that is no disc about a star."""
    in_a_disc = draft.has("background") or (draft.start and draft.start.reference_density)
    if not (draft.has("star") and in_a_disc):
        wrong = "t_stop = (stokes / Omega) Sigma_ref / Sigma needs a disc about a star"
        words = quoted(starts_where(lambda start: start.reference_density))
        yield ("drag", "law"), f"{wrong}; add [star], and set initial.kind = {words} or add [background]"


EPSTEIN = StoppingTimeLaw(
    formulas.EPSTEIN,
    _epstein_value,
    of_grains=True,
    orbits=(2,),
    formula=_epstein_formula,
    rules=(_grain_problems, _height_problems),
)
EPSTEIN_STOKES = replace(
    EPSTEIN,
    form=formulas.EPSTEIN_STOKES,
    formula=_stokes_formula,
    rules=(_grain_problems, _height_problems, _column_problems),
)
CONSTANT = StoppingTimeLaw(
    formulas.CONSTANT,
    _value_of_key("K"),
    "K",
    formula=lambda scene: "rho_d / K",
    uniform_rate=lambda scene, population, density: scene.drag.K / density,
)
STOPPING_TIME = StoppingTimeLaw(
    formulas.STOPPING_TIME,
    _given_time,
    "t_stop",
    rules=(_time_problems,),
    uniform_rate=lambda scene, population, density: population.ratio / _given_time(scene, population),
    uniform_time=_given_time,
)
STOKES_NUMBER = StoppingTimeLaw(
    formulas.STOKES_NUMBER,
    _value_of_key("stokes"),
    "stokes",
    orbits=(1, 2),
    formula=lambda scene: "stokes / Omega",
    rules=(_orbit_problems,),
)
STOKES_OVER_DENSITY = StoppingTimeLaw(
    formulas.EPSTEIN,
    _stokes_at_reference,
    "stokes",
    orbits=(1, 2),
    formula=lambda scene: "(stokes / Omega) Sigma_ref / Sigma",
    rules=(_disc_problems,),
)
