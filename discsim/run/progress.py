"""Progress of a run: a live display on a terminal, plain lines elsewhere; run.log always contains the lines."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from numba.core import event

from discsim.numerics import world
from discsim.output.files import refuse_special
from discsim.printable import printable
from discsim.run.screen import Screen
from discsim.scene.orbits import show_plain_time, shown_orbit
from discsim.scene.units import clock

if TYPE_CHECKING:
    from discsim.numerics.state import State
    from discsim.scene import Scene

LINE_EVERY = 10.0  # wall-clock seconds between plain lines
FRAME_EVERY = 0.25  # wall-clock seconds between frames of the live display


class CompilationListener(event.Listener):
    """Listener of numba that counts and reports kernels when they compile; `count` excludes kernels from the cache."""

    def __init__(self, progress: Progress) -> None:
        self.progress, self.count = progress, 0

    def on_start(self, event: event.Event) -> None:
        self.count += 1
        self.progress.compiling(self.count, event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: event.Event) -> None:
        pass


class Progress:
    """Reporter of a run. Errors go to stderr, all other messages to stdout, and all messages also to run.log.

    quiet: whether nothing is written to stdout; warnings then go to stderr.
    """

    def __init__(self, scene: Scene, quiet: bool) -> None:
        self.scene, self.quiet = scene, quiet
        self.screen = Screen()
        self._log: TextIO | None = None
        self._lines_before_log: list[str] = []  # lines from before the log was open
        self._next_line = self._next_frame = 0.0  # wall-clock times from which on the next line or frame is due
        # Wall-clock time, time and step after the first step. Kernels compile in that step, so the speed excludes it.
        self._speed_start: tuple[float, float, int] | None = None

    def open_log(self, path: Path, resume: bool) -> None:
        """Open the log file, and write the lines that were reported before. resume: whether to append to the file."""
        refuse_special(path)
        self._log = path.open("a" if resume else "w", encoding="utf-8", errors="backslashreplace")
        early, self._lines_before_log = self._lines_before_log, []
        for line in early:
            self.note(line)

    def say(self, text: str) -> None:
        """Write a line to the screen and the log."""
        self.note(printable(text))
        if not self.quiet:
            self.screen.line(printable(text))

    def warn(self, text: str) -> None:
        """Write a warning to the screen, in a quiet run to stderr, and to the log."""
        self.say(f"warning: {text}")
        if self.quiet:
            _print_error(printable(f"warning: {text}"))

    def fail(self, *lines: str) -> None:
        """Print an error message of one or more lines on stderr, and write it to the log."""
        text = "\n".join(map(printable, lines))
        self.screen.clear()
        _print_error(text)
        if self._log is not None:
            with suppress(OSError):  # the log itself may have failed
                self.note(text)

    def compiling(self, count: int, name: str) -> None:
        """Report that the kernel `name` compiles, if an update of the display or a line is due.

        count: number of kernels so far.
        """
        now = time.monotonic()
        if count == 1:
            self.say("compiling kernels for the first time: up to a minute for a scene with drag")
            self._next_line = now + LINE_EVERY
        if self.screen.has_frames and not self.quiet:
            if now >= self._next_frame:
                self._next_frame = now + FRAME_EVERY
                self.screen.frame(f"compiling kernel {count}: {name}")
        elif now >= self._next_line:
            self._next_line = now + LINE_EVERY
            self.say(f"compiling kernel {count}: {name}")

    def step(self, state: State, dt: float, set_by: str) -> None:
        """Report a step of length dt, if an update of the display or a line is due.

        set_by: name of the effect or key that limits the step.
        """
        now = time.monotonic()
        if self._speed_start is None:
            self._speed_start = (now, state.time, state.step)
            self._next_line = now + LINE_EVERY
        if now >= self._next_line:
            self._next_line = now + LINE_EVERY
            self.line(state, dt, set_by)
        if now >= self._next_frame and self.screen.has_frames and not self.quiet:
            self._next_frame = now + FRAME_EVERY
            self._frame(state, dt, set_by)

    def line(self, state: State, dt: float, set_by: str, end: str = "") -> None:
        """Write a plain line about the present step, followed by the remark `end`, such as "snapshot 0003".

        With a live display only lines with a remark appear on the screen; the log has all lines.
        """
        text = "  ".join(fact for fact in (*self._facts(state, dt, set_by).values(), end) if fact)
        if end or not self.screen.has_frames:
            self.say(text)
        else:
            self.note(text)

    def close(self) -> None:
        """Erase the live display, and close the log."""
        self.screen.clear()
        if self._log is not None:
            with suppress(OSError):  # a full disk was reported before
                self._log.close()
            self._log = None

    def note(self, text: str) -> None:
        """Write `text` to the log only."""
        if self._log is None:
            self._lines_before_log.append(text)
        else:
            self._log.write(text + "\n")
            self._log.flush()

    def _facts(self, state: State, dt: float, set_by: str) -> dict[str, str]:
        """Return by name the texts of a line or of the display, such as "step" and "speed".

        Unknown texts are absent or empty.
        """
        show = partial(show_plain_time, units=self.scene.units, scene_text=self.scene.text)
        facts = {
            "step": f"step {state.step}",
            "time": f"t = {show(state.time)} of {show(self.scene.run.until)}{self._orbit_count(state.time)}",
            "dt": f"dt = {show(dt)}, set by {set_by}" if dt > 0.0 else "",
        }
        if self._speed_start is not None:
            wall, begun, step = self._speed_start
            elapsed = time.monotonic() - wall
            if state.step > step and elapsed > 0.0 and state.time > begun:
                left = elapsed * max(self.scene.run.until - state.time, 0.0) / (state.time - begun)
                facts["speed"] = f"{(state.step - step) / elapsed:.3g} steps/s"
                facts["left"] = f"{clock(left)} left"
        if world.processes.is_parallel:
            facts["load"] = f"busiest rank {world.processes.balance:.2f} times the mean load"
        return facts

    def _orbit_count(self, t: float) -> str:
        """Return the time `t` in orbits, like " (10 of 40 orbits at 5.2 au)"; "" if the scene does not count orbits."""
        orbit = shown_orbit(self.scene.text, self.scene.units)
        return f" ({t / orbit.period:.4g} of {orbit.count(self.scene.run.until)})" if orbit else ""

    def _frame(self, state: State, dt: float, set_by: str) -> None:
        """Draw the frame of the live display about the present step."""
        from rich.progress_bar import ProgressBar  # slow to import
        from rich.table import Table

        facts = self._facts(state, dt, set_by)
        speed = "  ".join(facts[name] for name in ("step", "speed", "left", "load") if name in facts)
        bar = ProgressBar(total=self.scene.run.until, completed=state.time, width=60)
        frame = Table.grid()
        for row in (f"effects: {', '.join(self.scene.effects)}", facts["time"], bar, facts["dt"], speed):
            frame.add_row(row)
        self.screen.frame(frame)


def _print_error(text: str) -> None:
    """Print a text on stderr."""
    with suppress(OSError):  # the terminal may be gone
        print(text, file=sys.stderr)
