"""Colours and sizes of text that follow the current style of matplotlib (rcParams), so that dark figures are legible.

The background is `axes.facecolor` and the ink `text.color`; the unit of sizes is `font.size`, by default 10 points.
"""

from __future__ import annotations

from difflib import get_close_matches
from importlib.util import find_spec
from typing import Any

import numpy as np
from matplotlib import colormaps, rcParams
from matplotlib.colors import Colormap, to_rgb

from discsim.output.fields.base import PlotError
from discsim.parts import install_command
from discsim.scene.units import clipped

RGB = tuple[float, float, float]
FONT_SIZE = 10.0  # font.size of matplotlib's default style, for which sizes in figures are chosen
LIGHTEN = 0.35  # share of ink in the colours of lines on a dark background


def shade(share: float) -> RGB:
    """Return the grey with a share of ink between 0 (background) and 1 (ink)."""
    return _mixed(to_rgb(rcParams["axes.facecolor"]), to_rgb(rcParams["text.color"]), share)


def line_colour(colour: Any) -> Any:
    """Return the colour of a line: on a dark background a lighter one, and ink for black."""
    if sum(shade(0.0)) > 1.5:
        return colour
    rgb = to_rgb(colour)
    return shade(1.0) if not any(rgb) else _mixed(rgb, shade(1.0), LIGHTEN)


def _mixed(one: RGB, other: RGB, share: float) -> RGB:
    red, green, blue = ((1.0 - share) * a + share * b for a, b in zip(one, other, strict=True))
    return red, green, blue


def text_scale() -> float:
    """Return the size of text relative to that of matplotlib's default style."""
    return float(rcParams["font.size"]) / FONT_SIZE


def line_scale() -> float:
    """Return the width of lines relative to that of matplotlib's default style, 1.5 points."""
    return float(rcParams["lines.linewidth"]) / 1.5


def contrast(image: Any, values: Any) -> tuple[str, str]:
    """Return "black" and "white", first the one that is legible on the `values` as the mappable `image` colours them.

    NaN has the colour of missing values, `shade(0.15)`.
    """
    values = np.asarray(values, dtype=float)
    rgb = image.to_rgba(np.ma.masked_invalid(values))[..., :3]
    lightness = np.where(np.isnan(values), np.mean(shade(0.15)), rgb.mean(axis=-1)).mean()
    return ("black", "white") if lightness > 0.5 else ("white", "black")


def checked_colour_map(given: Any, prefix: str = "") -> Colormap:
    """Return a colour map of matplotlib, or with a name like "cmr.rainforest" of cmasher. Raises PlotError."""
    if isinstance(given, Colormap):
        return given
    shown = f'{prefix}cmap: "{clipped(" ".join(str(given).split()))}"'
    if str(given).startswith("cmr.") and not _has_cmasher():
        raise PlotError(f"{shown} needs cmasher, which is not installed; run: {install_command('colours')}")
    if not isinstance(given, str) or given not in colormaps:
        known = {name.lower(): name for name in colormaps}
        near = get_close_matches(str(given)[:80].lower(), known, 3, 0.5) or ["viridis", "inferno", "rdbu"]
        names = ", ".join(known[name] for name in near)
        library = "cmasher" if str(given).startswith("cmr.") else "matplotlib"
        raise PlotError(f"{shown} is not a colour map of {library}; the nearest names are {names}")
    return colormaps[given]


def _has_cmasher() -> bool:
    """Return whether cmasher is installed; its import adds its colour maps to those of matplotlib."""
    if not find_spec("cmasher"):
        return False
    import cmasher  # noqa: F401

    return True
