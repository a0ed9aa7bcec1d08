"""Particles and tables as pandas DataFrames; pandas is imported on demand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from discsim.parts import install_command

COLUMN_PREFIXES = {"pos": "", "vel": "v", "acc": "a"}  # the column of the x component of vel is vx
AXES = "xy"


def dataframe_of(arrays: Mapping[str, np.ndarray]) -> Any:
    """Return a pandas DataFrame with copies of particle arrays, and the array `ids` as its index.

    arrays: arrays (n,) or (n, dimensions) by name. The components of pos, vel and acc become the columns x, y, vx,
    vy, ax, ay; the components of any other vector become name_x and name_y. Raises ImportError if pandas is not
    installed.
    """
    pandas = _pandas()
    columns: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        if name == "ids":
            continue
        if array.ndim == 1:
            columns[name] = array.copy()
            continue
        begin = COLUMN_PREFIXES.get(name, f"{name}_")
        columns |= {f"{begin}{axis}": array[:, k].copy() for k, axis in enumerate(AXES[: array.shape[1]])}
    return pandas.DataFrame(columns, index=pandas.Index(arrays["ids"].copy(), name="ids"))


def dataframe_of_table(
    values: np.ndarray, rows: tuple[str, np.ndarray], columns: tuple[str, np.ndarray], attrs: Mapping[str, str]
) -> Any:
    """Return a pandas DataFrame with a copy of `values` (rows, columns), and `attrs`.

    rows, columns: name and values of the index and of the columns. Raises ImportError if pandas is not installed.
    """
    pandas = _pandas()
    index, labels = (pandas.Index(each.copy(), name=name) for name, each in (rows, columns))
    frame = pandas.DataFrame(values.copy(), index=index, columns=labels)
    frame.attrs.update(attrs)
    return frame


def _pandas() -> Any:
    """Import pandas. Raises ImportError if it is not installed."""
    try:
        import pandas
    except ImportError as error:
        needed = "to_pandas() needs pandas, which is not installed"
        raise ImportError(f"{needed}; install it with {install_command('pandas')}") from error
    return pandas
