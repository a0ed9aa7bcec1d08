"""The notebook of the documentation: it runs in a kernel, and an interrupt in its midst changes no bit."""

import ast
from copy import deepcopy
from pathlib import Path

import nbformat
import pytest
from checkout import EXTRAS, packages_of
from nbclient import NotebookClient

PATH = Path(__file__).parents[1] / "docs/notebook.ipynb"
BITS = """
import hashlib
arrays = [array for p in (sim.gas, sim.dust) for array in p.arrays().values()]
hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest(), times, radii
"""
IMPORTED = "import sys; sorted({name.split('.')[0] for name in sys.modules})"
# Ctrl-C, as the kernel has it, in the midst of the tenth step.
INTERRUPTED = """
import signal
advance = sim._advance
def interrupted(*arguments):
    if sim.state.step == 9:
        signal.raise_signal(signal.SIGINT)
    advance(*arguments)
sim._advance = interrupted
"""


def code(text, **metadata):
    return nbformat.v4.new_code_cell(text, metadata=metadata)


@pytest.fixture(scope="module")
def cells():
    """Cells of the notebook as they were run, then those of a second time, interrupted, all in one kernel."""
    book = nbformat.read(PATH, as_version=4)
    own = len(book.cells)
    sources = [cell.source for cell in book.cells]
    made, look, run = (next(k for k, text in enumerate(sources) if words in text)
                       for words in ("sim = discsim.Simulation(", "def look", "sim.run("))  # fmt: skip
    assert made < look < run
    again = [deepcopy(book.cells[k]) for k in (made, look, run)]
    again[2].metadata["tags"] = ["raises-exception"]
    book.cells += [code(BITS), *again[:2], code(INTERRUPTED), again[2]]
    book.cells += [code("sim.state.step"), deepcopy(book.cells[run]), code(BITS), code(IMPORTED)]
    NotebookClient(book, timeout=300, kernel_name="python3").execute()
    return book.cells[:own], book.cells[own:]


def value(cell):
    (found,) = (out for out in cell.outputs if out.output_type == "execute_result")
    return found.data["text/plain"]


def test_ten_cells_lead_from_a_scene_to_a_figure(cells):
    own, _ = cells
    assert len(own) == 10
    assert all(out.output_type != "error" for cell in own if cell.cell_type == "code" for out in cell.outputs)
    assert own[-1].outputs[-1].data["image/png"]
    assert "<table>" in own[2].outputs[0].data["text/html"]  # of the scene
    assert all(not cell.get("outputs") for cell in nbformat.read(PATH, as_version=4).cells)  # stored without any


def test_interrupted_it_comes_to_the_same_bits(cells):
    _, (bits, _, _, _, stopped, step, _, again, _) = cells
    assert [out.ename for out in stopped.outputs if out.output_type == "error"] == ["KeyboardInterrupt"]
    assert value(step) == "10"  # the step was made whole
    assert value(bits) == value(again)


def test_the_site_is_installed_with_what_its_notebook_imports(cells):
    """Packages of the extras are enough: pandas comes with `to_pandas()`, though no cell imports it."""
    imported = {name.replace("_", "-") for name in ast.literal_eval(value(cells[1][-1]))}
    optional = {package for extra in EXTRAS for package in packages_of(extra)}
    assert "pandas" in imported & optional <= packages_of("docs")
