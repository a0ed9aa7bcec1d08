"""Rows: vectors of four numbers in registers (SIMD), for loops too short to be vectorised by the compiler.

    row = load(array, at)            the LANES numbers of an array of any shape, from element `at` on
    row + row, row - row, row * row  lane by lane, also with a number in place of either row; products and sums are
    row / row, root(row)             fused where the processor can; root also of a number
    lane(row, k)                     lane k of a row
    sums_of(a, b, c, d)              the sums over the lanes of each, as a row
    store(array, at, row)            write a row to memory
    fetch(array, at)                 prefetch an element
    empty_row()                      zeros

Where numba's compilation is disabled, rows are arrays. Extending numba: its manual, "Low-level extension API".
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, type_callable

LANES = 4
LINE = np.uint64(8)  # numbers in a cache line, which `fetch` loads


class Vec4Type(types.Type):
    def __init__(self):
        super().__init__(name=f"Row{LANES}")


vec4_type = Vec4Type()
VECTOR = ir.VectorType(ir.DoubleType(), LANES)


@register_model(Vec4Type)
class Vec4Model(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, VECTOR)


def load(array, at):
    """Return LANES numbers of a contiguous array from its element `at` on."""
    return array.reshape(-1)[at : at + LANES].copy()


def store(array, at, row):
    """Write a row into a contiguous array from its element `at` on."""
    array.reshape(-1)[at : at + LANES] = row


def extract(row, k):
    return row[k]


def zeros():
    return np.zeros(LANES)


def horizontal_sums(a, b, c, d):
    return np.array([a.sum(), b.sum(), c.sum(), d.sum()])


def prefetch(array, at):
    pass


def sqrt(x):
    return np.sqrt(x)


def _place(context, builder, kind, array, at):
    data = cgutils.create_struct_proxy(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), VECTOR.as_pointer())


def _loads(context, builder, signature, arguments):
    # Arrays are aligned to numbers (8 bytes), not to vectors.
    return builder.load(_place(context, builder, signature.args[0], *arguments), align=8)


def _stores(context, builder, signature, arguments):
    builder.store(arguments[2], _place(context, builder, signature.args[0], *arguments[:2]), align=8)
    return context.get_dummy_value()


def _takes(context, builder, signature, arguments):
    return builder.extract_element(*arguments)


def _zeros(context, builder, signature, arguments):
    return ir.Constant(VECTOR, [0.0] * LANES)


def compile_as(function, build, returned, *given):
    """Compile calls of `function` with arguments of the types `given` to the code that `build` emits.

    types.Array stands for any array. A function inlined by numba would cost every kernel seconds: numba infers the
    types of each call again.
    """

    @type_callable(function)
    def typed(context):
        def signature(*args):
            return returned(*(arg if kind is types.Array else kind for arg, kind in zip(args, given, strict=True)))

        # numba takes the number of arguments from the function's own.
        of_arguments = (
            lambda: signature(),
            lambda a: signature(a),
            lambda a, b: signature(a, b),
            lambda a, b, c: signature(a, b, c),
            lambda a, b, c, d: signature(a, b, c, d),
        )
        return of_arguments[len(given)]

    lower_builtin(function, *given)(build)


def _lanes(numbers):
    return ir.Constant(ir.VectorType(ir.IntType(32), LANES), list(numbers))


def _fetches(context, builder, signature, arguments):
    byte, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
    kind = ir.FunctionType(ir.VoidType(), [byte, whole, whole, whole])
    fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
    place = builder.bitcast(_place(context, builder, signature.args[0], *arguments), byte)
    builder.call(fetch, [place, whole(0), whole(3), whole(1)])  # read, high locality, data cache
    return context.get_dummy_value()


def _sums(context, builder, signature, arguments):
    a, b, c, d = arguments

    def pairs(one, other):  # sums of pairs of lanes, of `one` and `other` in turn
        even, odd = builder.shuffle_vector(one, other, _lanes((0, 4, 2, 6))), _lanes((1, 5, 3, 7))
        return builder.fadd(even, builder.shuffle_vector(one, other, odd))

    one, other = pairs(a, b), pairs(c, d)
    low = builder.shuffle_vector(one, other, _lanes((0, 1, 4, 5)))
    return builder.fadd(low, builder.shuffle_vector(one, other, _lanes((2, 3, 6, 7))))


compile_as(load, _loads, vec4_type, types.Array, types.intp)
compile_as(store, _stores, types.void, types.Array, types.intp, vec4_type)
compile_as(extract, _takes, types.float64, vec4_type, types.intp)
compile_as(zeros, _zeros, vec4_type)
compile_as(prefetch, _fetches, types.void, types.Array, types.intp)
compile_as(horizontal_sums, _sums, vec4_type, vec4_type, vec4_type, vec4_type, vec4_type)


def _row_of(builder, kind, value):
    """Return a row as it is, or a number in each lane."""
    if kind == vec4_type:
        return value
    first = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), value, ir.IntType(32)(0))
    return builder.shuffle_vector(first, ir.Constant(VECTOR, ir.Undefined), _lanes([0] * LANES))


def compile_operator(symbol, emit, flags=("contract",)):
    """Compile an operator for rows, or a number and a row, to the builder's instruction named `emit`."""
    pairs = [(vec4_type, vec4_type), (types.float64, vec4_type), (vec4_type, types.float64)]

    @type_callable(symbol)
    def typed(context):
        def signature(one, other):
            if vec4_type not in (one, other):
                return None
            return vec4_type(*(kind if kind == vec4_type else types.float64 for kind in (one, other)))

        return signature

    def build(context, builder, signature, arguments):
        both = (_row_of(builder, kind, value) for kind, value in zip(signature.args, arguments, strict=True))
        return getattr(builder, emit)(*both, flags=flags)

    for pair in pairs:
        lower_builtin(symbol, *pair)(build)


compile_operator(operator.add, "fadd")
compile_operator(operator.iadd, "fadd")
compile_operator(operator.sub, "fsub")
compile_operator(operator.mul, "fmul")
compile_operator(operator.truediv, "fdiv", ())


@type_callable(sqrt)
def _type_root(context):
    def signature(x):
        return vec4_type(vec4_type) if x == vec4_type else types.float64(types.float64)

    return signature


@lower_builtin(sqrt, vec4_type)
@lower_builtin(sqrt, types.float64)
def _roots(context, builder, signature, arguments):
    kind, name = (VECTOR, f"v{LANES}f64") if arguments[0].type == VECTOR else (ir.DoubleType(), "f64")
    root_of = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind]), f"llvm.sqrt.{name}")
    return builder.call(root_of, arguments)
