"""SIMD vectors of LANES = 4 numbers for numba code, for loops too short to be vectorised by the compiler.

    row = load(array, at)               a vector of four elements of a contiguous array of any shape, from `at` on
    row + row, row - row, row * row     by lane, also with a number in place of either vector; products and sums are
    row / row, sqrt(row)                fused where the processor can do this; sqrt also of a number
    extract(row, k)                     lane k of a vector, a number
    horizontal_sums(a, b, c, d)         the vector of the four sums over the lanes of a, b, c and d
    store(array, at, row)               writes a vector to the array, from element `at` on
    prefetch(array, at)                 loads the cache line of element `at`
    zeros()                             a vector of zeros

Where numba's compilation is disabled, vectors are numpy arrays. The registration of types and functions follows numba's
manual, "Low-level extension API".
"""

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, type_callable

LANES = 4
LINE = np.uint64(8)  # numbers in a cache line, which `prefetch` loads


class Vec4Type(types.Type):
    """numba type of a vector."""

    def __init__(self):
        super().__init__(name=f"Row{LANES}")


vec4_type = Vec4Type()
VECTOR = ir.VectorType(ir.DoubleType(), LANES)


@register_model(Vec4Type)
class Vec4Model(models.PrimitiveModel):
    """Data model of a vector: an LLVM vector of doubles."""

    def __init__(self, manager, kind):
        super().__init__(manager, kind, VECTOR)


def load(array, at):
    """Return the vector of LANES elements of a contiguous array from element `at` on."""
    return array.reshape(-1)[at : at + LANES].copy()


def store(array, at, row):
    """Write a vector to a contiguous array from element `at` on."""
    array.reshape(-1)[at : at + LANES] = row


def extract(row, k):
    """Return lane k of a vector."""
    return row[k]


def zeros():
    """Return a vector of zeros."""
    return np.zeros(LANES)


def horizontal_sums(a, b, c, d):
    """Return the vector of the sums over the lanes of a, of b, of c and of d."""
    return np.array([a.sum(), b.sum(), c.sum(), d.sum()])


def prefetch(array, at):
    """Load the cache line of element `at` of an array; without compilation do nothing."""


def sqrt(x):
    """Return the square root of a number, or of each lane of a vector."""
    return np.sqrt(x)


def _vector_pointer(context, builder, kind, array, at):
    """Return the pointer to element `at` of an array of the numba type `kind`, as a pointer to a vector."""
    data = cgutils.create_struct_proxy(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), VECTOR.as_pointer())


# The functions _build_... emit the LLVM code of a call, with the arguments that numba's `lower_builtin` gives.
def _build_load(context, builder, signature, arguments):
    # Arrays are aligned to numbers (8 bytes), not to vectors.
    return builder.load(_vector_pointer(context, builder, signature.args[0], *arguments), align=8)


def _build_store(context, builder, signature, arguments):
    builder.store(arguments[2], _vector_pointer(context, builder, signature.args[0], *arguments[:2]), align=8)
    return context.get_dummy_value()


def _build_extract(context, builder, signature, arguments):
    return builder.extract_element(*arguments)


def _build_zeros(context, builder, signature, arguments):
    return ir.Constant(VECTOR, [0.0] * LANES)


def register_function(function, build, returned, *given):
    """Compile calls of `function`, with arguments of the numba types `given`, to the LLVM code that `build` emits.

    returned: numba type of the result. types.Array in `given` stands for an array of any type. A function that numba
    inlines would need no registration, but numba infers the types of each call again: seconds for every kernel.
    """

    @type_callable(function)
    def typed(context):
        def signature(*args):
            """Return the signature of a call with arguments of the numba types `args`."""
            return returned(*(arg if kind is types.Array else kind for arg, kind in zip(args, given, strict=True)))

        # numba reads the number of arguments from the signature of the Python function.
        of_arguments = (
            lambda: signature(),
            lambda a: signature(a),
            lambda a, b: signature(a, b),
            lambda a, b, c: signature(a, b, c),
            lambda a, b, c, d: signature(a, b, c, d),
        )
        return of_arguments[len(given)]

    lower_builtin(function, *given)(build)


def _lane_numbers(numbers):
    """Return the constant of lane numbers that builder.shuffle_vector needs."""
    return ir.Constant(ir.VectorType(ir.IntType(32), LANES), list(numbers))


def _build_prefetch(context, builder, signature, arguments):
    byte, integer = ir.IntType(8).as_pointer(), ir.IntType(32)
    kind = ir.FunctionType(ir.VoidType(), [byte, integer, integer, integer])
    function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
    pointer = builder.bitcast(_vector_pointer(context, builder, signature.args[0], *arguments), byte)
    builder.call(function, [pointer, integer(0), integer(3), integer(1)])  # read, high locality, data cache
    return context.get_dummy_value()


def _build_horizontal_sums(context, builder, signature, arguments):
    a, b, c, d = arguments

    def pairs(one, other):  # sums of lanes 0 + 1 of `one`, 0 + 1 of `other`, 2 + 3 of `one`, 2 + 3 of `other`
        even, odd = builder.shuffle_vector(one, other, _lane_numbers((0, 4, 2, 6))), _lane_numbers((1, 5, 3, 7))
        return builder.fadd(even, builder.shuffle_vector(one, other, odd))

    one, other = pairs(a, b), pairs(c, d)
    low = builder.shuffle_vector(one, other, _lane_numbers((0, 1, 4, 5)))
    return builder.fadd(low, builder.shuffle_vector(one, other, _lane_numbers((2, 3, 6, 7))))


register_function(load, _build_load, vec4_type, types.Array, types.intp)
register_function(store, _build_store, types.void, types.Array, types.intp, vec4_type)
register_function(extract, _build_extract, types.float64, vec4_type, types.intp)
register_function(zeros, _build_zeros, vec4_type)
register_function(prefetch, _build_prefetch, types.void, types.Array, types.intp)
register_function(horizontal_sums, _build_horizontal_sums, vec4_type, vec4_type, vec4_type, vec4_type, vec4_type)


def _as_vector(builder, kind, value):
    """Return a vector unchanged, and a number as a vector with this number in each lane."""
    if kind == vec4_type:
        return value
    first = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), value, ir.IntType(32)(0))
    return builder.shuffle_vector(first, ir.Constant(VECTOR, ir.Undefined), _lane_numbers([0] * LANES))


def register_operator(symbol, emit, flags=("contract",)):
    """Compile an operator between two vectors, or a vector and a number, to the LLVM instruction named `emit`."""
    pairs = [(vec4_type, vec4_type), (types.float64, vec4_type), (vec4_type, types.float64)]

    @type_callable(symbol)
    def typed(context):
        def signature(one, other):
            """Return the signature of the operator between two numba types; None if neither is a vector."""
            if vec4_type not in (one, other):
                return None
            return vec4_type(*(kind if kind == vec4_type else types.float64 for kind in (one, other)))

        return signature

    def build(context, builder, signature, arguments):
        both = (_as_vector(builder, kind, value) for kind, value in zip(signature.args, arguments, strict=True))
        return getattr(builder, emit)(*both, flags=flags)

    for pair in pairs:
        lower_builtin(symbol, *pair)(build)


register_operator(operator.add, "fadd")
register_operator(operator.iadd, "fadd")
register_operator(operator.sub, "fsub")
register_operator(operator.mul, "fmul")
register_operator(operator.truediv, "fdiv", ())


@type_callable(sqrt)
def _type_sqrt(context):
    def signature(x):
        """Return the signature of `sqrt` for an argument of the numba type x."""
        return vec4_type(vec4_type) if x == vec4_type else types.float64(types.float64)

    return signature


@lower_builtin(sqrt, vec4_type)
@lower_builtin(sqrt, types.float64)
def _build_sqrt(context, builder, signature, arguments):
    kind, name = (VECTOR, f"v{LANES}f64") if arguments[0].type == VECTOR else (ir.DoubleType(), "f64")
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind]), f"llvm.sqrt.{name}")
    return builder.call(function, arguments)
