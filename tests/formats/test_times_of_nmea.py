"""The times that recordings write before a sentence, behind its checksum and in JSON around it: read rightly, or not at all."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import numpy as np
import pytest

from coastwatch.formats.intake.faults import Ledger, Tally
from coastwatch.formats.intake.timestamps import leading_time_s, trailing_time_s
from coastwatch.formats.nmea.sentences import ais_sentences

pytestmark = pytest.mark.contract

NOON_S = datetime(2024, 5, 6, 12, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    "text",
    [
        "2024-05-06 12:00:00 UTC ",
        "2024-05-06;12:00:00;",
        "2024-05-06\t12:00:00\t",
        "2024-05-06, 12:00:00, ",
        "2024-05-06 12:00:00 station1 ",
        "2024-05-06 12:00:00 GMT: ",
        "2024-05-06 12:00:00 -- ",
        "2024-05-06T12:00:00 -80 ",  # the strength of the signal
        "2024-05-06T12:00:00 -05 1 ",
        "2024-05-06T12:00:00,7,",
        "2024-05-06_12:00:00 ",
        "2024-05-06T14:00:00+02 ",
        "1.7149968e+09,",
        "2024-05-06 12:00:00: ",
        "2024-05-06 12:00 ",
        "2024/05/06 12:00:00,000 ",
        "[2024-05-06 12:00:00] ",
        "2024-05-06T12:00:00.0000000Z,257001,",
        "2024-05-06T14:00:00+02:00 ",
        "2024-05-06 14:00:00 +0200 ",
        "20240506T120000Z ",
        "20240506120000 ",
        "20240506,120000,",
        "1714996800 ",
        "1714996800.0,",
        "1714996800000: ",
    ],
)
def test_a_time_before_a_sentence(text: str) -> None:
    assert leading_time_s(text.encode()) == NOON_S


@pytest.mark.parametrize(
    "text", [",rRDSULI1,1714996800", ",2024-05-06T12:00:00Z", " 2024-05-06 12:00:00", ",20240506120000", " 1714996800000"]
)
def test_a_time_behind_a_sentence(text: str) -> None:
    assert trailing_time_s(text.encode()) == NOON_S


@pytest.mark.parametrize(
    "text",
    [
        *("2024-05-06", "2024-05-06 ", "2024-13-06 12:00:00", "2024-05-06 12.00.00 ", "06/05/2024 12:00:00 ", "12:00:00 "),
        *("2024-05-06 12:00:00 CEST ", "2024-05-06 01:00:00 PM "),  # which would be wrong by hours
        *("17 ", "240506 120000 ", "20241306120000 ", "station1 ", ""),
    ],
)
def test_what_is_no_time_or_may_be_another_one_is_none(text: str) -> None:
    assert np.isnan(leading_time_s(text.encode()))
    assert np.isnan(trailing_time_s(b"," + text.encode()))


SENTENCES = (
    "!AIVDM,2,1,2,A,57`B?hl2CdtQ`lO;SK9L4Tl5@62222222222220l1@>666QVS>1jDhSl,0*51",
    "!AIVDM,2,2,2,A,SQH888888888880,2*54",
)


@pytest.mark.parametrize(
    ("times", "found_s"),
    [
        ({"rxuxtime": 1714996800.25, "rxtime": "20240506120000"}, NOON_S + 0.25),
        ({"rxtime": "20240506120000"}, NOON_S),
        ({"toa": 1714996800, "rxuxtime": 1795994361}, NOON_S),
        ({}, np.nan),
        ({"rxuxtime": None}, np.nan),
    ],
)
def test_sentences_in_messages_of_ais_catcher(times: dict[str, object], found_s: float) -> None:
    """They had an unreadable prefix, and the second part of a message was lost."""
    line = json.dumps({"class": "AIS", "device": "AIS-catcher", **times, "nmea": SENTENCES, "type": 5, "year": 2019})
    tally, ledger = Tally(), Ledger()
    found = list(ais_sentences([b"", line.encode(), b"!AIVDM,1,1,,A,15,0*00"], "x", tally, ledger))
    assert [s.sentence.decode() for s in found[:2]] == list(SENTENCES)
    assert [s.line for s in found] == [2, 2, 3]
    assert np.array_equal([s.own_s for s in found[:2]], [found_s] * 2, equal_nan=True)
    assert (ledger.read, tally.faults()) == (3, ())


@pytest.mark.parametrize(
    "line",
    [
        "{",
        '{"nmea":3}',
        '{"nmea":[]}',
        '{"nmea":[1,null]}',
        '{"nmea":["{}"]}',
        '{"nmea":["\\ud800"],"toa":1}',  # half of a character
        json.dumps({"toa": "9" * 30_000, "nmea": [""] * 9000}),  # of 60 KB it made 270 MB
        "[" * 60_000,
        '{"a":' * 30_000,
        "{}",
    ],
)
def test_other_json_is_counted_and_nothing_ends(line: str) -> None:
    tally = Tally()
    assert list(ais_sentences([line.encode()], "x", tally, Ledger())) == []
    assert sum(fault.count for fault in tally.faults()) >= 1
