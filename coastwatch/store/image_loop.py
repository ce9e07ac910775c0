"""The compiled loops of `image`: rows as records of SQLite's file format, in pages of a tree (https://sqlite.org/fileformat2.html).

A column at a time for the rows of one page, reals that stand side by side together: a value is then written by a loop that knows
its kind.
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit
from coastwatch.store.image_bytes import (
    ABSENT,
    FIRST_BLOB,
    FIRST_TEXT,
    FLOAT,
    byte_at,
    bytes_of,
    copy_bytes,
    put_1,
    put_2,
    put_4,
    put_8,
    put_varint,
    put_whole,
    real_of,
    serial_of,
    serial_of_real,
    varint_bytes,
    word_at,
)
from coastwatch.store.image_form import AT, BASE, KIND, MORE, MORE_STEP, REQUIRED, STEP
from coastwatch.store.native import BLOB, INTEGER, REAL, TEXT

LEAF, INTERIOR = 0x0A, 0x02
"""Kinds of page of a tree whose cells are keys, as the rows of a table WITHOUT ROWID are."""

LEAST = 4
"""Bytes of the shortest cell with its place."""

BLOCK = 2048
"""Rows whose records are measured column by column."""


@jit
def _text(starts, letters, code):  # type: ignore[no-untyped-def]
    """Where a text begins and how many bytes it has."""
    first = word_at(starts + 8 * code)  # type: ignore[call-arg,var-annotated]
    return letters + first, word_at(starts + 8 * code + 8) - first


@jit
def _rising(columns, keys, count):  # type: ignore[no-untyped-def]
    """Whether the key of every row is more than that of the row before."""
    for row in range(1, count):
        risen = False
        for c in range(keys):
            at = columns[c, AT] + row * columns[c, STEP]
            before, here = word_at(at - columns[c, STEP]), word_at(at)  # type: ignore[call-arg,var-annotated]
            risen = before < here
            if before != here:
                break
        if not risen:
            return False
    return True


@jit
def _measure_numbers(kind, at, step, low, high, sizes):  # type: ignore[no-untyped-def]
    """Add what numbers of rows low to high take, beside one byte of each record's header; gives how many are absent."""
    absent = 0
    if kind == REAL:
        for row in range(low, high):
            serial = serial_of_real(word_at(at + row * step))  # type: ignore[call-arg]
            sizes[row] += bytes_of(serial)
            absent += serial == ABSENT
        return absent
    for row in range(low, high):
        value = word_at(at + row * step)  # type: ignore[call-arg,var-annotated]
        there = kind == INTEGER or value >= 0
        sizes[row] += bytes_of(serial_of(value)) if there else 0
        absent += not there
    return absent


@jit
def _measure_bytes(column, low, high, sizes, heads):  # type: ignore[no-untyped-def]
    """The same of texts and blobs."""
    absent, is_text = 0, column[KIND] == TEXT
    for row in range(low, high):
        code = size = np.int64(0)
        if is_text:
            code = word_at(column[AT] + row * column[STEP])  # type: ignore[call-arg]
            there = code >= 0
        else:
            there = byte_at(column[MORE] + row * column[MORE_STEP]) != 0  # type: ignore[call-arg,var-annotated]
        if there:
            size = _text(column[MORE], column[BASE], code)[1] if is_text else column[BASE]
            extra = varint_bytes(FIRST_TEXT + 2 * size) - 1
            sizes[row] += size + extra
            heads[row] += extra
        absent += not there
    return absent


@jit
def measure(columns, keys, sizes, heads):  # type: ignore[no-untyped-def]
    """Bytes of each row's record; gives the most, or -1 where a required value is absent or rows are not in the order of their keys.

    Args: columns: (C, 7) in the order of the record, as in image_form; keys: how many of them, whole numbers, are the key.
    sizes: (V,) bytes of the record; heads: (V,) bytes of its header, at most 127.
    """
    count, most = sizes.shape[0], 0
    if not _rising(columns, keys, count):
        return -1
    for low in range(0, count, BLOCK):
        high = min(low + BLOCK, count)
        for row in range(low, high):
            sizes[row] = heads[row] = 1 + columns.shape[0]
        for c in range(columns.shape[0]):
            column = columns[c]
            if column[KIND] == TEXT or column[KIND] == BLOB:
                absent = _measure_bytes(column, low, high, sizes, heads)
            else:
                absent = _measure_numbers(column[KIND], column[AT], column[STEP], low, high, sizes)
            if absent > 0 and column[REQUIRED] != 0:
                return -1
        for row in range(low, high):
            most = max(most, sizes[row])
    return most


@jit
def cut(sizes, child_bytes, room, risen):  # type: ignore[no-untyped-def]
    """Which records stand between the pages of one level of the tree, in the level above; gives how many there are.

    Args: sizes: (N,) bytes of the records of this level, of which four always fit in a page; child_bytes: of a child's number in
    each cell; room: bytes of a page for cells and their places. risen: (N // 4 + 1,) places of those records.
    No page stays empty: where only the last record does not fit, it gets a page, and the one before it rises.
    """
    count, used, last = 0, 0, sizes.shape[0] - 1
    for k in range(sizes.shape[0]):
        cell = 2 + child_bytes + varint_bytes(sizes[k]) + sizes[k]
        if used + cell <= room:
            used += cell
            continue
        risen[count], used = (k, 0) if k < last else (k - 1, cell)
        count += 1
    return count


@jit
def _put_reals(columns, rows, places, bodies, count):  # type: ignore[no-untyped-def]
    """Write columns of float64 that stand side by side, of a page's rows.

    Args: rows: which; places, bodies: where each one's serial type and value belong; both go on.
    """
    for n in range(count):
        place, body = places[n], bodies[n]
        for c in range(columns.shape[0]):
            bits = word_at(columns[c, AT] + rows[n] * columns[c, STEP])  # type: ignore[call-arg,var-annotated]
            serial = serial_of_real(bits)
            if serial == FLOAT:
                put_8(body, bits)
                body += 8
            elif serial != ABSENT:
                body = put_whole(body, np.int64(real_of(bits)), serial)
            put_1(place + c, serial)
        places[n], bodies[n] = place + columns.shape[0], body


@jit
def _put_wholes(kind, at, step, rows, places, bodies, count):  # type: ignore[no-untyped-def]
    """Write whole numbers."""
    for n in range(count):
        value = word_at(at + rows[n] * step)  # type: ignore[call-arg,var-annotated]
        place, body = places[n], bodies[n]
        there = kind == INTEGER or value >= 0
        serial = serial_of(value) if there else ABSENT
        put_1(place, serial)
        places[n], bodies[n] = place + 1, put_whole(body, value, serial) if there else body


@jit
def _put_texts(at, step, starts, letters, rows, places, bodies, count):  # type: ignore[no-untyped-def]
    """Write texts."""
    for n in range(count):
        code, serial = word_at(at + rows[n] * step), ABSENT  # type: ignore[call-arg,var-annotated]
        if code >= 0:
            text, size = _text(starts, letters, code)
            serial = FIRST_TEXT + 2 * size
            copy_bytes(bodies[n], text, size)
            bodies[n] += size
        places[n] = put_varint(places[n], serial)


@jit
def _put_blobs(at, step, there, there_step, size, rows, places, bodies, count):  # type: ignore[no-untyped-def]
    """Write blobs."""
    for n in range(count):
        row, serial = rows[n], ABSENT
        if byte_at(there + row * there_step) != 0:  # type: ignore[call-arg]
            serial = FIRST_BLOB + 2 * size
            copy_bytes(bodies[n], at + row * step, size)
            bodies[n] += size
        places[n] = put_varint(places[n], serial)


@jit
def _put_columns(columns, rows, places, bodies, count):  # type: ignore[no-untyped-def]
    """Write all columns of a page's rows."""
    c = 0
    while c < columns.shape[0]:
        column, first = columns[c], c
        kind, at, step, more, base = column[KIND], column[AT], column[STEP], column[MORE], column[BASE]
        while c < columns.shape[0] and columns[c, KIND] == REAL:
            c += 1
        if c > first:
            _put_reals(columns[first:c], rows, places, bodies, count)
            continue
        if kind == TEXT:
            _put_texts(at, step, more, base, rows, places, bodies, count)
        elif kind == BLOB:
            _put_blobs(at, step, more, column[MORE_STEP], base, rows, places, bodies, count)
        else:
            _put_wholes(kind, at, step, rows, places, bodies, count)
        c += 1


@jit
def _put_page(page, page_bytes, below, first, stop, sizes, heads, rows, places, bodies):  # type: ignore[no-untyped-def]
    """Write all of a page but what is in its records, and say where that belongs. Args: as of `fill` and `_put_reals`."""
    content, pointer, child = page + page_bytes, page + (12 if below else 8), 4 if below else 0
    for n in range(stop - first):
        size, head = np.int64(sizes[rows[n]]), np.int64(heads[rows[n]])
        content -= child + varint_bytes(size) + size
        put_2(pointer + 2 * n, content - page)  # type: ignore[call-arg]
        if below:
            put_4(content, below + first + n)
        record = put_varint(content + child, size)
        places[n], bodies[n] = put_varint(record, head), record + head
    free_block = fragments = 0
    put_1(page, INTERIOR if below else LEAF)  # type: ignore[call-arg]
    put_2(page + 1, free_block)
    put_2(page + 3, stop - first)
    put_2(page + 5, content - page)
    put_1(page + 7, fragments)
    if below:
        put_4(page + 8, below + stop)


@jit
def fill(image, page_bytes, number, below, held, ends, columns, sizes, heads):  # type: ignore[no-untyped-def]
    """Write the pages of one level.

    Args: image: address of page 1; number: of the level's first page; below: of the first page of the level below, 0: of leaves;
    held: (N,) the level's records by their row, in leaves not looked at; ends: where each page ends among them, before a record
    that stands in the level above or behind the last; sizes, heads: of each row.
    """
    most = page_bytes // LEAST
    rows, places, bodies = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64)
    first = 0
    for k in range(ends.shape[0]):
        stop = ends[k]
        for n in range(first, stop):
            rows[n - first] = held[n] if below else n
        _put_page(image + (number + k - 1) * page_bytes, page_bytes, below, first, stop, sizes, heads, rows, places, bodies)
        _put_columns(columns, rows, places, bodies, stop - first)
        first = stop + 1
