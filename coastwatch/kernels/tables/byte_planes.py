"""Columns of 64-bit words cut into planes of bytes, and put together again bit for bit. C columns, N rows.

A word is stored as it is, or as its difference from a word of a base: of numbers that change slowly the upper bytes are then zero.
The bytes of one place in all rows are a plane. A plane is left out where it is zero, one byte where it is the same in every row,
and else goes to the bytes worth compressing or to the noise, which no compression makes smaller.
"""

import numpy as np

from coastwatch.kernels.jit import jit

ZERO, SAME, QUIET, NOISE = 0, 1, 2, 3
SAMPLE = 256
NOISE_FROM = 1400
"""Sum of squared counts of a sample's bytes: 511 for bytes drawn evenly, 65,536 for one value. So many is a plane of which a tenth is
zero, of covariances that some vessels told anew unchanged: pressing it saves 5 % of it, for most of the time that pressing takes."""


@jit
def _difference(words, c, base, place, out):  # type: ignore[no-untyped-def]
    """Zigzag differences of one column from its base rows (none where place is -1); returns all bits that occur, and that change."""
    some, change = np.uint64(0), np.uint64(0)
    for i in range(len(out)):
        before = base[c, place[i]] if place[i] >= 0 else np.uint64(0)
        d = np.int64(words[c, i] - before)
        z = np.uint64((d << 1) ^ (d >> 63))
        out[i] = z
        some |= z
        change |= z ^ out[0]
    return some, change


@jit
def _same(words, c, out):  # type: ignore[no-untyped-def]
    """One column as it is; returns all bits that occur, and that change."""
    some, change = np.uint64(0), np.uint64(0)
    for i in range(len(out)):
        z = words[c, i]
        out[i] = z
        some |= z
        change |= z ^ words[c, 0]
    return some, change


@jit
def _is_noise(z, shift):  # type: ignore[no-untyped-def]
    """Whether bytes of a sample of rows are drawn about evenly."""
    step = len(z) // SAMPLE
    if step == 0:
        return False
    seen = np.zeros(256, np.int64)
    total = 0
    for k in range(SAMPLE):
        value = np.int64((z[k * step] >> shift) & np.uint64(255))
        total += 2 * seen[value] + 1
        seen[value] += 1
    return total < NOISE_FROM


@jit
def _put(z, shift, out):  # type: ignore[no-untyped-def]
    for i in range(len(z)):
        out[i] = np.uint8(z[i] >> shift)


@jit
def split(words, base, place, based, quiet, noise, kind):  # type: ignore[no-untyped-def]
    """Planes of a table of words; returns how many bytes went to `quiet` and to `noise`.

    Args: words: (C, N) uint64; base: (C, B) uint64; place: (N,) row of the base, -1 for none; based: False: words as they are;
    quiet, noise: (8 C N,) uint8, written; kind: (C, 8) uint8, written: ZERO, SAME, QUIET or NOISE of each plane, lowest byte first.
    """
    columns, rows = words.shape
    z = np.empty(rows, np.uint64)
    q, s = 0, 0
    for c in range(columns):
        some, change = _difference(words, c, base, place, z) if based else _same(words, c, z)
        for b in range(8):
            shift, byte = np.uint64(8 * b), np.uint64(255)
            if (some >> shift) & byte == 0:
                kind[c, b] = ZERO
            elif (change >> shift) & byte == 0:
                kind[c, b] = SAME
                quiet[q] = np.uint8(z[0] >> shift)
                q += 1
            elif _is_noise(z, shift):
                kind[c, b] = NOISE
                _put(z, shift, noise[s : s + rows])
                s += rows
            else:
                kind[c, b] = QUIET
                _put(z, shift, quiet[q : q + rows])
                q += rows
    return q, s


@jit
def _add(plane, shift, out):  # type: ignore[no-untyped-def]
    for i in range(len(out)):
        out[i] |= np.uint64(plane[i]) << shift


@jit
def join(quiet, noise, kind, base, place, based, out):  # type: ignore[no-untyped-def]
    """The words that `split` was given. Args: as of `split`; out: (C, N) uint64, written."""
    columns, rows = out.shape
    q, s = 0, 0
    for c in range(columns):
        row = out[c]
        row[:] = np.uint64(0)
        for b in range(8):
            shift = np.uint64(8 * b)
            if kind[c, b] == SAME:
                row |= np.uint64(quiet[q]) << shift
                q += 1
            elif kind[c, b] == QUIET:
                _add(quiet[q : q + rows], shift, row)
                q += rows
            elif kind[c, b] == NOISE:
                _add(noise[s : s + rows], shift, row)
                s += rows
        if based:
            for i in range(rows):
                before = base[c, place[i]] if place[i] >= 0 else np.uint64(0)
                row[i] = before + ((row[i] >> np.uint64(1)) ^ (np.uint64(0) - (row[i] & np.uint64(1))))
