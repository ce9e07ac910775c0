"""Radar tracks: both methods are pure and resumable, equal to rounding, and one vessel is one track."""

from __future__ import annotations

import pickle
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from radar_world import ORIGIN_DEG, plots_of, two_radars, world

from coastwatch.batches import Plots
from coastwatch.geodesy import to_plane
from coastwatch.tracks import FilterpyImm, Imm, RadarTracker
from coastwatch.tracks.table import Table

METHODS = [Imm(), FilterpyImm()]
PERIOD_S = 3.0
ROUNDING = 1e-9  # relative; the two gains differ by rounding times the condition of the innovation
OWN_M = 150.0  # four standard deviations of the widest plots: a track farther from its vessel is another's


def cut(plots, cycle):
    return plots.take((plots.time_s > PERIOD_S * cycle) & (plots.time_s <= PERIOD_S * (cycle + 1)))


def run(method, plots, cycles, sensors=None, region=0, memory=None, first=0):
    sensors = sensors or two_radars()
    memory = method.init() if memory is None else memory
    out = []
    for cycle in range(first, first + cycles):
        memory, tracks = method.step(memory, cut(plots, cycle), PERIOD_S * (cycle + 1), sensors, region)
        out.append(tracks)
    return memory, out


def flat(value):
    """Everything in a memory as one list of arrays and numbers."""
    if is_dataclass(value):
        return [x for f in fields(value) for x in flat(getattr(value, f.name))]
    return [value]


def same(a, b):
    return all(np.array_equal(x, y, equal_nan=True) for x, y in zip(flat(a), flat(b), strict=True))


@pytest.fixture(scope="module")
def busy():
    """Forty vessels, misses and clutter, for ten cycles."""
    return plots_of(world(40, 5, turning=True), two_radars(), 30.0, 5, detection=0.9, clutter_per_m2=1e-7)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_step_is_pure(method, busy):
    memory, _ = run(method, busy, 4)
    kept, plots = pickle.loads(pickle.dumps(memory)), cut(busy, 4)
    kept_plots = pickle.loads(pickle.dumps(plots))
    first = method.step(memory, plots, 5 * PERIOD_S, two_radars(), 0)
    second = method.step(memory, plots, 5 * PERIOD_S, two_radars(), 0)
    assert same(memory, kept)
    assert same(plots, kept_plots)
    assert same(first[0], second[0])
    assert same(first[1], second[1])


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_pickled_in_mid_run_it_resumes_to_the_bit(method, busy):
    whole, tracks = run(method, busy, 8)
    half, _ = run(method, busy, 4)
    resumed, rest = run(method, busy, 4, memory=pickle.loads(pickle.dumps(half)), first=4)
    assert same(whole, resumed)
    assert same(tracks[-1], rest[-1])


@pytest.mark.parametrize("origin", ["estimated", "known"])
def test_filterpy_is_equal_to_rounding(busy, origin):
    fast, slow = Imm(plot_origin=origin), FilterpyImm(plot_origin=origin)
    one, ours = run(fast, busy, 10)
    other, theirs = run(slow, busy, 10)
    assert len(ours[-1]) > 15
    for name in ("state", "covariance", "mode"):
        got, want = getattr(one.table, name), getattr(other.table, name)
        np.testing.assert_allclose(got, want, rtol=ROUNDING, atol=ROUNDING * np.abs(want).max())
    for a, b in zip(ours, theirs, strict=True):
        assert np.array_equal(a.track_id, b.track_id)
        np.testing.assert_allclose(a.position_deg, b.position_deg, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-7, atol=1e-8)


def test_one_vessel_seen_by_two_radars_is_one_track():
    """All cycles, all vessels: never a second confirmed track near a vessel, and every vessel in cover has one."""
    truth, sensors = world(150, 6), two_radars()
    plots = plots_of(truth, sensors, 90.0, 6)
    _, out = run(Imm(), plots, 30)
    for cycle, tracks in enumerate(out):
        vessels, count = np.unique(tracks.origin, return_counts=True)
        assert (count == 1).all()
        assert -1 not in vessels
        if cycle >= 5:
            seen = np.unique(plots.origin[(plots.time_s > PERIOD_S * (cycle - 4)) & (plots.time_s <= PERIOD_S * (cycle - 3))])
            kept = np.unique(plots.origin[(plots.time_s > PERIOD_S * (cycle - 1)) & (plots.time_s <= PERIOD_S * (cycle + 1))])
            assert np.isin(np.intersect1d(seen, kept), vessels).mean() > 0.97
    assert np.array_equal(out[-1].track_id, np.unique(out[-1].track_id))


def test_clutter_and_misses():
    """Pd 0.9 and 5e-7 false plots a square metre and turn: few false tracks, tracks stay with their vessel."""
    truth, sensors = world(200, 8), two_radars()
    plots = plots_of(truth, sensors, 120.0, 8, detection=0.9, clutter_per_m2=5e-7)
    _, out = run(Imm(), plots, 40)
    false, true, changed, owner = 0, 0, 0, {}
    for cycle, tracks in enumerate(out[10:], 10):
        where, _ = truth.at(np.maximum(tracks.origin, 0), np.full(len(tracks), PERIOD_S * (cycle + 1)))
        own = (tracks.origin >= 0) & (np.hypot(*(to_plane(tracks.position_deg, ORIGIN_DEG) - where).T) < OWN_M)
        false, true = false + int((~own).sum()), true + int(own.sum())
        for track, origin in zip(tracks.track_id[own].tolist(), tracks.origin[own].tolist(), strict=True):
            changed += owner.setdefault(track, origin) != origin
            owner[track] = origin
    assert false < 0.06 * true  # clutter alone makes three short tracks at a time in 460 km2
    assert changed <= 2  # swaps between vessels, in 90 s
    assert true > 0.97 * 30 * 105  # 105 vessels are in cover


def test_two_tracks_of_one_vessel_become_one():
    """Every track doubled, as after two radars began one each: within some turns the younger ones are gone."""
    plots = plots_of(world(40, 17), two_radars(), 60.0, 17)
    memory, out = run(Imm(), plots, 8)
    twin = replace(
        memory.table, track_id=memory.table.track_id + memory.next_id, radar_s=np.full_like(memory.table.radar_s, -np.inf)
    )
    doubled = replace(memory, table=Table.join([memory.table, twin]), next_id=2 * memory.next_id)
    _, after = run(Imm(), plots, 12, memory=doubled, first=8)
    assert len(np.unique(after[0].origin)) < len(after[0])
    assert np.isin(out[-1].track_id, after[-1].track_id).mean() > 0.9
    _, count = np.unique(after[-1].origin, return_counts=True)
    assert (count == 1).all()


def test_ships_abreast_stay_two():
    """Two ships 60 m apart on one course, seen by both radars from 4 km: two tracks throughout."""
    one = world(1, 18)
    place = to_plane(two_radars().radars.site_deg[0], ORIGIN_DEG) + np.array([[4000.0, -500.0], [4060.0, -500.0]])
    pair = replace(
        one,
        start_m=place,
        velocity_m_s=np.tile([0.0, 5.0], (2, 1)),
        rate_rad_s=np.zeros(2),
        kick_s=np.repeat(one.kick_s, 2, axis=0),
        kick_m_s=np.zeros((2, one.kick_m_s.shape[1], 2)),
    )
    plots = plots_of(pair, two_radars(), 120.0, 18)
    _, out = run(Imm(), plots, 40)
    assert [len(tracks) for tracks in out[12:]] == [2] * 28


def test_a_young_track_is_given_fewer_misses():
    """After 4 plots 2 misses end it, after 20 it takes 5; of one radar, so that a look is a turn."""
    sensors = two_radars()
    one = replace(sensors, radars=sensors.radars.take(slice(1, 2)))
    plots = plots_of(world(60, 19), one, 120.0, 19)
    beacon, rest = plots.take(plots.origin == plots.origin[0]), plots.take(plots.origin != plots.origin[0])

    def alive(hits, turns):
        memory = Imm().init()
        there = Plots.join([beacon, rest.take(rest.time_s < PERIOD_S * hits)])
        for cycle in range(hits + turns):
            memory, tracks = Imm().step(memory, cut(there, cycle), PERIOD_S * (cycle + 1), one, 0)
        return len(tracks) - 1

    assert alive(5, 1) > 10
    assert alive(5, 4) == 0
    assert alive(20, 4) > 10
    assert alive(20, 7) == 0


def test_known_origin_drops_clutter_and_starts_at_two_plots():
    truth, sensors = world(60, 9), two_radars()
    plots = plots_of(truth, sensors, 30.0, 9, clutter_per_m2=5e-7)
    _, out = run(Imm(plot_origin="known"), plots, 10)
    until = plots.take((plots.time_s <= 30.0) & (plots.origin >= 0))
    vessels, count = np.unique(until.origin, return_counts=True)
    assert np.array_equal(np.sort(out[-1].origin), vessels[count >= 2])


def test_errors_are_as_large_as_the_covariance_says():
    truth, sensors = world(150, 10), two_radars()
    plots = plots_of(truth, sensors, 120.0, 10)
    _, out = run(Imm(plot_origin="known"), plots, 40)
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
    _, out = run(Imm(), plots, 20)
    tracks = out[-1]
    sites = to_plane(sensors.radars.site_deg, ORIGIN_DEG)
    place = to_plane(tracks.position_deg, ORIGIN_DEG)
    nearest = np.hypot(*(place[:, None] - sites).transpose(2, 0, 1)).min(axis=1)
    eigen = np.linalg.eigvalsh(tracks.report_covariance)
    across = (nearest * sensors.radars.azimuth_sigma_rad[0]) ** 2
    np.testing.assert_allclose(eigen.sum(axis=1), 100.0 + across, rtol=0.01)


def test_a_lost_track_coasts_then_ends_and_its_id_is_not_used_again():
    truth, sensors = world(30, 12), two_radars()
    plots = plots_of(truth, sensors, 120.0, 12)
    silent = plots.take((plots.time_s < 30.0) | (plots.time_s > 75.0))
    method = Imm()
    _, out = run(method, silent, 40)
    before, coasting, gone, after = out[9], out[15], out[22], out[35]
    assert len(coasting) == len(before) > 10
    assert (coasting.updated_s <= 30.0).all()
    assert (coasting.time_s == 48.0).all()
    assert len(gone) == 0
    assert len(after) > 10
    assert after.track_id.min() > before.track_id.max()


def test_ids_are_of_the_region():
    sensors = two_radars(region=1)
    plots = plots_of(world(20, 13), sensors, 30.0, 13)
    _, out = run(Imm(), plots, 10, sensors, region=1)
    assert len(out[-1]) > 0
    assert (out[-1].track_id // 2**40 == 1).all()
    assert (out[-1].source == 1).all()


def test_order_of_plots_within_a_cycle_is_of_no_matter(busy):
    method = Imm()
    memory, _ = run(method, busy, 5)
    plots = cut(busy, 5)
    shuffled = plots.take(np.random.default_rng([14, 1]).permutation(len(plots)))
    one = method.step(memory, plots, 6 * PERIOD_S, two_radars(), 0)
    other = method.step(memory, shuffled, 6 * PERIOD_S, two_radars(), 0)
    assert same(one[1], other[1])


def test_plots_that_come_a_cycle_late_still_count():
    """One radar's plots arrive 2 s late, hence out of order with the other's: as many tracks, hardly worse."""
    truth, sensors = world(100, 15), two_radars()
    plots = plots_of(truth, sensors, 90.0, 15)
    received = plots.time_s + np.where(plots.sensor == 0, 2.0, 0.0)
    method, memory = Imm(), Imm().init()
    for cycle in range(30):
        there = (received > PERIOD_S * cycle) & (received <= PERIOD_S * (cycle + 1))
        memory, tracks = method.step(memory, plots.take(there), PERIOD_S * (cycle + 1), sensors, 0)
    _, prompt = run(method, plots, 30)
    assert len(tracks) >= 0.97 * len(prompt[-1])
    _, count = np.unique(tracks.origin, return_counts=True)
    assert (count == 1).all()
    where, _ = truth.at(tracks.origin, np.full(len(tracks), 90.0))
    assert np.sqrt(((to_plane(tracks.position_deg, ORIGIN_DEG) - where) ** 2).sum(axis=1).mean()) < 25.0


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_no_plot_and_one_plot(method):
    sensors = two_radars()
    memory, tracks = method.step(method.init(), Plots.empty(), 3.0, sensors, 0)
    assert len(tracks) == 0
    plots = plots_of(world(20, 16), sensors, 6.0, 16)
    memory, tracks = method.step(memory, cut(plots, 0).take(slice(0, 1)), 3.0, sensors, 0)
    assert len(tracks) == 0
    assert len(memory.table) == 1


@pytest.mark.parametrize(("column", "value"), [("position_m", np.nan), ("time_s", np.inf), ("time_s", np.nan), ("time_s", 1e6)])
def test_a_plot_that_is_no_number_or_of_the_future_is_dropped(busy, column, value):
    method = Imm()
    memory, _ = run(method, busy, 5)
    plots = cut(busy, 5)
    bad = getattr(plots, column).copy()
    bad[0] = value
    after, tracks = method.step(memory, replace(plots, **{column: bad}), 6 * PERIOD_S, two_radars(), 0)
    want, clean = method.step(memory, plots.take(slice(1, None)), 6 * PERIOD_S, two_radars(), 0)
    assert after.dropped == want.dropped + 1
    assert same(tracks, clean)


def test_old_and_repeated_plots_do_no_harm(busy):
    """Time that goes backwards by a minute, and every plot twice: the tracks stay, nothing is divided by zero."""
    method = Imm()
    memory, out = run(method, busy, 8)
    plots = cut(busy, 8)
    old = replace(plots, time_s=plots.time_s - 60.0)
    memory, tracks = method.step(memory, Plots.join([plots, plots, old]), 9 * PERIOD_S, two_radars(), 0)
    assert len(tracks) >= len(out[-1]) - 2
    assert np.isfinite(tracks.position_deg).all()
    assert np.isin(out[-1].track_id, tracks.track_id).mean() > 0.9


def test_settings_from_text_and_back():
    reader = TypeAdapter(RadarTracker)
    made = reader.validate_python({"method": "filterpy_imm", "upkeep": {"delete_misses": 4}})
    assert isinstance(made, FilterpyImm)
    assert reader.validate_python(made.model_dump()) == made
    with pytest.raises(ValidationError, match=r"upkeep\.gate"):
        reader.validate_python({"method": "imm", "upkeep": {"gate": 0.9}})
    with pytest.raises(ValidationError, match="confirm_hits"):
        reader.validate_python({"method": "imm", "upkeep": {"confirm_hits": 6}})


def test_a_memory_of_other_radars_is_refused(busy):
    memory, _ = run(Imm(), busy, 1)
    sensors = two_radars()
    one = replace(sensors, radars=sensors.radars.take(slice(0, 1)))
    with pytest.raises(ValueError, match="got 2 radars, needed 1"):
        Imm().step(memory, Plots.empty(), 6.0, one, 0)
