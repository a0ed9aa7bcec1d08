"""Compiler that converts every constant of a kernel to single precision.

numba types a literal as double precision, and an operation with a literal then promotes the other operand. With
`SingleCompiler` one source serves both precisions, depending on the arrays passed. Code that must stay in double
precision is a function of its own. Custom compilers: numba's manual, "Customizing the compiler".
"""

import numpy as np
from numba.core import ir
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.untyped_passes import InlineInlinables


def _single(value):
    if isinstance(value, tuple):
        return tuple(_single(one) for one in value)
    return np.float32(value) if isinstance(value, float) else value


@register_pass(mutates_CFG=False, analysis_only=False)
class SingleConstants(FunctionPass):
    """Compiler pass that converts constants of a function, and of functions inlined in it, to single precision."""

    _name = "single_constants"

    def __init__(self):
        super().__init__()

    def run_pass(self, state):
        for block in state.func_ir.blocks.values():
            for assigned in block.find_insts(ir.Assign):
                if isinstance(assigned.value, ir.Const | ir.Global | ir.FreeVar):
                    assigned.value.value = _single(assigned.value.value)
        return True


class SingleCompiler(CompilerBase):
    """numba's default compiler, with `SingleConstants` after inlining."""

    def define_pipelines(self):
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.add_pass_after(SingleConstants, InlineInlinables)
        manager.finalize()
        return [manager]
