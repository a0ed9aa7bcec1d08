"""The compiler of sums over neighbours is numba's but for how it reads and copies what it inlines."""

import importlib.util
import re

import pytest
from numba import njit
from numba.core import ir, types
from numba.core.inline_closurecall import InlineWorker

from discsim.kernels import inlining


@njit(inline="always")
def inner_part(k, x):
    if k > 2:
        x = x + 0.1 * k
    return x


@njit(inline="always")
def part(k, x):
    y = inner_part(k, x)
    return y * y if k == 1 else inner_part(k + 1, y) - k


def total(n, x):
    found = 0.0
    for k in range(n):
        found += part(k, x + found)
    return found


def other_total(n, x):
    return part(n, x) - part(n + 1, x)


def machine_code(function, **options):
    """Instructions, without the names of what they are part of."""
    compiled = njit((types.int64, types.float64), **options)(function)
    (code,) = compiled.inspect_asm().values()
    return [re.sub(r"_ZN\w+|\.const\S+|NRT\w+", "", line) for line in code.splitlines() if re.match(r"\t[a-z]", line)]


def copies_and_reader():
    return [vars(one).get(inlining.COPY) for one in inlining.SHARED], InlineWorker.run_untyped_passes


@pytest.fixture
def untouched():
    before = copies_and_reader()
    yield
    assert copies_and_reader() == before


def test_what_is_inlined_is_read_once_and_becomes_the_same(monkeypatch, untouched):
    read = []
    numbas = inlining.as_numba_reads
    monkeypatch.setattr(inlining, "as_numba_reads", lambda *given: read.append(given[1]) or numbas(*given))
    for function in (total, other_total):  # the first twice: what was kept is what numba reads
        assert machine_code(function, pipeline_class=inlining.Compiler) == machine_code(function)
        compiled = njit(pipeline_class=inlining.Compiler)(function)
        assert compiled(7, 0.3) == njit(function)(7, 0.3) == function(7, 0.3)
    assert sorted(one.__name__ for one in read) == ["inner_part", "part"]  # numba still reads by that name
    code, names = inlining.kept[part.py_func]
    assert len(inlining.scope_of(code)._con) == 2 * len(names)  # its own, and those of the last use alone


@pytest.mark.parametrize("where, name", [(InlineWorker, "run_untyped_passes"), (ir.VarMap, "__init__")])
def test_a_numba_that_inlines_in_another_way_does_so(monkeypatch, untouched, where, name):
    """Without a name that this leans on: looked at where it is imported, and there again for what it compiles."""
    spec = importlib.util.spec_from_file_location("another_inlining", inlining.__file__)
    other = importlib.util.module_from_spec(spec)
    with monkeypatch.context() as gone:
        gone.delattr(where, name)
        spec.loader.exec_module(other)
    assert inlining.known_inside and not other.known_inside
    assert machine_code(total, pipeline_class=other.Compiler) == machine_code(total)


def test_numba_is_as_it_was_where_a_function_does_not_compile(untouched):
    with pytest.raises(ValueError), inlining.sparing():
        assert all(inlining.COPY in vars(one) for one in inlining.SHARED)
        assert ir.Loc("a", 1).__deepcopy__({}) == ir.Loc("a", 1)
        raise ValueError
