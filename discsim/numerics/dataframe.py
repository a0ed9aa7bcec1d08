"""Particles as a pandas DataFrame; pandas is imported on demand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from discsim.parts import command_of_extra

SHORT = {"pos": "", "vel": "v", "acc": "a"}  # prefixes of the columns of their components
AXES = "xy"


def dataframe_of(arrays: Mapping[str, np.ndarray]) -> Any:
    """Return a DataFrame with copies of arrays (n,) and (n, dimensions) by name, with `ids` as its index.

    pos, vel and acc have the columns x, y, vx, vy, ax, ay; other vectors name_x and name_y. Raises ImportError if
    pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        needed = "to_pandas() needs pandas, which is not installed"
        raise ImportError(f"{needed}; expected {command_of_extra('pandas')}") from error
    columns: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        if name == "ids":
            continue
        if array.ndim == 1:
            columns[name] = array.copy()
            continue
        begin = SHORT.get(name, f"{name}_")
        columns |= {f"{begin}{axis}": array[:, k].copy() for k, axis in enumerate(AXES[: array.shape[1]])}
    return pandas.DataFrame(columns, index=pandas.Index(arrays["ids"].copy(), name="ids"))
