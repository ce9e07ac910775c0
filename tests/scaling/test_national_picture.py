"""The national picture of scaling/load: seeded, streamed, with the shares, densities and lifetimes that its README states."""

from __future__ import annotations

import copy
from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from coastwatch.batches import Batch, Ints, Sensors
from coastwatch.centre import Received
from coastwatch.geodesy import difference_m, earth_centred
from scaling.load import national
from scaling.load.national.tracks import ChannelKind
from scaling.load.national.traffic import SHARES, Traffic

pytestmark = pytest.mark.contract

CYCLES = 120  # six minutes: vessels come and go, tracks break, MMSIs change
STEP_S = 0.01


@cache
def world(tracks: int = 2000, seed: int = 1) -> tuple[national.World, Sensors]:
    made = national.build_world(tracks, seed)
    return made, national.scenario_of(made, {}).sensors()


def run(
    cycles: int, tracks: int = 2000, seed: int = 1, state: national.State | None = None
) -> tuple[national.State, list[Received]]:
    made, sensors = world(tracks, seed)
    state, out = state or national.initial_state(made), []
    for _ in range(cycles):
        state, received = national.next_cycle(made, state, sensors)
        out.append(received)
    return state, out


@cache
def six_minutes() -> list[Received]:
    return run(CYCLES)[1]


def same(a: Batch, b: Batch) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=True) for f in fields(a))


def test_a_seed_gives_the_same_bits_and_another_gives_others() -> None:
    ours, again, other = run(3)[1][-1], run(3)[1][-1], run(3, seed=2)[1][-1]
    assert same(ours.tracks, again.tracks)
    assert same(ours.bearing_tracks, again.bearing_tracks)
    assert not np.array_equal(ours.tracks.position_deg[:100], other.tracks.position_deg[:100])


def test_a_copied_state_gives_the_same_cycles() -> None:
    state, before = run(5)
    kept = copy.deepcopy(state)
    _, straight = run(4, state=state)
    _, resumed = run(4, state=kept)
    assert len(before) == 5
    assert same(straight[-1].tracks, resumed[-1].tracks)
    assert same(straight[-1].bearing_tracks, resumed[-1].bearing_tracks)


@pytest.mark.parametrize(("tracks", "within"), [(2000, 0.05), (20_000, 0.02)])
def test_the_shares_are_as_stated(tracks: int, within: float) -> None:
    """Sizes are rounded to whole ports and regions, which are few in a small world; three standard deviations of who is absent are less."""
    got = run(1, tracks)[1][0].tracks
    radar, ais = (np.unique(got.origin[(got.mmsi < 0) == of_radar]) for of_radar in (True, False))
    vessels = np.union1d(radar, ais)
    assert len(got) == pytest.approx(tracks, rel=within)
    assert (got.mmsi < 0).mean() == pytest.approx(0.5, abs=within / 2)
    assert len(np.intersect1d(radar, ais)) / len(vessels) == pytest.approx(0.5, abs=within)
    kinds = np.bincount(world(tracks)[0].traffic_of(vessels), minlength=len(Traffic)) / len(vessels)
    assert kinds == pytest.approx(np.array(SHARES), abs=0.01)


def test_a_vessel_in_an_overlap_has_a_track_in_both_regions() -> None:
    got = run(1, 20_000)[1][0].tracks
    radar = got.take(got.mmsi < 0)
    order = np.lexsort((radar.source, radar.origin))
    origin, source = radar.origin[order], radar.source[order]
    twice = origin[1:] == origin[:-1]
    assert 0.02 < twice.mean() < 0.12
    assert (source[1:] - source[:-1])[twice].tolist() == [1] * int(twice.sum())
    assert len(np.unique(source)) == len(world(20_000)[1].region_names)


@pytest.mark.parametrize("kind", Traffic)
def test_a_velocity_is_the_rate_of_its_position(kind: Traffic) -> None:
    made, _ = world()
    rows = np.flatnonzero(made.slots.kind == kind)
    times = np.full(len(rows), national.START_S + 700.0)
    now = national.truth(made, rows, times)
    there = now.vessel == national.truth(made, rows, times + STEP_S).vessel
    ahead, behind = (national.truth(made, rows, times + sign * STEP_S / 2).position_deg for sign in (1.0, -1.0))
    rate = difference_m(ahead, behind) / STEP_S
    assert there.mean() > 0.9
    assert np.abs(rate - now.velocity_m_s)[there].max() < 1e-3  # a rounding of time stamps, 0.2 us, at 13 m/s over the step


def test_ships_at_anchor_and_trawlers_are_as_close_as_stated() -> None:
    made, _ = world(20_000)
    rows = np.arange(len(made.slots))
    points = earth_centred(national.truth(made, rows, np.full(len(rows), national.START_S + 700.0)).position_deg)
    gap = cKDTree(points).query(points, k=2)[0][:, 1]
    at_anchor, fishing = (gap[made.slots.kind == kind] for kind in (Traffic.ANCHORAGE, Traffic.FLEET))
    assert 100.0 < np.median(at_anchor) < 350.0
    assert 60.0 < at_anchor.min() < 110.0
    assert 100.0 < fishing.min() < 200.0


def test_vessels_come_and_go_tracks_break_and_mmsis_change() -> None:
    got = [received.tracks for received in six_minutes()]
    first, last = got[0], got[-1]
    left, new = np.setdiff1d(first.origin, last.origin), np.setdiff1d(last.origin, first.origin)
    assert len(left) > 50
    assert len(new) > 50
    stayed, before, after = np.intersect1d(first.origin[first.mmsi >= 0], last.origin[last.mmsi >= 0], return_indices=True)
    renamed = first.mmsi[first.mmsi >= 0][before] != last.mmsi[last.mmsi >= 0][after]
    assert 0.003 < renamed.mean() < 0.03  # 3 % change theirs every 15 minutes
    ids = {int(t): int(o) for received in got for t, o in zip(received.track_id, received.origin, strict=True)}
    tracks_of = np.bincount(np.unique(list(ids.values()), return_inverse=True)[1])
    assert tracks_of.max() > 2
    assert len(stayed) > 500


def test_a_track_id_belongs_to_one_track_and_is_never_reused() -> None:
    meaning: dict[int, tuple[int, int, int, float]] = {}
    ended: set[int] = set()
    before: set[int] = set()
    for received in six_minutes():
        t = received.tracks
        now = set(t.track_id.tolist())
        assert len(now) == len(t)
        assert not now & ended
        ended |= before - now
        before = now
        columns = (t.track_id, t.source, t.origin, t.mmsi, t.started_s)
        for track, *attributes in zip(*(c.tolist() for c in columns), strict=True):
            assert meaning.setdefault(track, tuple(attributes)) == tuple(attributes)
    assert len(ended) > 100


def test_every_track_has_a_time_of_its_own_within_its_interval() -> None:
    made, _ = world()
    for number, received in enumerate(six_minutes()[:20]):
        age_s = made.time_s(number) - received.tracks.time_s
        of_radar = received.tracks.mmsi < 0
        assert age_s.min() >= 0.0
        assert age_s[of_radar].max() < 4.0
        assert age_s[~of_radar].max() < 10.0
        assert len(np.unique(received.tracks.time_s)) > 0.99 * len(received.tracks)
    intervals = made.channels.interval_s[made.channels.kind == ChannelKind.AIS]
    assert np.unique(intervals).tolist() == [2.0, 6.0, 10.0]


def test_sonars_hear_about_a_hundred_vessels_with_their_windows() -> None:
    late = six_minutes()[-1].bearing_tracks
    known = np.isfinite(late.window_bearing_rad).sum(axis=1)
    assert 70 <= len(late) <= 130
    assert np.median(known) > 80
    made, sensors = world()
    true = national.truth(made, late.origin, late.updated_s)
    east_north = difference_m(true.position_deg, late.site_deg)
    off = np.arctan2(east_north[:, 0], east_north[:, 1]) - late.window_bearing_rad[:, -1]
    off = (off + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(off + made.sonars.bias_rad[0]).max() < 5.5 * sensors.sonars.bearing_sigma_rad[0]
    assert (np.hypot(*east_north.T) < 1.01 * sensors.sonars.range_m[0]).mean() > 0.95


def test_the_density_is_the_same_in_a_large_world() -> None:
    lengths = [
        made.coasts.length_m * len(made.coasts.latitude_deg) for made in (national.build_world(n, 1) for n in (5000, 200_000))
    ]
    ratio: Ints = np.array([len(national.build_world(n, 1).slots) for n in (5000, 200_000)])
    assert lengths[1] / lengths[0] == pytest.approx(ratio[1] / ratio[0], rel=1e-3)
    assert lengths[1] > 3.0e6
