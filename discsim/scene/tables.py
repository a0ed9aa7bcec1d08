"""The types of all tables of a scene, by name.

This module defines the tables [units], [run] and [space]; effects and starts define the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from discsim.parts import EFFECTS, INTEGRATORS, STARTS
from discsim.scene.fields import (
    MAX_COURANT,
    MAX_SNAPSHOTS,
    AllowedValues,
    Count,
    Default,
    Measure,
    Number,
    Seconds,
    Table,
    Time,
    kinds_of,
    measure_of,
    models_in,
    sides_of_space,
    whole_number,
    word_of,
)  # fmt: skip

# Default Courant factors. In waves and blasts the error of the time step matters; in discs it is smaller than the
# difference between two seeds (docs/cost.md).
COURANT, COURANT_OF_DISCS = 0.3, 0.6
IntegratorName: Any = word_of(INTEGRATORS)


class UnitsTable(Table):
    system: Literal["physical", "code"] = Field(
        "physical", description='physical units, or "code": dimensionless numbers with G = 1'
    )
    length: str = Field("1 au", description="code unit of length")
    mass: str = Field("1 Msun", description="code unit of mass; the unit of time follows from G = 1")


class Run(Table):
    until: Time = Field(gt=0, description="end time; the last step ends exactly at this time")
    snapshots: Count = Field(
        10, ge=1, le=MAX_SNAPSHOTS, description="number of snapshots after the initial one, evenly spaced in time"
    )
    every: Time | None = Field(None, gt=0, description="time between snapshots, instead of run.snapshots")
    seed: Count = Field(1, ge=0, description="seed of the random numbers")
    courant: Annotated[Number, Default(f"{COURANT}; with a star {COURANT_OF_DISCS}")] = Field(
        gt=0, le=MAX_COURANT, description="Courant factor: time step as a fraction of each effect's limit"
    )
    timestep: Time | None = Field(None, gt=0, description="fixed time step, instead of a variable time step")
    integrator: IntegratorName = Field(
        "kdk", description='time integrator: "kdk" is the kick-drift-kick leapfrog, "euler" is forward Euler'
    )
    threads: Annotated[Count | None, Default("all cores")] = Field(
        None, ge=1, description="number of threads; results do not depend on it"
    )
    checkpoint_every: Annotated[Seconds, Default('"10 min"'), AllowedValues("wall-clock time")] = Field(
        600.0, description="wall-clock time between checkpoints"
    )
    walltime: Annotated[Seconds | None, AllowedValues("wall-clock time")] = Field(
        None, description='wall-clock limit, like "2 h"; the run then writes a checkpoint and stops'
    )


class Space(Table):
    dimensions: Annotated[Literal[1, 2], BeforeValidator(whole_number)] = Field(2, description="number of dimensions")
    size: Annotated[tuple[Annotated[float, Field(gt=0), Measure("length")], ...], BeforeValidator(sides_of_space)] = (
        Field(description="side length of space, or the two lengths [x, y]")
    )
    cells: Annotated[Count | None, Default("from the particles")] = Field(
        None, ge=1, le=65536, description="number of square grid cells along the longest side"
    )
    boundary: Literal["open", "periodic"] = Field("open", description="boundary condition of gas, dust and gravity")


class Tables(Mapping[str, Any]):
    """Mapping from the name of a table to its type; look-up imports the module of the type.

    The type of a table that may occur several times, like [[dust]], is a tuple of any length.
    """

    _own: ClassVar[dict[str, Any]] = {"units": UnitsTable, "run": Run, "space": Space}

    def __getitem__(self, name: str) -> Any:
        return _type_of(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*self._own, "initial", *EFFECTS))

    def __len__(self) -> int:
        return sum(1 for _ in self)


@cache
def _type_of(name: str) -> Any:
    if name in Tables._own:
        return Tables._own[name]
    if name == "initial":
        return kinds_of(STARTS.values())
    effect = EFFECTS[name]
    return tuple.__class_getitem__((effect.keys, ...)) if effect.role.several else effect.keys


TABLES = Tables()
REQUIRED = ("run", "space", "initial")


def optional_tables(model: type[Table]) -> list[str]:
    """Return the keys of a table model whose values are optional tables, such as `viscosity` of [gas]."""
    fields = {key: field for key, field in model.model_fields.items() if not field.is_required()}
    return [key for key, field in fields.items() if models_in(field.annotation) and measure_of(field) is None]


def removable_tables() -> list[str]:
    """Return the names that `--without` accepts: effects in the order of a step, each before its optional tables."""
    names = []
    for effect in EFFECTS:
        names += [effect, *(f"{effect}.{part}" for part in optional_tables(EFFECTS[effect].keys))]
    return names
