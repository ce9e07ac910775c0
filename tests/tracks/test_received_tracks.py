"""Tracks of other systems: identity, patience, velocity and covariance; they come out as they came in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coastwatch.batches import Sensors, TrackReports, Tracks, TrackSources
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.scenario.sites import TrackSource, sensors_of
from coastwatch.server import checkpoint
from coastwatch.tracks import ReceivedInput, ReceivedTracks

pytestmark = pytest.mark.contract

HOME = np.array([50.0, -1.0])
SIGMA_M, SIGMA_M_S = 30.0, 0.4


def sensors(**more: float) -> Sensors:
    return sensors_of((), (), (), [TrackSource(name="coast", **more), TrackSource(name="port")])


def states(
    time_s: float,
    number: list[int],
    metres: np.ndarray,
    velocity: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
) -> TrackReports:
    n = len(number)
    return TrackReports(
        sensor=np.zeros(n, np.int64),
        number=np.array(number, np.int64),
        time_s=np.full(n, time_s),
        received_s=np.full(n, time_s),
        position_deg=offset_deg(np.tile(HOME, (n, 1)), metres),
        velocity_m_s=np.full((n, 2), np.nan) if velocity is None else velocity,
        covariance=np.full((n, 4, 4), np.nan) if covariance is None else covariance,
        origin=np.full(n, -1, np.int64),
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_number_keeps_its_track_among_those_of_all_sources_in_any_order(seed: int) -> None:
    g, method, two = np.random.default_rng(seed), ReceivedTracks(), sensors(patience_s=1e6)
    memory, expected = method.init(), dict[tuple[int, int], int]()
    for cycle in range(5):
        n = int(g.integers(0, 40))
        number = g.choice(np.array([0, 1, 5, 2**40, 2**61, *range(100, 160)]), n, replace=False)
        sent = replace(states(10.0 * cycle, number.tolist(), np.zeros((n, 2))), sensor=g.integers(0, 2, n))
        memory, _ = method.step(memory, ReceivedInput(sent, 10.0 * cycle, two, Tracks.empty()))
        found = memory.table
        now = dict(zip(zip(found.sensor.tolist(), found.number.tolist(), strict=True), found.track.tolist(), strict=True))
        assert len(now) == len(found)
        assert {key: now[key] for key in expected if key in now} == {key: expected[key] for key in expected if key in now}
        assert set(zip(sent.sensor.tolist(), sent.number.tolist(), strict=True)) <= set(now)
        expected = now


def test_a_track_comes_out_as_it_came_in() -> None:
    root = np.random.default_rng(1).normal(size=(2, 4, 4))
    covariance, velocity = root @ root.swapaxes(1, 2) + np.eye(4), np.array([[5.0, 1.0], [-3.0, 2.0]])
    sent = states(99.0, [7, 3], np.array([[0.0, 0.0], [4000.0, 0.0]]), velocity, covariance)
    method = ReceivedTracks()
    memory, tracks = method.step(method.init(), ReceivedInput(sent, 100.0, sensors(), Tracks.empty()))
    order = [1, 0]  # by number
    np.testing.assert_array_equal(tracks.position_deg, sent.position_deg[order])
    np.testing.assert_array_equal(tracks.velocity_m_s, velocity[order])
    np.testing.assert_array_equal(tracks.covariance, covariance[order])
    assert (tracks.time_s == 99.0).all()
    assert (tracks.mmsi == -1).all()
    again = method.step(memory, ReceivedInput(TrackReports.empty(), 110.0, sensors(), Tracks.empty()))[1]
    assert again.track_id.tolist() == tracks.track_id.tolist()
    assert (again.updated_s == 99.0).all()


def test_a_number_is_another_track_after_a_jump_and_after_its_patience() -> None:
    method, here = ReceivedTracks(), np.zeros((1, 2))
    memory, first = method.step(method.init(), ReceivedInput(states(1.0, [5], here), 1.0, sensors(), Tracks.empty()))
    memory, same = method.step(
        memory, ReceivedInput(states(4.0, [5], here + np.array([30.0, 0.0])), 4.0, sensors(), Tracks.empty())
    )
    memory, jumped = method.step(
        memory, ReceivedInput(states(7.0, [5], here + np.array([9000.0, 0.0])), 7.0, sensors(), Tracks.empty())
    )
    memory, silent = method.step(memory, ReceivedInput(TrackReports.empty(), 60.0, sensors(), Tracks.empty()))
    _, back = method.step(
        memory, ReceivedInput(states(61.0, [5], here + np.array([9000.0, 0.0])), 61.0, sensors(), Tracks.empty())
    )
    assert same.track_id == first.track_id
    assert len(silent) == 0
    assert len({int(t.track_id[0]) for t in (first, jumped, back)}) == 3


def test_a_track_that_is_sent_slowly_is_kept_for_its_own_intervals() -> None:
    method, memory = ReceivedTracks(), ReceivedTracks().init()
    for time_s in (0.0, 28.0, 56.0):
        memory, _ = method.step(
            memory, ReceivedInput(states(time_s, [5], np.zeros((1, 2))), time_s + 0.1, sensors(), Tracks.empty())
        )
    alive = [
        len(method.step(memory, ReceivedInput(TrackReports.empty(), t, sensors(), Tracks.empty()))[1]) for t in (120.0, 130.0)
    ]
    assert alive == [1, 0]


@pytest.mark.parametrize(
    ("north_m", "numbers", "alive"),
    [
        (20.0, [9], [9]),  # the vessel under another number
        (900.0, [9], [5, 9]),  # another vessel
        (20.0, [5, 9], [5, 9]),  # two ships side by side: both are sent
        (20.0, [], [5]),  # nothing is sent for a while
    ],
)
def test_a_track_that_goes_on_under_another_number_ends(north_m: float, numbers: list[int], alive: list[int]) -> None:
    """A source that renumbered its tracks made two vessels of each for as long as its patience."""
    method, memory = ReceivedTracks(), ReceivedTracks().init()
    tracks, velocity = Tracks.empty(), np.array([[5.0, 0.0]])
    for cycle in range(20):
        now = [5] if cycle < 15 else numbers
        metres = np.array([[15.0 * cycle, north_m * (number != 5)] for number in now]).reshape(-1, 2)
        sent = states(3.0 * cycle, now, metres, np.tile(velocity, (len(now), 1)))
        before = checkpoint.save(memory)
        after, tracks = method.step(memory, ReceivedInput(sent, 3.0 * cycle + 1.0, sensors(), Tracks.empty()))
        assert checkpoint.save(memory) == before
        memory = after
        if cycle >= 15:
            assert memory.table.number.tolist() == alive
            assert len(tracks) == len(alive)


def test_an_older_state_changes_nothing_and_order_does_not_matter() -> None:
    method, metres = ReceivedTracks(), np.array([[0.0, 0.0], [50.0, 0.0], [1000.0, 0.0]])
    one, two = states(1.0, [1, 2, 3], metres), states(4.0, [1, 2, 3], metres + 10.0)
    both = TrackReports.join([one, two])
    _, tracks = method.step(method.init(), ReceivedInput(both, 5.0, sensors(), Tracks.empty()))
    memory, mixed = method.step(
        method.init(), ReceivedInput(both.take(np.array([5, 0, 3, 1, 4, 2])), 5.0, sensors(), Tracks.empty())
    )
    np.testing.assert_array_equal(tracks.position_deg, mixed.position_deg)
    _, late = method.step(memory, ReceivedInput(one, 6.0, sensors(), Tracks.empty()))
    np.testing.assert_array_equal(late.position_deg, two.position_deg)


def test_a_velocity_that_is_not_sent_is_that_between_two_positions() -> None:
    method = ReceivedTracks()
    memory, first = method.step(
        method.init(), ReceivedInput(states(0.0, [1], np.zeros((1, 2))), 0.0, sensors(), Tracks.empty())
    )
    assert first.velocity_m_s.tolist() == [[0.0, 0.0]]
    assert first.covariance[0, 2, 2] > 9.0**2
    _, second = method.step(
        memory, ReceivedInput(states(10.0, [1], np.array([[60.0, -20.0]])), 10.0, sensors(), Tracks.empty())
    )
    np.testing.assert_allclose(second.velocity_m_s, [[6.0, -2.0]], atol=1e-3)


def test_a_velocity_is_kept_while_steps_are_too_short_to_measure_it() -> None:
    method, memory, seen = ReceivedTracks(), ReceivedTracks().init(), []
    for time_s in (0.0, 1.01, 2.0, 3.02, 4.0, 4.99, 6.01):  # 1 Hz with jitter: three steps are shorter than 1 s
        sent = states(time_s, [1], np.array([[10.0 * time_s, -4.0 * time_s]]))
        memory, tracks = method.step(memory, ReceivedInput(sent, time_s, sensors(), Tracks.empty()))
        seen.append(tracks.velocity_m_s[0])
        assert tracks.time_s == time_s
        np.testing.assert_array_equal(tracks.position_deg, sent.position_deg)
    assert seen[0].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(seen[1:], np.tile([10.0, -4.0], (6, 1)), atol=1e-3)


def test_a_fast_source_is_measured_over_a_second_and_follows_a_turn() -> None:
    method, memory, east = ReceivedTracks(), ReceivedTracks().init(), []
    for k in range(21):  # 10 m/s east for 1 s, then 10 m/s north; 10 Hz in binary fractions, so that 8 steps are 1 s
        metres = 10.0 * np.array([[min(k, 8), max(k - 8, 0)]]) / 8.0
        memory, tracks = method.step(memory, ReceivedInput(states(k / 8.0, [1], metres), k / 8.0, sensors(), Tracks.empty()))
        east.append(tracks.velocity_m_s[0].round(2).tolist())
    assert east == [[0.0, 0.0]] * 8 + [[10.0, 0.0]] * 8 + [[0.0, 10.0]] * 5


def test_a_jump_takes_no_velocity_from_the_track_before() -> None:
    method, memory = ReceivedTracks(), ReceivedTracks().init()
    for time_s, east_m in ((0.0, 0.0), (2.0, 20.0), (2.5, 9000.0), (3.0, 9005.0), (3.5, 9010.0)):
        sent = states(time_s, [1], np.array([[east_m, 0.0]]))
        memory, tracks = method.step(memory, ReceivedInput(sent, time_s, sensors(), Tracks.empty()))
        if 2.0 < time_s < 3.5:
            assert tracks.velocity_m_s.tolist() == [[0.0, 0.0]]
            assert tracks.covariance[0, 2, 2] > 9.0**2
    np.testing.assert_allclose(tracks.velocity_m_s, [[10.0, 0.0]], atol=1e-3)


@pytest.mark.parametrize("stamp_s", [86_403.0, 8.5, np.inf, np.nan])
def test_a_state_from_the_future_is_dropped_and_counted(stamp_s: float) -> None:
    method, here = ReceivedTracks(ahead_s=5.0), np.zeros((1, 2))
    memory, first = method.step(method.init(), ReceivedInput(states(0.0, [1], here), 0.0, sensors(), Tracks.empty()))
    right, wrong = states(3.0, [1], here + 10.0), states(stamp_s, [1, 2], np.array([[90.0, 0.0], [500.0, 0.0]]))
    memory, second = method.step(memory, ReceivedInput(TrackReports.join([right, wrong]), 3.0, sensors(), Tracks.empty()))
    assert memory.dropped.tolist() == [2, 0]
    assert second.track_id.tolist() == first.track_id.tolist()
    np.testing.assert_array_equal(second.position_deg, right.position_deg)
    memory, third = method.step(memory, ReceivedInput(states(6.0, [1], here + 20.0), 6.0, sensors(), Tracks.empty()))
    assert third.time_s.tolist() == [6.0]
    assert memory.dropped.tolist() == [2, 0]
    memory, ahead = method.step(memory, ReceivedInput(states(14.0, [1], here + 30.0), 9.0, sensors(), Tracks.empty()))
    assert ahead.time_s.tolist() == [14.0]  # by ahead_s exactly
    assert memory.dropped.tolist() == [2, 0]
    assert checkpoint.load(checkpoint.save(memory)).dropped.tolist() == [2, 0]
    memory, same = method.step(memory, ReceivedInput(states(13.0, [1], here + 90.0), 15.0, sensors(), Tracks.empty()))
    assert same.time_s.tolist() == [14.0]
    assert memory.dropped.tolist() == [3, 0]  # it is older than the one that is kept
    memory, _ = method.step(memory, ReceivedInput(states(14.0, [1], here + 30.0), 18.0, sensors(), Tracks.empty()))
    assert memory.dropped.tolist() == [3, 0]  # the same again


def world(cycles: int, seed: int, share: float = 0.5) -> tuple[np.ndarray, Tracks]:
    """The covariance that a source without any gets, from 20 vessels of which a share has AIS, and its tracks."""
    rng, method, memory = np.random.default_rng(seed), ReceivedTracks(), ReceivedTracks().init()
    at, velocity = rng.uniform(-20e3, 20e3, (20, 2)), rng.uniform(-8.0, 8.0, (20, 2))
    heard = int(20 * share)
    tracks = Tracks.empty()
    for cycle in range(cycles):
        now = 3.0 * (cycle + 1)
        true = at + now * velocity
        ais = replace(
            Tracks.empty(),
            track_id=np.arange(heard),
            source=np.full(heard, 2),
            time_s=np.full(heard, now),
            position_deg=offset_deg(np.tile(HOME, (heard, 1)), true[:heard]),
            velocity_m_s=velocity[:heard],
            covariance=np.tile(np.eye(4) * 0.01, (heard, 1, 1)),
            report_covariance=np.tile(np.eye(2) * 0.01, (heard, 1, 1)),
            updated_s=np.full(heard, now),
            started_s=np.zeros(heard),
            mmsi=np.arange(heard),
            origin=np.full(heard, -1),
        )
        noisy = true + rng.normal(0.0, SIGMA_M, true.shape), velocity + rng.normal(0.0, SIGMA_M_S, true.shape)
        memory, tracks = method.step(memory, ReceivedInput(states(now, list(range(20)), *noisy), now, sensors(), ais))
    return np.sqrt(np.diagonal(tracks.covariance[0])), tracks


def test_a_covariance_that_is_not_given_is_estimated_from_the_differences_to_ais() -> None:
    sigma, _ = world(60, 1)
    np.testing.assert_allclose(sigma, [SIGMA_M, SIGMA_M, SIGMA_M_S, SIGMA_M_S], rtol=0.25)  # 256 samples: 3 sigma are 0.2
    sigma, _ = world(60, 1, share=0.0)
    assert sigma.tolist() == [50.0, 50.0, 1.0, 1.0]


def test_a_run_that_is_resumed_gives_the_same_tracks() -> None:
    method, rng = ReceivedTracks(), np.random.default_rng(3)
    memory = method.init()
    for cycle in range(6):
        sent = states(3.0 * cycle, [1, 2, 9], rng.uniform(0.0, 20.0, (3, 2)))
        copy = checkpoint.load(checkpoint.save(memory))
        memory, tracks = method.step(memory, ReceivedInput(sent, 3.0 * cycle, sensors(), Tracks.empty()))
        _, resumed = method.step(copy, ReceivedInput(sent, 3.0 * cycle, sensors(), Tracks.empty()))
        assert resumed.track_id.tobytes() == tracks.track_id.tobytes()
        assert resumed.covariance.tobytes() == tracks.covariance.tobytes()
    assert np.abs(difference_m(tracks.position_deg, sent.position_deg)).max() == 0.0


@pytest.mark.parametrize("name", ["coast", "port"])
def test_sources_are_numbered_before_ais(name: str) -> None:
    found = sensors()
    assert found.source_names == ("coast", "port", "ais")
    assert found.source_names[found.track_source([*found.track_sources.name].index(name))] == name
    assert found.ais_source == 2
    assert isinstance(found.track_sources, TrackSources)


def test_the_size_and_the_alternative_that_another_centre_sends_are_those_of_the_track() -> None:
    method, sent = ReceivedTracks(), states(1.0, [4, 9], np.array([[0.0, 0.0], [900.0, 0.0]]))
    sent = replace(sent, echo_length_m=np.array([210.0, np.nan]), echo_axis_deg=np.array([75.0, np.nan]))
    sent = replace(sent, alternative_m=np.array([np.nan, 80.0]))
    _, found = method.step(method.init(), ReceivedInput(sent, 1.0, sensors(), Tracks.empty()))
    np.testing.assert_array_equal(found.echo_length_m, [210.0, np.nan])
    np.testing.assert_array_equal(found.echo_axis_deg, [75.0, np.nan])
    np.testing.assert_array_equal(found.alternative_m, [np.nan, 80.0])
    assert np.isnan(found.echo_width_m).all()


@pytest.mark.parametrize("interval_s", [36.0, 60.0])
def test_a_source_that_sends_more_rarely_than_its_patience_is_known_by_its_interval(interval_s: float) -> None:
    """One track ends between its first two states, which are told apart; from then on tracks of that source wait for the next one."""
    method, memory, ids, shown = ReceivedTracks(), ReceivedTracks().init(), list[set[int]](), list[int]()
    for cycle in range(200):
        time_s, step = 3.0 * cycle, round(interval_s / 3.0)
        sent = states(time_s, [5], np.array([[5.0 * time_s, 0.0]])) if cycle % step == 0 else TrackReports.empty()
        memory, tracks = method.step(memory, ReceivedInput(sent, time_s, sensors(), Tracks.empty()))
        memory = checkpoint.load(checkpoint.save(memory))
        ids, shown = [*ids, set(tracks.track_id.tolist())], [*shown, len(tracks)]
    assert len(set.union(*ids)) == 2
    assert min(shown[round(interval_s / 3.0) :]) == 1
    for cycle in range(200, 350):
        memory, tracks = method.step(memory, ReceivedInput(TrackReports.empty(), 3.0 * cycle, sensors(), Tracks.empty()))
    assert (len(tracks), len(memory.table), len(memory.lost)) == (0, 0, 0)


@pytest.mark.parametrize(("sigma_m", "interval_s"), [(20.0, 3.0), (50.0, 6.0)])
def test_a_velocity_made_of_two_positions_is_as_uncertain_as_they_make_it(sigma_m: float, interval_s: float) -> None:
    """Thirty vessels with AIS, whose source gives positions alone: also the error of these is learnt right."""
    rng, method, vessels = np.random.default_rng(2), ReceivedTracks(), 30
    start_m, course = rng.uniform(-2e4, 2e4, (vessels, 2)), rng.uniform(0.0, 2.0 * np.pi, vessels)
    velocity = rng.uniform(2.0, 9.0, (vessels, 1)) * np.column_stack([np.sin(course), np.cos(course)])
    memory, where, one, nees = method.init(), sensors(), np.ones(vessels), list[np.ndarray]()
    for cycle in range(100):
        time_s = interval_s * cycle
        place_m = start_m + velocity * time_s
        sent = states(time_s, list(range(1, vessels + 1)), place_m + rng.normal(0.0, sigma_m, place_m.shape))
        ais = Tracks(
            where.ais_source * 10**9 + np.arange(vessels), np.full(vessels, where.ais_source), time_s * one,
            offset_deg(np.tile(HOME, (vessels, 1)), place_m), velocity, np.tile(np.diag([9.0, 9.0, 0.01, 0.01]), (vessels, 1, 1)),
            np.tile(9.0 * np.eye(2), (vessels, 1, 1)), time_s * one, 0.0 * one, np.full(vessels, -1), np.full(vessels, -1),
        )  # fmt: skip
        memory, tracks = method.step(memory, ReceivedInput(sent, time_s, where, ais))
        if cycle >= 40:
            off = np.hstack([difference_m(tracks.position_deg, ais.position_deg), tracks.velocity_m_s - velocity])
            nees.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(tracks.covariance), off))
    assert np.linalg.eigvalsh(tracks.covariance).min() > 0.0
    assert 3.5 < np.concatenate(nees).mean() < 4.5
    assert method.summary(memory, where).position_sigma_m[0] == pytest.approx(sigma_m, rel=0.1)
