"""The cover of radars: what is learnt of shadow, of one vessel alone, and of false plots."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.batches import (
    AisDetection,
    Associations,
    Measurements,
    Plots,
    RadarCover,
    Radars,
    Sensors,
    Sonars,
    Stations,
    Tracks,
)
from coastwatch.cover import CoverInput, DiscCover, LearntCover
from coastwatch.cover.learnt import CoverMemory
from coastwatch.geodesy import from_plane
from coastwatch.server import checkpoint

pytestmark = pytest.mark.contract

SITE = np.array([[54.0, 10.0]])
RANGE_M, PERIOD_S = 8000.0, 3.0
SENSORS = Sensors(
    Radars(
        np.array(["a"]),
        np.zeros(1, np.int64),
        SITE,
        np.array([RANGE_M]),
        np.array([PERIOD_S]),
        np.array([10.0]),
        np.array([0.005]),
    ),
    Stations.empty(),
    Sonars.empty(),
    ("coast",),
    SITE,
)
AIS = SENSORS.ais_source
SHADOW = (np.radians(90.0), np.radians(180.0))


def tracks_of(source, position_m, first_id, updated_s=0.0):
    n = len(position_m)
    return Tracks(
        track_id=first_id + np.arange(n),
        source=np.full(n, source),
        time_s=np.zeros(n),
        position_deg=from_plane(position_m, SITE[0]),
        velocity_m_s=np.zeros((n, 2)),
        covariance=np.zeros((n, 4, 4)),
        report_covariance=np.zeros((n, 2, 2)),
        updated_s=np.full(n, updated_s),
        started_s=np.full(n, -1000.0),
        mmsi=np.where(source == AIS, 1 + np.arange(n), -1),
        origin=np.full(n, -1),
    )


def plots_at(position_m, time_s):
    n = len(position_m)
    row, polar = np.zeros(n, np.int64), (np.hypot(*position_m.T), np.arctan2(*position_m.T))
    return Plots(row, row, np.full(n, time_s), position_m, np.zeros((n, 2, 2)), np.zeros((n, 2)), *polar, row - 1)


def polar(azimuth_deg, range_m):
    angle = np.radians(azimuth_deg)
    return np.stack([range_m * np.sin(angle), range_m * np.cos(angle)], -1)


def turn(method, memory, number, ais_m, seen, clutter_m, jumped=False, updated_s=0.0):
    """One turn of the radar: vessels with AIS, of which it sees some, and plots of nobody."""
    time_s, with_plot = PERIOD_S * number, np.flatnonzero(seen)
    ais, radar = tracks_of(AIS, ais_m, 1000, updated_s), tracks_of(0, ais_m[with_plot], 1)
    tracks = Tracks.join([radar, ais])
    vessel = np.concatenate([with_plot, np.arange(len(ais))])
    none = np.zeros(0, np.int64)
    n = len(radar)
    taken = Measurements(
        radar.track_id,
        np.zeros(n, np.int64),
        np.full(n, time_s),
        radar.position_deg,
        np.full((n, 2), np.nan),
        np.full((n, 4, 4), np.nan),
        np.repeat(SITE, n, axis=0),
    )
    plots = plots_at(np.concatenate([ais_m[with_plot], clutter_m]), time_s)
    alarmed = np.zeros(len(tracks), np.bool_)
    together = Associations(none, none, np.zeros(0), vessel)
    memory, output = method.step(memory, CoverInput(plots, tracks, together, taken, alarmed, np.array([jumped]), SENSORS))
    return memory, *output


def turns(
    method, count, ais_m, seen, clutter_m=None, jumped_at=None, updated_s=0.0
) -> tuple[CoverMemory, RadarCover, AisDetection]:
    clutter_m = polar(np.array([200.0]), np.array([7900.0])) if clutter_m is None else clutter_m
    memory, out = method.init(), None
    for number in range(count):
        memory, *out = turn(method, memory, number, ais_m, seen, clutter_m, number == jumped_at, updated_s)
    return memory, *out


def ring_of_vessels():
    """Two vessels in each of 72 sectors, in one ring; those in the shadow are not seen."""
    azimuth = np.repeat(np.arange(72) * 5.0 + 2.0, 3) + np.tile([0.0, 1.0, 2.0], 72)
    position = polar(azimuth, np.full(len(azimuth), 4100.0))
    shadow = (azimuth >= 90.0) & (azimuth < 180.0)
    return azimuth, position, ~shadow


def test_a_shadow_is_learnt_and_the_rest_stays_in_cover():
    _, position, seen = ring_of_vessels()
    _, cover, detection = turns(LearntCover(), 40, position, seen)
    expected = np.zeros(len(position))
    expected[detection.track_id - 1000] = detection.probability
    assert (expected[~seen] < 0.5).all()
    assert (expected[seen] > 0.5).all()
    ring = int(4100.0 / RANGE_M * 16)
    assert (cover.ais_detection[0, 18:36, ring] < 0.45).all()
    assert (cover.ais_detection[0, 40:, ring] > 0.6).all()


def test_vessels_that_were_heard_once_are_no_witnesses():
    """Somebody may have invented them: they would make a shadow of all the sea."""
    _, position, seen = ring_of_vessels()
    _, cover, detection = turns(LearntCover(), 40, position, seen, updated_s=-1000.0)
    assert cover.ais_looks.sum() == 0.0
    assert detection.probability == pytest.approx(LearntCover().prior_probability)


def test_a_vessel_does_not_speak_for_itself():
    """A false position in a cell that nobody else visits is expected to be seen as well as the radar sees elsewhere."""
    _, position, _ = ring_of_vessels()
    position = np.concatenate([position, polar(np.array([300.0]), np.array([7000.0]))])
    seen = np.append(np.ones(len(position) - 1, np.bool_), False)
    _, cover, detection = turns(LearntCover(), 60, position, seen)
    own = detection.probability[detection.track_id == 1000 + len(position) - 1]
    assert own == pytest.approx(0.99, abs=0.02)
    assert cover.ais_detection[0, 60, 14] < own - 0.25


def test_a_visit_counts_no_more_turns_than_set():
    position = polar(np.array([30.0]), np.array([3000.0]))
    _, cover, _ = turns(LearntCover(visit_looks=5.0), 50, position, np.array([True]))
    assert cover.ais_looks.sum() == pytest.approx(5.0)


def test_a_jump_of_the_registration_forgets():
    _, position, seen = ring_of_vessels()
    _, cover, _ = turns(LearntCover(), 30, position, seen, jumped_at=29)
    assert cover.turns[0] == pytest.approx(1.0)
    assert cover.ais_looks.sum() == pytest.approx(len(position))


def test_the_density_of_false_plots_is_that_of_clutter():
    """Plots that are in tracks do not count."""
    _, position, seen = ring_of_vessels()
    clutter = polar(np.array([101.0, 102.0, 103.0]), np.full(3, 2100.0))
    _, cover, _ = turns(LearntCover(memory_s=1e9), 101, position, seen, clutter)
    area = np.pi / 72 * (2500.0**2 - 2000.0**2)
    assert cover.false_plots_per_m2[0, 20, 4] == pytest.approx(3.03 / area, rel=0.01)
    assert np.count_nonzero(cover.false_plots_per_m2) == 1


def test_it_resumes_to_the_bit():
    _, position, seen = ring_of_vessels()
    memory, *_ = turns(LearntCover(), 5, position, seen)
    again = checkpoint.load(checkpoint.save(memory))
    clutter = polar(np.array([200.0]), np.array([7900.0]))
    one, other = (turn(LearntCover(), m, 5, position[:100], seen[:100], clutter) for m in (memory, again))
    assert np.array_equal(one[1].ais_detection, other[1].ais_detection)
    assert np.array_equal(one[2].probability, other[2].probability)


def test_a_disc_expects_every_vessel():
    _, position, seen = ring_of_vessels()
    _, cover, detection = turns(DiscCover(), 2, position, seen)
    assert len(cover) == 0
    assert len(detection) == len(position)
    assert (detection.probability == 1.0).all()


def test_a_moored_vessel_on_the_edge_of_two_cells_counts_as_one_inside():
    """Its position errs by 3 m: each crossing of the edge was a visit of its own, and a radar that did not see it was blind."""
    direction, rng, none = (
        np.array([np.sin(np.radians(42.5)), np.cos(np.radians(42.5))]),
        np.random.default_rng(1),
        np.zeros(0, np.int64),
    )
    looks = []
    for range_m in (2750.0, 2500.0):  # rings of 500 m
        method, memory = LearntCover(), LearntCover().init()
        for cycle in range(200):
            time_s = 1e6 + 3.0 * cycle
            ais = tracks_of(AIS, (direction * range_m + rng.normal(0.0, 3.0, 2))[None], AIS * 2**40 + 1, updated_s=0.0)
            alone = Associations(none, none, np.zeros(0), np.array([0]), 0, 0, False)
            plots = plots_at(np.array([[3000.0, -3000.0]]), time_s - 1.0)
            no, nobody = np.zeros(1, np.bool_), Measurements.empty()
            memory, (cover, _) = method.step(memory, CoverInput(plots, ais, alone, nobody, no, no, SENSORS))
        looks.append(cover.ais_looks.sum())
    assert looks[0] == pytest.approx(12.0, rel=0.05)
    assert looks[1] == pytest.approx(looks[0], rel=0.05)
