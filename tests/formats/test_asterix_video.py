"""Radar video on the wire: what is encoded comes back, libasterix reads the same, and damaged messages are counted."""

from __future__ import annotations

import math
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from hypothesis import given, strategies as st
from video_world import START_S, sensors

from coastwatch.formats.asterix.video import VideoMessage, VideoText, decode, encode
from coastwatch.formats.asterix.video_feed import ABSURD_RANGE, VIDEO
from coastwatch.formats.decoding import FeedSettings, decode as decode_feed

pytestmark = pytest.mark.contract


def message(cells=100, seed=1, bits=8, **fields):
    level = np.random.default_rng(seed).integers(0, 1 << min(bits, 8), cells).astype(np.uint8)
    return VideoMessage(**{**VideoMessage(25, 1, 7, 100, 116, 0, 50_000_000, level, 3600.5, bits)._asdict(), **fields})


def same(one, other):
    assert one._replace(level=None, time_of_day_s=0.0) == other._replace(level=None, time_of_day_s=0.0)
    assert one.time_of_day_s == pytest.approx(other.time_of_day_s, nan_ok=True)
    np.testing.assert_array_equal(one.level, other.level)


@given(st.integers(0, 4000), st.sampled_from([1, 2, 4, 8, 16, 32]), st.booleans(), st.integers(0, 2**32 - 1), st.booleans())
def test_what_is_encoded_comes_back(cells, bits, compressed, number, timed):
    sent = message(cells, number, bits, number=number, first_cell=number // 7, time_of_day_s=86_399.5 if timed else math.nan)
    every = [sent._replace(compressed=compressed), sent]
    found, faults = decode(b"".join(map(encode, every)))
    assert faults == []
    for got, wanted in zip(found, every, strict=True):
        same(got, wanted)


@pytest.mark.oracle
@pytest.mark.parametrize("cells", [100, 3000, 20_000])
def test_libasterix_reads_the_same(cells):
    from asterix import base, generated

    sent = message(cells)
    (block,) = base.RawDatablock.parse(base.Bits.from_bytes(encode(sent)))
    (record,) = generated.Cat_240_1_3.cv_uap.parse(block.get_raw_records())
    item = record.get_item({100: "050", 3000: "051", 20_000: "052"}[cells])
    octets = b"".join(part.unparse().to_bytes() for part in item.variation.get_list())
    assert octets[:cells] == sent.level.tobytes()
    assert record.get_item("020").variation.unparse().to_bytes() == (7).to_bytes(4, "big")


@pytest.mark.oracle
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16, 32])
def test_libasterix_reads_every_depth_and_what_it_writes_is_read(bits, compressed):
    from asterix import base, generated

    sent, kind = message(101, bits=bits, compressed=compressed), generated.Cat_240_1_3
    (block,) = base.RawDatablock.parse(base.Bits.from_bytes(encode(sent)))
    (record,) = kind.cv_uap.parse(block.get_raw_records())
    assert record.get_item("048").variation.unparse().to_bytes() == bytes(
        [0x80 * compressed, {1: 1, 2: 2, 4: 3, 8: 4, 16: 5, 32: 6}[bits]]
    )
    octets, cells = (
        int.from_bytes(record.get_item("049").variation.unparse().to_bytes()[k], "big") for k in (slice(0, 2), slice(2, 5))
    )
    name = next(name for name in ("050", "051", "052") if record.get_item(name) is not None)
    raw = b"".join(part.unparse().to_bytes() for part in record.get_item(name).variation.get_list())[:octets]
    raw = zlib.decompress(raw) if compressed else raw
    shown = np.unpackbits(np.frombuffer(raw, np.uint8))[: cells * bits].reshape(cells, bits)[:, : min(bits, 8)]
    assert np.array_equal(shown @ (1 << np.arange(shown.shape[1])[::-1]), sent.level)
    (again,), faults = decode(kind.create([record]).unparse().to_bytes())
    assert faults == []
    same(again, sent)


def test_expansion_fields_are_skipped_a_summary_is_text_and_other_categories_are_left():
    whole = encode(message(10))
    body = bytearray(whole[3:])
    body[1] |= 0b110  # RE and SP follow
    extended = bytes(body) + bytes([3, 1, 2]) + bytes([2, 9])
    block = bytes([240]) + (3 + len(extended)).to_bytes(2, "big") + extended
    summary = bytes([240, 0, 12, 0b11010000, 25, 1, 1, 4]) + b"NOVA"
    found, faults = decode(bytes([48, 0, 4, 0]) + block + summary)
    assert faults == []
    same(found[0], message(10))
    assert found[1] == VideoText(25, 1, "NOVA")


def compressed(raw, cells):
    """A message whose compressed octets are those of raw, and which announces so many cells of 8 bits."""
    octets = zlib.compress(raw, 9)
    whole = encode(message(100)._replace(level=np.frombuffer(octets, np.uint8)))
    at = whole.index(bytes([0, 4]) + len(octets).to_bytes(2, "big"))
    return whole[:at] + bytes([0x80, 4]) + len(octets).to_bytes(2, "big") + cells.to_bytes(3, "big") + whole[at + 7 :]


@pytest.mark.parametrize(("size", "cells", "most"), [(10_000_000, 100, 256), (257, 256, 256), (1, 0, 0)])
def test_a_bomb_is_refused_where_it_passes_what_it_announces(size, cells, most):
    bomb = compressed(bytes(size), cells)
    tracemalloc.start()
    found, faults = decode(bomb)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert not found
    assert faults == [f"cells: more than announced; got over {most} octets, needed {cells}"]
    assert peak < 100_000 + 4 * len(bomb)


@pytest.mark.parametrize("block", [4, 64, 256])
def test_cells_padded_to_a_block_before_they_were_compressed_are_taken(block):
    level = message(101).level
    found, faults = decode(compressed(level.tobytes().ljust(-(-101 // block) * block, b"\0"), 101))
    assert faults == []
    assert np.array_equal(found[0].level, level)


def test_octets_after_the_last_cell_are_padding():
    whole = encode(message(100))  # 25 blocks of 4 octets
    at = whole.index(bytes([0, 100, 0, 0, 100]))
    padded = whole[: at + 2] + (97).to_bytes(3, "big") + whole[at + 5 :]
    found, faults = decode(padded)
    assert faults == []
    assert np.array_equal(found[0].level, message(100).level[:97])
    found, faults = decode(whole[: at + 2] + (101).to_bytes(3, "big") + whole[at + 5 :])
    assert not found
    assert faults == ["cells: fewer than announced; got 100 octets, needed 101"]


def altered(without=(), **octets):
    """A message of 100 cells without some of its items, with other octets in some. Args: octets: by the name of the item."""
    sent = message(100)
    names = {"source": 1, "number": 3, "header": 6, "resolution": 7, "counters": 8, "block": 9}
    items = {
        1: bytes([25, 1]), 2: bytes([2]), 3: bytes(4), 6: struct.pack(">HHII", 0, 16, 0, 50_000_000), 7: bytes([0, 4]),
        8: bytes([0, 100, 0, 0, 100]), 9: bytes([25]) + sent.level.tobytes(),
    }  # fmt: skip
    items |= {names[name]: value for name, value in octets.items()}
    items = {frn: value for frn, value in items.items() if frn not in {names[name] for name in without}}
    fspec = [sum(0x80 >> k for k in range(7) if first + k in items) for first in (1, 8)]
    body = bytes([fspec[0] | 1, fspec[1]]) + b"".join(items[frn] for frn in sorted(items))
    return bytes([240]) + (3 + len(body)).to_bytes(2, "big") + body


CELLS = "cells: more than 65,536, or of an unknown size; got "


def no_item(name):
    needed = "020; 040 or 041; 048; 049; 050, 051 or 052"
    return f"record: of video without an item that it needs; got no {name}, needed {needed}"


@pytest.mark.parametrize(
    ("block", "fault"),
    [
        (altered(["source"]), "record: without source or type; got items of FRN [2, 3, 6, 7, 8, 9], needed 1 and 2"),
        (altered(["number"]), no_item("020")),
        (altered(["header"]), no_item("040 or 041")),
        (altered(["resolution"]), no_item("048")),
        (altered(["counters"]), no_item("049")),
        (altered(["block", "counters"]), no_item("049 and 050, 051 or 052")),
        (altered(resolution=bytes([0, 0])), CELLS + "100 of code 0"),
        (altered(resolution=bytes([0, 7])), CELLS + "100 of code 7"),
        (altered(resolution=bytes([0x80, 255])), CELLS + "100 of code 255"),
        (altered(counters=bytes([0, 100, 1, 0, 1])), CELLS + "65537 of code 4"),
        (altered(counters=bytes([0, 100, 255, 255, 255])), CELLS + "16777215 of code 4"),
        (altered(counters=bytes([0, 99, 0, 0, 100])), "cells: fewer than announced; got 99 octets, needed 100"),
        (altered(resolution=bytes([0, 6])), "cells: fewer than announced; got 100 octets, needed 400"),
        (altered(resolution=bytes([0x80, 4])), "cells: not in zlib"),
    ],
)
def test_what_is_refused_is_one_fault_with_its_kind_and_what_was_got(block, fault):
    found, faults = decode(block + encode(message(10)))
    assert faults == [fault]
    same(found[0], message(10))  # the block after it is read


def test_a_message_that_is_written_item_by_item_is_read():
    (found,), faults = decode(altered())
    assert faults == []
    assert np.array_equal(found.level, message(100).level)


@pytest.mark.parametrize(
    ("first", "duration", "got"),
    [
        (2**32 - 1, 50_000_000, "got 4294967395 of 7.49 m"),
        (131_000, 50_000_000, "got 131100 of 7.49 m"),
        (0, 0, "got 100 of 0 m"),
        (0, 300_000, "got 100 of 0.045 m"),
        (0, 2**32 - 1, None),
        (1_000, 2**32 - 1, "got 1100 of 644 m"),
    ],
)
def test_absurd_range_or_duration_is_counted_with_what_was_got_and_needed(first, duration, got):
    made = VIDEO.decoder(FeedSettings("feed", "video+udp://x", {"25/1": "north"}), sensors())
    decode_feed(made, "feed", [(START_S, altered(header=struct.pack(">HHII", 0, 16, first, duration)), 0)], None)
    faults = {fault.kind: (fault.count, fault.example) for fault in made.tally.faults()}
    needed = ", needed 0.05 m or more, at most 131072, 500 km"
    assert faults == ({} if got is None else {ABSURD_RANGE: (1, got + needed)})
    assert len(made.reports_between(-math.inf, math.inf).video) == (got is None)


@given(st.integers(0, 2**32), st.binary(max_size=60))
def test_damaged_messages_are_faults_and_never_errors(seed, noise):
    rng = np.random.default_rng(seed)
    for compressed in (False, True):
        for _ in range(40):
            raw = bytearray(encode(message(int(rng.integers(0, 300)), compressed=compressed)))
            for at in rng.integers(0, len(raw), rng.integers(1, 6)):
                raw[at] = rng.integers(0, 256)
            found, faults = decode(bytes(raw[: rng.integers(1, len(raw) + 1)]))
            assert len(found) + len(faults) <= len(raw)
    found, faults = decode(noise)
    assert len(found) + len(faults) <= len(noise)
