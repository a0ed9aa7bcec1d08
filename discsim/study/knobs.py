"""The knobs of a scene: keys of its numerics that a search may turn, from what its tables, fields and registries have.

A rung of a number multiplies it by a fixed ratio, towards the finer; that of a choice is the next word of its key's
type. `particles` turns those of gas and dust together, and a fixed smoothing length with them, so that neighbours stay;
`dust particles` those of the dust alone; `neighbours` is eta, or the fixed length. A key that the scene does not use,
or a value that it does not go with, is no knob: the scene's own rules say so.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from discsim.drag.width import in_lengths
from discsim.effects import effect_classes
from discsim.formulas.smoothing import SMOOTHING
from discsim.numerics.layout import grid_cells
from discsim.preview.derived import particle_count
from discsim.scene import Scene, SceneError, near
from discsim.scene.differences import differences
from discsim.scene.fields import choices_in
from discsim.scene.messages import value_at
from discsim.scene.rules import Draft, longest_courant
from discsim.study.points import Settings, StudyError, Varied
from discsim.study.trials import RUNG, Place

# Keys that a rung multiplies, by what; those of particles and neighbours are more than one key.
NUMBERS = {"run.courant": 0.5**0.5, "run.timestep": 0.5**0.5, "space.cells": 2.0, "drag.cell": 0.5}
CHOICES = ("drag.scheme", "gas.kernel", "gas.precision")
MORE_PARTICLES = 2.0
# By dimensions, with the stride: in 1D only whole numbers of spacings have the right density (`formulas/smoothing.py`).
MORE_NEIGHBOURS = {1: (2.0, RUNG), 2: (1.25, 1)}
FEWEST = {1: 24, 2: 150}  # particles of a species, by dimensions
LEAST, MOST = {"space.cells": 8.0, "run.courant": 0.01}, {"space.cells": 8192.0}
WIDE = 8 * RUNG  # rungs of a number, either way
COARSE = {1: 3 * RUNG, 2: 4 * RUNG}  # rungs of particles that a search begins below the scene, by dimensions
_QUANTITY = re.compile(r"\s*([\d_.eE+-]+)(.*)", re.S)


class Base:
    """A scene as it stands, or with other words of its choices: validated, and its tables as they were written."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.data = scene, tomllib.loads(scene.text)

    def written(self, key: str) -> Any:
        return value_at(self.data, *(int(part) if part.isdecimal() else part for part in key.split(".")))

    def value(self, key: str) -> Any:
        """As the scene has it: as it was written, or by default."""
        found = self.written(key)
        if found is None:
            found = self.scene
            for part in key.split("."):
                found = getattr(found, part, None)
        if found is None and key == "drag.cell" and self.scene.drag is not None and self.scene.gas is not None:
            return in_lengths(self.scene) or None
        return found

    def times(self, key: str, factor: float, whole: bool = False, digits: int = 4) -> str:
        """The value of a key times a factor, as text of so many digits; the unit stays."""
        value, unit = self.value(key), ""
        if isinstance(value, str):
            match = _QUANTITY.fullmatch(value)
            assert match is not None
            value, unit = float(match[1].replace("_", "")), match[2]
        found = f"{round(value * factor)}" if whole else f"{value * factor:.{digits}g}"
        return f'"{found}{unit}"' if unit else found

    @property
    def species(self) -> list[str]:
        """Keys of the numbers of particles."""
        dust = self.data.get("dust")
        tables = [f"dust.{i}" for i in range(len(dust))] if isinstance(dust, list) else ["dust"] if dust else []
        return [f"{table}.particles" for table in (["gas"] if self.scene.gas else []) + tables]


@dataclass(frozen=True)
class Knob:
    """A knob. write(base, factor or word): the keys to set, where its rung is not 0.

    ratio: of the value a rung up. words: of a choice, "" for the scene's own. finer: of the number of particles, so
    that the place to begin at knows it.
    """

    name: str
    keys: tuple[str, ...]
    write: Callable[[Base, Any], Settings]
    ratio: float = 1.0
    words: tuple[str, ...] = ()
    lowest: int = -WIDE
    highest: int = WIDE
    stride: int = 1

    @property
    def choice(self) -> bool:
        return bool(self.words)

    def word(self, base: Base, rung: int) -> str:
        """Of a choice, for people."""
        return self.words[rung] or str(base.value(self.keys[0]))

    def settings(self, base: Base, rung: int) -> Settings:
        if rung == 0:
            return {}
        return self.write(base, self.words[rung] if self.choice else self.ratio ** (rung / RUNG))


class Knobs:
    """The knobs of a scene, and the settings of a place of them.

    load(settings): the scene with them. finest: half rungs of particles above the scene's own that may be tried.
    varied: keys with the values that a user gives them; keep: keys that are left alone. Raises StudyError.
    """

    def __init__(
        self, load: Callable[[Settings], Scene], varied: Sequence[Varied] = (), keep: Sequence[str] = (),
        finest: int = WIDE,
    ) -> None:  # fmt: skip
        self.load = load
        self.base = Base(load({}))
        given = [self._given(each) for each in varied]
        taken = {key for knob in given for key in knob.keys} | set(keep)
        found = [*self._words(), *self._particles(finest), *self._numbers()]
        known = [key for knob in [*given, *found] for key in (knob.name, *knob.keys)]
        for key in keep:
            if key not in known:
                raise StudyError(
                    f"--keep {key}: no knob of this scene; expected some of {', '.join(known)}{near(key, known)}"
                )
        self.all = [*given, *(knob for knob in found if not taken & {knob.name, *knob.keys[:1]})]
        if not self.all:
            raise StudyError("no knob is left to turn; expected fewer --keep")
        self._settings: dict[Place, Settings | None] = {}

    def start(self) -> Place:
        """The coarse place to begin at."""
        coarse = -COARSE[self.base.scene.space.dimensions]
        return tuple(max(coarse, knob.lowest) if knob.name == "particles" else 0 for knob in self.all)

    def settings(self, place: Place) -> Settings | None:
        """The keys that a place sets; None where the scene does not go with them."""
        if place not in self._settings:
            try:
                self._settings[place] = self._made(place)
            except SceneError:
                self._settings[place] = None
        return self._settings[place]

    def _made(self, place: Place) -> Settings:
        """Words first, then numbers, which may have other defaults with them."""
        base, out = self.base, Settings()
        for choices in (True, False):
            for knob, rung in zip(self.all, place, strict=True):
                if knob.choice == choices:
                    out |= knob.settings(base, rung)
                    if knob.name == "particles" and rung:
                        base = Base(self.load(out))
            if choices and out:
                base = Base(self.load(out))
        self.load(out)
        return out

    # What a scene has

    def _goes(self, settings: Settings) -> bool:
        try:
            self.load(settings)
        except SceneError:
            return False
        return True

    def _given(self, varied: Varied) -> Knob:
        """The knob of --vary: what the scene has, and the values that are others. Raises SceneError."""

        def write(base: Base, word: str) -> Settings:
            return varied.settings(word)

        found = [(value, self.load(varied.settings(value))) for value in varied.values]
        words = [value for value, scene in found if any(differences(self.base.scene, scene))]
        if not words:
            raise StudyError(f"--vary {varied.name}: only what the scene has already; expected other values")
        return Knob(varied.name, varied.keys, write, words=("", *words), lowest=0, highest=len(words))

    def _words(self) -> Iterator[Knob]:
        scene = self.base.scene
        for key in CHOICES:
            table, name = key.split(".")
            field = type(scene.table(table)).model_fields.get(name) if scene.table(table) else None
            if field is None:
                continue
            own = getattr(scene.table(table), name)
            others = [word for word in choices_in(field.annotation) if word != own]
            write = _kernel if key == "gas.kernel" else _word(key)
            words = tuple(word for word in others if self._goes(write(self.base, word)))
            if words:
                yield Knob(key, (key,), write, words=("", *words), lowest=0, highest=len(words))

    def _particles(self, finest: int) -> Iterator[Knob]:
        base, dim = self.base, self.base.scene.space.dimensions
        scene, keys = base.scene, tuple(base.species)
        counts = {key: int(base.value(key) if base.written(key) is not None else 0) for key in keys}
        if not keys or not all(counts.values()):
            return

        def lowest(some: Sequence[str]) -> int:
            least = min(counts[key] for key in some) / FEWEST[dim]
            return -min(WIDE, int(RUNG * math.log2(max(least, 1.0))))

        def particles(at: Base, factor: float) -> Settings:
            out = {key: at.times(key, factor, whole=True) for key in keys}
            if scene.gas and scene.gas.smoothing_length is not None:
                exactly = int(out["gas.particles"]) / counts["gas.particles"]  # h stays a whole number of spacings
                out["gas.smoothing_length"] = at.times("gas.smoothing_length", exactly ** (-1.0 / dim), digits=8)
            return out

        yield Knob("particles", keys, particles, MORE_PARTICLES, lowest=lowest(keys), highest=finest)
        dust = tuple(key for key in keys if key.startswith("dust"))
        if dust and len(dust) < len(keys) and not scene.model.cells:
            write = _times(*dust, whole=True)
            yield Knob("dust particles", dust, write, MORE_PARTICLES, lowest=lowest(dust), highest=min(finest, WIDE))

    def _longest_courant(self) -> float:
        scene = self.base.scene
        tables = {name: scene.table(name) for name in ("initial", "space", "gas") if scene.table(name) is not None}
        return longest_courant(Draft(self.base.data, tables))[0]

    def _numbers(self) -> Iterator[Knob]:
        scene = self.base.scene
        for key, ratio in NUMBERS.items():
            value = self.base.value(key)
            if key == "space.cells":
                if scene.space.dimensions == 2 and any(e.needs_grid for e in effect_classes(scene).values()):
                    lowest, highest = _within(key, float(_cells(self.base, 1.0)[key]), ratio)
                    yield Knob(key, (key,), _cells, ratio, (), lowest, highest, stride=RUNG)
            elif value is None or (key == "run.courant" and scene.run.timestep is not None):
                continue
            elif self._goes(_times(key)(self.base, ratio)):
                number = float(value) if not isinstance(value, str) else 1.0
                most = self._longest_courant() if key == "run.courant" else math.inf
                yield Knob(key, (key,), _times(key), ratio, (), *_within(key, number, ratio, most))
        if scene.gas and not scene.model.cells:
            key = "gas.eta" if scene.gas.smoothing_length is None else "gas.smoothing_length"
            more, stride = MORE_NEIGHBOURS[scene.space.dimensions]
            yield Knob("neighbours", (key,), _times(key, digits=8), more, (), -3 * RUNG, 6 * RUNG, stride)


def _within(key: str, value: float, ratio: float, most: float = math.inf) -> tuple[int, int]:
    """The rungs that keep a value between its least and its most."""
    bounds = [LEAST.get(key, 0.0), min(most, MOST.get(key, math.inf))]
    ends = [RUNG * math.log(bound / value) / math.log(ratio) for bound in bounds if 0.0 < bound < math.inf]
    low, high = (min(ends), max(ends)) if ends else (-WIDE, WIDE)
    return min(0, max(-WIDE, math.ceil(low - 1e-9))), max(0, min(WIDE, math.floor(high + 1e-9)))


def _word(key: str) -> Callable[[Base, str], Settings]:
    return lambda base, word: {key: word}


def _times(*keys: str, whole: bool = False, digits: int = 4) -> Callable[[Base, float], Settings]:
    return lambda base, factor: {key: base.times(key, factor, whole, digits) for key in keys}


def _kernel(base: Base, word: str) -> Settings:
    """Another kernel has an eta of its own; one that the scene gives stays as many times the usual one."""
    eta = base.written("gas.eta")
    if eta is None:
        return {"gas.kernel": word}
    of_dimension = base.scene.space.dimensions - 1
    usual = [SMOOTHING[name].eta[of_dimension] for name in (base.scene.gas.kernel, word)]
    return {"gas.kernel": word, "gas.eta": f"{eta * usual[1] / usual[0]:.4g}"}


def _cells(base: Base, factor: float) -> Settings:
    """Cells of the grid along its longest side; by default there are about as many as particles."""
    scene = base.scene
    first = (scene.gas,) if scene.gas else scene.dust or ()
    cell, _ = grid_cells(scene, sum(particle_count(scene, species) for species in first))
    return {"space.cells": str(round(max(scene.space.size) / cell * factor))}
