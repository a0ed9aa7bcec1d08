"""Drag laws, which determine the stopping time: their parameters from a scene, and their rules.

Formulas are in `formulas/laws.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discsim.formulas import laws as formulas
from discsim.parts import LAWS, Lazy
from discsim.physics import profile
from discsim.physics.grains import epstein_stopping_time, mean_free_column, typical_size
from discsim.scene.rules import Draft, Problem, Rule, kinds

if TYPE_CHECKING:
    from discsim.scene import Scene

kernels = Lazy("discsim.kernels.drag.laws")
Array = np.ndarray


@dataclass(frozen=True)
class Law:
    """Drag law: a law of the stopping time t_stop.

    Attributes
    ----------
    form : int
        Form of the law, a constant of `formulas/laws.py`. Several laws may share a form.
    value : callable (scene, population)
        Return the main parameter of a dust population: K, t_stop, St or s rho_s c_s / c, depending on the form.
    key : str
        Key of [drag] that the law needs. It is an error with laws that need another key.
    of_grains : bool
        Whether the law depends on grain size and grain density.
    orbits : tuple of int
        Numbers of space dimensions in which the law needs an orbital frequency.
    formula : callable (scene), optional
        Return the formula of t_stop as text, for previews.
    rules : tuple of Rule
        Additional rules for a scene with this law.
    uniform_rate : callable (drag, eps, rho_g), optional
        Return eps / t_stop in uniform gas and dust, from the table [drag]; None if the table does not determine it.
    uniform_time : callable (drag), optional
        Return t_stop from the table [drag]; None if t_stop depends on the gas.
    """

    form: int
    value: Callable[[Scene, Any], float]
    key: str = ""
    of_grains: bool = False
    orbits: tuple[int, ...] = ()
    formula: Callable[[Scene], str] | None = None
    rules: tuple[Rule, ...] = ()
    uniform_rate: Callable[[Any, float, float], float] | None = None
    uniform_time: Callable[[Any], float] | None = None

    @property
    def by_column(self) -> bool:
        """True if the stopping time depends on the mean free path of the gas. It then depends on the slip too."""
        return self.form == formulas.EPSTEIN_STOKES


class SceneLaw:
    """Parameters of a scene's drag law for kernels.

    code: form of the law. grains (populations, 5): parameters of each population; VALUE to THERMAL of
    `formulas/laws.py` are the column indices. typical (populations,): mean grain size. nonlinear: whether the stopping
    time depends on the slip.
    """

    def __init__(self, scene: Scene):
        drag: Any = scene.drag
        law: Law = LAWS[drag.law]
        self.code = law.form
        self.nonlinear = drag.supersonic or law.by_column
        self.populations = len(scene.dust or ())
        self.several = True if self.populations > 1 else None  # None: kernels compile no branch for it
        self.grains = np.array([_grain(scene, law, population) for population in scene.dust or ()])
        self.typical = np.array([typical_size(dust) if law.of_grains else 1.0 for dust in scene.dust or ()])

    def rows(self, species: Array, size: Array) -> Array:
        """Return the parameters (n, 5) of dust particles. species (n,): populations. size (n,): grain sizes."""
        rows: Array = self.grains[species]
        rows[:, [formulas.VALUE, formulas.SIZE]] *= (size / self.typical[species])[:, None]
        return rows

    def stopping_time(self, population: int, density: Array, sound: Array, omega: Array, ratio: float) -> Array:
        """Return the stopping time (n,) of a population at zero slip.

        density, sound, omega (n,): density, thermal speed and orbital frequency of the gas. ratio: dust-to-gas ratio.
        """
        return kernels.stopping_times(self.code, self.grains[population], ratio, density, sound, omega)


def _grain(scene: Scene, law: Law, population: Any) -> list[float]:
    value, faster = law.value(scene, population), formulas.KWOK * scene.drag.supersonic
    if not law.by_column:
        return [value, faster, 0.0, 0.0, 0.0]
    size = typical_size(population)
    return [value, faster, size, mean_free_column(scene), size * population.grain_density / value]


def stopping_times(scene: Scene, density: Array, sound: Array | None, omega: Array | None) -> list[Array]:
    """Return the stopping time (n,) of each population at zero slip.

    density, sound, omega (n,): density, thermal speed and orbital frequency of the gas; sound and omega are None if the
    scene does not define them. The list is empty if the law needs such a value. The code is not compiled, and suitable
    only for small n.
    """
    if scene.drag is None:
        return []
    law: Law = LAWS[scene.drag.law]
    if (omega is None and scene.space.dimensions in law.orbits) or (sound is None and law.of_grains):
        return []
    unknown = np.full(len(density), np.nan)
    places = np.transpose([density, unknown if sound is None else sound, 0.0 * density if omega is None else omega])
    ratios = [population.ratio for population in scene.dust or ()]
    return [
        np.array([formulas.stopping_time(law.form, grain, ratio, *place) for place in places])
        for grain, ratio in zip(SceneLaw(scene).grains, ratios, strict=True)
    ]


def _epstein_value(scene: Scene, population: Any) -> float:
    """Return t_stop c_s rho_g of Epstein's law, which depends only on the grain."""
    convention = scene.drag.convention
    return epstein_stopping_time(typical_size(population), population.grain_density, 1.0, 1.0, convention)


def _value_of_key(key: str) -> Callable[[Scene, Any], float]:
    return lambda scene, population: getattr(scene.drag, key)


def _stokes_at_reference(scene: Scene, population: Any) -> float:
    """Return the parameter of Epstein's law for grains with the Stokes number drag.stokes at the reference density."""
    return scene.drag.stokes * profile.reference_density(scene) / math.sqrt(2 * math.pi)


def _epstein_formula(scene: Scene) -> str:
    kinetic = scene.drag.convention == "kinetic"
    time = "sqrt(pi/8) s rho_s / (c_s rho_g)" if kinetic else "s rho_s / (c_s rho_g)"
    if scene.space.dimensions == 1:
        return time
    return f"{time}, St = {'(pi/2)' if kinetic else 'sqrt(2 pi)'} s rho_s / Sigma"


def _stokes_formula(scene: Scene) -> str:
    return f"{_epstein_formula(scene)}; longer where the mean free path is below 4 s / 9"


def _grains(draft: Draft) -> Iterator[Problem]:
    for i, dust in enumerate(draft.dust or ()):
        for key in ("grain_size", "grain_density"):
            if getattr(dust, key) is None:
                yield ("dust", i, key), f'missing, but drag.law "{draft.drag.law}" needs it; expected this key too'


def _height(draft: Draft) -> Iterator[Problem]:
    if draft.dimensions == 2 and not draft.has("star"):
        yield (
            ("drag", "law"),
            "rho_g = Sigma / (sqrt(2 pi) H) with H = c_s / Omega needs a star; expected [star] too",
        )


def _needs_column(draft: Draft) -> Iterator[Problem]:
    if draft.drag.mean_free_column is None and draft.in_code_units:
        yield (
            ("drag", "mean_free_column"),
            f'missing, but law "{draft.drag.law}" needs it in code units; expected this key too',
        )


def _needs_star(draft: Draft) -> Iterator[Problem]:
    if not draft.has("star"):
        yield ("drag", "law"), "t_stop = stokes / Omega needs a star; expected a table [star] too"


def _needs_disc(draft: Draft) -> Iterator[Problem]:
    in_a_disc = draft.has("background") or (draft.start and draft.start.reference_density)
    if not (draft.has("star") and in_a_disc):
        words = " or ".join(f'"{kind}"' for kind in kinds(lambda start: start.reference_density))
        yield (
            ("drag", "law"),
            "t_stop = (stokes / Omega) Sigma_ref / Sigma needs a disc about a star; expected initial.kind = "
            f"{words} or [background], and [star]",
        )


EPSTEIN = Law(
    formulas.EPSTEIN, _epstein_value, of_grains=True, orbits=(2,), formula=_epstein_formula, rules=(_grains, _height)
)  # fmt: skip
EPSTEIN_STOKES = Law(
    formulas.EPSTEIN_STOKES,
    _epstein_value,
    of_grains=True,
    orbits=(2,),
    formula=_stokes_formula,
    rules=(_grains, _height, _needs_column),
)
CONSTANT = Law(
    formulas.CONSTANT,
    _value_of_key("K"),
    "K",
    formula=lambda scene: "rho_d / K",
    uniform_rate=lambda drag, ratio, density: drag.K / density,
)
STOPPING_TIME = Law(
    formulas.STOPPING_TIME,
    _value_of_key("t_stop"),
    "t_stop",
    uniform_rate=lambda drag, ratio, density: ratio / drag.t_stop,
    uniform_time=lambda drag: drag.t_stop,
)
STOKES_NUMBER = Law(
    formulas.STOKES_NUMBER,
    _value_of_key("stokes"),
    "stokes",
    orbits=(1, 2),
    formula=lambda scene: "stokes / Omega",
    rules=(_needs_star,),
)
STOKES_OVER_DENSITY = Law(
    formulas.EPSTEIN,
    _stokes_at_reference,
    "stokes",
    orbits=(1, 2),
    formula=lambda scene: "(stokes / Omega) Sigma_ref / Sigma",
    rules=(_needs_disc,),
)
