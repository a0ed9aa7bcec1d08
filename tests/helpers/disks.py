"""Disks that are full, and what a power cut leaves of a directory."""

import errno
import os
import subprocess
from pathlib import Path

import pytest


class Memory:
    """A file system in memory of some pages of 4 KiB at `path`, which root may mount."""

    PAGE = 4096

    def __init__(self, path, pages):
        self.path = path
        path.mkdir()
        if os.geteuid() != 0 or self._mount(pages).returncode:
            pytest.skip("mounting a small disk takes root; the stand-in does without")

    def _mount(self, pages, *options):
        options = ",".join((f"size={pages * self.PAGE}", *options))
        return subprocess.run(["mount", "-t", "tmpfs", "-o", options, "discsim-tests", str(self.path)])

    def grow(self, pages):
        assert self._mount(pages, "remount").returncode == 0

    def protect(self, pages, writable):
        assert self._mount(pages, "remount", "rw" if writable else "ro").returncode == 0

    def close(self):
        subprocess.run(["umount", "-l", str(self.path)], check=True)


class Limited:
    """A file in a directory that has no room for more than some bytes: what fits is written, then the disk is full."""

    def __init__(self, file, directory, room):
        self._file, self._directory, self._room = file, directory, room

    def write(self, data):
        self._file.flush()
        used = sum(path.stat().st_size for path in self._directory.rglob("*") if path.is_file())
        fits = max(self._room - used, 0)
        self._file.write(data[:fits])
        self._file.flush()
        if fits < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return len(data)

    def __enter__(self):
        return self

    def __exit__(self, *fault):
        self._file.close()

    def __getattr__(self, name):
        return getattr(self._file, name)


class Flushed:
    """What is surely on the disk of a directory: contents at the last fsync of each file, names at that of each folder.

    Files stay open here, so that no other gets the number of one that was removed.
    """

    def __init__(self, directory, monkeypatch):
        self.directory = directory
        self.contents, self.names, self._open = {}, {}, {}
        self._really = os.fsync
        monkeypatch.setattr(os, "fsync", self.fsync)

    def fsync(self, file):
        self._really(file)
        path = Path(os.readlink(f"/proc/self/fd/{file}"))
        if path.is_dir():
            self.names[path] = {one.name: None if one.is_dir() else self._number(one) for one in path.iterdir()}
        else:
            self.contents[self._number(path)] = path.read_bytes()

    def _number(self, path):
        number = path.stat().st_ino
        if number not in self._open:
            self._open[number] = path.open("rb")
        return number

    def left(self, into, names_too):
        """Make what a cut leaves as folder `into`: of names what was flushed too, or all that there are now."""
        self._fill(self.directory, into, names_too)
        return into

    def _fill(self, folder, into, names_too):
        if names_too and folder not in self.names:
            names = {}
        elif names_too:
            names = self.names[folder]
        else:
            names = {one.name: None if one.is_dir() else self._number(one) for one in folder.iterdir()}
        into.mkdir(parents=True)
        for name, number in names.items():
            if number is None:
                self._fill(folder / name, into / name, names_too)
            else:
                (into / name).write_bytes(self.contents.get(number, b""))

    def close(self):
        for file in self._open.values():
            file.close()
