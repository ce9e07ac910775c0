"""The bytes of a table as made here are those that SQLite makes, whatever the values and however many rows."""

from __future__ import annotations

import numpy as np
import pytest
from image_world import KEY, PAGES, bits, columns, expected, form, levels, opened
from sqlalchemy import (
    BigInteger,
    Column,
    MetaData,
    Table,
    Text,
)

from coastwatch.store import image
from coastwatch.store.cells import Texts, part, plain


@pytest.mark.parametrize("page_bytes", PAGES)
@pytest.mark.parametrize("count", [1, 2, 300, 3000])
def test_every_value_comes_back(count: int, page_bytes: int) -> None:
    given = columns(count)
    made = image.image_of(form(page_bytes=page_bytes), given, page_bytes)
    assert made is not None
    raw = opened(made.tobytes())
    assert raw.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    found = [tuple(map(bits, row)) for row in raw.execute("SELECT * FROM rows ORDER BY run_id, id")]
    assert found == [tuple(map(bits, row[:1])) + row[1:] for row in expected(given, count)]
    types = {
        name: raw.execute(f"SELECT DISTINCT typeof({name}) FROM rows").fetchall() for name in ("real", "whole_as_real", "flag")
    }
    assert ("integer",) not in types["real"] + types["whole_as_real"]
    assert types["flag"] == [("integer",)]
    raw.close()


def records(memory: bytes) -> list[bytes]:
    """Those of a table that is one page, as they lie there."""
    page, found = image.PAGE_BYTES, []
    for n in range(int.from_bytes(memory[page + 3 : page + 5], "big")):
        at = page + int.from_bytes(memory[page + 8 + 2 * n : page + 10 + 2 * n], "big")
        size = memory[at] if memory[at] < 128 else (memory[at] & 127) << 7 | memory[at + 1]
        at += 1 if memory[at] < 128 else 2
        found.append(memory[at : at + size])
    return found


def test_records_are_those_that_sqlite_makes() -> None:
    """To the byte: whole reals are whole numbers there."""
    given = columns(200)
    raw = opened(form().empty)
    rows = zip(*(plain(column, 200) for column in given), strict=True)
    raw.executemany(f"INSERT INTO rows VALUES ({', '.join('?' * len(given))})", rows)
    raw.commit()
    made = image.image_of(form(), given, image.PAGE_BYTES)
    assert made is not None
    assert records(made.tobytes()) == records(raw.serialize())
    assert len(records(made.tobytes())) == 200
    raw.close()


PAIR = Table("pair", MetaData(), Column("a", BigInteger, **KEY), Column("b", Text), sqlite_with_rowid=False)  # type: ignore[arg-type]


def test_a_tree_of_any_number_of_rows_is_whole() -> None:
    """Small pages, so that every way in which pages, and pages of pages, can end comes up."""
    page_bytes, depths, rng = 512, set(), np.random.default_rng(7)
    texts = ["z" * length for length in range(80)]
    codes = rng.integers(0, 80, 1500)
    for count in [*range(1, 700), 1500]:
        made = image.image_of(form(PAIR, page_bytes), [np.arange(count) * 1000, Texts(codes[:count], texts)], page_bytes)
        assert made is not None
        raw = opened(made.tobytes())
        assert raw.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert raw.execute("SELECT count(*), sum(length(b)), max(a) FROM pair").fetchall() == [
            (count, int(codes[:count].sum()), (count - 1) * 1000)
        ]
        assert raw.execute("SELECT b FROM pair WHERE a = ?", (count // 2 * 1000,)).fetchone() == (texts[codes[count // 2]],)
        raw.close()
        depths.add(levels(made.tobytes(), page_bytes))
    assert depths >= {1, 2, 3, 4}


def test_a_page_is_filled_to_its_last_byte() -> None:
    """Rows of one length: as many as fit in a page are one page, one more are three."""
    page_bytes, sizes = 4096, []
    same = Texts(np.zeros(200, np.int64), ["z" * 90])
    for count in range(30, 60):
        made = image.image_of(form(PAIR, page_bytes), [np.arange(count) + 1000, part(same, slice(count))], page_bytes)
        assert made is not None
        sizes.append(len(made) // page_bytes)
    cell = 2 + 1 + 1 + 2 + 1 + 2 + 90  # place, length, length of the header, its two types, 1000, text
    whole = (page_bytes - 8) // cell
    assert sizes == [2 if count <= whole else 4 for count in range(30, 60)]
