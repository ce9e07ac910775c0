"""The decided past of multi-hypothesis tracks: smoothed, each plot once, the same after a restart; and lives by AIS messages alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from radar_world import ORIGIN_DEG, PERIOD_S, cut, plots_of, two_radars, world

from coastwatch.batches import DecidedPath, Messages, Picture, Plots, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.picture.vessels import with_details
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, TableTracker

pytestmark = pytest.mark.contract

CYCLES = 20
MMSI = 219_002_000
ALWAYS = {"trust": "always"}  # tracks that no radar sees are reported


def messages_of(truth, vessels, every_s, mmsi):
    """Messages of 5 m from these vessels. Args: mmsi: of each."""
    time = np.tile(np.arange(1.0, PERIOD_S * CYCLES, every_s), len(vessels))
    vessel = np.repeat(vessels, len(time) // len(vessels))
    order = np.argsort(time, kind="stable")
    time, vessel = time[order], vessel[order]
    place = truth.at(vessel, time)[0] + 5.0 * np.random.default_rng(5).standard_normal((len(time), 2))
    spread, waits = np.tile(25.0 * np.eye(2), (len(time), 1, 1)), np.full(len(time), every_s)
    return Messages(time, place, spread, np.asarray(mmsi)[vessel], vessel, interval_s=waits)


def run(method, plots, messages, cycles=range(CYCLES), memory=None, through=lambda memory: memory):
    """Memory, tracks and decided states of each cycle. Args: through: what becomes of the memory after a cycle."""
    memory, tracks, decided = method.init() if memory is None else memory, [], []
    for cycle in cycles:
        end_s = PERIOD_S * (cycle + 1)
        now = messages.take((messages.time_s > end_s - PERIOD_S) & (messages.time_s <= end_s))
        given = RegionInput.of_plots(cut(plots, cycle), end_s, two_radars())._replace(messages=now)
        memory, found = method.step(memory, given)
        memory = through(memory)
        tracks.append(found.tracks)
        decided.append(found.decided)
    return memory, tracks, decided


@pytest.fixture(scope="module")
def scene():
    truth = world(16, 61, side_nm=3.0)
    plots = plots_of(truth, two_radars(), PERIOD_S * CYCLES, 61, detection=0.8, clutter_per_m2=5e-7)
    return truth, plots, messages_of(truth, np.arange(4), 6.0, MMSI + np.arange(16))


def errors_m(truth, tracks, track_id, position_deg, time_s):
    """How far states are from the vessels of their tracks. Args: tracks: say of which vessel each track is."""
    order = np.argsort(tracks.track_id, kind="stable")
    at = np.searchsorted(tracks.track_id[order], track_id)
    vessel = tracks.origin[order][np.minimum(at, len(order) - 1)]
    known = np.isin(track_id, tracks.track_id) & (vessel >= 0)
    where, _ = truth.at(vessel[known], time_s[known])
    return np.hypot(*(to_plane(position_deg[known], ORIGIN_DEG) - where).T)


def test_the_decided_past_is_more_exact_than_what_was_shown(scene):
    truth, plots, messages = scene
    _, tracks, decided = run(TableTracker(method="multi_hypothesis"), plots, messages)
    last, shown, past = tracks[-1], Tracks.join(tracks[6:]), DecidedPath.join(decided)
    assert len(past) > 150
    online = errors_m(truth, last, shown.track_id, shown.position_deg, shown.time_s)
    smoothed = errors_m(truth, last, past.track_id, past.position_deg, past.time_s)
    assert np.sqrt((smoothed**2).mean()) < 0.75 * np.sqrt((online**2).mean())
    sigma = np.sqrt(past.covariance[:, 0, 0] + past.covariance[:, 1, 1])
    assert (np.linalg.eigvalsh(past.covariance) > 0.0).all()
    assert 0.5 < np.sqrt((smoothed**2).mean() / (sigma**2).mean()) < 1.5
    assert {-1, 0, 1} == set(past.radar.tolist())
    instants = np.column_stack([past.track_id, past.time_s])
    assert len(np.unique(instants, axis=0)) == len(past)
    for one in decided:
        assert (np.diff(one.track_id) >= 0).all()
    age_s = np.concatenate([PERIOD_S * (k + 1) - one.time_s for k, one in enumerate(decided)])
    assert age_s.min() > 0.0
    assert np.median(age_s) < 15.0


def test_of_a_track_that_ends_every_plot_is_decided(scene):
    """Four vessels give no plot after 36 s: their tracks end, and no state of them waits for later looks."""
    plots, gone = scene[1], np.array([0, 2, 3, 6])
    plots = plots.take((plots.time_s < 36.0) | ~np.isin(plots.origin, gone))
    _, tracks, decided = run(TableTracker(method="multi_hypothesis"), plots, Messages.empty())
    past, then = DecidedPath.join(decided), tracks[11]
    ended = then.track_id[np.isin(then.origin, gone)]
    assert len(ended) == 4
    assert not np.isin(ended, tracks[-1].track_id).any()
    newest = {track: past.time_s[past.track_id == track].max() for track in ended.tolist()}
    shown = dict(zip(then.track_id.tolist(), then.origin.tolist(), strict=True))
    plot = {vessel: plots.time_s[plots.origin == vessel].max() for vessel in gone.tolist()}
    of_their_last_plot = [newest[track] == plot[shown[track]] for track in ended.tolist()]
    assert np.mean(of_their_last_plot) > 0.7  # others ended on a false plot, or left it out
    assert len(np.unique(np.column_stack([past.track_id, past.time_s]), axis=0)) == len(past)


def test_a_run_that_is_saved_in_each_open_decision_is_the_same_to_the_bit(scene):
    _, plots, messages = scene
    method = TableTracker(method="multi_hypothesis")
    memory, tracks, decided = run(method, plots, messages, range(10))
    again, resumed, past = run(method, plots, messages, range(10), through=lambda memory: load(save(memory)))
    assert (memory.forest.leaves.plot >= 0).any()
    for one, other in ((tracks[-1], resumed[-1]), (DecidedPath.join(decided), DecidedPath.join(past))):
        assert np.array_equal(one.position_deg, other.position_deg)
        assert np.array_equal(one.covariance, other.covariance)
    assert np.array_equal(memory.forest.leaves.step, again.forest.leaves.step)


def test_other_trackers_decide_nothing_later(scene):
    _, plots, messages = scene
    _, _, decided = run(TableTracker(method="vimmjipda"), plots, messages, range(4))
    assert sum(map(len, decided)) == 0


def test_a_step_of_no_row_is_refused(scene):
    _, plots, messages = scene
    memory, *_ = run(TableTracker(method="multi_hypothesis"), plots, messages, range(3))
    memory.forest.leaves.step[0, -1] = 10**6
    with pytest.raises(ValueError, match=r"Leaves\.step"):
        load(save(memory))


def test_an_odd_mmsi_is_no_identity_and_its_messages_are_used(scene):
    truth, plots, _ = scene
    names = np.full(16, 11_930_446)
    names[1] = MMSI
    method = TableTracker(method="multi_hypothesis", messages=ALWAYS)
    _, tracks, decided = run(method, plots, messages_of(truth, np.arange(2), 6.0, names))
    held = dict(zip(tracks[-1].origin.tolist(), tracks[-1].held_mmsi.tolist(), strict=True))
    assert held[0] == -1
    assert held[1] == MMSI
    assert np.unique(tracks[-1].origin, return_counts=True)[1].max() == 1
    by_message = DecidedPath.join(decided)
    by_message = by_message.take(by_message.radar < 0)
    of_odd = tracks[-1].track_id[tracks[-1].origin == 0][0]
    assert (by_message.track_id == of_odd).sum() >= 4


def test_a_vessel_that_radars_lose_lives_by_its_messages_and_ends_when_they_stay_away():
    truth = world(1, 62, kick_m_s=0.0, side_nm=1.0)
    plots = plots_of(truth, two_radars(), PERIOD_S * CYCLES, 62)
    plots = plots.take(plots.time_s < 12.0)
    method = TableTracker(method="multi_hypothesis", messages=ALWAYS, upkeep={"coast_s": 9.0})
    slow = messages_of(truth, np.arange(1), 10.0, [MMSI])
    _, tracks, _ = run(method, plots, slow)
    assert [len(one) for one in tracks[4:]] == [1] * (CYCLES - 4)
    assert len(np.unique(np.concatenate([one.track_id for one in tracks[4:]]))) == 1
    _, tracks, _ = run(method, plots, slow.take(slow.time_s < 25.0))
    assert [len(one) for one in tracks[-4:]] == [0] * 4


def test_a_track_with_two_histories_says_how_far_away_it_may_be():
    """Vessel 0 is not seen for some turns, then there are two plots, 40 m on either side of it. The other vessels are sure."""
    truth = world(8, 63, kick_m_s=0.0, side_nm=3.0)
    sensors = two_radars(azimuth_sigma_deg=0.1)
    plots = plots_of(truth, sensors, PERIOD_S * CYCLES, 63)
    later = plots.take((plots.origin == 0) & (plots.time_s > 33.0))
    rest = plots.take((plots.origin != 0) | (plots.time_s < 24.0))
    east = np.array([40.0, 0.0])
    sides = [replace(later, position_m=later.position_m + sign * east) for sign in (-1.0, 1.0)]
    _, tracks, _ = run(TableTracker(method="multi_hypothesis"), Plots.join([rest, *sides]), Messages.empty(), range(12))
    assert np.isnan(Tracks.join(tracks[6:11]).alternative_m).all()
    doubtful = tracks[11].take(np.isfinite(tracks[11].alternative_m))
    assert doubtful.origin.tolist() == [0]
    assert 50.0 < doubtful.alternative_m[0] < 110.0
    found = with_details(Picture.empty(V=len(tracks[11])), tracks[11], np.arange(len(tracks[11]))).alternative_m
    np.testing.assert_array_equal(found, tracks[11].alternative_m)
    none_sure, one_sure = np.array([300.0, 120.0]), np.array([300.0, np.nan])
    for each, vessel in ((none_sure, 120.0), (one_sure, np.nan)):
        two = replace(tracks[11].take(np.arange(2)), alternative_m=each)
        np.testing.assert_array_equal(with_details(Picture.empty(V=1), two, np.zeros(2, np.int64)).alternative_m, [vessel])


def test_a_track_of_another_vessels_plots_loses_its_mmsi_when_that_is_heard_elsewhere():
    """A ship at berth that no radar shows yet, whose first message its neighbour takes, 300 m away; the next is 43 s later."""
    truth = world(2, 1, kick_m_s=0.0)
    truth = replace(truth, start_m=np.array([[0.0, 0.0], [300.0, 0.0]]), velocity_m_s=np.zeros((2, 2)))
    plots = plots_of(truth, two_radars(), PERIOD_S * CYCLES, 3)
    plots = plots.take((plots.origin == 0) | (plots.time_s > 12.0))  # the second ship is seen later
    time_s = np.array([5.0, 48.0, 51.0, 54.0, 57.0])
    place = np.array([[15.0, 0.0], *np.tile([300.0, 0.0], (4, 1))])
    spread = np.tile(100.0 * np.eye(2), (5, 1, 1))
    messages = Messages(time_s, place, spread, np.full(5, MMSI), np.ones(5, np.int64), interval_s=np.full(5, 180.0))
    _, tracks, _ = run(TableTracker(method="multi_hypothesis"), plots, messages)
    held = [dict(zip(one.origin.tolist(), one.held_mmsi.tolist(), strict=True)) for one in tracks]
    assert held[12] == {0: MMSI, 1: -1}
    assert held[-1] == {0: -1, 1: MMSI}


def test_a_track_waits_a_minute_for_the_messages_of_a_ship_at_berth(scene):
    """Its messages come each three minutes: a track that coasted so long would take the plots of its neighbours."""
    truth, plots, _ = scene
    plots = plots.take((plots.origin == 0) & (plots.time_s < 12.0))
    message = messages_of(truth, [0], 1e9, MMSI + np.arange(16))
    message = replace(message, interval_s=np.array([180.0]))
    method, alive = TableTracker(method="multi_hypothesis"), []
    memory = None
    for cycles in (range(18), range(18, 30)):  # 54 s and 90 s
        memory, *_ = run(method, plots, message, cycles, memory)
        alive.append(len(memory.table))
    assert alive == [1, 0]
