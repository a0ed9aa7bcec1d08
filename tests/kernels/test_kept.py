"""Kernels that the cache has kept, and what of that is read."""

import os
import subprocess
import sys

import pytest
from another import loaded_without
from numba.core.codegen import JITCodeLibrary, get_host_cpu_features

from discsim.kernels import kept

# A kernel of a file of its own that calls two of discsim's: one that Python calls too, and one that it does not. It
# says whether the intermediate code of the first is still unread, before and after, and how often the cache had each.
CALLER = """
from discsim.kernels.grid import cell_of
from discsim.kernels.inner import compiled
from discsim.kernels.laws import steepness

@compiled
def place_of(x, origin, inverse, count, periodic):
    return cell_of(x, origin, inverse, count, periodic) + int(8 * steepness(2.0, 0.0, 3.0, inverse))

def is_unread():
    (found,) = cell_of.overloads.values()
    return hasattr(found.library, "unread")

given = 0.3, 0.0, 4.0, 4, True
cell_of(*given)
print(is_unread(), place_of(*given), is_unread())
print(*(sum(one.stats.cache_hits.values()) for one in (cell_of, place_of)))
"""

# A numba that has the intermediate code of a library elsewhere.
ANOTHER = """
from numba.core.codegen import CPUCodeLibrary

as_numba_links = CPUCodeLibrary._get_module_for_linking
CPUCodeLibrary._get_module_for_linking = lambda library: as_numba_links(library)
"""

# One of another package, which calls none of discsim's.
OTHER = """
import sys
from numba import njit

if sys.argv[1:]:
    import discsim.kernels

@njit(cache=True)
def half(x):
    return x / 2

print(half(3.0), sum(half.stats.cache_hits.values()))
"""


def printed(directory, text, *words):
    (directory / "caller.py").write_text(text)
    # Given, as the cache has kernels by the processor's features, of which discsim changes one where none are given.
    given = {"NUMBA_CACHE_DIR": str(directory / "cache"), "NUMBA_CPU_FEATURES": get_host_cpu_features()}
    command = [sys.executable, str(directory / "caller.py"), *words]
    return subprocess.run(command, env=os.environ | given, capture_output=True, text=True, check=True).stdout.split()


def test_intermediate_code_is_read_when_a_kernel_is_compiled_that_calls_it(tmp_path):
    found = [printed(tmp_path, CALLER), printed(tmp_path, CALLER)]
    for one in (tmp_path / "cache").rglob("caller.place_of*"):
        one.unlink()
    found.append(printed(tmp_path, CALLER))
    assert found == [
        ["False", "4", "False", "0", "0"],
        ["True", "4", "True", "1", "1"],
        ["True", "4", "False", "1", "0"],
    ]


def test_a_numba_that_has_it_elsewhere_keeps_and_reads_it_as_it_is_used_to(tmp_path):
    found = [printed(tmp_path, ANOTHER + CALLER) for _ in range(2)]
    assert found == [["False", "4", "False", "0", "0"], ["False", "4", "False", "1", "1"]]


@pytest.mark.parametrize("first, then", [([], ["discsim"]), (["discsim"], [])])
def test_what_others_keep_loads_without_discsim(tmp_path, first, then):
    assert printed(tmp_path, OTHER, *first) == ["1.5", "0"]
    assert printed(tmp_path, OTHER, *then) == ["1.5", "1"]


@pytest.mark.parametrize("where, name", kept.INSIDES)
def test_a_numba_that_is_another_is_left_alone(monkeypatch, where, name):
    before = JITCodeLibrary.serialize_using_object_code
    assert not loaded_without(monkeypatch, kept, where, name).known_inside
    assert JITCodeLibrary.serialize_using_object_code == before
