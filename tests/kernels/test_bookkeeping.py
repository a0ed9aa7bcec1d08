"""What takes the place of five functions of numba's compiler gives what those give."""

import operator

import pytest
from another import loaded, loaded_without
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from numba.core import compiler, event, ir, types
from numba.core.postproc import PostProcessor
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.types.functions import BaseFunction
from numba.cpython import mathimpl

from discsim.kernels import bookkeeping, candidates, nodes_relax, philox

settings = st.dictionaries(st.sampled_from(["nrt", "boundscheck", "no_cfunc_wrapper", "forceinline"]), st.booleans())


def options(values):
    flags = compiler.Flags()
    for name, value in values.items():
        setattr(flags, name, value)
    return flags


@given(settings, settings)
def test_options_are_equal_where_numba_says_so(one, other):
    one, other = options(one), options(other)
    assert (one == other) == (one.values() == other.values())  # as numba compares them
    assert one != other or hash(one) == hash(other)
    assert one == one.copy() and one != "options"
    assert hash(one) == hash(tuple(sorted(one.values())))  # numba's


def test_variables_are_those_that_numba_finds():
    numbas = loaded(ir, "numbas_own")
    numbas.Var, numbas.Inst = ir.Var, ir.Inst
    look = numbas.Stmt._rec_list_vars
    seen = 0
    for kernel in (candidates.find_runs, nodes_relax.relax_node, philox.words_of):
        for block in compiler.run_frontend(kernel.py_func).blocks.values():
            for statement in block.body:
                assert statement.list_vars() == look(statement, vars(statement))
                seen += len(statement.list_vars())
    assert seen > 100
    x, y = (ir.Var(None, name, ir.Loc("", 0)) for name in "xy")
    held = [{"a": x}, 1, None, "text", ((y,),)]
    assert bookkeeping.variables_in(held) == [x, y]


def test_calls_mean_what_numba_finds_under_the_options_of_their_caller(monkeypatch):
    """The least of two numbers is compiled once for each set of options; of texts numba is asked each time."""
    asked, numbas = [], bookkeeping.as_numba_resolves
    monkeypatch.setattr(bookkeeping, "as_numba_resolves", lambda *given: asked.append(given[2]) or numbas(*given))
    context, text = cpu_target.typing_context, types.unicode_type
    context.refresh()
    least = context.resolve_value_type(min)
    for pair in ((types.float64, types.int64), (types.float64, types.float64)):
        found = []
        for nrt in (False, True, False, True):
            with ConfigStack().enter(options({"nrt": nrt, "boundscheck": True})):  # with which nothing else is compiled
                signature = bookkeeping.signature_of(least, context, pair, {})
                found.append(least.get_impl_key(signature))
                assert numbas(least, context, pair, {}) == signature and least.get_impl_key(signature) is found[-1]
        assert found[0] is found[2] is not found[1] is found[3]
        assert asked.count(pair) == 2
    for _ in range(2):
        bookkeeping.signature_of(context.resolve_value_type(operator.add), context, (text, text), {})
    assert asked.count((text, text)) == 2


def test_what_is_registered_later_is_known_without_another_import(monkeypatch):
    context = cpu_target.target_context
    context.refresh()
    monkeypatch.setattr(bookkeeping, "as_numba_imports", None)
    mathimpl.registry.lower(options, types.float64)(lambda *given: None)
    assert options not in context._defns
    context.refresh()
    assert options in context._defns


def test_calls_of_llvm_are_not_timed():
    with event.install_recorder("numba:llvm_lock") as seen:
        njit(lambda x: x + 1)(1)
    assert not seen.buffer


def dump(code):
    return [(label, [str(statement) for statement in block.body]) for label, block in code.blocks.items()]


@pytest.mark.parametrize("kernel", [candidates.find_runs, nodes_relax.relax_node, philox.words_of])
def test_variables_live_as_long_as_numba_lets_them(kernel):
    found = []
    for finish in (bookkeeping.finish, bookkeeping.as_numba_finishes):
        code = compiler.run_frontend(kernel.py_func)
        finish(PostProcessor(code), True)
        found.append((dump(code), dict(code.variable_lifetime.livemap), code.generator_info))
    assert found[0] == found[1]
    assert any("del " in line for _, lines in found[0][0] for line in lines)


def counted(n):
    for i in range(n):
        yield 2 * i


@pytest.mark.parametrize("function", [counted, options])
def test_what_is_alive_in_a_block_is_found_for_generators_and_functions_of_others(monkeypatch, function):
    """numba asks for it where it leaves what it cannot compile to Python, and where it goes on with a generator."""
    if function is counted:
        monkeypatch.setattr(bookkeeping, "COMPILED", (*bookkeeping.COMPILED, __name__))
    code = compiler.run_frontend(function)
    assert any(code.get_block_entry_vars(block) for block in code.blocks.values())
    assert (code.generator_info is not None) == (function is counted)
    code = compiler.run_frontend(philox.words_of.py_func)
    assert not code.block_entry_vars


@pytest.mark.parametrize("one", [types.unicode_type, types.ListType(types.int64), types.undefined])
def test_what_may_become_known_later_is_not_kept(one):
    assert not bookkeeping.is_plain(one) and not bookkeeping.is_plain(types.Tuple([types.int64, types.Tuple([one])]))
    assert bookkeeping.is_plain(types.Tuple([types.int64, types.UniTuple(types.float64[:, :], 2)]))


@pytest.mark.parametrize("where, name", bookkeeping.INSIDES)
def test_a_numba_that_is_another_is_left_alone(monkeypatch, where, name):
    before = TargetConfig.__eq__, TargetConfig.__hash__, BaseFunction.get_call_type
    assert not loaded_without(monkeypatch, bookkeeping, where, name).known_inside
    assert (TargetConfig.__eq__, TargetConfig.__hash__, BaseFunction.get_call_type) == before
