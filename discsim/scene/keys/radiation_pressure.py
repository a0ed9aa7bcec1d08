"""The table [radiation_pressure]."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from discsim.scene.fields import AllowedValues, Number, Table, fault


def _as_list(value: Any) -> Any:
    """Return the value of the key beta as a list. Raises a `fault` for an empty list."""
    if isinstance(value, list | tuple) and not value:
        raise fault("the list is empty; expected a number, or one number per population of dust")
    return list(value) if isinstance(value, list | tuple) else [value]


class Keys(Table):
    beta: Annotated[
        tuple[Annotated[Number, Field(ge=0)], ...],
        BeforeValidator(_as_list),
        AllowedValues("number, or list of numbers"),
    ] = Field(description="F_rad / F_grav of the grains; list: one number per population of dust")
