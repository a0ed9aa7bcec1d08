"""A terminal in a few lines: what a run has written to it, on a screen that is resized on the way."""

import fcntl
import os
import pty
import re
import struct
import sys
import termios

from deaths import forked, status_of

SIZED = "\x1b]R;{};{}\x07"  # a mark in what is written, of a new size at this very place


class Terminal:
    """Rows of text, each with whether it goes on from the one above.

    reflow: whether rows that are wider than a narrower screen are wrapped anew, as most do; else they are cut.
    """

    def __init__(self, width, height, reflow):
        self.width, self.height, self.reflow = width, height, reflow
        self.rows, self.goes_on, self.row, self.column, self.wraps = [""], [False], 0, 0, True

    def feed(self, text, at_size=lambda: None):
        for mark, number, letter, width, height, plain in re.findall(
            r"(\x1b\[\??(\d*)[\d;]*([A-Za-z])|\x1b\]R;(\d+);(\d+)\x07)|([^\x1b])", text
        ):
            if plain:
                self._plain(plain)
            elif width:
                at_size()
                self.resize(int(width), int(height))
            elif letter == "A":
                self.row = max(self.row - int(number or 1), len(self.rows) - self.height, 0)
            elif letter == "J":
                self.rows[self.row] = self.rows[self.row][: self.column]
                del self.rows[self.row + 1 :], self.goes_on[self.row + 1 :]
            elif letter in "hl" and number == "7":
                self.wraps = letter == "h"
            else:
                assert letter in "mhl", mark

    def _plain(self, character):
        if character == "\r":
            self.column = 0
        elif character == "\n":
            self._down(False)
        else:
            if self.column >= self.width and self.wraps:
                self._down(True)
                self.column = 0
            self.column = min(self.column, self.width - 1)
            row = self.rows[self.row].ljust(self.column)
            self.rows[self.row] = row[: self.column] + character + row[self.column + 1 :]
            self.column += 1

    def _down(self, goes_on):
        self.row += 1
        if self.row == len(self.rows):
            self.rows.append("")
            self.goes_on.append(goes_on)

    def resize(self, width, height):
        lines, at = [], None
        for number, (row, goes_on) in enumerate(zip(self.rows, self.goes_on, strict=True)):
            if not goes_on:
                lines.append("")
            if number == self.row:
                at = len(lines) - 1, len(lines[-1]) + self.column
            lines[-1] += row
        self.height, narrower = height, width < self.width
        self.width = width
        if not self.reflow:
            if narrower:
                self.rows = [row[:width] for row in self.rows]
            return
        self.rows, self.goes_on = [], []
        for number, line in enumerate(lines):
            if number == at[0]:
                self.row, self.column = len(self.rows) + at[1] // width, at[1] % width
            pieces = [line[start : start + width] for start in range(0, max(len(line), 1), width)]
            self.rows += pieces
            self.goes_on += [False] + [True] * (len(pieces) - 1)

    def lines(self):
        """Text as it was written, without the wrapping."""
        found = []
        for row, goes_on in zip(self.rows, self.goes_on, strict=True):
            if goes_on:
                found[-1] += row
            else:
                found.append(row)
        return [line.rstrip() for line in found]


def resized(width, height):
    """Give the terminal of this process a new size, with a mark in what it writes."""
    sys.stdout.flush()
    fcntl.ioctl(1, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))
    os.write(1, SIZED.format(width, height).encode())


def written_to_a_terminal(act, width=100, height=24, errors=None):
    """Status of `act` in a child on a terminal, and what it wrote there; its errors go to the file `errors`."""
    own, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))

    def on_terminal():
        os.close(own)
        for number in (0, 1) if errors is not None else (0, 1, 2):
            os.dup2(its, number)
        if errors is not None:
            os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT), 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        status = act()
        sys.stdout.flush()
        sys.stderr.flush()
        return status

    child = forked(on_terminal)
    os.close(its)
    found = []
    try:
        while piece := os.read(own, 1 << 16):
            found.append(piece)
    except OSError:  # what Linux says at the end of a terminal
        pass
    os.close(own)
    return status_of(child), b"".join(found).decode()
