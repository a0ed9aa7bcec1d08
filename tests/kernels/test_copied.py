"""Functions that only compiled code calls have no machine code of their own, and work as with it."""

import os
import subprocess
import sys

import numpy as np
import pytest
from another import loaded_without
from numba import njit, types, vectorize
from numba.core.codegen import JITCPUCodegen
from numba.core.registry import cpu_target

from discsim.formulas import laws
from discsim.kernels import copied
from discsim.kernels.inner import CALLED, KERNEL

# A kernel of a file of its own that calls one of discsim's, and how often each was found in the cache.
CALLER = """
from discsim.kernels.inner import compiled
from discsim.kernels.laws import steepness

@compiled
def slope(fast):
    return steepness(2.0, 0.0, 3.0, fast)

print(slope(4.0))
print(*(sum(one.stats.cache_hits.values()) for one in (slope, steepness)))
"""


def test_only_what_python_calls_gets_machine_code_and_is_optimised_as_a_whole(monkeypatch):
    engine, optimised = cpu_target.target_context.codegen()._engine, []
    monkeypatch.setattr(copied, "optimize", optimised.append)
    for wrappers, has_code in ((CALLED, False), ({}, True)):
        function = njit(**{**KERNEL, **wrappers, "cache": False})(laws.steepness)
        function.compile((types.float64,) * 4)
        (found,) = function.overloads.values()
        assert engine.is_symbol_defined(found.fndesc.llvm_func_name) == has_code
        assert (found.library in optimised) == has_code


def test_what_the_cache_has_of_them_is_called(tmp_path):
    """Where the caller has to be compiled again, alone."""
    (tmp_path / "caller.py").write_text(CALLER)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    found = []
    for _ in range(3):
        command = [sys.executable, str(tmp_path / "caller.py")]
        found.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
        if len(found) == 1:
            for kept in (tmp_path / "cache").rglob("caller.slope*"):
                kept.unlink()
    assert [text.split()[0] for text in found] == ["0.375"] * 3
    assert [text.split()[1:] for text in found] == [["0", "0"], ["0", "1"], ["1", "0"]]


def test_functions_of_others_call_each_other():
    @njit(**copied.UNCALLED)
    def is_even(n):
        return True if n == 0 else is_odd(n - 1)

    @njit(**copied.UNCALLED)
    def is_odd(n):
        return False if n == 0 else is_even(n - 1)

    @njit
    def both(n):
        return is_even(n), is_odd(n)

    @vectorize(["float64(float64)"])
    def at_least_one(x):
        return max(x, 1.0)

    assert both(4) == (True, False)
    assert np.array_equal(at_least_one(np.arange(3.0)), [1.0, 1.0, 2.0])


@pytest.mark.parametrize("where, name", copied.INSIDES)
def test_a_numba_that_is_another_is_left_alone(monkeypatch, where, name):
    before = JITCPUCodegen.set_env
    assert not loaded_without(monkeypatch, copied, where, name).known_inside
    assert JITCPUCodegen.set_env == before
