"""Sixteen float32 lanes in numba kernels, or eight.

Numba vectorises only what LLVM's loop vectoriser recognises, and a masked blend of neighbouring pixels is beyond it. Here
is a `Lanes` value and the few operations that the blending kernels need, each a handful of LLVM vector instructions: AVX-512
or twice AVX on x86, NEON on ARM, SSE where there is no better. Loads, stores and the counter do not check bounds. A `Half`
has half the lanes, for the few channels of a feature plane; `mul`, `fma` and `store` take either.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES = 16
HALF = LANES // 2
_FLOAT, _INT, _BIT = ir.FloatType(), ir.IntType(32), ir.IntType(1)
_VECTOR, _INTS, _HALF_VECTOR = ir.VectorType(_FLOAT, LANES), ir.VectorType(_INT, LANES), ir.VectorType(_FLOAT, HALF)


class _Type(types.Type):
    """An opaque numba type held in one LLVM vector."""


lanes, mask, half = _Type("Lanes"), _Type("Mask"), _Type("Half")


@register_model(_Type)
class _Model(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        vector = {"Lanes": _VECTOR, "Half": _HALF_VECTOR, "Mask": ir.VectorType(_BIT, LANES)}[numba_type.name]
        super().__init__(manager, numba_type, vector)


def _constant(value: float) -> ir.Constant:
    return ir.Constant(_VECTOR, [ir.Constant(_FLOAT, float(np.float32(value)))] * LANES)


def _integers(value: int) -> ir.Constant:
    return ir.Constant(_INTS, [ir.Constant(_INT, value)] * LANES)


def _broadcast(builder, scalar, vector=_VECTOR):
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, ir.Constant(_INT, 0))
    order = ir.Constant(ir.VectorType(_INT, vector.count), [ir.Constant(_INT, 0)] * vector.count)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), order)


def _call(builder, name, *arguments):
    vector = arguments[0].type
    function_type = ir.FunctionType(vector, [vector] * len(arguments))
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, f"llvm.{name}.v{vector.count}f32"), arguments)


def _fma(builder, a, b, c):
    return _call(builder, "fmuladd", a, b, c)


def _reduce(builder, value, combine):
    """One number out of all lanes, pairwise."""
    width = LANES // 2
    while width:
        order = ir.Constant(_INTS, [ir.Constant(_INT, min(i + width, LANES - 1)) for i in range(LANES)])
        value = combine(value, builder.shuffle_vector(value, ir.Constant(value.type, ir.Undefined), order))
        width //= 2
    return builder.extract_element(value, ir.Constant(_INT, 0))


def _pointer(context, builder, array_type, array, index, element):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


def _operation(result, *arguments):
    """Make an intrinsic of fixed types from `emit(builder, *values)`."""

    def decorate(emit):
        def codegen(context, builder, signature, values):
            return emit(builder, *values)

        # numba reads the number of parameters off the typing function, hence one for each arity
        typings = {
            1: lambda typing, a: (result(*arguments), codegen),
            2: lambda typing, a, b: (result(*arguments), codegen),
            3: lambda typing, a, b, c: (result(*arguments), codegen),
        }
        typing = typings[len(arguments)]
        typing.__name__, typing.__doc__ = emit.__name__, emit.__doc__
        return intrinsic(typing)

    return decorate


@_operation(lanes, types.float32)
def splat(builder, value):
    """The same number in every lane."""
    return _broadcast(builder, value)


@_operation(lanes, types.float32)
def ramp(builder, start):
    """start, start + 1, start + 2, …"""
    return builder.fadd(_broadcast(builder, start), ir.Constant(_VECTOR, [ir.Constant(_FLOAT, float(i)) for i in range(LANES)]))


@_operation(half, types.float32)
def splat_half(builder, value):
    """The same number in each of eight lanes."""
    return _broadcast(builder, value, _HALF_VECTOR)


def _arithmetic(instruction: str):
    @intrinsic
    def operation(typing, a, b):
        return a(a, a), lambda context, builder, signature, values: getattr(builder, instruction)(*values)

    return operation


add, sub, mul, div = (_arithmetic(instruction) for instruction in ("fadd", "fsub", "fmul", "fdiv"))


@intrinsic
def fma(typing, a, b, c):
    """a b + c, rounded once where the processor can."""
    return a(a, a, a), lambda context, builder, signature, values: _fma(builder, *values)


@_operation(lanes, lanes, lanes)
def minimum(builder, a, b):
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


@_operation(lanes, lanes, lanes)
def maximum(builder, a, b):
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


@_operation(mask, lanes, lanes)
def greater(builder, a, b):
    return builder.fcmp_ordered(">", a, b)


@_operation(mask, mask, mask)
def both(builder, a, b):
    return builder.and_(a, b)


@_operation(lanes, mask, lanes, lanes)
def select(builder, mask, a, b):
    """a where the mask is set, else b."""
    return builder.select(mask, a, b)


@_operation(lanes, lanes)
def finished(builder, transmittance):
    """−|x|: the mark of a pixel that takes no more light."""
    bits = builder.or_(builder.bitcast(transmittance, _INTS), _integers(-(2**31)))
    return builder.bitcast(bits, _VECTOR)


@_operation(types.boolean, mask)
def some(builder, mask):
    """Whether any lane is set."""
    bits = builder.bitcast(mask, ir.IntType(LANES))
    return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))


@_operation(types.int64, types.uint64)
def lowest_bit(builder, bits):
    """Index of the lowest set bit of a non-zero number."""
    return builder.cttz(bits, ir.Constant(_BIT, 1))


@_operation(types.float32, lanes)
def total(builder, value):
    """Sum of the lanes, pairwise."""
    return _reduce(builder, value, builder.fadd)


@_operation(lanes, lanes)
def sqrt(builder, a):
    return _call(builder, "sqrt", a)


@_operation(types.uint64, lanes, lanes)
def spans_as_bits(builder, low, high):
    """For 16 rows of 4 × 8 pixels, the eights that hold a pixel x with low ≤ x ≤ high: row r's are bits 4 r to 4 r + 3.

    `low` must be in [0, 32] and `high` in [-1, 31].
    """
    low, high = _call(builder, "ceil", low), _call(builder, "floor", high)
    empty = builder.fcmp_ordered(">", low, high)
    first = builder.ashr(builder.fptosi(low, _INTS), _integers(3))
    last = builder.ashr(builder.fptosi(high, _INTS), _integers(3))
    bits = builder.sub(builder.shl(_integers(2), builder.and_(last, _integers(7))), builder.shl(_integers(1), first))
    wide = ir.VectorType(ir.IntType(64), LANES)
    bits = builder.zext(builder.select(empty, _integers(0), bits), wide)
    bits = builder.shl(bits, ir.Constant(wide, [ir.Constant(ir.IntType(64), 4 * i) for i in range(LANES)]))
    return _reduce(builder, bits, builder.or_)


# 2^f on [−½, ½], least greatest relative error (1e-7); highest power first.
_EXP2 = (0.001327647199, 0.009675541334, 0.05550713274, 0.2402211972, 0.6931469671, 1.000000072)
_ROUND = 1.5 * 2**23


@_operation(lanes, lanes)
def exp2(builder, x):
    """2^x for |x| < 126, relative error 2e-7; elsewhere any number, and never a trap."""
    shifted = builder.fadd(x, _constant(_ROUND))  # the sum's low bits are round(x)
    fraction = builder.fsub(x, builder.fsub(shifted, _constant(_ROUND)))
    power = _constant(_EXP2[0])
    for coefficient in _EXP2[1:]:
        power = _fma(builder, power, fraction, _constant(coefficient))
    exponent = builder.shl(builder.bitcast(shifted, _INTS), _integers(23))
    return builder.bitcast(builder.add(builder.bitcast(power, _INTS), exponent), _VECTOR)


def _loading(result, vector):
    @intrinsic
    def load(typing, array, index):
        def codegen(context, builder, signature, values):
            return builder.load(_pointer(context, builder, signature.args[0], values[0], values[1], vector), align=4)

        return result(array, types.intp), codegen

    return load


#: LANES numbers, or HALF, of a contiguous float32 array from a flat index.
load, load_half = _loading(lanes, _VECTOR), _loading(half, _HALF_VECTOR)


@intrinsic
def spread(typing, array, index):
    """One number of a contiguous float32 array, by flat index, in every lane."""

    def codegen(context, builder, signature, values):
        return _broadcast(builder, builder.load(_pointer(context, builder, signature.args[0], values[0], values[1], _FLOAT)))

    return lanes(array, types.intp), codegen


@intrinsic
def store(typing, array, index, value):
    """Write all lanes of a value to a contiguous float32 array at a flat index."""

    def codegen(context, builder, signature, values):
        pointer = _pointer(context, builder, signature.args[0], values[0], values[1], values[2].type)
        builder.store(values[2], pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), codegen
