"""The setups (example scenes) and the analysis scripts that come with discsim.

They are in `setups/` and `analysis/` next to this module in an installed package, and at the top of a clone.
"""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from discsim.printable import UserError, printable

PACKAGE_DIRECTORY = Path(__file__).parent
SETUP_DIRECTORIES = (PACKAGE_DIRECTORY / "setups", PACKAGE_DIRECTORY.parent / "setups")
SCRIPT_DIRECTORIES = (PACKAGE_DIRECTORY / "analysis", PACKAGE_DIRECTORY.parent / "analysis")
_LABELLED_LINE = re.compile(r"([A-Z][A-Za-z ]*): +(.+)")


class ShippedError(UserError):
    """Error for an unknown name of a setup, or a copy that would replace a file; the message gives the reason."""


@dataclass(frozen=True)
class Setup:
    """A shipped scene file at `path`, with the notes in the comment at its top."""

    path: Path

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def text(self) -> str:
        return self.path.read_text(encoding="utf-8", errors="replace")

    @property
    def title(self) -> str:
        """The printable title of the scene; "" if the file has no title or is not valid TOML."""
        try:
            return printable(tomllib.loads(self.text).get("title", ""))
        except tomllib.TOMLDecodeError:
            return ""

    @property
    def about(self) -> str:
        """The first line of the comment at the top of the file, which describes the scene."""
        return self._comment()[0]

    @property
    def notes(self) -> dict[str, str]:
        """The labelled notes in the comment at the top, such as "How long: ...": texts by label, such as "How long"."""
        found: dict[str, str] = {}
        label = ""
        for line in self._comment()[1:]:
            start = _LABELLED_LINE.fullmatch(line)
            if start:
                label, found[start[1]] = start[1], start[2]
            elif line and label:
                found[label] += f" {line}"
            else:  # before the first label, or after the blank line at the end of a note
                label = ""
        return found

    def _comment(self) -> list[str]:
        """Return the lines of the comment at the top of the file, without "#"; one empty line if there is none."""
        head = re.match(r"(?:#.*\n)+", self.text)
        return [line.removeprefix("#").strip() for line in head[0].splitlines()] if head else [""]


def setups() -> dict[str, Setup]:
    """Return the shipped setups by name."""
    folder = next(directory for directory in SETUP_DIRECTORIES if directory.is_dir())
    return {path.stem: Setup(path) for path in sorted(folder.glob("*.toml"))}


def setup(name: str) -> Setup:
    """Return the shipped setup `name`. Raises ShippedError, which suggests the nearest name, if there is none."""
    known = setups()
    if name not in known:
        raise ShippedError(f"{name}: unknown setup{_nearest_hint(name, known)}")
    return known[name]


def scene_file(given: Path) -> Path:
    """Return the scene file that the command-line argument `given` names.

    The result is the file `given` if this file exists. Otherwise, for a bare NAME without suffix, the result is the
    file NAME.toml or else the shipped setup NAME. Raises ShippedError if none of these files exists.
    """
    if os.path.isfile(given):
        return given
    known, bare = setups(), given.name == str(given) and not given.suffix
    with_suffix = Path(f"{given}.toml")
    if bare and os.path.isfile(with_suffix):
        return with_suffix
    if bare and given.name in known:
        return known[given.name].path
    if not os.path.lexists(given):
        expected = "file not found; give a scene file (TOML)"
        if given.stem in known:
            raise ShippedError(f"{given}: {expected}; for the setup of this name give: {given.stem}")
        if bare:
            raise ShippedError(f"{given}: {expected}, or the name of a setup{_nearest_hint(given.name, known)}")
    return given  # if it is no readable file, loading the scene gives the message


def copy_setup(name: str, path: Path) -> None:
    """Copy the shipped setup `name` to the new file `path`.

    Raises ShippedError if the setup is unknown or the file exists, and OSError if the file cannot be written.
    """
    content = setup(name).path.read_bytes()
    try:
        file = path.open("xb")
    except FileExistsError:
        raise ShippedError(f"{path}: already exists; give the name of a new file") from None
    try:
        with file:
            file.write(content)
    except OSError:
        path.unlink(missing_ok=True)
        raise


def analysis_script(name: str) -> ModuleType:
    """Return an analysis script, of which `discsim analyse` is the command, as a Python module.

    Parameters
    ----------
    name : str
        "gap", "torque", "clumps", "stress" or "oneway_twoway"; in a clone any script in `analysis`.

    Returns
    -------
    module
        The module. Its docstring has the equations, and its functions the measurements.

    Raises
    ------
    ShippedError
        If there is no such script.
    """
    folder = next(directory for directory in SCRIPT_DIRECTORIES if directory.is_dir())
    path = folder / f"{name}.py"
    if path not in folder.glob("*.py"):
        known = ", ".join(sorted(each.stem for each in folder.glob("*.py")))
        raise ShippedError(f"{printable(name)}: unknown analysis script; expected one of {known}")
    spec = spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _nearest_hint(name: str, known: dict[str, Setup]) -> str:
    """Return the end of a message about an unknown setup `name`: the nearest known name, or where to find the names."""
    near = get_close_matches(name.lower(), known, n=1, cutoff=0.5)
    return f'; did you mean "{near[0]}"?' if near else "; `discsim setups` lists them"
