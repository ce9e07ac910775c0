"""HDT and THS: which headings are taken, and of which radars."""

from __future__ import annotations

import math

import numpy as np
import pytest

from coastwatch.batches import HeadingReports, Reports, Sensors
from coastwatch.errors import AddressError
from coastwatch.formats.decoding import FeedSettings
from coastwatch.formats.nmea.headings import HEADING, NOT_VALID
from coastwatch.formats.nmea.sentence_feed import made_sentence
from coastwatch.scenario.sites import Radar, sensors_of

pytestmark = pytest.mark.contract

NOW_S = 1_782_907_200.0


def sensors(*references: str) -> Sensors:
    """Radars "0", "1" and so on."""
    where = {"latitude_deg": 50.8, "longitude_deg": -1.1, "range_nm": 12.0, "rpm": 24.0}
    return sensors_of([Radar(name=str(k), **where, azimuth_reference=word) for k, word in enumerate(references)], (), ())


def decoder(of: Sensors, **options: str):
    assert HEADING.decoder is not None
    return HEADING.decoder(FeedSettings("gyro", "heading+udp://:1", options), of)


def heard(bodies: list[str], of: Sensors, **options: str) -> tuple[HeadingReports, list[str]]:
    """The headings of sentences that come a second apart, and the kinds of faults."""
    made = decoder(of, **options)
    for k, body in enumerate(bodies):
        made.decode([(NOW_S + k, made_sentence(body).encode(), 0)], None)
    return made.reports_between(-math.inf, math.inf).headings, [fault.kind for fault in made.tally.faults()]


def test_hdt_and_valid_ths_give_a_heading_at_their_arrival() -> None:
    found, faults = heard(["HEHDT,359.5,T", "HETHS,0.25,A", "GPTHS,1.5,E"], sensors("heading"))
    assert found.heading_deg.tolist() == [359.5, 0.25, 1.5]
    assert found.time_s.tolist() == [NOW_S, NOW_S + 1.0, NOW_S + 2.0]
    assert faults == []


def test_a_heading_that_is_not_valid_simulated_or_set_by_hand_is_refused() -> None:
    found, faults = heard(["HETHS,12.0,V", "HETHS,12.0,S", "HETHS,12.0,M", "HEHDT,,T"], sensors("heading"))
    assert len(found) == 0
    assert faults == [NOT_VALID]
    found, faults = heard(["HEHDT,361.0,T"], sensors("heading"))
    assert len(found) == 0
    assert faults == ["beyond the bounds of its format: heading"]


def test_a_heading_is_of_every_radar_of_a_ship_or_of_those_named() -> None:
    both = sensors("true", "heading", "heading")
    for options, want in (({}, [1, 2]), ({"radar": "2"}, [2]), ({"radar": "2,1"}, [1, 2])):
        found, _ = heard(["HEHDT,10.0,T"], both, **options)
        assert found.sensor.tolist() == want
    for of, options in ((sensors("true"), {}), (both, {"radar": "0"}), (both, {"radar": "9"})):
        with pytest.raises(AddressError, match=r"needed \?radar=NAME with radars of azimuth_reference = 'heading'"):
            decoder(of, **options)


def test_sentences_that_are_sent_come_back() -> None:
    assert HEADING.encode is not None
    of = sensors("heading")
    time_s = NOW_S + np.arange(50) * 0.1
    sent = HeadingReports(np.zeros(50, np.int64), time_s, time_s, np.linspace(355.0, 364.8, 50) % 360.0)

    lines = HEADING.encode(Reports(headings=sent), of)
    made = decoder(of)
    made.decode([(NOW_S + 9.0, line, 0) for line in lines], None)
    found = made.reports_between(-math.inf, math.inf).headings
    assert np.abs(found.time_s - sent.time_s).max() < 1e-3
    assert np.abs(found.heading_deg - sent.heading_deg).max() < 0.006
