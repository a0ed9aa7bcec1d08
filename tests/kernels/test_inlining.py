"""The compiler of sums over neighbours is numba's but for how it copies what it inlines."""

from numba import njit
from numba.core import ir

from discsim.kernels import inlining

COPIES = "__deepcopy__"


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


def test_what_is_inlined_twice_and_in_another_is_the_same(monkeypatch):
    seen = []
    run = inlining.InlineSharing.run_pass
    monkeypatch.setattr(inlining.InlineSharing, "run_pass", lambda *given: seen.append(COPIES) or run(*given))
    compiled = njit(pipeline_class=inlining.Compiler)(total)
    assert compiled(7, 0.3) == njit(total)(7, 0.3) == total(7, 0.3)
    assert seen  # numba still inlines by a pass of that name
    assert COPIES not in vars(ir.Scope)


def test_copies_are_as_numba_makes_them_where_a_function_does_not_compile():
    try:
        with inlining.shared_scopes():
            assert COPIES in vars(ir.Scope)
            raise ValueError
    except ValueError:
        assert COPIES not in vars(ir.Scope)
