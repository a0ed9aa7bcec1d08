"""Styles of figures for a paper, a slide, or a dark page: parameters of matplotlib and the size of a figure."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from math import inf
from typing import Any

import matplotlib.style
from matplotlib import rc_context

from discsim.output.fields.base import PlotError
from discsim.scene.units import clipped

MIN_DPI, MAX_DPI = 30, 1200
MAX_PIXELS = 200_000_000  # of a figure; these take 0.8 GB
MAX_FRAME_SIDE = 4096  # largest side of a frame, in pixels, that common players of films decode


@dataclass(frozen=True)
class Style:
    """Parameters of matplotlib, and the size of a figure in inches.

    `one` is the width of a figure with one panel and `several` that of a figure with several; `height` is the largest
    height. Without `several` the panels have a fixed size. `dpi` is the resolution, by default that of `resolution`.
    `line` is the height of a line of the title, in inches for text of the default size.
    """

    rc: Any = field(default_factory=dict)
    one: float = 4.4
    several: float | None = None
    height: float = inf
    dpi: int | None = None
    line: float = 0.22

    def resolution(self, is_single: bool) -> int:
        """Return the pixels per inch; a single panel, which is narrow, has more."""
        return self.dpi or (200 if is_single else 130)


DEFAULT = Style()
STYLES = {
    # Columns of journals are 88 mm wide, and pages 180 mm. Fonts that ship with matplotlib, like Times.
    "paper": Style(
        {
            "font.size": 8.0,
            "font.family": "STIXGeneral",
            "mathtext.fontset": "stix",
            "axes.linewidth": 0.6,
            "lines.linewidth": 1.0,
            "lines.markeredgewidth": 0.6,
            "xtick.major.width": 0.6,
            "ytick.major.width": 0.6,
            "pdf.fonttype": 42,
        },
        one=3.46,
        several=7.09,
        dpi=300,
        line=0.28,
    ),
    "slide": Style(
        {
            "font.size": 16.0,
            "axes.linewidth": 1.2,
            "lines.linewidth": 2.6,
            "xtick.major.width": 1.2,
            "ytick.major.width": 1.2,
            "xtick.major.size": 6.0,
            "ytick.major.size": 6.0,
        },
        one=13.33,
        several=13.33,
        height=7.5,
        dpi=144,
    ),
    "dark": Style(
        {
            **dict(matplotlib.style.library["dark_background"].items()),
            "figure.facecolor": "#14171c",
            "figure.edgecolor": "#14171c",
            "axes.facecolor": "#14171c",
            "savefig.facecolor": "auto",
            "savefig.edgecolor": "auto",
            "text.color": "#f0f0f0",
        }
    ),
}
_CURRENT: ContextVar[Style] = ContextVar("style", default=DEFAULT)


def current() -> Style:
    """Return the style of the innermost `use_style`."""
    return _CURRENT.get()


@contextmanager
def use_style(name: str | None, prefix: str = "") -> Iterator[None]:
    """Draw figures within a `with` block in a style.

    Parameters
    ----------
    name : str or None
        "paper" (one column or a page of a journal, fonts of 8 points), "slide" (16:9, large fonts, wide lines), or
        "dark" (light text on a dark background). None changes nothing.
    prefix : str
        Text before the name of the argument in messages.

    Raises
    ------
    PlotError
        If there is no such style.

    Examples
    --------
    >>> import discsim, matplotlib
    >>> with discsim.plot.use_style("slide"):
    ...     print(matplotlib.rcParams["font.size"])
    16.0
    """
    if name is None:
        yield
        return
    if name not in STYLES:
        raise PlotError(f'{prefix}style: "{clipped(str(name))}"; expected one of {", ".join(STYLES)}')
    token = _CURRENT.set(STYLES[name])
    try:
        with rc_context(STYLES[name].rc):
            yield
    finally:
        _CURRENT.reset(token)


def checked_dpi(given: Any, prefix: str = "") -> int | None:
    """Return a resolution in pixels per inch; None stays None. Raises PlotError."""
    if given is None:
        return None
    if isinstance(given, bool) or not isinstance(given, int) or not MIN_DPI <= given <= MAX_DPI:
        wanted = f"expected a whole number from {MIN_DPI} to {MAX_DPI}"
        raise PlotError(f"{prefix}dpi: {clipped(str(given))}; {wanted}")
    return given


def check_pixels(inches: Any, dpi: float, is_frame: bool = False) -> None:
    """Raise PlotError if a figure or a frame of a film with these sides would have too many pixels."""
    across, up = (round(float(side) * dpi) for side in inches)
    if across * up > MAX_PIXELS or (is_frame and max(across, up) > MAX_FRAME_SIDE):
        what, most = "figure", f"{MAX_PIXELS:_} pixels"
        if is_frame:
            what, most = "frame", f"{MAX_FRAME_SIDE} pixels on each side"
        remedy = "give fewer dpi, or fewer fields"
        raise PlotError(f"{dpi:g} dpi: the {what} has {across} x {up} pixels; expected at most {most}; {remedy}")
