"""Compiler of sums over neighbours, with two passes in addition to numba's.

numba compiles one specialisation of a function for each literal integer or truth value among the arguments of a call,
but keeps all branches in each. `FoldArguments` replaces such arguments by their values, so that only the branch that
is taken gets compiled.

numba gives floating-point literals double precision, so that an operation with a literal is done in double precision.
`SingleConstants` converts the literals of a function to single precision if one of its arguments has single precision.
One source then serves both precisions. Code that must stay in double precision is in separate functions.

Custom compilers: numba's manual, "Customizing the compiler".
"""

import numpy as np
from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import build_definitions
from numba.core.postproc import PostProcessor
from numba.core.untyped_passes import InlineInlinables, IRProcessing


def _to_single(value):
    """Return `value` with all its floats, also inside tuples, converted to single precision."""
    if isinstance(value, tuple):
        return tuple(_to_single(one) for one in value)
    return np.float32(value) if isinstance(value, float) else value


def _has_single(kind):
    """Return whether a numba type is a single-precision number, or an array or tuple that contains such numbers."""
    if hasattr(kind, "types"):  # the types of the entries of a tuple
        return any(_has_single(one) for one in kind.types)
    return getattr(kind, "dtype", kind) == types.float32


def _assignments(state):
    """Return all assignments in the function that a compiler pass works on."""
    return [one for block in state.func_ir.blocks.values() for one in block.find_insts(ir.Assign)]


@register_pass(mutates_CFG=False, analysis_only=False)
class FoldArguments(FunctionPass):
    """Compiler pass that replaces the literal arguments of a function by constants."""

    _name = "fold_arguments"

    def __init__(self):  # abstract in numba
        super().__init__()

    def run_pass(self, state):
        for one in _assignments(state):
            if isinstance(one.value, ir.Arg) and isinstance(state.args[one.value.index], types.Literal):
                one.value = ir.Const(state.args[one.value.index].literal_value, one.loc)
        former = state.func_ir
        # Dead branches are found from the definitions of variables, which are rebuilt here with the new constants.
        state.func_ir = ir.FunctionIR(
            former.blocks, former.is_generator, former.func_id, former.loc, build_definitions(former.blocks),
            former.arg_count, former.arg_names,
        )  # fmt: skip
        PostProcessor(state.func_ir).run()
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class SingleConstants(FunctionPass):
    """Compiler pass that converts constants to single precision if an argument has it, also in inlined functions."""

    _name = "single_constants"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        if any(_has_single(kind) for kind in state.args):
            for one in _assignments(state):
                if isinstance(one.value, ir.Const | ir.Global | ir.FreeVar):
                    one.value.value = _to_single(one.value.value)
        return True


class SumsCompiler(CompilerBase):
    """numba's default compiler with the passes `FoldArguments` and `SingleConstants` added."""

    def define_pipelines(self):
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.add_pass_after(FoldArguments, IRProcessing)
        manager.add_pass_after(SingleConstants, InlineInlinables)
        manager.finalize()
        return [manager]
