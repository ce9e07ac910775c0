"""The life of radar tracks: one vessel is one track, clutter begins few, lost ones end and are not confused with new ones."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from radar_world import ORIGIN_DEG, PERIOD_S, cut, plots_of, run, two_radars, world

from coastwatch.batches import Plots
from coastwatch.geodesy import KNOT_M_S, to_plane
from coastwatch.tracks import RegionInput, TableTracker

pytestmark = pytest.mark.contract

OWN_M = 150.0  # four standard deviations of the widest plots: a track farther from its vessel is another's


def test_one_vessel_seen_by_two_radars_is_one_track():
    """All cycles, all vessels: never a second confirmed track near a vessel, and every vessel in cover has one."""
    truth, sensors = world(150, 6), two_radars()
    plots = plots_of(truth, sensors, 90.0, 6)
    _, out = run(TableTracker(method="sided_imm"), plots, 30)
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
    _, out = run(TableTracker(method="sided_imm"), plots, 40)
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


@pytest.mark.parametrize(("speed_kn", "kept"), [(59.0, True), (95.0, False)])
def test_a_track_is_deleted_for_its_speed_only_where_its_noise_cannot_explain_it(speed_kn: float, kept: bool):
    """A boat of 60 knots was a chain of short tracks: each ended when its noisy speed passed the limit of 60."""
    truth, sensors = world(8, 31), two_radars()
    start_m = np.column_stack([np.full(8, -4000.0), 1100.0 * (np.arange(8) - 3.5)])
    velocity_m_s = np.tile([speed_kn * KNOT_M_S, 0.0], (8, 1))
    abreast = replace(truth, start_m=start_m, velocity_m_s=velocity_m_s, kick_m_s=0.0 * truth.kick_m_s)
    _, out = run(TableTracker(method="vimmjipda"), plots_of(abreast, sensors, 150.0, 31), 50)
    ids = {int(track) for tracks in out for track in tracks.track_id}
    shown = sum(len(tracks) for tracks in out[15:]) / 35
    assert (shown > 6.0 and len(ids) <= 10) if kept else shown < 2.0


def test_two_tracks_of_one_vessel_become_one():
    """Every track doubled, as after two radars began one each: within some turns the younger ones are gone."""
    plots = plots_of(world(40, 17), two_radars(), 60.0, 17)
    memory, out = run(TableTracker(method="sided_imm"), plots, 8)
    old, first_id = memory.table.live, memory.next_id
    table, slots = memory.table.with_slots(first_id + np.arange(len(old)))
    for f in fields(table):
        if f.metadata["shape"][0] == "S" and f.name != "track_id":
            getattr(table, f.name)[slots] = getattr(table, f.name)[old]
    table.radar_s[slots] = -np.inf
    doubled = replace(memory, table=table, next_id=first_id + len(old))
    _, after = run(TableTracker(method="sided_imm"), plots, 12, memory=doubled, first=8)
    assert len(np.unique(after[0].origin)) < len(after[0])
    assert np.isin(out[-1].track_id, after[-1].track_id).mean() > 0.9
    _, count = np.unique(after[-1].origin, return_counts=True)
    assert (count == 1).all()


@pytest.mark.parametrize("method", ["sided_imm", "sided_vimmjipda"])
def test_ships_abreast_stay_two(method):
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
    _, out = run(TableTracker(method=method), plots, 40)
    assert [len(tracks) for tracks in out[12:]] == [2] * 28


def test_a_young_track_is_given_fewer_misses():
    """After 4 plots 2 misses end it, after 20 it takes 5; of one radar, so that a look is a turn."""
    sensors = two_radars()
    one = replace(sensors, radars=sensors.radars.take(slice(1, 2)))
    plots = plots_of(world(60, 19), one, 120.0, 19)
    beacon, rest = plots.take(plots.origin == plots.origin[0]), plots.take(plots.origin != plots.origin[0])

    def alive(hits, turns):
        memory = TableTracker(method="sided_imm").init()
        there = Plots.join([beacon, rest.take(rest.time_s < PERIOD_S * hits)])
        for cycle in range(hits + turns):
            memory, (tracks, *_) = TableTracker(method="sided_imm").step(
                memory, RegionInput.of_plots(cut(there, cycle), PERIOD_S * (cycle + 1), one)
            )
        return len(tracks) - 1

    assert alive(5, 1) > 10
    assert alive(5, 4) == 0
    assert alive(20, 4) > 10
    assert alive(20, 7) == 0


def test_a_lost_track_coasts_then_ends_and_its_id_is_not_used_again():
    truth, sensors = world(30, 12), two_radars()
    plots = plots_of(truth, sensors, 120.0, 12)
    silent = plots.take((plots.time_s < 30.0) | (plots.time_s > 75.0))
    method = TableTracker(method="sided_imm")
    _, out = run(method, silent, 40)
    before, coasting, gone, after = out[9], out[15], out[22], out[35]
    assert len(coasting) == len(before) > 10
    assert (coasting.updated_s <= 30.0).all()
    assert (coasting.time_s == 48.0).all()
    _, by_existence = run(TableTracker(method="vimmjipda"), silent, 40)
    for lost, found in ((gone, after), (by_existence[22], by_existence[35])):
        assert len(lost) == 0
        assert len(found) > 10
        assert found.track_id.min() > before.track_id.max()
