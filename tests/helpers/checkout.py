"""The tree as a clone has it, and the packages that its extras name."""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

HOME = Path(__file__).parents[2]
PROJECT = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]


def copy_of_tree(target):
    """Copy what git tracks, or would, into the new folder `target`."""
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listing, cwd=HOME, capture_output=True, text=True, check=True).stdout
    for name in names.split("\0")[:-1]:
        if (HOME / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(HOME / name, target / name)


def packages_of(extra):
    """Names of the packages that are there with an extra, those of extras that it names too."""
    found = set()
    for requirement in (*PROJECT["dependencies"], *EXTRAS[extra]):
        name, others = re.match(r"([\w-]+)(?:\[([\w,]+)\])?", requirement).groups()
        if name == PROJECT["name"]:
            found |= {package for other in others.split(",") for package in packages_of(other)}
        else:
            found.add(name)
    return found
