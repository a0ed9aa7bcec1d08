"""What a run shows: a live display on a terminal, plain lines elsewhere; the lines always go to run.log."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from discsim.numerics import world
from discsim.output.files import refuse_special
from discsim.printable import printable
from discsim.run.screen import Screen
from discsim.scene.units import clock

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene

LINE_EVERY = 10.0  # wall-clock seconds between plain lines
FRAME_EVERY = 0.25  # and between frames of the live display


class Progress:
    """Tells of a run. Errors go to stderr, all else to stdout; `quiet` leaves only the errors and the log."""

    def __init__(self, scene: Scene, quiet: bool) -> None:
        self.scene, self.quiet = scene, quiet
        self.screen = Screen()
        self._log: TextIO | None = None
        self._early: list[str] = []  # said before there was a log
        self._next_line = self._next_frame = 0.0
        # Wall-clock time, time and step after the first step: kernels compile in that, so it tells no speed.
        self._since: tuple[float, float, int] | None = None

    def open_log(self, path: Path, resume: bool) -> None:
        """Keep the log at `path`, with what was said until now first."""
        refuse_special(path)
        self._log = path.open("a" if resume else "w", encoding="utf-8", errors="backslashreplace")
        early, self._early = self._early, []
        for line in early:
            self.note(line)

    def say(self, text: str) -> None:
        """A line for the screen and the log."""
        self.note(printable(text))
        if not self.quiet:
            self.screen.line(printable(text))

    def fail(self, *lines: str) -> None:
        """Print an error, one message of one or more lines, on stderr, and keep it in the log."""
        text = "\n".join(map(printable, lines))
        self.screen.clear()
        with suppress(OSError):  # of a terminal that is gone
            print(text, file=sys.stderr)
        if self._log is not None:
            with suppress(OSError):  # perhaps the log itself is what failed
                self.note(text)

    def compiling(self, count: int, name: str) -> None:
        """Before the compilation of a kernel, the `count`-th of the run: a frame or a line, when one is due."""
        now = time.monotonic()
        if count == 1:
            self.say("compiling kernels that are not on disk yet: once, up to a minute for a scene with drag")
            self._next_line = now + LINE_EVERY
        if self.screen.has_frames and not self.quiet:
            if now >= self._next_frame:
                self._next_frame = now + FRAME_EVERY
                self.screen.frame(f"compiling kernel {count}: {name}")
        elif now >= self._next_line:
            self._next_line = now + LINE_EVERY
            self.say(f"compiling kernel {count}: {name}")

    def step(self, state: State, dt: float, set_by: str) -> None:
        """After each step: a frame or a line, when one is due."""
        now = time.monotonic()
        if self._since is None:
            self._since = (now, state.time, state.step)
            self._next_line = now + LINE_EVERY
        if now >= self._next_line:
            self._next_line = now + LINE_EVERY
            self.line(state, dt, set_by)
        if now >= self._next_frame and self.screen.has_frames and not self.quiet:
            self._next_frame = now + FRAME_EVERY
            self._frame(state, dt, set_by)

    def line(self, state: State, dt: float, set_by: str, end: str = "") -> None:
        """One plain line about the present step; under a live display only that of a snapshot stays."""
        facts = [*self._facts(state, dt, set_by).values(), end]
        text = "  ".join(fact for fact in facts if fact)
        if end or not self.screen.has_frames:
            self.say(text)
        else:
            self.note(text)

    def close(self) -> None:
        self.screen.clear()
        if self._log is not None:
            with suppress(OSError):  # of lines that found no room: told already
                self._log.close()
            self._log = None

    def note(self, text: str) -> None:
        """Lines for the log alone."""
        if self._log is None:
            self._early.append(text)
        else:
            self._log.write(text + "\n")
            self._log.flush()

    def _facts(self, state: State, dt: float, set_by: str) -> dict[str, str]:
        show, until = self.scene.units.show_time, self.scene.run.until
        facts = {
            "step": f"step {state.step}",
            "time": f"t = {show(state.time)} of {show(until)}",
            "dt": f"dt = {show(dt)}, set by {set_by}" if dt > 0.0 else "",
        }
        if self._since is not None:
            wall, begun, step = self._since
            elapsed = time.monotonic() - wall
            if state.step > step and elapsed > 0.0 and state.time > begun:
                left = elapsed * max(until - state.time, 0.0) / (state.time - begun)
                facts["speed"] = f"{(state.step - step) / elapsed:.3g} steps/s"
                facts["left"] = f"{clock(left)} left"
        if world.together.many:
            facts["load"] = f"busiest rank {world.together.balance:.2f} of the mean"
        return facts

    def _frame(self, state: State, dt: float, set_by: str) -> None:
        from rich.progress_bar import ProgressBar  # slow to import
        from rich.table import Table

        facts = self._facts(state, dt, set_by)
        pace = "  ".join(facts[name] for name in ("step", "speed", "left", "load") if name in facts)
        bar = ProgressBar(total=self.scene.run.until, completed=state.time, width=60)
        frame = Table.grid()
        for row in (f"effects: {', '.join(self.scene.effects)}", facts["time"], bar, facts["dt"], pace):
            frame.add_row(row)
        self.screen.frame(frame)
