"""The decoder of many AIS payloads against pyais, which decodes one message at a time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pyais.constants import ShipType
from pyais.messages import AISSentence

from coastwatch.batches import AisStatics, PositionAccuracy, Reports
from coastwatch.formats.intake.ais_validation import AisRows, StaticRows
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.intake.timestamps import checksum
from coastwatch.formats.nmea.ais import encode
from coastwatch.formats.nmea.messages import Assembler, checksums_are_right
from coastwatch.formats.nmea.payload import NEEDED_BITS, STATIC_BITS_19, decoded
from coastwatch.formats.nmea.sentences import ReceivedSentence

pytestmark = pytest.mark.golden

DATA = Path(__file__).parents[2].parent / "shared" / "data"
ARMOUR = "".join(chr(c) for c in range(48, 120) if not 88 <= c < 96)
KINDS = (1, 2, 3, 5, 18, 19, 24, 27)


def sentence_of(payload: str, fill: int) -> bytes:
    body = f"AIVDM,1,1,,A,{payload},{fill}".encode()
    return b"!" + body + f"*{checksum(body):02X}".encode()


def ours(sentences: list[bytes]) -> tuple[AisRows, AisStatics, StaticRows, Tally]:
    tally = Tally()
    received = [ReceivedSentence(i, s, float(i), math.nan, b"") for i, s in enumerate(sentences)]
    return *decoded(Assembler("x", tally).whole(received, True), "x", tally), tally


def theirs(raw: bytes) -> Any:
    """The message by pyais; None if it cannot be decoded or is too short."""
    sentence = AISSentence(raw)
    if sentence.ais_id not in KINDS or len(sentence.bv) < NEEDED_BITS[sentence.ais_id]:
        return None
    try:
        return sentence.decode()
    except Exception:
        return None


def text(value: str | None) -> str:
    return (value or "").partition("@")[0].strip()


def check(sentences: list[bytes]) -> int:
    """Compare every field of these sentences. Returns how many messages were compared."""
    rows, statics, static_rows, _ = ours(sentences)
    position = {int(r): k for k, r in enumerate(rows.row)}
    static = {int(r): k for k, r in enumerate(static_rows.row)}
    compared = 0
    for i, raw in enumerate(sentences):
        said = theirs(raw)
        kind = AISSentence(raw).ais_id
        assert (i in position) == (said is not None and kind not in (5, 24))
        if i in position:
            k = position[i]
            assert rows.mmsi[k] == int(said.mmsi)
            assert rows.position_deg[k].tolist() == [said.lat, said.lon]
            assert rows.sog_kn[k] == said.speed or (kind == 27 and said.speed == 63 and math.isnan(rows.sog_kn[k]))
            assert rows.cog_deg[k] == said.course or (kind == 27 and said.course == 511 and math.isnan(rows.cog_deg[k]))
            assert rows.second[k] == (-1 if kind == 27 else said.second)
            unknown = kind == 27 or said.heading is None or said.heading >= 360
            assert math.isnan(rows.heading_deg[k]) if unknown else rows.heading_deg[k] == said.heading
            assert rows.class_b[k] == (kind in (18, 19))
            assert rows.nav_status[k] == (-1 if kind in (18, 19) else int(said.status))
            monitored = bool(getattr(said, "raim", False)) and kind != 19
            assert rows.accuracy[k] == (PositionAccuracy.HIGH if said.accuracy else 2 * monitored)
        whole = said is not None and (kind in (5, 24) or (kind == 19 and len(AISSentence(raw).bv) >= STATIC_BITS_19))
        assert (i in static) == whole
        if whole:
            k = static[i]
            assert statics.mmsi[k] == int(said.mmsi)
            assert statics.name[k] == text(getattr(said, "shipname", ""))
            assert statics.call_sign[k] == text(getattr(said, "callsign", ""))
            of_group = [
                int(ShipType.from_value(int(v or 0)) or 0) for v in (getattr(said, "ship_type", 0), statics.ship_type[k])
            ]
            assert of_group[0] == of_group[1]
            for got, names in ((statics.length_m[k], ("to_bow", "to_stern")), (statics.beam_m[k], ("to_port", "to_starboard"))):
                needed = sum(getattr(said, name, 0) or 0 for name in names)
                assert got == needed if needed else math.isnan(got)
            sides = "bow", "stern", "port", "starboard"
            antenna = [getattr(statics, f"to_{side}_m")[k] for side in sides]
            stated = [getattr(said, f"to_{side}", 0) or 0 for side in sides]
            assert np.isnan(antenna).all() if math.isnan(statics.length_m[k]) else antenna == stated
        compared += said is not None
    return compared


@given(st.lists(st.tuples(st.sampled_from(KINDS), st.text(ARMOUR, min_size=15, max_size=80), st.integers(0, 5)), max_size=30))
def test_any_payload_gives_the_fields_of_pyais(payloads: list[tuple[int, str, int]]) -> None:
    full = {1: 28, 2: 28, 3: 28, 5: 71, 18: 28, 19: 52, 24: 28, 27: 16}  # characters, so that no field is cut
    check(
        [
            sentence_of(ARMOUR[k] + p.ljust(full[k] - 1, "0"), fill)
            for k, p, fill in payloads
            for fill in (fill if k != 27 else 0,)
        ]
    )


def test_a_craft_of_a_mother_ship_has_no_length() -> None:
    mmsi = f"{24:06b}{0:02b}{982571234:030b}{1:02b}{37:08b}".ljust(132, "0") + f"{257000001:030b}000000"
    payload = "".join(ARMOUR[int(mmsi[k : k + 6], 2)] for k in range(0, 168, 6))
    assert check([sentence_of(payload, 0)]) == 1
    assert math.isnan(ours([sentence_of(payload, 0)])[1].length_m[0])


@pytest.mark.parametrize("name", ["pyais_nmea/nmea_data_sample.txt", "kystverket_tagblock/norwegian.raw"])
def test_recorded_messages_give_the_fields_of_pyais(name: str) -> None:
    file = DATA / name
    if not file.exists():
        pytest.skip(f"{file} is not on this machine")
    lines = [line[line.index(b"!") :].strip() for line in file.read_bytes().splitlines() if b"!" in line]
    whole = [line for line in lines if line.count(b",") == 6 and line.split(b",")[1] == b"1" and line.split(b",")[5]]
    assert check(whole) > 150


@given(st.lists(st.tuples(st.binary(min_size=4, max_size=60), st.booleans()), max_size=20))
def test_checksums_of_many_sentences_are_those_of_each(bodies: list[tuple[bytes, bool]]) -> None:
    made = [(body.replace(b"*", b"+"), right) for body, right in bodies]
    sentences = [b"!" + body + f"*{checksum(body) ^ (not right):02X}".encode() for body, right in made]
    assert checksums_are_right(sentences).tolist() == [right for _, right in made]
    assert not checksums_are_right([b"!AIVDM*ZZ"]).any()


def test_a_course_that_a_long_range_report_does_not_give_is_no_fault() -> None:
    """511 was counted as a course that no message can hold."""
    rows, _, _, tally = ours([b"!AIVDM,1,1,,,Ko`BEkd6?`<`t0Ot,0*61"])
    assert (rows.mmsi.tolist(), np.isnan(rows.cog_deg).tolist()) == ([512005582], [True])
    assert not tally.faults()


def test_no_sentence_gives_no_row() -> None:
    rows, statics, static_rows, tally = ours([])
    assert len(rows) == len(statics) == len(static_rows) == 0
    assert not tally.faults()
    assert isinstance(rows.mmsi, np.ndarray)


def test_sizes_that_are_sent_are_rounded_and_held_to_the_limits_of_their_fields() -> None:
    sizes = [(99.6, 0.4, 10.6, 9.5), (600.0, 20.0, 21.0, 80.0), (-30.0, 130.0, 9.0, 9.0), (math.nan,) * 4, (math.nan,) * 4]
    sides = np.array(sizes).T
    lengths, beams = np.array([100.0, 620.0, 100.0, 81.7, 2000.0]), np.array([20.1, 101.0, 18.0, 12.6, 300.0])
    statics = AisStatics(
        received_s=np.arange(5.0), mmsi=np.arange(211_000_001, 211_000_006), name=np.full(5, "X"),
        call_sign=np.full(5, "Y"), ship_type=np.full(5, 70), length_m=lengths, beam_m=beams, to_bow_m=sides[0],
        to_stern_m=sides[1], to_port_m=sides[2], to_starboard_m=sides[3],
    )  # fmt: skip
    lines = [line.rsplit(b"\\", 1)[1] for line in encode(Reports(statics=statics), {})]
    _, found, _, _ = ours(lines)
    got = np.stack([found.to_bow_m, found.to_stern_m, found.to_port_m, found.to_starboard_m], axis=-1)
    assert got.tolist() == [[100, 0, 11, 10], [511, 20, 21, 63], [0, 130, 9, 9], [41, 41, 7, 6], [511, 511, 63, 63]]
