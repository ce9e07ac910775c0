"""What the compiled loops of `image` are made of: bytes at an address, and numbers as SQLite's file format has them.

The format is https://sqlite.org/fileformat2.html, sections 1.6 (numbers of variable length) and 2.1 (serial types).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from coastwatch.kernels.jit import jit

ABSENT, FLOAT, ZERO, FIRST_BLOB, FIRST_TEXT = 0, 7, 8, 12, 13
"""Serial types: of NULL, of float64, of the number 0 (then that of 1), of a blob and of a text without bytes."""

SHORT = 2.0**47
"""Whole numbers under this take less than eight bytes."""


def _stored(bits: int) -> tuple[Any, Any]:
    """Signature and code that write the lowest bits of a number at an address, the highest byte first."""
    kind = ir.IntType(bits)

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        value = builder.trunc(given[1], kind) if bits < 64 else given[1]
        builder.store(builder.bswap(value) if bits > 8 else value, builder.inttoptr(given[0], kind.as_pointer()), align=1)

    return types.void(types.int64, types.int64), code


def _loaded(bits: int) -> tuple[Any, Any]:
    """Signature and code that read so many bits at an address."""
    kind = ir.IntType(bits)

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        value = builder.load(builder.inttoptr(given[0], kind.as_pointer()), align=1)
        return builder.zext(value, ir.IntType(64)) if bits < 64 else value

    return types.int64(types.int64), code


@intrinsic
def put_1(context, at, value):  # type: ignore[no-untyped-def]
    return _stored(8)


@intrinsic
def put_2(context, at, value):  # type: ignore[no-untyped-def]
    return _stored(16)


@intrinsic
def put_4(context, at, value):  # type: ignore[no-untyped-def]
    return _stored(32)


@intrinsic
def put_8(context, at, value):  # type: ignore[no-untyped-def]
    return _stored(64)


@intrinsic
def byte_at(context, at):  # type: ignore[no-untyped-def]
    return _loaded(8)


@intrinsic
def word_at(context, at):  # type: ignore[no-untyped-def]
    return _loaded(64)


@intrinsic
def real_of(context, bits):  # type: ignore[no-untyped-def]
    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.bitcast(given[0], ir.DoubleType())

    return types.float64(types.int64), code


@intrinsic
def copy_bytes(context, to, at, count):  # type: ignore[no-untyped-def]
    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        to, at = (builder.inttoptr(address, ir.IntType(8).as_pointer()) for address in given[:2])
        cgutils.raw_memcpy(builder, to, at, given[2], 1)  # type: ignore[no-untyped-call]

    return types.void(types.int64, types.int64, types.int64), code


@jit
def varint_bytes(value):  # type: ignore[no-untyped-def]
    """Bytes of a number of SQLite's variable length, under 2^21."""
    return 1 if value < 1 << 7 else 2 if value < 1 << 14 else 3


@jit
def put_varint(at, value):  # type: ignore[no-untyped-def]
    """Write such a number; gives the address behind it."""
    count = varint_bytes(value)
    for k in range(count - 1):
        put_1(at + k, 0x80 | (value >> (7 * (count - 1 - k))))  # type: ignore[call-arg]
    put_1(at + count - 1, value & 0x7F)  # type: ignore[call-arg]
    return at + count


@jit
def serial_of(value):  # type: ignore[no-untyped-def]
    """The serial type of a whole number: the shortest that holds it."""
    if value == 0 or value == 1:
        return ZERO + value
    size = value if value >= 0 else ~value
    if size < 1 << 31:
        return 1 if size < 1 << 7 else 2 if size < 1 << 15 else 3 if size < 1 << 23 else 4
    return 5 if size < 1 << 47 else 6


@jit
def bytes_of(serial):  # type: ignore[no-untyped-def]
    """Bytes of a number of this serial type."""
    if serial >= ZERO:
        return 0
    return serial if serial < 5 else 6 if serial == 5 else 8


@jit
def put_whole(at, value, serial):  # type: ignore[no-untyped-def]
    """Write a whole number of this serial type; gives the address behind it."""
    count = bytes_of(serial)
    rest = count
    if rest == 8:
        put_8(at, value)  # type: ignore[call-arg]
        return at + count
    if rest >= 4:
        rest -= 4
        put_4(at + rest, value)  # type: ignore[call-arg]
        value >>= 32
    if rest >= 2:
        rest -= 2
        put_2(at + rest, value)  # type: ignore[call-arg]
        value >>= 16
    if rest:
        put_1(at, value)  # type: ignore[call-arg]
    return at + count


@jit
def serial_of_real(bits):  # type: ignore[no-untyped-def]
    """The serial type that SQLite gives these bits of a float64 in a column of reals: a whole one that is shorter so is a whole number."""
    value = real_of(bits)  # type: ignore[call-arg,var-annotated]
    if not -SHORT <= value < SHORT:
        return FLOAT if value == value else ABSENT
    whole = np.int64(value)
    return serial_of(whole) if np.float64(whole) == value else FLOAT
