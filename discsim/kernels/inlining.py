"""Compilers of kernels with many `inline="always"`: numba's own, but that it reads and copies less of what it inlines.

numba reads a function anew for each call of it, with all that is inlined in that, and copies it block by block: with
each statement the variables, their places in the source, and the scope, which holds all variables. Of a function that
is long and branches, that is longer than all else that is compiled. What it reads is the same each time, and in what it
copies the variables are replaced by new ones of the caller at once: statements are copied, what they name is shared.
What is compiled is the same.

`SingleCompiler` takes every constant of a kernel, and of what is inlined in it, for one of single precision: to numba a
literal is of double precision, and turns whatever it meets into that. So one source serves both precisions, by the
arrays that it is given; what has to stay in double precision is a function of its own.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba.core import ir
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.inline_closurecall import InlineWorker
from numba.core.untyped_passes import InlineInlinables

SHARED: tuple[Any, ...] = ir.Scope, ir.Var, ir.Loc
COPY = "__deepcopy__"
# What numba does not promise to keep: one that has none of that inlines in its own way, which takes longer.
as_numba_reads = getattr(InlineWorker, "run_untyped_passes", None)
known_inside = as_numba_reads is not None and hasattr(ir.VarMap(), "_con")

kept: dict[Callable, tuple[Any, dict[str, Any]]] = {}  # of a function what numba reads, and the names in its scope


def read_once(worker: Any, function: Callable, enable_ssa: bool = False) -> Any:
    """What numba reads of a function that it inlines; names of the caller, which its scope gets each time, go again."""
    worker.flags.enable_ssa = enable_ssa
    if function not in kept:
        code = as_numba_reads(worker, function, enable_ssa)
        kept[function] = code, dict(scope_of(code)._con)
    code, names = kept[function]
    scope_of(code)._con = dict(names)
    return code


def scope_of(code: Any) -> Any:
    return next(iter(code.blocks.values())).scope.localvars


@contextmanager
def sparing() -> Iterator[None]:
    """Functions are read once, and copies share what they name; numba compiles one function at a time."""
    if not known_inside:
        yield
        return
    read, copies = InlineWorker.run_untyped_passes, {one: vars(one).get(COPY) for one in SHARED}
    InlineWorker.run_untyped_passes = read_once  # type: ignore[method-assign]
    for one in SHARED:
        setattr(one, COPY, lambda this, memo: this)
    try:
        yield
    finally:
        InlineWorker.run_untyped_passes = read  # type: ignore[method-assign]
        for one, own in copies.items():
            if own is None:
                delattr(one, COPY)
            else:
                setattr(one, COPY, own)


@register_pass(mutates_CFG=True, analysis_only=False)
class InlineSparing(InlineInlinables):
    _name = "inline_sparing"

    def run_pass(self, state):
        with sparing():
            return super().run_pass(state)


class Compiler(CompilerBase):
    def define_pipelines(self):
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [(InlineSparing if one is InlineInlinables else one, what) for one, what in manager.passes]
        manager.finalize()
        return [manager]


def _single(value):
    if isinstance(value, tuple):
        return tuple(_single(one) for one in value)
    return np.float32(value) if isinstance(value, float) else value


@register_pass(mutates_CFG=False, analysis_only=False)
class SingleConstants(FunctionPass):
    _name = "single_constants"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        for block in state.func_ir.blocks.values():
            for assigned in block.find_insts(ir.Assign):
                if isinstance(assigned.value, ir.Const | ir.Global | ir.FreeVar):
                    assigned.value.value = _single(assigned.value.value)
        return True


class SingleCompiler(Compiler):
    def define_pipelines(self):
        (manager,) = super().define_pipelines()
        manager.add_pass_after(SingleConstants, InlineSparing)
        manager.finalize()
        return [manager]
