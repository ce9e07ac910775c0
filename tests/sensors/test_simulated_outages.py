"""What breaks tracks: radars that fail, are blind in a sector or miss some vessels for good, and gaps in AIS."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from simulated_world import START_S, recorded

from coastwatch.sensors.simulated.ais import AisTruth
from coastwatch.sensors.simulated.radar import RadarTruth

pytestmark = pytest.mark.contract

CYCLES = 60  # of 3 s


def plots(**settings):
    return recorded(count=50, cycles=CYCLES, radar=RadarTruth(clutter_per_m2=1e-7, **settings)).reports.radar


def test_a_radar_that_is_down_sends_nothing_and_otherwise_what_it_would_have():
    whole, broken = plots(), plots(outage_s=20.0, outage_every_s=60.0)
    for radar in (0, 1):
        before, after = whole.take(whole.sensor == radar), broken.take(broken.sensor == radar)
        kept = np.isin(before.time_s, after.time_s)
        np.testing.assert_array_equal(before.take(kept).range_m, after.range_m)
        down = (before.time_s[~kept] - START_S) % 60.0
        width = min(np.ptp(down), np.ptp((down + 30.0) % 60.0))
        assert 18.0 < width < 20.0
        assert len(after) == pytest.approx(len(before) * 2 / 3, rel=0.05)
    down = [np.isin(np.arange(180), (broken.time_s[broken.sensor == r] - START_S).astype(int)) for r in (0, 1)]
    assert (down[0] != down[1]).any(), "each radar fails at its own times"


def test_a_blind_sector_has_neither_echoes_nor_clutter():
    whole, blind = plots(), plots(blind_from_deg=350.0, blind_to_deg=40.0)
    azimuth = blind.azimuth_deg[blind.origin < 0]
    assert not ((azimuth > 350.0) | (azimuth < 40.0)).any()
    inside = (whole.azimuth_deg >= 352.0) | (whole.azimuth_deg < 38.0)
    outside = (whole.azimuth_deg > 42.0) & (whole.azimuth_deg < 348.0)
    assert inside.any()
    assert not np.isin(whole.time_s[inside & (whole.origin >= 0)], blind.time_s).any()
    assert np.isin(whole.time_s[outside], blind.time_s).all()


def test_a_share_of_vessels_is_never_seen_by_any_radar():
    whole, fewer = plots(), plots(unseen_share=0.2)
    gone = np.setdiff1d(whole.origin, fewer.origin)
    assert 0 < len(gone) <= 10, "10 of 50; some may not have come into range"
    left = whole.take(~np.isin(whole.origin, gone))
    np.testing.assert_array_equal(left.range_m, fewer.range_m)


def test_ais_gaps_come_again_and_again_for_each_carrier_at_its_own_time():
    whole = recorded(count=50, cycles=CYCLES).reports.ais
    gappy = recorded(count=50, cycles=CYCLES, ais=AisTruth(gap_s=45.0, gap_every_s=90.0)).reports.ais
    np.testing.assert_array_equal(whole.take(np.isin(whole.time_s, gappy.time_s)).position_deg, gappy.position_deg)
    longest = [np.diff(np.sort(gappy.time_s[gappy.origin == v])).max() for v in np.unique(gappy.origin)]
    assert 42.0 < min(longest) <= max(longest) <= 51.0, "45 s and up to one interval of 3 s before and after"
    assert len(gappy) == pytest.approx(0.5 * len(whole), rel=0.05)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: RadarTruth(outage_s=60.0), "outage_s: got 60.0, needed less than outage_every_s = 60.0"),
        (lambda: AisTruth(gap_s=200.0), "gap_s: got 200.0, needed less than gap_every_s = 120.0"),
        (lambda: RadarTruth(unseen_share=1.5), "less than or equal to 1"),
        (lambda: RadarTruth(blind_to_deg=361.0), "less than or equal to 360"),
    ],
)
def test_what_cannot_be_is_refused(made, words):
    with pytest.raises(ValidationError, match=words):
        made()
