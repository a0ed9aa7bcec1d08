"""The table [radiation_pressure]."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from discsim.scene.fields import Number, Table, Words, fault


def _each(value: Any) -> Any:
    """Return beta as a list."""
    if isinstance(value, list | tuple) and not value:
        raise fault("the list is empty; expected a number, or one number per population of dust")
    return list(value) if isinstance(value, list | tuple) else [value]


class Keys(Table):
    beta: Annotated[
        tuple[Annotated[Number, Field(ge=0)], ...], BeforeValidator(_each), Words("number, or list of numbers")
    ] = Field(description="F_rad / F_grav of the grains; list: one number per population of dust")
