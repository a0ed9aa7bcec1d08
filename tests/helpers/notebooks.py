"""The notebooks of the documentation: their cells, and their execution.

    python tests/helpers/notebooks.py planet_and_dust_rings ...

executes notebooks of docs/notebooks, by default all, and stores them with their outputs.
"""

import hashlib
import json
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "docs/notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def read(name):
    """The notebook as it is stored."""
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def code_cells(book):
    return [cell for cell in book.cells if cell.cell_type == "code"]


def source_hash(book):
    """SHA-256 of the code of all cells."""
    return hashlib.sha256(json.dumps([cell.source for cell in code_cells(book)]).encode()).hexdigest()


def execute(book, folder):
    """Execute a notebook in a folder; an error in a cell is raised."""
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(book, timeout=1200, kernel_name="python3", record_timing=False, resources=resources).execute()


def store(name):
    """Execute a notebook in an empty folder, and store it with its outputs and the hash of the code that made them."""
    book = read(name)
    for cell in code_cells(book):
        cell.outputs, cell.execution_count = [], None
    with tempfile.TemporaryDirectory() as folder:
        execute(book, folder)
    for cell in book.cells:
        cell.metadata.pop("execution", None)
    book.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
        "discsim": {"code_sha256": source_hash(book)},
    }
    nbformat.write(book, FOLDER / f"{name}.ipynb")


if __name__ == "__main__":
    for each in sys.argv[1:] or NAMES:
        store(each)
