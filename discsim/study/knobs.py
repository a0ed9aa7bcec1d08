"""Knobs of a scene: numerical parameters that the search for cheap settings varies.

A knob is a number or a choice. One rung up multiplies a number by a fixed ratio, towards higher accuracy. A grid point
is a tuple with an entry for each knob, 0 for the value in the scene. For a number, the entry counts half rungs; for a
choice, the entry is the index of a value. The knobs follow from the tables of the scene and the types of their keys:

    particles        particle numbers of gas and dust, with a fixed smoothing length that keeps neighbour numbers
    dust particles   particle numbers of dust
    neighbours       eta, or the fixed smoothing length
    run.courant ...  keys in NUMBERS and CHOICES that the scene uses

Values that violate the rules of the scene are left out.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from discsim.drag.published.fixed_grid import OF_SPH
from discsim.drag.width import in_lengths
from discsim.effects import effect_classes
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics.layout import grid_cells
from discsim.preview.derived import particle_count
from discsim.scene import Scene, SceneError, nearest_hint
from discsim.scene.differences import differences
from discsim.scene.fields import choices_in
from discsim.scene.messages import value_at
from discsim.scene.rules import Draft, longest_courant
from discsim.scene.tomltext import inline
from discsim.study.points import Settings, StudyError, Varied
from discsim.study.trials import UNITS_PER_RUNG, GridPoint

# Numeric keys with the factor of one rung. `particles` and `neighbours` have their own factors, below.
NUMBERS = {"run.courant": 0.5**0.5, "run.timestep": 0.5**0.5, "space.cells": 2.0, "drag.cell": 0.5}
CHOICES = ("gas.method", "drag.scheme", "gas.kernel", "gas.precision")
MORE_PARTICLES = 2.0
# Factor of one rung, and stride in half rungs, by dimensions: in 1D the density is right only if h is a whole number of
# particle spacings (`formulas/smoothing.py`).
MORE_NEIGHBOURS = {1: (2.0, UNITS_PER_RUNG), 2: (1.25, 1)}
MIN_PARTICLES = {1: 24, 2: 150}  # smallest particle number of a species, by dimensions
MIN_VALUE, MAX_VALUE = {"space.cells": 8.0, "run.courant": 0.01}, {"space.cells": 8192.0}
MAX_RUNGS = 8 * UNITS_PER_RUNG  # largest entry of a number in a grid point, up and down
# Half rungs of `particles` from the scene down to the start of a search, by dimensions.
START_RUNGS = {1: 3 * UNITS_PER_RUNG, 2: 4 * UNITS_PER_RUNG}
_QUANTITY = re.compile(r"\s*([\d_.eE+-]+)(.*)", re.S)


class Base:
    """A validated scene and its tables as written in TOML; the factors of knobs multiply their values."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.data = scene, tomllib.loads(scene.text)

    def written(self, key: str) -> Any:
        """Return the value of a key as written in the scene; None if the scene does not set it."""
        return value_at(self.data, *(int(part) if part.isdecimal() else part for part in key.split(".")))

    def value(self, key: str) -> Any:
        """Return the value of a key as written, or its default if the scene does not set it."""
        found = self.written(key)
        if found is None:
            found = self.scene
            for part in key.split("."):
                found = getattr(found, part, None)
        if found is None and key == "drag.cell" and self.scene.drag is not None and self.scene.gas is not None:
            return in_lengths(self.scene) or None
        return found

    def times(self, key: str, factor: float, whole: bool = False, digits: int = 4) -> str:
        """Return the value of a key times a factor, as text with the unit of the value.

        The number is rounded to an integer if `whole`, else to `digits` significant digits.
        """
        value, unit = self.value(key), ""
        if isinstance(value, str):
            match = _QUANTITY.fullmatch(value)
            assert match is not None
            value, unit = float(match[1].replace("_", "")), match[2]
        found = f"{round(value * factor)}" if whole else f"{value * factor:.{digits}g}"
        return f'"{found}{unit}"' if unit else found

    @property
    def species(self) -> list[str]:
        """The keys of all particle numbers, such as "dust.0.particles"."""
        dust = self.data.get("dust")
        tables = [f"dust.{i}" for i in range(len(dust))] if isinstance(dust, list) else ["dust"] if dust else []
        return [f"{table}.particles" for table in (["gas"] if self.scene.gas else []) + tables]


Write = Callable[[Base, Any], Settings]  # settings of a knob from a factor, or from the word of a choice


@dataclass(frozen=True)
class Knob:
    """A parameter that a search varies: a number, or a choice.

    keys: keys of the scene that the knob sets. write: write(base, factor), for a choice write(base, word), returns
    the settings for an entry of a grid point other than 0. ratio: factor of one rung. words: values of a choice, of
    which the first, "", stands for the value in the scene. lowest, highest, stride: range of the knob's entry in a
    grid point, and distance between allowed entries.
    """

    name: str
    keys: tuple[str, ...]
    write: Write
    ratio: float = 1.0
    words: tuple[str, ...] = ()
    lowest: int = -MAX_RUNGS
    highest: int = MAX_RUNGS
    stride: int = 1

    @property
    def is_choice(self) -> bool:
        """True if the knob is a choice, not a number."""
        return bool(self.words)

    def word(self, base: Base, rung: int) -> str:
        """Return the value with the index `rung` of a choice, as text."""
        return self.words[rung] or str(base.value(self.keys[0]))

    def settings(self, base: Base, rung: int) -> Settings:
        """Return the settings for the entry `rung` of this knob in a grid point; {} for 0, the value in the scene."""
        if rung == 0:
            return {}
        return self.write(base, self.words[rung] if self.is_choice else self.ratio ** (rung / UNITS_PER_RUNG))


class Knobs:
    """All knobs of a scene, and the settings of grid points. Raises StudyError.

    load: load(settings) returns the scene with these settings. varied: the --vary options of the user. keep: names or
    keys of knobs that stay fixed. finest: largest entry of the knob `particles`, in half rungs.
    """

    def __init__(
        self, load: Callable[[Settings], Scene], varied: Sequence[Varied] = (), keep: Sequence[str] = (),
        finest: int = MAX_RUNGS,
    ) -> None:  # fmt: skip
        self.load = load
        self.base = Base(load({}))
        given = [self._knob_of_option(each) for each in varied]
        taken = {key for knob in given for key in knob.keys} | set(keep)
        found = [*self._choice_knobs(), *self._particle_knobs(finest), *self._number_knobs()]
        known = [key for knob in [*given, *found] for key in (knob.name, *knob.keys)]
        for key in keep:
            if key not in known:
                expected = f"expected one of {', '.join(known)}{nearest_hint(key, known)}"
                raise StudyError(f"--keep {key}: not a key that the search varies; {expected}")
        self.all = [*given, *(knob for knob in found if not taken & {knob.name, *knob.keys[:1]})]
        if not self.all:
            raise StudyError("no key is left to vary; remove a --keep")
        self._settings: dict[GridPoint, Settings | None] = {}

    def start(self) -> GridPoint:
        """Return the grid point at which a search starts: fewer particles, all other knobs as in the scene."""
        coarse = -START_RUNGS[self.base.scene.space.dimensions]
        return tuple(max(coarse, knob.lowest) if knob.name == "particles" else 0 for knob in self.all)

    def settings(self, point: GridPoint) -> Settings | None:
        """Return the settings of a grid point; None if the scene is invalid with them."""
        if point not in self._settings:
            try:
                self._settings[point] = self._settings_of(point)
            except SceneError:
                self._settings[point] = None
        return self._settings[point]

    def _settings_of(self, point: GridPoint) -> Settings:
        """Return the settings of a grid point. Raises SceneError if the scene is invalid with them.

        Choices are set first, because the default values of numbers may depend on them.
        """
        base, out = self.base, Settings()
        for choices in (True, False):
            for knob, rung in zip(self.all, point, strict=True):
                if knob.is_choice == choices:
                    out |= knob.settings(base, rung)
                    if knob.name == "particles" and rung:
                        base = Base(self.load(out))
            if choices and out:
                base = Base(self.load(out))
        self.load(out)
        return out

    # Knobs of the scene

    def _is_valid(self, settings: Settings) -> bool:
        """Return whether the scene is valid with the settings."""
        try:
            self.load(settings)
        except SceneError:
            return False
        return True

    def _knob_of_option(self, varied: Varied) -> Knob:
        """Return the knob of a --vary option, without the values that do not change the scene.

        Raises StudyError, SceneError.
        """
        found = [(value, self.load(varied.settings(value))) for value in varied.values]
        words = [value for value, scene in found if any(differences(self.base.scene, scene))]
        if not words:
            raise StudyError(f"--vary {varied.name}: all values equal the value of the scene; add other values")
        return _choice_knob(varied.name, varied.keys, lambda base, word: varied.settings(word), words)

    def _choice_knobs(self) -> Iterator[Knob]:
        """Yield a knob for each key in CHOICES for which values other than the scene's are valid."""
        scene = self.base.scene
        for key in CHOICES:
            table, name = key.split(".")
            field = type(scene.table(table)).model_fields.get(name) if scene.table(table) else None
            if field is None:
                continue
            own = getattr(scene.table(table), name)
            others = [word for word in choices_in(field.annotation) if word != own]
            write = WRITERS.get(key) or _write_word(key)
            words = [word for word in others if self._is_valid(write(self.base, word))]
            if words:
                yield _choice_knob(key, (key,), write, words)

    def _particle_knobs(self, finest: int) -> Iterator[Knob]:
        """Yield the knobs `particles` and `dust particles`, if the scene sets all particle numbers."""
        base, dim = self.base, self.base.scene.space.dimensions
        scene, keys = base.scene, tuple(base.species)
        counts = {key: int(base.value(key) if base.written(key) is not None else 0) for key in keys}
        if not keys or not all(counts.values()):
            return

        def lowest(some: Sequence[str]) -> int:
            # The smallest entry of a knob that sets these keys.
            least = min(counts[key] for key in some) / MIN_PARTICLES[dim]
            return -min(MAX_RUNGS, int(UNITS_PER_RUNG * math.log2(max(least, 1.0))))

        def particles(at: Base, factor: float) -> Settings:
            out = {key: at.times(key, factor, whole=True) for key in keys}
            if scene.gas and scene.gas.smoothing_length is not None:
                exactly = int(out["gas.particles"]) / counts["gas.particles"]  # keeps h a whole number of spacings
                out["gas.smoothing_length"] = at.times("gas.smoothing_length", exactly ** (-1.0 / dim), digits=8)
            return out

        yield Knob("particles", keys, particles, MORE_PARTICLES, lowest=lowest(keys), highest=finest)
        dust = tuple(key for key in keys if key.startswith("dust"))
        if dust and len(dust) < len(keys) and not scene.model.cells:
            write = _write_multiple(*dust, whole=True)
            yield Knob("dust particles", dust, write, MORE_PARTICLES, lowest=lowest(dust), highest=finest)

    def _longest_courant(self) -> float:
        """Return the largest stable Courant factor of the scene."""
        scene = self.base.scene
        tables = {name: scene.table(name) for name in ("initial", "space", "gas") if scene.table(name) is not None}
        return longest_courant(Draft(self.base.data, tables))[0]

    def _number_knobs(self) -> Iterator[Knob]:
        """Yield the knobs of the keys in NUMBERS, and the knob `neighbours`."""
        scene = self.base.scene
        for key, ratio in NUMBERS.items():
            value = self.base.value(key)
            if key == "space.cells":
                if scene.space.dimensions == 2 and any(e.role.grid for e in effect_classes(scene).values()):
                    lowest, highest = _rung_limits(key, float(_write_cells(self.base, 1.0)[key]), ratio)
                    yield Knob(key, (key,), _write_cells, ratio, (), lowest, highest, stride=UNITS_PER_RUNG)
            elif value is None or (key == "run.courant" and scene.run.timestep is not None):
                continue
            elif self._is_valid(_write_multiple(key)(self.base, ratio)):
                number = float(value) if not isinstance(value, str) else 1.0
                most = self._longest_courant() if key == "run.courant" else math.inf
                yield Knob(key, (key,), _write_multiple(key), ratio, (), *_rung_limits(key, number, ratio, most))
        if scene.gas and scene.model.is_sph:
            key = "gas.eta" if scene.gas.smoothing_length is None else "gas.smoothing_length"
            more, stride = MORE_NEIGHBOURS[scene.space.dimensions]
            ends = -3 * UNITS_PER_RUNG, 6 * UNITS_PER_RUNG
            yield Knob("neighbours", (key,), _write_multiple(key, digits=8), more, (), *ends, stride)


def _rung_limits(key: str, value: float, ratio: float, most: float = math.inf) -> tuple[int, int]:
    """Return the smallest and the largest entry of a grid point for which the value of a key stays within its limits.

    value: value of the key in the scene. ratio: factor of one rung. The limits are MIN_VALUE, MAX_VALUE and `most`.
    """
    bounds = [MIN_VALUE.get(key, 0.0), min(most, MAX_VALUE.get(key, math.inf))]
    ends = [UNITS_PER_RUNG * math.log(bound / value) / math.log(ratio) for bound in bounds if 0.0 < bound < math.inf]
    low, high = (min(ends), max(ends)) if ends else (-MAX_RUNGS, MAX_RUNGS)
    return min(0, max(-MAX_RUNGS, math.ceil(low - 1e-9))), max(0, min(MAX_RUNGS, math.floor(high + 1e-9)))


def _choice_knob(name: str, keys: tuple[str, ...], write: Write, words: Sequence[str]) -> Knob:
    """Return the knob of a choice between the value in the scene and `words`."""
    return Knob(name, keys, write, words=("", *words), lowest=0, highest=len(words))


def _write_word(key: str) -> Write:
    """Return the function `Knob.write` of a knob that sets a key to a word."""
    return lambda base, word: {key: word}


def _write_multiple(*keys: str, whole: bool = False, digits: int = 4) -> Write:
    """Return the function `Knob.write` of a knob that multiplies the values of keys by a factor."""
    return lambda base, factor: {key: base.times(key, factor, whole, digits) for key in keys}


def _write_kernel(base: Base, word: str) -> Settings:
    """Return the settings for the kernel `word`.

    If the scene sets eta, the ratio of eta to the kernel's default is kept.
    """
    eta = base.written("gas.eta")
    if eta is None:
        return {"gas.kernel": word}
    of_dimension = base.scene.space.dimensions - 1
    usual = [SMOOTHING[name].eta[of_dimension] for name in (base.scene.gas.kernel, word)]
    return {"gas.kernel": word, "gas.eta": f"{eta * usual[1] / usual[0]:.4g}"}


def _write_method(base: Base, word: str) -> Settings:
    """Return the settings for gas of the method `word`, without keys that only other methods use."""
    unused = OF_SPH if word == "grid" else ("grid",)
    kept = {key: value for key, value in base.data["gas"].items() if key not in unused}
    return {"gas": inline(kept | {"method": word})}


WRITERS: dict[str, Write] = {"gas.method": _write_method, "gas.kernel": _write_kernel}


def _write_cells(base: Base, factor: float) -> Settings:
    """Return the settings with `space.cells`, the number of cells along the longest side: the default times a factor.

    The default is about one cell per particle.
    """
    scene = base.scene
    first = (scene.gas,) if scene.gas else scene.dust or ()
    cell, _ = grid_cells(scene, sum(particle_count(scene, species) for species in first))
    return {"space.cells": str(round(max(scene.space.size) / cell * factor))}
