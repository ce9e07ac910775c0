"""Files of NMEA that end at, before and after each block: all of each is used, and each line is a report or is counted."""

from __future__ import annotations

import gzip
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from nmea_sentences import T0, checked, sentence, tagged, wire
from spans import span_of

from coastwatch.batches import FileContent
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea.messages import LONE_PART, MOST_SLOTS, PART_LINES, Assembler
from coastwatch.formats.nmea.sentences import ais_sentences
from coastwatch.sensors.recorded.nmea import feed as nmea
from coastwatch.sensors.recorded.nmea.feed import Nmea

pytestmark = pytest.mark.golden

BLOCK = 20
SAID = [sentence(mmsi=257000001 + k, lat=10 + k / 100)[0] for k in range(120)]


@settings(max_examples=80)
@given(
    blocks=st.integers(0, 4), past=st.integers(-2, 2), odd=st.sets(st.integers(0, 100), max_size=12), packed=st.booleans(),
    tail=st.integers(200, 4000),
)  # fmt: skip
def test_a_file_that_ends_near_the_end_of_a_block_is_used_to_its_last_line(
    blocks: int, past: int, odd: set[int], packed: bool, tail: int
) -> None:
    count = max(blocks * BLOCK + past, 1)
    odd = {k for k in odd if 0 < k < count - 1}
    lines = [tagged(f"c:{T0 + k:.0f}", SAID[k]) for k in range(count)]
    for k in odd:
        lines[k] = lines[k][:-1] + "x"  # no check sum
    with TemporaryDirectory() as folder, mock.patch.multiple(nmea, BLOCK=BLOCK, TAIL_BYTES=tail):
        path = Path(folder) / "feed.nmea"
        text = "\r\n".join([*lines, ""]).encode()
        path.write_bytes(gzip.compress(text) if packed else text)
        feed = Nmea(files=(path,))
        assert span_of(feed) == (T0 - 1.0, T0 + count - 1.0)
        stream = feed.stream()
        reports = stream.between(-np.inf, np.inf)
        content: FileContent = stream.contents()[0]
    assert len(reports.ais) == content.records == count - len(odd)
    assert sum(fault.count for fault in stream.faults()) == len(odd)


def test_a_file_between_one_and_two_blocks_of_their_true_size_is_used_to_its_last_line(tmp_path: Path) -> None:
    """Such files lost all after the first block, in silence."""
    count = nmea.BLOCK + 5_000
    path = tmp_path / "feed.nmea"
    path.write_text("\r\n".join(tagged(f"c:{T0 + k // 10:.0f}", SAID[k % 120]) for k in range(count)) + "\r\n")
    assert span_of(Nmea(files=(path,))) == (T0 - 1.0, T0 + (count - 1) // 10)


def test_parts_without_end_are_dropped_and_counted_as_lone() -> None:
    """A sender of first halves, each with a group of its own: nothing of them is kept for longer than a part may come late."""
    half = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"}, seq_id=4)[0]
    tally = Tally()
    assembler, total = Assembler("live", tally), 0
    for block in range(20):
        lines = [tagged(f"g:1-2-{1000 * block + k},s:r{block}-{k}", half).encode() for k in range(1000)]
        found = list(ais_sentences(lines, "live", Tally()))
        assembler.whole([one._replace(line=one.line + total) for one in found], False)
        total += len(lines)
    assert tally.count(LONE_PART) >= total - 2 * PART_LINES
    assembler.whole([], True)
    assert tally.count(LONE_PART) == total


def test_the_stations_of_odd_messages_are_forgotten() -> None:
    half = wire({"msg_type": 5, "mmsi": 257000001, "shipname": "NORD"}, seq_id=4)[0].rpartition("*")[0][1:]
    fields = half.split(",")
    assembler = Assembler("live", Tally())
    for number in range(2 * MOST_SLOTS):
        body = ",".join([*fields[:3], str(number), *fields[4:]])
        said = f"!{body}*{checked(body)}".encode()
        assembler.whole(list(ais_sentences([said], "live", Tally()))[:1], False)
    assert sum(map(len, vars(assembler)["_newest"])) <= MOST_SLOTS * 4
