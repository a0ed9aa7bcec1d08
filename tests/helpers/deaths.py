"""Runs that are killed before a chosen one of their file operations, or in the midst of a file; what that leaves."""

import io
import os
import shutil
import signal
import sys
import warnings
from pathlib import Path
from types import ModuleType

NAMES = {
    "open", "write", "writerow", "writerows", "flush", "fsync", "close", "ftruncate", "flock",
    "replace", "remove", "unlink", "mkdir", "rmdir",
}  # fmt: skip


def watched(act, before):
    """What `act` returns; `before(n)` is called before its file operation n, from 1 on."""
    count = 0

    def look(frame, what, function):
        nonlocal count
        if what == "c_call" and is_file_operation(function):
            count += 1
            sys.setprofile(None)
            before(count)
            sys.setprofile(look)

    sys.setprofile(look)
    try:
        return act()
    finally:
        sys.setprofile(None)


class Pieces:
    """A file to write that takes what it is given in pieces, each of which is in the file when the next one comes."""

    NUMBER = 6
    writing = False  # whether one is in the midst of a write

    def __init__(self, file):
        self._file = file

    def write(self, data):
        length = max(1, -(-len(data) // self.NUMBER))
        for start in range(0, len(data), length):
            Pieces.writing = start > 0
            self._file.write(data[start : start + length])
            self._file.flush()
        Pieces.writing = False
        return len(data)

    def __enter__(self):
        return self

    def __exit__(self, *fault):
        self._file.close()

    def __getattr__(self, name):
        return getattr(self._file, name)


def in_pieces(monkeypatch, wrap=Pieces):
    """Have all files of a run written in pieces, or through another wrapper of an open file."""
    really = Path.open

    def opened(path, mode="r", *arguments, **options):
        file = really(path, mode, *arguments, **options)
        return file if "r" in mode else wrap(file)

    monkeypatch.setattr(Path, "open", opened)


def is_file_operation(function):
    """Whether a builtin asks something of the file system: of `os`, a file, or a csv writer on one."""
    owner = getattr(function, "__self__", None)
    ours = isinstance(owner, ModuleType | io.IOBase) or type(owner).__module__ == "_csv"
    return ours and not isinstance(owner, io.BytesIO) and function.__name__ in NAMES


def left_by_kills(act, directory, copies):
    """What a kill of `act` could leave in `directory`, as folders in `copies`, but for logs and parts of files.

    A kill loses what a file has not been given yet, and nothing else.
    """
    names = {}

    def keep(number):
        files = [path for path in directory.rglob("*") if path.suffix not in (".part", ".log", "")]
        content = str([(path, path.read_bytes()) for path in sorted(files)])
        if directory.exists():
            out = copies / str(names.setdefault(content, number))
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(directory, out)  # the last of them: with the most on its way

    watched(act, keep)
    return sorted(copies.iterdir(), key=lambda path: int(path.name))


def killed_before(number, act):
    """Exit status of a child that dies by SIGKILL before its file operation `number`."""

    def die(count):
        if count == number:
            os.kill(os.getpid(), signal.SIGKILL)

    return status_of(forked(lambda: watched(act, die)))


def forked(act):
    """Process id of a child that does `act` and ends with its status, whatever happens."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of threads that other tests left: the child needs none of them
        child = os.fork()
    if child == 0:
        status = 99
        try:
            status = act()
        finally:
            os._exit(status)
    return child


def status_of(child):
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
