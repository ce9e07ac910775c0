"""Radar tracks: all methods are pure and resumable, equal to rounding, and one vessel is one track."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from as_bytes import same
from pydantic import TypeAdapter, ValidationError
from radar_world import ORIGIN_DEG, PERIOD_S, cut, every_tracker, plots_of, run, two_radars, world

from coastwatch.batches import Plots
from coastwatch.geodesy import to_plane
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import MultiHypothesisLiteral, RadarTracker, RegionInput, TableTracker
from coastwatch.tracks.radar.bank import Filterpy
from coastwatch.tracks.radar.clutter import ClutterSettings

pytestmark = pytest.mark.contract

METHODS = every_tracker()
UNLIKE = [  # that take their plots each by a code of its own
    TableTracker(method="sided_imm"),
    TableTracker(method="vimmjipda"),
    TableTracker(method="multi_hypothesis"),
    TableTracker(method="sided_multi_hypothesis"),
    MultiHypothesisLiteral(plot_sigma_m=30.0, clutter_per_m2=1e-7, nearest_new_m=100.0, gate=9.21),
]
ROUNDING = 1e-9  # relative; the two gains differ by rounding times the condition of the innovation


@pytest.fixture(scope="module")
def busy():
    """Forty vessels, misses and clutter, for ten cycles."""
    return plots_of(world(40, 5, turning=True), two_radars(), 30.0, 5, detection=0.9, clutter_per_m2=1e-7)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_step_is_deterministic_and_does_not_write_into_plots(method, busy):
    memory, _ = run(method, busy, 4)
    again, plots = load(save(memory)), cut(busy, 4)
    kept_plots = copy.deepcopy(plots)
    first = method.step(memory, RegionInput.of_plots(plots, 5 * PERIOD_S, two_radars()))
    second = method.step(again, RegionInput.of_plots(plots, 5 * PERIOD_S, two_radars()))
    assert same(plots, kept_plots)
    assert same(first[0], second[0])
    assert same(first[1].tracks, second[1].tracks)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_saved_in_mid_run_it_resumes_to_the_bit(method, busy):
    whole, tracks = run(method, busy, 8)
    half, _ = run(method, busy, 4)
    resumed, rest = run(method, busy, 4, memory=load(save(half)), first=4)
    assert same(whole, resumed)
    assert same(tracks[-1], rest[-1])


@pytest.mark.parametrize("origin", ["estimated", "known"])
def test_filterpy_is_equal_to_rounding(busy, origin):
    fast, slow = TableTracker(method="imm", plot_origin=origin), TableTracker(method="filterpy_imm", plot_origin=origin)
    one, ours = run(fast, busy, 10)
    other, theirs = run(slow, busy, 10)
    assert len(ours[-1]) > 15
    for name in ("state", "covariance", "mode_probability"):
        got, want = getattr(one.table, name)[one.table.live], getattr(other.table, name)[other.table.live]
        np.testing.assert_allclose(got, want, rtol=ROUNDING, atol=ROUNDING * np.abs(want).max())
    for a, b in zip(ours, theirs, strict=True):
        assert np.array_equal(a.track_id, b.track_id)
        np.testing.assert_allclose(a.position_deg, b.position_deg, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-7, atol=1e-8)


def test_known_origin_drops_clutter_and_starts_at_two_plots():
    truth, sensors = world(60, 9), two_radars()
    plots = plots_of(truth, sensors, 30.0, 9, clutter_per_m2=5e-7)
    _, out = run(TableTracker(method="sided_imm", plot_origin="known"), plots, 10)
    until = plots.take((plots.time_s <= 30.0) & (plots.origin >= 0))
    vessels, count = np.unique(until.origin, return_counts=True)
    assert np.array_equal(np.sort(out[-1].origin), vessels[count >= 2])


def test_known_origin_with_clutter_alone_has_no_tracks():
    """A file without the true vessels has only such plots."""
    plots = plots_of(world(20, 9), two_radars(), 9.0, 9)
    memory, out = run(TableTracker(method="sided_imm", plot_origin="known"), replace(plots, origin=np.full(len(plots), -1)), 3)
    assert [len(tracks) for tracks in out] == [0, 0, 0]
    assert len(memory.table) == 0


def test_a_late_plot_does_not_move_the_site_back(busy):
    memory, _ = run(TableTracker(method="sided_imm"), busy, 5)
    before = memory.site_m.copy()
    late = cut(busy, 4).take(slice(0, 1))
    late = replace(late, time_s=late.time_s - 2.0, site_m=late.site_m + 5000.0)
    memory, _ = TableTracker(method="sided_imm").step(memory, RegionInput.of_plots(late, 6 * PERIOD_S, two_radars()))
    assert np.array_equal(memory.site_m, before)


def test_errors_are_as_large_as_the_covariance_says():
    truth, sensors = world(150, 10), two_radars()
    plots = plots_of(truth, sensors, 120.0, 10)
    _, out = run(TableTracker(method="sided_imm", plot_origin="known"), plots, 40)
    tracks = out[-1]
    where, velocity = truth.at(tracks.origin, np.full(len(tracks), 120.0))
    error = np.hstack([to_plane(tracks.position_deg, ORIGIN_DEG) - where, tracks.velocity_m_s - velocity])
    square = (error * np.linalg.solve(tracks.covariance, error[..., None])[..., 0]).sum(axis=1)
    assert 1.0 < square.mean() < 6.0  # 4 for the very model; the bank is prepared for manoeuvres that these vessels do not make
    ahead = np.sqrt((error[:, :2] ** 2).sum(axis=1).mean())
    assert ahead < 20.0  # m; 35 m is what single plots are worth here


def test_what_a_plot_is_worth_at_the_track():
    truth, sensors = world(60, 11), two_radars()
    plots = plots_of(truth, sensors, 60.0, 11)
    _, out = run(TableTracker(method="sided_imm"), plots, 20)
    tracks = out[-1]
    sites = to_plane(sensors.radars.site_deg, ORIGIN_DEG)
    place = to_plane(tracks.position_deg, ORIGIN_DEG)
    nearest = np.hypot(*(place[:, None] - sites).transpose(2, 0, 1)).min(axis=1)
    eigen = np.linalg.eigvalsh(tracks.report_covariance)
    across = (nearest * sensors.radars.azimuth_sigma_rad[0]) ** 2
    np.testing.assert_allclose(eigen.sum(axis=1), 100.0 + across, rtol=0.01)


def test_ids_are_of_the_region():
    sensors = two_radars(region=1)
    plots = plots_of(world(20, 13), sensors, 30.0, 13)
    _, out = run(TableTracker(method="sided_imm"), plots, 10, sensors, region=1)
    assert len(out[-1]) > 0
    assert (out[-1].track_id // 2**40 == 1).all()
    assert (out[-1].source == 1).all()


def test_order_of_plots_within_a_cycle_is_of_no_matter(busy):
    method = TableTracker(method="sided_imm")
    memory, _ = run(method, busy, 5)
    plots = cut(busy, 5)
    shuffled = plots.take(np.random.default_rng([14, 1]).permutation(len(plots)))
    again = load(save(memory))
    _, one = method.step(memory, RegionInput.of_plots(plots, 6 * PERIOD_S, two_radars()))
    _, other = method.step(again, RegionInput.of_plots(shuffled, 6 * PERIOD_S, two_radars()))
    assert same(one.tracks, other.tracks)


def test_plots_of_one_time_are_tracked_alike_in_any_order(busy):
    """All plots of a radar in a cycle have one time stamp, as in recordings of whole seconds."""
    method = TableTracker(method="sided_imm")
    memories, rng = [method.init(), method.init()], np.random.default_rng([14, 2])
    for cycle in range(6):
        now_s = (cycle + 1) * PERIOD_S
        plots = cut(busy, cycle)
        plots = replace(plots, time_s=now_s - 0.5 * plots.sensor)
        orders = np.arange(len(plots)), rng.permutation(len(plots))
        found = [
            method.step(m, RegionInput.of_plots(plots.take(o), now_s, two_radars()))
            for m, o in zip(memories, orders, strict=True)
        ]
        memories = [memory for memory, *_ in found]
    assert same(memories[0], memories[1])
    assert same(found[0][1].tracks, found[1][1].tracks)
    assert len(found[0][1].tracks) > 10


def test_plots_that_come_a_cycle_late_still_count():
    """One radar's plots arrive 2 s late, hence out of order with the other's: as many tracks, hardly worse."""
    truth, sensors = world(100, 15), two_radars()
    plots = plots_of(truth, sensors, 90.0, 15)
    received = plots.time_s + np.where(plots.sensor == 0, 2.0, 0.0)
    method, memory = TableTracker(method="sided_imm"), TableTracker(method="sided_imm").init()
    for cycle in range(30):
        there = (received > PERIOD_S * cycle) & (received <= PERIOD_S * (cycle + 1))
        memory, (tracks, *_) = method.step(memory, RegionInput.of_plots(plots.take(there), PERIOD_S * (cycle + 1), sensors))
    _, prompt = run(method, plots, 30)
    assert len(tracks) >= 0.97 * len(prompt[-1])
    _, count = np.unique(tracks.origin, return_counts=True)
    assert (count == 1).all()
    where, _ = truth.at(tracks.origin, np.full(len(tracks), 90.0))
    assert np.sqrt(((to_plane(tracks.position_deg, ORIGIN_DEG) - where) ** 2).sum(axis=1).mean()) < 25.0


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_no_plot_and_one_plot(method):
    sensors = two_radars()
    memory, (tracks, *_) = method.step(method.init(), RegionInput.of_plots(Plots.empty(), 3.0, sensors))
    assert len(tracks) == 0
    plots = plots_of(world(20, 16), sensors, 6.0, 16)
    memory, (tracks, *_) = method.step(memory, RegionInput.of_plots(cut(plots, 0).take(slice(0, 1)), 3.0, sensors))
    assert len(tracks) == 0
    assert len(memory.table) == 1


@pytest.mark.parametrize("method", UNLIKE, ids=lambda m: m.method)
@pytest.mark.parametrize(
    ("column", "value"), [("position_m", np.nan), ("time_s", np.inf), ("time_s", np.nan), ("time_s", 1e6), ("time_s", -1e300)]
)
def test_a_plot_that_is_no_number_or_of_the_future_is_dropped(busy, method, column, value):
    memory, _ = run(method, busy, 5)
    plots = cut(busy, 5)
    bad = getattr(plots, column).copy()
    bad[0] = value
    again = load(save(memory))
    _, got = method.step(memory, RegionInput.of_plots(replace(plots, **{column: bad}), 6 * PERIOD_S, two_radars()))
    _, clean = method.step(again, RegionInput.of_plots(plots.take(slice(1, None)), 6 * PERIOD_S, two_radars()))
    assert got.dropped == clean.dropped + 1 == 1
    assert same(got.tracks, clean.tracks)


@pytest.mark.parametrize("method", UNLIKE, ids=lambda m: m.method)
def test_old_and_repeated_plots_do_no_harm(busy, method):
    """Time that goes backwards by a minute, and every plot twice: the tracks stay, nothing is divided by zero."""
    memory, out = run(method, busy, 8)
    plots = cut(busy, 8)
    old = replace(plots, time_s=plots.time_s - 60.0)
    memory, (tracks, *_) = method.step(
        memory, RegionInput.of_plots(Plots.join([plots, plots, old]), 9 * PERIOD_S, two_radars())
    )
    assert len(tracks) >= len(out[-1]) - 2
    assert np.isfinite(tracks.position_deg).all()
    assert np.isin(out[-1].track_id, tracks.track_id).mean() > 0.9


def test_settings_from_text_and_back():
    reader = TypeAdapter(RadarTracker)
    made = reader.validate_python({"method": "filterpy_imm", "upkeep": {"delete_misses": 4}})
    assert isinstance(made.bank, Filterpy)
    assert reader.validate_python(made.model_dump()) == made
    with pytest.raises(ValidationError, match=r"upkeep\.hits\.gate"):
        reader.validate_python({"method": "imm", "upkeep": {"gate": 0.9}})
    with pytest.raises(ValidationError, match="confirm_hits"):
        reader.validate_python({"method": "imm", "upkeep": {"confirm_hits": 6}})


def test_a_memory_of_other_radars_is_refused(busy):
    memory, _ = run(TableTracker(method="sided_imm"), busy, 1)
    sensors = two_radars()
    one = replace(sensors, radars=sensors.radars.take(slice(0, 1)))
    with pytest.raises(ValueError, match="got 2 radars, needed 1"):
        TableTracker(method="sided_imm").step(memory, RegionInput.of_plots(Plots.empty(), 6.0, one))
    with pytest.raises(ValueError, match="got 9 models, needed 3"):
        TableTracker(method="imm").step(memory, RegionInput.of_plots(Plots.empty(), 6.0, sensors))


LEARNT = [
    method.model_copy(update={"clutter": ClutterSettings(learnt=True)})
    for method in METHODS
    if method.association.method != "known_origin"
]


@pytest.mark.parametrize("method", LEARNT, ids=lambda m: m.method)
def test_with_a_clutter_map_it_resumes_to_the_bit(method, busy):
    whole, tracks = run(method, busy, 8)
    half, _ = run(method, busy, 4)
    resumed, rest = run(method, busy, 4, memory=load(save(half)), first=4)
    assert same(whole, resumed)
    assert same(tracks[-1], rest[-1])
    assert whole.clutter.turns.min() > 5.0
    assert whole.clutter.plots.sum() > 20.0


def test_a_clutter_map_makes_standing_echoes_begin_no_tracks():
    """A field of echoes that stand, each seen in most turns, and vessels under way through it."""
    random, sensors = np.random.default_rng([77]), two_radars()
    near = replace(sensors, radars=replace(sensors.radars, range_m=np.full(2, 2500.0)))
    vessels = plots_of(world(20, 9), sensors, 90.0, 9)
    times = np.arange(0.5, 90.0, 2.0)
    place = random.uniform(-1500.0, 1500.0, (100, 2))
    seen = random.random((len(times), len(place))) < 0.7
    turn, echo = np.nonzero(seen)
    example = vessels.take(np.zeros(len(turn), np.int64))
    noise = random.normal(0.0, 5.0, (len(turn), 2))
    covariance = np.tile(25.0 * np.eye(2), (len(turn), 1, 1))
    echoes = replace(
        example,
        time_s=times[turn],
        position_m=place[echo] + noise,
        covariance=covariance,
        sensor=np.zeros(len(turn), np.int64),
        origin=np.full(len(turn), -1),
    )
    plots = Plots.join([vessels, echoes])
    _, constant = run(TableTracker(method="sided_imm"), plots, 30, near)
    _, learnt = run(TableTracker(method="sided_imm", clutter=ClutterSettings(learnt=True, cell_m=8.0)), plots, 30, near)
    standing = [(tracks[-1].origin < 0).sum() for tracks in (constant, learnt)]
    under_way = [len(np.unique(tracks[-1].origin[tracks[-1].origin >= 0])) for tracks in (constant, learnt)]
    assert standing[1] < 0.6 * standing[0]
    assert under_way[1] >= under_way[0]
