"""Vessels that one region sees alone, where a radar of another region should see them too."""

from dataclasses import replace

import numpy as np
import pytest

from coastwatch.batches import Radars, Sensors, Sonars, Stations, Tracks
from coastwatch.geodesy import offset_deg
from coastwatch.picture import Identity
from coastwatch.picture.confirmed import Confirmations, confirm, judged_regions

pytestmark = pytest.mark.contract

HOME = np.array([63.4, 10.4])
WIDE, NEAR = 0, 1  # regions: a radar, and a lidar inside its range
CYCLES = 30


def sensors(near_range_m=150.0, apart_m=0.0):
    site = offset_deg(np.tile(HOME, (2, 1)), np.array([[0.0, 0.0], [apart_m, 0.0]]))
    range_m, one = np.array([550.0, near_range_m]), np.ones(2)
    radars = Radars(np.array(["radar", "lidar"]), np.array([WIDE, NEAR]), site, range_m, one, one, 0.01 * one)
    none = Stations(np.zeros(0, "U1"), np.zeros((0, 2)), np.zeros(0))
    return Sensors(radars, none, Sonars.empty(), ("radar", "lidar"), site)


def tracks(ids, source):
    n = len(ids)
    zero, matrix, none = np.zeros(n), np.tile(np.eye(4), (n, 1, 1)), np.full(n, -1)
    place, report = np.tile(HOME, (n, 1)), np.tile(np.eye(2), (n, 1, 1))
    return Tracks(np.array(ids), np.array(source), zero, place, np.zeros((n, 2)), matrix, report, zero, zero, none, none)


def shown(vessels, cycles=CYCLES, settings=None, of=None, memory=None):
    """Which vessels are shown at the end. Args: vessels: of each, the pairs of a track id and its source."""
    memory = memory or Confirmations.empty()
    row = np.repeat(np.arange(len(vessels)), [len(v) for v in vessels])
    given = tracks(*zip(*[pair for v in vessels for pair in v], strict=True))
    start_s = float(memory.time_s[0]) if len(memory.time_s) else 0.0
    for cycle in range(1, cycles + 1):
        memory, out = confirm(
            settings or Identity(confirmed_share=0.8), memory, given, row, len(vessels), start_s + cycle, of or sensors()
        )
    return memory, out.tolist()


def test_only_a_region_inside_the_range_of_another_one_is_judged():
    assert judged_regions(sensors()).tolist() == [False, True]
    assert judged_regions(sensors(near_range_m=550.0)).tolist() == [False, False]
    assert judged_regions(sensors(apart_m=500.0)).tolist() == [False, False]


def test_what_the_inner_radar_sees_alone_is_not_shown():
    assert shown([[(1, WIDE)], [(2, NEAR)], [(3, WIDE), (4, NEAR)]])[1] == [True, False, True]


def test_a_confirmed_track_is_shown_for_a_while_after_the_other_radar_lost_it():
    memory, _ = shown([[(3, WIDE), (4, NEAR)]])
    after, out = shown([[(4, NEAR)]], cycles=3, memory=memory)
    assert out == [True]
    assert shown([[(4, NEAR)]], cycles=CYCLES, memory=after)[1] == [False]


def test_a_region_whose_tracks_are_confirmed_begins_vessels_and_one_with_false_tracks_does_not():
    good, _ = shown([[(3, WIDE), (4, NEAR)]], cycles=100)
    bad, _ = shown([[(3, WIDE), (4, NEAR)], [(5, NEAR)]], cycles=100)
    assert shown([[(9, NEAR)]], cycles=1, memory=good)[1] == [True]
    assert shown([[(9, NEAR)]], cycles=1, memory=bad)[1] == [False]


def test_by_default_what_one_radar_sees_alone_is_shown():
    assert shown([[(2, NEAR)]], settings=Identity())[1] == [True]


def test_two_regions_of_one_range_are_not_asked():
    assert shown([[(2, NEAR)]], of=sensors(near_range_m=550.0))[1] == [True]


def test_tracks_of_other_sources_are_not_judged():
    one = sensors()
    assert shown([[(2, NEAR)], [(7, one.ais_source)]], of=replace(one))[1] == [False, True]
