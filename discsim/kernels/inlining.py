"""Compilers of kernels with many `inline="always"`: numba's own, where blocks of a function share its scope.

numba copies a function that it inlines block by block, and with each block a scope that holds all its variables: of one
that is long and branches, that is as long as all else that is compiled. The copies are equal, and the function that
they are of is read anew for each call: one scope is enough. What is compiled is the same.

`SingleCompiler` takes every constant of a kernel, and of what is inlined in it, for one of single precision: to numba a
literal is of double precision, and turns whatever it meets into that. So one source serves both precisions, by the
arrays that it is given; what has to stay in double precision is a function of its own.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numba.core import ir
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.untyped_passes import InlineInlinables


@contextmanager
def shared_scopes() -> Iterator[None]:
    """Copies of parts of a function have its scope; numba compiles one function at a time."""
    ir.Scope.__deepcopy__ = lambda scope, memo: scope  # type: ignore[attr-defined]
    try:
        yield
    finally:
        del ir.Scope.__deepcopy__  # type: ignore[attr-defined]


@register_pass(mutates_CFG=True, analysis_only=False)
class InlineSharing(InlineInlinables):
    _name = "inline_sharing_scopes"

    def run_pass(self, state):
        with shared_scopes():
            return super().run_pass(state)


class Compiler(CompilerBase):
    def define_pipelines(self):
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [(InlineSharing if one is InlineInlinables else one, what) for one, what in manager.passes]
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
        manager.add_pass_after(SingleConstants, InlineSharing)
        manager.finalize()
        return [manager]
