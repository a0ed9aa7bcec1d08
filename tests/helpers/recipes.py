"""The files of the recipes of the documentation, as their pages have them."""

import re
import tomllib
from pathlib import Path

from installed import install

PAGES = Path(__file__).parents[2] / "docs" / "recipes"


def files_of(page):
    """File name -> text, of the blocks of code that begin with their name."""
    blocks = re.findall(r"^```(?:python|toml)\n# (\S+)\n(.*?)^```$", page, re.S | re.M)
    return dict(blocks)


def commands_of(page):
    """The commands of its last block of them, line by line."""
    return re.findall(r"^```sh\n(.*?)^```$", page, re.S | re.M)[-1].splitlines()


def write_package(path, files):
    """Write files, and what an installation would leave of the entry points; the name of the part."""
    points = tomllib.loads(files["pyproject.toml"])["project"]["entry-points"]
    install(path, {}, points)
    for name, text in files.items():
        (path / name).write_text(text)
    return next(iter(next(iter(points.values()))))
