"""Sums whose inner loop is four lanes of one vector register, spelled out for the compiler.

Three components beside each other are too short for the compiler's own vectorised loops, and its scalar code is bound
by the latency of one sum. Here neighbouring numbers in memory (components, and grid points along the last axis) fill
the lanes. The order of every sum is fixed by the code, so the result depends on the inputs alone; products and sums may
be contracted to fused operations where the machine has them.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = ["LANES", "plane_sums", "row_sums", "solid_sums"]

#: Numbers of one vector.
LANES = 4

_generated: Any = intrinsic  # which passes the typing context itself: callers leave it out

_INT, _LANE = ir.IntType(64), ir.IntType(32)
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_ZERO = ir.Constant(_VECTOR, [0.0] * LANES)
_FUSED = ("contract",)


@_generated
def solid_sums(typing, numbers, first, stride_x, stride_y, wx, wy):  # type: ignore[no-untyped-def]
    """``Σ_ij wx[i] wy[j] numbers[first + i stride_x + j stride_y + m]`` for m = 0 … 11, i and j = 0 … 3."""
    del typing
    signature = types.UniTuple(types.float64, 12)(numbers, first, stride_x, stride_y, wx, wy)  # type: ignore[no-untyped-call]

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        numbers, first, stride_x, stride_y, wx, wy = arguments
        data = context.make_array(signature.args[0])(context, builder, numbers).data
        totals = [_ZERO] * 3
        for i in range(4):
            for j in range(4):
                step = builder.add(builder.mul(_whole(i), stride_x), builder.mul(_whole(j), stride_y))
                weight = builder.fmul(builder.extract_value(wx, i), builder.extract_value(wy, j))
                totals = _add_line(builder, data, builder.add(first, step), weight, totals)
        return _unpacked(builder, totals)

    return signature, generate


@_generated
def plane_sums(typing, numbers, first, stride, wx):  # type: ignore[no-untyped-def]
    """``Σ_i wx[i] numbers[first + i stride + m]`` for m = 0 … 7, i = 0 … 3."""
    del typing
    signature = types.UniTuple(types.float64, 8)(numbers, first, stride, wx)  # type: ignore[no-untyped-call]

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        numbers, first, stride, wx = arguments
        data = context.make_array(signature.args[0])(context, builder, numbers).data
        totals = [_ZERO] * 2
        for i in range(4):
            start = builder.add(first, builder.mul(_whole(i), stride))
            totals = _add_line(builder, data, start, builder.extract_value(wx, i), totals)
        return _unpacked(builder, totals)

    return signature, generate


@_generated
def row_sums(typing, entries, columns, first, last, vectors, groups, group):  # type: ignore[no-untyped-def]
    """``Σ_e entries[e] vectors[columns[e], 4 group + m]`` for m = 0 … 3, e = first … last − 1.

    ``vectors`` is flat, rows of ``4 groups`` numbers. Even and odd terms are summed apart.
    """
    del typing
    signature = types.UniTuple(types.float64, LANES)(entries, columns, first, last, vectors, groups, group)  # type: ignore[no-untyped-call]

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        entries, columns, first, last, vectors, groups, group = arguments
        weights, places, numbers = (
            context.make_array(signature.args[i])(context, builder, array).data
            for i, array in ((0, entries), (1, columns), (4, vectors))
        )
        even, odd = (cgutils.alloca_once_value(builder, _ZERO) for _ in range(2))  # type: ignore[no-untyped-call]

        def add(e: Any, total: Any) -> None:
            row = builder.mul(builder.sext(builder.load(builder.gep(places, [e])), _INT), groups)
            start = builder.mul(builder.add(row, group), _whole(LANES))
            weight = builder.load(builder.gep(weights, [e]))
            builder.store(_add_line(builder, numbers, start, weight, [builder.load(total)])[0], total)

        pairs = builder.ashr(builder.sub(last, first), _whole(1))
        with cgutils.for_range(builder, pairs, intp=_INT) as loop:
            e = builder.add(first, builder.shl(loop.index, _whole(1)))
            add(e, even)
            add(builder.add(e, _whole(1)), odd)
        left = builder.add(first, builder.shl(pairs, _whole(1)))
        with builder.if_then(builder.icmp_signed("<", left, last)):
            add(left, even)
        return _unpacked(builder, [builder.fadd(builder.load(even), builder.load(odd))])

    return signature, generate


def _add_line(builder: Any, data: Any, start: Any, weight: Any, totals: list[Any]) -> list[Any]:
    """The totals plus ``weight`` times as many vectors of neighbouring numbers from ``start`` on."""
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    single = builder.insert_element(undefined, weight, ir.Constant(_LANE, 0))
    weights = builder.shuffle_vector(single, undefined, ir.Constant(ir.VectorType(_LANE, LANES), [0] * LANES))
    sums = []
    for k, total in enumerate(totals):
        place = builder.gep(data, [builder.add(start, _whole(LANES * k))])
        numbers = builder.load(builder.bitcast(place, _VECTOR.as_pointer()), align=8)
        sums.append(builder.fadd(builder.fmul(weights, numbers, flags=_FUSED), total, flags=_FUSED))
    return sums


def _unpacked(builder: Any, totals: list[Any]) -> Any:
    """The lanes of vectors as a tuple."""
    lanes = [builder.extract_element(total, ir.Constant(_LANE, m)) for total in totals for m in range(LANES)]
    return cgutils.pack_array(builder, lanes)  # type: ignore[no-untyped-call]


def _whole(number: int) -> Any:
    return ir.Constant(_INT, number)
