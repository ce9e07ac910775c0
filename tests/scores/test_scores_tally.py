"""What a run adds up: the whole of the scores, and the dark flags."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scores_world import RADAR, bearing_tracks, joined, picture, tracks
from simulated_world import CENTRE_DEG, START_S, recorded, sensors

from coastwatch.batches import AisReports, BearingAssociations, Flag, FusedTracks, Stations
from coastwatch.geodesy import NAUTICAL_MILE_M, within_any
from coastwatch.scores import Tally, add, result
from coastwatch.scores.dark import Dark, watch, without_reports
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.oracle

WITH_STATION = replace(
    sensors(), stations=Stations(np.array(["shore"], "U32"), CENTRE_DEG[None], np.array([40.0 * NAUTICAL_MILE_M]))
)
MADE = recorded(40, cycles=60, ais={"silent_share": 0.2})
TIMES = MADE.truth.time_s[1:]


@dataclass(frozen=True)
class Cycle:
    """What a perfect chain would yield, but for what a test changes."""

    time_s: float
    tracks: Any
    associations: Any
    fused: FusedTracks
    bearing_tracks: Any
    picture: Any
    bearing_associations: Any


def perfect(time_s, made=MADE, east_m=0.0):
    """Every vessel in radar range has a radar track, every AIS vessel an AIS track, both where it truly is."""
    truth = made.truth.at(time_s)
    seen = np.isin(truth.vessel, np.unique(made.reports.radar.origin))
    heard = np.isin(truth.vessel, np.unique(made.reports.ais.origin))
    row = np.concatenate([np.flatnonzero(seen), np.flatnonzero(heard)])
    source = [RADAR] * int(seen.sum()) + [sensors().ais_source] * int(heard.sum())
    who, vessel = np.unique(truth.vessel[row], return_inverse=True)
    here = np.searchsorted(truth.vessel, who)
    place, velocity = truth.position_deg[here].copy(), truth.velocity_m_s[here]
    place[:, 1] += east_m / 102_470.0  # metres a degree of longitude at 23 degrees south
    covariance = np.tile(np.diag([4.0, 4.0, 1.0, 1.0]), (len(who), 1, 1))
    n = int(seen.sum())
    pairs = np.arange(n)
    return Cycle(
        time_s,
        tracks(source, truth.vessel[row], truth.position_deg[row], truth.velocity_m_s[row]),
        joined(vessel),
        FusedTracks(np.full(len(who), time_s), place, velocity, covariance),
        bearing_tracks(truth.vessel[seen]),
        picture(who, who + 1000, np.where(np.isin(who, made.reports.ais.origin), 0, int(Flag.DARK)), place),
        BearingAssociations(pairs, np.searchsorted(who, truth.vessel[seen]), np.zeros(n), np.zeros(1)),
    )


def over(cycles, made=MADE, where=WITH_STATION):
    tally = Tally()
    for cycle in cycles:
        tally = add(tally, cycle, made, where)
    return tally


def test_a_perfect_chain_scores_perfectly():
    scores = result(over([perfect(t) for t in TIMES[-20:]]), MADE, WITH_STATION)
    for stage in ("associations", "bearing_associations"):
        assert scores[stage]["f1"] == 1.0
        assert scores[stage]["fn"] == scores[stage]["fp"] == 0
    fusion = scores["fused_tracks"]
    assert fusion["position_rmse_m"] == pytest.approx(0.0, abs=1e-6)
    assert fusion["nees"] == pytest.approx(0.0, abs=1e-6)
    assert 0.9 < fusion["bound_position_rmse_m"] < 2.0
    assert 4.0 * fusion["bound_position_rmse_m"] < fusion["radar_bound_position_rmse_m"] < 30.0
    assert fusion["count"] == scores["associations"]["tp"] > 0
    shown = scores["picture"]
    assert shown["dark_recall"] == 1.0
    assert shown["dark_false_rate"] == 0.0
    assert shown["silent_vessels_in_cover"] == shown["silent_vessels_flagged"] > 0
    assert (shown["purity"], shown["id_switches"], shown["longest_single_id"]) == (1.0, 0, 1.0)
    json.dumps(scores, allow_nan=False)


def test_an_offset_is_the_error_and_the_bound_does_not_move():
    plain, moved = (
        result(over([perfect(t, east_m=e) for t in TIMES[-5:]]), MADE, WITH_STATION)["fused_tracks"] for e in (0.0, 6.0)
    )
    assert moved["position_rmse_m"] == pytest.approx(6.0, abs=0.02)
    assert moved["nees"] == pytest.approx(9.0, abs=0.1)
    assert moved["radar_position_rmse_m"] == pytest.approx(0.0, abs=1e-6)
    assert moved["bound_position_rmse_m"] == plain["bound_position_rmse_m"]


def test_the_bound_is_taken_over_the_vessels_that_count():
    both = np.intersect1d(MADE.reports.ais.origin, MADE.reports.radar.origin)
    cycles = [perfect(t) for t in TIMES[-5:]]
    only = [
        replace(c, associations=joined(np.where(c.tracks.origin == both[0], 0, 1 + np.arange(len(c.tracks))))) for c in cycles
    ]
    sizes = [int(c.associations.vessel.max()) + 1 for c in only]
    filled = [
        replace(c, fused=FusedTracks(np.full(n, c.time_s), np.zeros((n, 2)), np.zeros((n, 2)), np.full((n, 4, 4), np.nan)))
        for c, n in zip(only, sizes, strict=True)
    ]
    tally = over(filled)
    assert [list(origin) for _, origin in tally.counted] == [[both[0]]] * 5
    assert tally.nees_count == 0
    fusion = result(tally, MADE, WITH_STATION)["fused_tracks"]
    assert fusion["nees"] is None
    assert fusion["bound_position_rmse_m"] < 10.0


def test_a_saved_tally_goes_on_alike():
    cycles = [perfect(t) for t in TIMES[-10:]]
    whole, half = over(cycles), load(save(over(cycles[:5])))
    for cycle in cycles[5:]:
        half = add(half, cycle, MADE, WITH_STATION)
    assert result(half, MADE, WITH_STATION) == result(whole, MADE, WITH_STATION)


def test_without_truth_there_is_no_score():
    blind = replace(MADE, truth=None)
    tally = add(Tally(), perfect(TIMES[-1]), blind, WITH_STATION)
    assert tally.fused.count == 0
    assert result(tally, blind, WITH_STATION) == {}


def test_without_known_origins_nothing_is_decided():
    unknown = perfect(TIMES[-1])
    unknown = replace(
        unknown,
        tracks=replace(unknown.tracks, origin=np.full(len(unknown.tracks), -1)),
        bearing_tracks=replace(unknown.bearing_tracks, origin=np.full(len(unknown.bearing_tracks), -1)),
    )
    scores = result(over([unknown]), replace(MADE, noise=None), WITH_STATION)
    assert scores["associations"] == scores["bearing_associations"] == {}
    assert scores["picture"] == {"gospa_rms_m": 0.0, "ospa_mean_m": 0.0}, "places are compared whoever is where"
    assert scores["fused_tracks"]["position_rmse_m"] is None
    assert scores["fused_tracks"]["bound_position_rmse_m"] is None


def test_recordings_without_noises_keep_no_list_and_have_no_bound():
    plain = replace(MADE, noise=None)
    tally = over([perfect(t) for t in TIMES[-3:]], plain)
    assert tally.counted == ()
    assert result(tally, plain, WITH_STATION)["fused_tracks"]["bound_position_rmse_m"] is None


def test_no_cycle_scores_nothing():
    scores = result(Tally(), MADE, WITH_STATION)
    assert scores["associations"] == {}
    assert scores["fused_tracks"]["count"] == 0


# ---- dark flags ----------------------------------------------------------------------------------------------------


def flagged(shown, time_s, silent, made=MADE, where=WITH_STATION):
    before = Dark.empty(V=len(made.truth.vessel))
    return watch(before, silent, made.truth, time_s, made.reports.ais, shown, where)


def test_a_flag_is_due_after_two_minutes_in_cover():
    silent = without_reports(MADE.truth.vessel, MADE.reports.ais)
    assert set(MADE.silenced) <= set(silent.tolist())
    nothing = picture([])
    assert flagged(nothing, START_S + 119.0, silent).due_count == 0
    late = flagged(nothing, START_S + 121.0, silent)
    now = MADE.truth.at(START_S + 121.0)
    inside = within_any(now.position_deg, sensors().radars.site_deg, sensors().radars.range_m)
    assert 0 < late.due_count <= int(np.isin(now.vessel[inside], silent).sum())
    assert late.flagged_count == late.clear_count == 0
    assert late.as_dict()["dark_recall"] == 0.0
    assert late.as_dict()["dark_false_rate"] is late.as_dict()["dark_recall_where_seen"] is None


def test_right_and_wrong_flags_are_counted_apart():
    silent = without_reports(MADE.truth.vessel, MADE.reports.ais)
    due = np.flatnonzero(flagged(picture([]), TIMES[-1], silent).due)
    heard = np.unique(MADE.reports.ais.origin)[:3]
    shown = picture([due[0], due[1], *heard, -1], flags=[Flag.DARK, Flag.COASTING, Flag.DARK | Flag.COASTING, 0, 0, Flag.DARK])
    got = flagged(shown, TIMES[-1], silent)
    assert (got.flagged_count, got.clear_count, got.false_count) == (1, 4, 2)
    np.testing.assert_array_equal(got.false_ids, [2, 5])
    assert got.as_dict()["silent_vessels_flagged"] == 1


def test_nobody_is_dark_where_no_station_listens():
    silent = without_reports(MADE.truth.vessel, MADE.reports.ais)
    deaf = flagged(picture([]), TIMES[-1], silent, where=sensors())
    assert deaf.due_count == 0


def test_who_is_heard_now_is_not_silent():
    heard = np.unique(MADE.reports.ais.origin)
    assert flagged(picture([]), TIMES[-1], heard).due_count == 0
    gone = replace(MADE, reports=replace(MADE.reports, ais=AisReports.empty()))
    assert flagged(picture([]), TIMES[-1], heard, made=gone).due_count > 0
