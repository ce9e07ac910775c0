"""AIS messages as measurements of radar tracks: ids right, wrong, swapped and doubled; batches equal the sequence; counted once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from radar_world import ORIGIN_DEG, PERIOD_S, cut, every_tracker, plots_of, two_radars, world

from coastwatch.associations.merged_ais import counted_once, find_merged_ais
from coastwatch.batches import Associations, Messages, Plots, SourceKind, Spots, Tracks, VesselBearings
from coastwatch.geodesy import to_plane
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, TableTracker
from coastwatch.tracks.radar.multi_hypothesis import MultiHypothesis

pytestmark = pytest.mark.contract

ALWAYS = {"trust": "always"}  # as in the papers: `test_ais_left` has tracks that leave their messages
METHODS = [
    m.model_copy(update={"messages": m.messages.model_copy(update=ALWAYS)})
    for m in every_tracker()
    if isinstance(m, TableTracker) and m.holds_messages and m.bank.method == "compiled"
]
FIRST_MMSI = 219_001_000
SIGMA_M = 3.0
VELOCITY_SIGMA_M_S = 0.1
CYCLES = 12


def messages_of(truth, vessels, seed, every_s=6.0, span_s=PERIOD_S * CYCLES):
    """Messages of these vessels of a world, MMSI FIRST_MMSI + vessel, sorted by time."""
    rng = np.random.default_rng([seed, 3])
    parts = []
    for k in vessels:
        times = np.arange(rng.uniform(0.0, every_s), span_s, every_s)
        parts.append((times, np.full(len(times), k)))
    time, vessel = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(time)
    time, vessel = time[order], vessel[order]
    place = truth.at(vessel, time)[0] + SIGMA_M * rng.standard_normal((len(time), 2))
    return Messages(time, place, np.tile(SIGMA_M**2 * np.eye(2), (len(time), 1, 1)), FIRST_MMSI + vessel, vessel)


def run(method, plots, messages, memory=None, cycles=range(CYCLES)):
    """Memory and the tracks of each cycle."""
    memory, out = method.init() if memory is None else memory, []
    for cycle in cycles:
        now = messages.take((messages.time_s > PERIOD_S * cycle) & (messages.time_s <= PERIOD_S * (cycle + 1)))
        given = RegionInput.of_plots(cut(plots, cycle), PERIOD_S * (cycle + 1), two_radars())
        memory, (tracks, *_) = method.step(memory, given._replace(messages=now))
        out.append(tracks)
    return memory, out


@pytest.fixture(scope="module")
def scene():
    """Twelve vessels, of which eight send messages."""
    truth = world(12, 31, side_nm=4.0)
    return truth, plots_of(truth, two_radars(), PERIOD_S * CYCLES, 31, detection=0.9), messages_of(truth, range(8), 31)


def ids(tracks):
    """The id that each vessel's track holds, by vessel."""
    return dict(zip(tracks.origin.tolist(), tracks.held_mmsi.tolist(), strict=True))


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_every_vessel_is_one_track_with_its_id(method, scene):
    truth, plots, messages = scene
    memory, out = run(method, plots, messages)
    vessels, count = np.unique(out[-1].origin, return_counts=True)
    assert (count == 1).all()
    found = ids(out[-1])
    assert all(found[k] == FIRST_MMSI + k for k in range(8) if k in found)
    assert all(found[k] == -1 for k in range(8, 12) if k in found)
    assert len(vessels) >= 11
    alone = run_alone(plots)
    where, _ = truth.at(np.maximum(out[-1].origin, 0), np.full(len(out[-1]), PERIOD_S * CYCLES))
    named = out[-1].held_mmsi >= 0
    error = np.hypot(*(to_plane(out[-1].position_deg, ORIGIN_DEG) - where)[named].T).mean()
    before, _ = truth.at(np.maximum(alone.origin, 0), np.full(len(alone), PERIOD_S * CYCLES))
    radar = np.hypot(*(to_plane(alone.position_deg, ORIGIN_DEG) - before)[np.isin(alone.origin, range(8))].T).mean()
    assert error < 0.8 * radar
    half, _ = run(method, plots, messages, cycles=range(6))
    resumed, rest = run(method, plots, messages, load(save(half)), range(6, CYCLES))
    assert np.array_equal(rest[-1].covariance, out[-1].covariance)
    assert np.array_equal(resumed.table.id_probability, memory.table.id_probability)
    rng = np.random.default_rng(31)
    _, shuffled = run(method, plots, messages.take(rng.permutation(len(messages))))
    assert np.array_equal(shuffled[-1].covariance, out[-1].covariance)


def run_alone(plots):
    """The last tracks with radar alone."""
    memory = TableTracker(method="vimmjipda").init()
    for cycle in range(CYCLES):
        memory, (tracks, *_) = TableTracker(method="vimmjipda").step(
            memory, RegionInput.of_plots(cut(plots, cycle), PERIOD_S * (cycle + 1), two_radars())
        )
    return tracks


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_a_wrong_id_begins_no_second_track_and_swapped_ids_change_hands(method, scene):
    """The fifth message of each vessel carries a random id; later vessels 0 and 1 send each other's."""
    _, plots, messages = scene
    wrong, mmsi = np.zeros(len(messages), np.bool_), messages.mmsi.copy()
    for k in range(8):
        wrong[np.flatnonzero(messages.origin == k)[3]] = True
    mmsi[wrong] = 900_000_000 + np.arange(8)
    _, out = run(method, plots, replace(messages, mmsi=mmsi))
    assert not np.isin(mmsi[wrong], np.concatenate([tracks.held_mmsi for tracks in out])).any()
    assert max(np.unique(tracks.origin, return_counts=True)[1].max(initial=0) for tracks in out) == 1
    late = messages.time_s > 12.0
    swapped = np.where(late & (messages.origin < 2), 2 * FIRST_MMSI + 1 - messages.mmsi, messages.mmsi)
    _, out = run(method, plots, replace(messages, mmsi=swapped))
    found = ids(out[-1])
    assert (found[0], found[1]) == (FIRST_MMSI + 1, FIRST_MMSI)
    assert len(np.unique(np.concatenate([tracks.track_id[tracks.origin == 0] for tracks in out]))) == 1


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_a_wrong_id_among_the_first_messages_of_a_vessel_begins_no_second_track(method):
    truth = world(1, 33, kick_m_s=0.0, side_nm=1.0)
    messages = messages_of(truth, [0], 33, every_s=0.9)
    mmsi = np.where(np.arange(len(messages)) == 1, 7, messages.mmsi)
    _, out = run(method, Plots.empty(), replace(messages, mmsi=mmsi), cycles=range(4))
    assert [len(tracks) for tracks in out[1:]] == [1] * 3
    assert out[-1].held_mmsi[0] == FIRST_MMSI


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_two_vessels_with_one_mmsi_stay_two_tracks(method, scene):
    truth, plots, messages = scene
    both = replace(messages, mmsi=np.where(messages.origin == 1, FIRST_MMSI, messages.mmsi))
    _, out = run(method, plots, both)
    tracks = out[-1]
    found = ids(tracks)
    if isinstance(method.association, MultiHypothesis):  # an MMSI is of one vessel
        assert {found[0], found[1]} in ({FIRST_MMSI, -1}, {-1})
    else:
        assert found[0] == found[1] == FIRST_MMSI
    where, _ = truth.at(tracks.origin, np.full(len(tracks), PERIOD_S * CYCLES))
    two = np.isin(tracks.origin, [0, 1])
    assert np.hypot(*(to_plane(tracks.position_deg, ORIGIN_DEG) - where)[two].T).max() < 20.0


def test_a_batch_of_single_messages_equals_the_sequence(scene):
    """Every message comes at the time of the batch that follows: method B is then method A."""
    _, plots, messages = scene
    slow = replace(messages, time_s=np.ceil(messages.time_s))
    slow = slow.take(np.unique(np.column_stack([slow.mmsi, slow.time_s]), axis=0, return_index=True)[1])
    both = (TableTracker(method=name) for name in ("vimmjipda_sequential", "vimmjipda_precise_batch"))
    one, other = (run(m, plots, slow)[1][-1] for m in both)
    assert len(one) > 8
    np.testing.assert_allclose(to_plane(one.position_deg, ORIGIN_DEG), to_plane(other.position_deg, ORIGIN_DEG), atol=0.5)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_speed_and_course_of_messages_make_tracks_more_exact_unless_switched_off(method, scene):
    truth, plots, messages = scene
    _, velocity = truth.at(messages.origin, messages.time_s)
    velocity = velocity + VELOCITY_SIGMA_M_S * np.random.default_rng([31, 4]).standard_normal(velocity.shape)
    noise = np.tile(VELOCITY_SIGMA_M_S**2 * np.eye(2), (len(messages), 1, 1))
    half = messages.origin % 2 == 0  # of the vessels send speed and course
    full = replace(messages, velocity_m_s=np.where(half[:, None], velocity, np.nan), velocity_covariance=noise)
    _, without = run(method, plots, messages)
    positions = method.messages.model_copy(update={"velocities": False})
    _, off = run(method.model_copy(update={"messages": positions}), plots, full)
    assert np.array_equal(off[-1].covariance, without[-1].covariance)
    _, out = run(method, plots, full)
    assert {k: v for k, v in ids(out[-1]).items() if v >= 0} == {k: v for k, v in ids(without[-1]).items() if v >= 0}
    assert max(np.unique(tracks.origin, return_counts=True)[1].max(initial=0) for tracks in out) == 1
    measured, before = (
        errors_of([tracks.take(np.isin(tracks.origin, [0, 2, 4, 6])) for tracks in one[6:]], truth) for one in (out, without)
    )
    assert measured[1] < 0.7 * before[1]
    assert measured[0] < before[0]
    rng = np.random.default_rng(32)
    _, shuffled = run(method, plots, full.take(rng.permutation(len(full))))
    assert np.array_equal(shuffled[-1].covariance, out[-1].covariance)


def errors_of(cycles, truth):
    """Root mean square error of the position, m, and of the velocity, m/s, of tracks of these cycles."""
    tracks = Tracks.join(cycles)
    where, velocity = truth.at(tracks.origin, tracks.time_s)
    apart = to_plane(tracks.position_deg, ORIGIN_DEG) - where, tracks.velocity_m_s - velocity
    return [float(np.sqrt((error**2).sum(axis=1).mean())) for error in apart]


def test_an_ais_track_whose_messages_are_in_a_radar_track_is_of_it_and_not_fused_again():
    """Rows: a radar track that holds 7, one that holds nothing, AIS 7 at the first, AIS 8 beside it, AIS 9 at the second."""
    place = ORIGIN_DEG + np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 1e-5], [0.0, 2e-5], [0.1, 1e-5]])
    source, mmsi = np.array([0, 0, 1, 1, 1]), np.array([-1, -1, 7, 8, 9])
    spread, zero = np.tile(np.eye(4), (5, 1, 1)), np.zeros(5)
    each = np.arange(5), source, zero, place, np.zeros((5, 2)), spread, spread[:, :2, :2], zero, zero
    tracks = Tracks(*each, mmsi, np.full(5, -1), held_mmsi=np.array([7, -1, -1, -1, -1]))
    kinds = np.array([SourceKind.RADAR, SourceKind.AIS])
    held = find_merged_ais(tracks, kinds, 1000.0)
    assert (held.ais.tolist(), held.holder.tolist()) == ([2], [0])
    spots = held.spots_of_others(Spots(np.zeros((1, 3)), np.zeros(5, np.int64), np.array([0, 0]), np.array([2, 4])))
    assert (len(spots.spot), spots.halo_row.tolist()) == (4, [3])
    # the method, which does not see AIS 7, pairs AIS 8 with the first and AIS 9 with the second
    found = Associations(np.array([0, 1]), np.array([2, 3]), np.array([5.0, 5.0]), np.array([0, 1, 0, 1]), 2)
    joined = held.joined_to(found, tracks, kinds)
    assert joined.vessel.tolist() == [0, 1, 0, 2, 1]
    assert list(zip(joined.first.tolist(), joined.second.tolist(), strict=True)) == [(0, 2), (1, 4)]
    counted, fused, _ = counted_once(tracks, joined, VesselBearings.empty(), kinds)
    assert counted.track_id.tolist() == [0, 1, 3, 4]
    assert fused.vessel.tolist() == [0, 1, 2, 1]
    assert list(zip(fused.first.tolist(), fused.second.tolist(), strict=True)) == [(1, 3)]


@pytest.mark.parametrize(("is_distance", "statistic"), [(True, (5.0, 40.0)), (False, (40.0, 5.0))])
def test_the_better_pair_of_the_vessel_of_a_held_track_stands(is_distance, statistic):
    """Rows: radar 0 that holds AIS 7, radar 1 near it, AIS 7, AIS 8. Radar 1 is paired with radar 0 and, less well, with AIS 8."""
    place = ORIGIN_DEG + np.array([[0.0, 0.0], [0.0, 4e-5], [0.0, 1e-5], [0.0, 4.4e-4]])
    spread, zero = np.tile(np.eye(4), (4, 1, 1)), np.zeros(4)
    each = np.arange(4), np.array([0, 1, 2, 2]), zero, place, np.zeros((4, 2)), spread, spread[:, :2, :2], zero, zero
    tracks = Tracks(*each, np.array([-1, -1, 7, 8]), np.full(4, -1), held_mmsi=np.array([7, -1, -1, -1]))
    kinds = np.array([SourceKind.RADAR, SourceKind.RADAR, SourceKind.AIS])
    held = find_merged_ais(tracks, kinds, 1000.0)
    found = Associations(np.array([0, 1]), np.array([1, 2]), np.array(statistic), np.zeros(3, np.int64), 2)
    found = replace(found, statistic_is_distance=is_distance)
    joined = held.joined_to(found, tracks, kinds)
    assert list(zip(joined.first.tolist(), joined.second.tolist(), strict=True)) == [(0, 1), (0, 2)]
    assert joined.vessel.tolist() == [0, 0, 0, 1]


def test_messages_without_a_radar_turn_keep_a_track():
    truth = world(1, 33, kick_m_s=0.0, side_nm=1.0)
    messages = messages_of(truth, [0], 33, every_s=3.0)
    _, out = run(TableTracker(method="vimmjipda_sequential", messages=ALWAYS), Plots.empty(), messages)
    assert [len(tracks) for tracks in out[1:]] == [1] * (CYCLES - 1)
    assert out[-1].updated_s[0] == messages.time_s[-1]
