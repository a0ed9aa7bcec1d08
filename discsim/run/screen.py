"""Output on a screen: lines of text and, on a terminal, a frame of several lines below them that is redrawn.

After each frame the cursor stays at the first character of the frame, also when the terminal is resized and wraps or
cuts long lines. Erasing from the cursor to the end of the screen therefore removes the whole frame.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import RenderableType

# Control codes of terminals. Without wrapping, a screen that has just become narrower cuts the frame's lines.
ERASE_TO_END, LINE_START, UP = "\x1b[J", "\r", "\x1b[{}A"
NO_WRAP, WRAP = "\x1b[?7l", "\x1b[?7h"
HIDE_CURSOR, SHOW_CURSOR = "\x1b[?25l", "\x1b[?25h"


class Screen:
    """Standard output of a run. If writing fails, as after the terminal is closed, the run continues without output.

    has_frames: whether standard output is a terminal that can redraw frames.
    """

    def __init__(self) -> None:
        self.out: TextIO | None = sys.stdout
        self.console: Any = None  # console of rich, on a terminal
        self.has_frames = False
        if self.out is not None and self.out.isatty():
            from rich.console import Console  # slow to import

            self.console = Console(file=self.out, markup=False, highlight=False, emoji=False)
            self.has_frames = self.console.is_terminal and not self.console.is_dumb_terminal
        self._shown = False  # whether a frame is on the screen

    def line(self, text: str) -> None:
        """Write a permanent line above the frame."""
        self.clear()
        self._write(text + "\n")

    def frame(self, content: RenderableType) -> None:
        """Draw a frame that replaces the previous one; lines that do not fit are cut."""
        width, height = self.console.size
        with self.console.capture() as drawn:
            self.console.print(content, width=max(width - 1, 1), height=None, overflow="crop", no_wrap=True)
        lines = drawn.get().splitlines()[: max(height - 1, 1)]
        to_frame_start = LINE_START + (UP.format(len(lines) - 1) if len(lines) > 1 else "")
        self._write(LINE_START + ERASE_TO_END + HIDE_CURSOR + NO_WRAP + "\n".join(lines) + WRAP + to_frame_start)
        self._shown = True

    def clear(self) -> None:
        """Erase the frame."""
        if self._shown:
            self._shown = False
            self._write(LINE_START + ERASE_TO_END + SHOW_CURSOR)

    def _write(self, text: str) -> None:
        """Write `text`, with "?" for characters that the encoding of the output lacks."""
        if self.out is None:
            return
        encoding = self.out.encoding or "utf-8"
        try:
            self.out.write(text.encode(encoding, "replace").decode(encoding))
            self.out.flush()
        except OSError:
            self.out = None
