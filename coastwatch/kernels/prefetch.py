"""A hint to the processor that a row of an array is wanted soon: for kernels that take rows in an order that memory has not.

A row that is met by chance costs 100 ns and more of waiting; asked for some rows ahead, the waits overlap.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _fetch(typing_context: Any, array: Any, row: Any) -> Any:
    """Asks for a row of numbers or of pairs, or for the beginning, middle and end of a matrix of up to 16 numbers.

    Args: array: (N,), (N, 2) or (N, d, d), in C order; row: 0..N - 1.
    """
    if not isinstance(array, types.Array) or not isinstance(row, types.Integer):
        return None

    def hints(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        of = context.make_array(array)(context, builder, arguments[0])
        stride = builder.extract_value(of.strides, 0)
        number, byte, kind = stride.type, ir.IntType(8).as_pointer(), ir.IntType(32)
        number_of_row = context.cast(builder, arguments[1], signature.args[1], types.intp)
        begin = builder.add(builder.ptrtoint(of.data, number), builder.mul(number_of_row, stride))
        hint = builder.module.declare_intrinsic(
            "llvm.prefetch", (byte,), ir.FunctionType(ir.VoidType(), [byte, kind, kind, kind])
        )
        half, last = builder.lshr(stride, number(1)), builder.sub(stride, number(1))
        for more in (number(0), half, last)[: 3 if array.ndim == 3 else 1]:
            at = builder.inttoptr(builder.add(begin, more), byte)
            builder.call(hint, [at, kind(0), kind(3), kind(1)])  # to read, to be kept, data
        return context.get_dummy_value()

    return types.none(array, row), hints


fetch: Any = intrinsic(_fetch)
