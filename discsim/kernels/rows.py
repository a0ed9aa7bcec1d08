"""Rows: four numbers in the vector registers of a processor, for loops that are too short for a compiler to see any.

    row = load(array, at)            the LANES numbers of an array, whatever its shape, from element `at` on
    row + row, row - row             of all lanes at once; products and sums are fused where the processor can
    a * row, row * row
    lane(row, k)                     one of them
    store(array, at, row)            back into memory
    empty_row()                      nothing but 0

Where numba is told not to compile, rows are arrays. Extending numba: its manual, "Low-level extension API".
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global
from numba.extending import lower_builtin, models, register_model

LANES = 4


class RowType(types.Type):
    def __init__(self):
        super().__init__(name=f"Row{LANES}")


row_type = RowType()
VECTOR = ir.VectorType(ir.DoubleType(), LANES)


@register_model(RowType)
class RowModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, VECTOR)


def load(array, at):
    """LANES numbers of a contiguous array from its element `at` on."""
    return array.reshape(-1)[at : at + LANES].copy()


def store(array, at, row):
    """Write a row into a contiguous array from its element `at` on."""
    array.reshape(-1)[at : at + LANES] = row


def lane(row, k):
    return row[k]


def empty_row():
    return np.zeros(LANES)


def _place(context, builder, kind, array, at):
    data = cgutils.create_struct_proxy(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), VECTOR.as_pointer())


def _loads(context, builder, signature, arguments):
    # An array begins where a number may; a row need not begin where a vector would.
    return builder.load(_place(context, builder, signature.args[0], *arguments), align=8)


def _stores(context, builder, signature, arguments):
    builder.store(arguments[2], _place(context, builder, signature.args[0], *arguments[:2]), align=8)
    return context.get_dummy_value()


def _takes(context, builder, signature, arguments):
    return builder.extract_element(*arguments)


def _zeros(context, builder, signature, arguments):
    return ir.Constant(VECTOR, [0.0] * LANES)


def compile_as(function, build, returned, *given):
    """Let compiled code call `function` of arguments of the types `given` (types.Array: any) by what `build` emits.

    A function that numba inlines would cost every kernel seconds: each call of it is inferred anew.
    """

    class Typed(AbstractTemplate):
        key = function

        def generic(self, args, kws):
            if kws or len(args) != len(given):
                return None
            return returned(*(arg if kind is types.Array else kind for arg, kind in zip(args, given, strict=True)))

    infer_global(function)(Typed)
    lower_builtin(function, *given)(build)


compile_as(load, _loads, row_type, types.Array, types.intp)
compile_as(store, _stores, types.void, types.Array, types.intp, row_type)
compile_as(lane, _takes, types.float64, row_type, types.intp)
compile_as(empty_row, _zeros, row_type)


@infer_global(operator.add)
@infer_global(operator.iadd)
@infer_global(operator.sub)
class SumOfRows(ConcreteTemplate):
    cases = [row_type(row_type, row_type)]  # noqa: RUF012


@infer_global(operator.mul)
class TimesRow(ConcreteTemplate):
    cases = [row_type(types.float64, row_type), row_type(row_type, row_type)]  # noqa: RUF012


@lower_builtin(operator.add, row_type, row_type)
@lower_builtin(operator.iadd, row_type, row_type)
def _add(context, builder, signature, arguments):
    return builder.fadd(*arguments, flags=("contract",))


@lower_builtin(operator.sub, row_type, row_type)
def _subtract(context, builder, signature, arguments):
    return builder.fsub(*arguments, flags=("contract",))


@lower_builtin(operator.mul, types.float64, row_type)
def _multiply(context, builder, signature, arguments):
    number, row = arguments
    first = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), number, ir.IntType(32)(0))
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    same = builder.shuffle_vector(first, ir.Constant(VECTOR, ir.Undefined), lanes)
    return builder.fmul(same, row, flags=("contract",))


@lower_builtin(operator.mul, row_type, row_type)
def _multiply_rows(context, builder, signature, arguments):
    return builder.fmul(*arguments, flags=("contract",))
