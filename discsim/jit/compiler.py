"""Compiler of sums: constant arguments are folded, and all constants have the precision of the arguments.

numba compiles a version of a function for each integer or truth value that its callers give literally, but keeps all
branches of it. `FoldArguments` replaces such arguments by their values, so that only the branch taken is typed.

numba types a literal as double precision, and an operation with a literal then promotes the other operand.
`SingleConstants` converts literals to single precision where an argument has it: one source serves both precisions.
Code that must stay in double precision is a function of its own.

Custom compilers: numba's manual, "Customizing the compiler".
"""

import numpy as np
from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import build_definitions
from numba.core.postproc import PostProcessor
from numba.core.untyped_passes import InlineInlinables, IRProcessing


def _single(value):
    if isinstance(value, tuple):
        return tuple(_single(one) for one in value)
    return np.float32(value) if isinstance(value, float) else value


def _is_single(kind):
    """Return whether a type is a number, an array or a tuple with numbers of single precision."""
    if hasattr(kind, "types"):  # those of a tuple's entries
        return any(_is_single(one) for one in kind.types)
    return getattr(kind, "dtype", kind) == types.float32


def _assigned(state):
    return [one for block in state.func_ir.blocks.values() for one in block.find_insts(ir.Assign)]


@register_pass(mutates_CFG=False, analysis_only=False)
class FoldArguments(FunctionPass):
    """Compiler pass that replaces literal arguments by constants."""

    _name = "fold_arguments"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        for one in _assigned(state):
            if isinstance(one.value, ir.Arg) and isinstance(state.args[one.value.index], types.Literal):
                one.value = ir.Const(state.args[one.value.index].literal_value, one.loc)
        former = state.func_ir
        # Branches are pruned by the definitions of variables, which a new function has to be given.
        state.func_ir = ir.FunctionIR(
            former.blocks, former.is_generator, former.func_id, former.loc, build_definitions(former.blocks),
            former.arg_count, former.arg_names,
        )  # fmt: skip
        PostProcessor(state.func_ir).run()
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class SingleConstants(FunctionPass):
    """Compiler pass that converts constants of a function of single precision, and of functions inlined in it."""

    _name = "single_constants"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        if any(_is_single(kind) for kind in state.args):
            for one in _assigned(state):
                if isinstance(one.value, ir.Const | ir.Global | ir.FreeVar):
                    one.value.value = _single(one.value.value)
        return True


class SumsCompiler(CompilerBase):
    """numba's default compiler with the two passes."""

    def define_pipelines(self):
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.add_pass_after(FoldArguments, IRProcessing)
        manager.add_pass_after(SingleConstants, InlineInlinables)
        manager.finalize()
        return [manager]
