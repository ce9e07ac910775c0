"""Azimuths from magnetic north or from the bow, made true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from coastwatch.batches import AzimuthReference, Floats, HeadingReports, RadarReports, Radars, RadarVideo, Reports, Videos
from coastwatch.plots.azimuths import KEPT_S, OLDEST_S, HeadingMemory, heading_at, true_azimuths
from coastwatch.scenario.sites import Radar, sensors_of

pytestmark = pytest.mark.contract

SHORE, MAGNETIC, SHIP = 0, 1, 2
VARIATION_DEG = -21.5
RATE_DEG_S = 1.5


def radars() -> Radars:
    """One of each reference."""
    where = {"latitude_deg": 50.8, "longitude_deg": -1.1, "range_nm": 12.0, "rpm": 24.0}
    by_north = Radar(name="magnetic", **where, azimuth_reference="magnetic", magnetic_variation_deg=VARIATION_DEG)
    made = (Radar(name="shore", **where), by_north, Radar(name="ship", **where, azimuth_reference="heading"))
    return sensors_of(made, (), ()).radars


def turning_deg(time_s: Floats) -> Floats:
    """The heading of a ship that turns through north."""
    return (355.0 + RATE_DEG_S * time_s) % 360.0


def headings(time_s: Floats) -> HeadingReports:
    return HeadingReports(np.full(len(time_s), SHIP), time_s, time_s, turning_deg(time_s))


def plots(sensor: int, time_s: Floats, azimuth_deg: Floats) -> RadarReports:
    n = len(time_s)
    where = np.tile([50.8, -1.1], (n, 1))
    return RadarReports(np.full(n, sensor), time_s, time_s, np.full(n, 4000.0), azimuth_deg, where, np.full(n, -1))


def spokes(time_s: Floats, azimuth_deg: Floats) -> Videos:
    n, level = len(time_s), np.zeros((len(time_s), 4), np.uint8)
    return Videos((RadarVideo(SHIP, 0.0, 10.0, time_s, time_s, np.radians(azimuth_deg), np.tile([50.8, -1.1], (n, 1)), level),))


def off_deg(one: Floats, other: Floats) -> float:
    return float(np.abs((np.asarray(one) - other + 180.0) % 360.0 - 180.0).max())


def test_a_true_radar_is_left_as_it_is_and_a_magnetic_one_is_turned_by_the_variation() -> None:
    time_s, azimuth = np.arange(8.0), np.linspace(0.0, 350.0, 8)
    for sensor, turned in ((SHORE, 0.0), (MAGNETIC, VARIATION_DEG)):
        given = Reports(radar=plots(sensor, time_s, azimuth))
        memory, made = true_azimuths(HeadingMemory(), given, radars())
        assert off_deg(made.radar.azimuth_deg, azimuth + turned) < 1e-9
        assert ((made.radar.azimuth_deg >= 0.0) & (made.radar.azimuth_deg < 360.0)).all()
        assert memory.left_out == 0
    true_alone = radars().take(np.array([SHORE]))
    given = Reports(radar=plots(SHORE, time_s, azimuth))
    assert true_azimuths(HeadingMemory(), given, true_alone)[1] is given


@pytest.mark.parametrize("every_s", [0.1, 1.0])
def test_plots_and_video_of_a_turning_ship_are_true_whatever_the_length_of_a_cycle(every_s: float) -> None:
    rng = np.random.default_rng(1)
    compass_s, seen_s = np.arange(0.0, 60.0, every_s), np.sort(rng.uniform(0.0, 60.0, 500))
    true_deg = rng.uniform(0.0, 360.0, 500)
    from_bow = (true_deg - turning_deg(seen_s)) % 360.0
    every = replace(
        Reports(), radar=plots(SHIP, seen_s, from_bow), headings=headings(compass_s), video=spokes(seen_s, from_bow)
    )
    for cycle_s in (60.0, 3.0, 0.7):
        memory, azimuth, video = HeadingMemory(), [], []
        for begin_s in np.arange(0.0, 60.0, cycle_s) - 1e-9:
            memory, made = true_azimuths(memory, every.between(begin_s, begin_s + cycle_s), radars())
            azimuth += made.radar.azimuth_deg.tolist()
            video += [np.degrees(a) for part in made.video.parts for a in part.azimuth_rad.tolist()]
        assert memory.left_out == 0
        assert len(memory.headings) <= KEPT_S / every_s + 1
        # A cycle of one heading knows no rate before the second one
        few = int((seen_s < 2.0 * every_s + cycle_s).sum()) if cycle_s < 60.0 else 0
        assert off_deg(np.array(azimuth)[few:], true_deg[few:]) < 1e-6
        assert off_deg(np.array(video)[few:], true_deg[few:]) < 1e-6


def test_without_a_heading_near_its_time_an_echo_of_a_ship_is_left_out_and_counted() -> None:
    compass_s = np.concatenate([np.arange(0.0, 10.0), np.arange(40.0, 50.0)])
    seen_s = np.array([-OLDEST_S - 0.5, -1.0, 5.0, 9.0 + OLDEST_S - 0.1, 9.0 + OLDEST_S + 0.1, 25.0, 36.0, 60.0])
    known = np.isfinite(heading_at(headings(compass_s), seen_s))
    assert known.tolist() == [False, True, True, True, False, False, True, False]
    given = Reports(radar=plots(SHIP, seen_s, np.zeros(8)), video=spokes(seen_s, np.zeros(8)))
    memory, made = true_azimuths(HeadingMemory(), replace(given, headings=headings(compass_s)), radars())
    assert (memory.left_out, len(made.radar), len(made.video)) == (8, 4, 4)
    memory, made = true_azimuths(HeadingMemory(), given, radars())
    assert (memory.left_out, len(made.radar), len(made.video)) == (16, 0, 0)


def test_headings_that_come_twice_or_late_change_nothing() -> None:
    compass_s, seen_s = np.arange(0.0, 20.0), np.linspace(0.0, 20.0, 50)
    shuffled = np.random.default_rng(2).permutation(np.repeat(np.arange(20), 2))
    want = heading_at(headings(compass_s), seen_s)
    assert np.array_equal(heading_at(headings(compass_s).take(shuffled), seen_s), want)


@pytest.mark.parametrize("given", [{"azimuth_reference": "magnetic"}, {"magnetic_variation_deg": 3.0}])
def test_a_variation_is_given_with_magnetic_azimuths_alone(given: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match="needed a variation with 'magnetic', and with no other"):
        Radar(name="x", range_nm=1.0, rpm=20.0, **given)


def test_references_have_the_names_of_the_settings() -> None:
    assert radars().azimuth_reference.tolist() == [AzimuthReference.TRUE, AzimuthReference.MAGNETIC, AzimuthReference.HEADING]
