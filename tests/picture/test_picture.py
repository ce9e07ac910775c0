"""Identity and flags: what an id must survive and when a flag is up."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from checkpoint_world import is_checked

from coastwatch.batches import (
    AisAlarms,
    AisDetection,
    Associations,
    Flag,
    FusedTracks,
    Radars,
    Sensors,
    Sonars,
    Stations,
    Tracks,
    TrackSources,
)
from coastwatch.geodesy import offset_deg
from coastwatch.picture import Identity, PictureInput
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

SITE = np.array([50.0, -1.0])
PERIOD_S = 3.0
EAST_M_S = 4.0


def sensors(ais_range_m=50e3, radar_range_m=50e3):
    one, two = np.array(["a"], "U32"), np.array(["r1", "r2"], "U32")
    radars = Radars(
        two,
        np.array([0, 1]),
        np.stack([SITE, SITE]),
        np.full(2, radar_range_m),
        np.full(2, 3.0),
        np.full(2, 10.0),
        np.full(2, 0.005),
    )
    return Sensors(
        radars, Stations(one, SITE[None], np.array([ais_range_m])), Sonars.empty(), ("west", "east"), np.stack([SITE, SITE])
    )


def cycle_of(cycle, rows):
    """Tracks of rows (track_id, source, vessel number, east_m, mmsi, origin, and perhaps age in s, start in s): all sail east at 4 m/s."""
    time_s = PERIOD_S * cycle
    n = len(rows)
    ids, source, vessel, east, mmsi, origin = (
        (np.array([r[k] for r in rows]) for k in range(6)) if n else (np.zeros(0, int),) * 6
    )
    at = offset_deg(np.broadcast_to(SITE, (n, 2)), np.stack([east + EAST_M_S * time_s, np.zeros(n)], axis=1))
    velocity = np.tile([EAST_M_S, 0.0], (n, 1))
    covariance = np.tile(np.diag([25.0, 25.0, 0.1, 0.1]), (n, 1, 1))
    tracks = Tracks(
        ids,
        source,
        np.full(n, time_s),
        at,
        velocity,
        covariance,
        np.tile(100.0 * np.eye(2), (n, 1, 1)),
        time_s - np.array([row[6] if len(row) > 6 else 0.0 for row in rows]),
        np.array([row[7] if len(row) > 7 else 0.0 for row in rows]),
        mmsi,
        origin,
    )
    count = int(vessel.max()) + 1 if n else 0
    first = np.array([np.flatnonzero(vessel == v)[0] for v in range(count)], np.int64)
    none = np.zeros(0, np.int64)
    fused = FusedTracks(np.full(count, time_s), at[first], velocity[first], covariance[first])
    return tracks, Associations(none, none, np.zeros(0), vessel.astype(np.int64)), fused


def alarms(tracks, twice=(), impossible=()):
    ais = tracks.take(tracks.mmsi >= 0)
    return AisAlarms(ais.track_id, ais.mmsi, np.isin(ais.track_id, impossible), np.isin(ais.track_id, twice))


def play(script, method=None, where=None, detection=None, jump=None, **alarm):
    """The pictures of a script: for each cycle the rows of `cycle_of`.

    Args: detection: of AIS tracks in every cycle; jump: the cycle in which the registration of both radars jumps.
    """
    method, where = method or Identity(), where or sensors()
    memory, out = method.init(), []
    for cycle, rows in enumerate(script):
        tracks, associations, fused = cycle_of(cycle, rows)
        jumped, checked = np.full(2, cycle == jump), is_checked(cycle) or cycle == jump
        frozen = save(memory) if checked else b""
        given = tracks, associations, fused, alarms(tracks, **alarm), PERIOD_S * cycle, where
        memory_1, (picture, members) = method.step(memory, PictureInput(*given, detection=detection, jumped=jumped))
        if checked:
            assert save(memory) == frozen, "a step must not write to its memory"
            resumed, (again, _) = method.step(load(frozen), PictureInput(*given, detection=detection, jumped=jumped))
            assert save(resumed) == save(memory_1)
            np.testing.assert_array_equal(again.vessel_id, picture.vessel_id)
        memory = memory_1
        out.append((picture, members))
    return out


RADAR, OTHER_RADAR, AIS = (1, 0, 0, 0.0, -1, 5), (2, 1, 0, 0.0, -1, 5), (3, 2, 0, 0.0, 235000001, 5)


def ids(out):
    return [p.vessel_id.tolist() for p, _ in out]


def test_an_id_is_no_mmsi_and_counts_up():
    out = play([[RADAR], [RADAR, (9, 0, 1, 5000.0, -1, 6)]])
    assert ids(out) == [[1], [1, 2]]


def test_it_survives_the_loss_and_the_return_of_ais():
    script = [[RADAR, AIS]] * 5 + [[RADAR]] * 5 + [[RADAR, AIS]] * 3
    out = play(script)
    assert ids(out) == [[1]] * 13
    assert {int(p.mmsi[0]) for p, _ in out} == {235000001}, "the name stays known"


def test_it_survives_a_hand_over_between_radars():
    out = play([[RADAR]] * 4 + [[RADAR, OTHER_RADAR]] * 2 + [[OTHER_RADAR]] * 4)
    assert ids(out) == [[1]] * 10


def test_it_survives_a_hand_over_with_a_gap():
    out = play([[RADAR]] * 4 + [[]] * 5 + [[OTHER_RADAR]] * 2)
    assert ids(out) == [[1]] * 11
    assert out[6][0].flags[0] & Flag.COASTING
    assert not out[9][0].flags[0] & Flag.COASTING


@pytest.mark.parametrize(("begins_s", "returns"), [(300.0, True), (0.0, False)])
def test_a_ship_that_radar_sees_again_first_has_its_id_back_when_its_ais_returns(begins_s, returns):
    """After a gap of both, seven ships of nine had new ids. Not where radar saw the other one beside it before the gap."""
    seen_again, ais = (9, 0, 0, 0.0, -1, 5, 0.0, begins_s), (8, 2, 0, 0.0, 235000001, 5, 0.0, 330.0)
    out = play([[RADAR, AIS]] * 20 + [[]] * 80 + [[seen_again]] * 10 + [[seen_again, ais]] * 10)
    before, last = ids(out)[10], ids(out)[-1]
    assert (before == last) == returns
    assert ids(out)[105] != before


@pytest.mark.parametrize(("begins_s", "more", "returns"), [(60.0, (), True), (15.0, (), False), (60.0, (12.0,), False)])
def test_a_vessel_that_turned_away_from_its_track_has_its_id_back(begins_s, more, returns):
    """Fast boats had a new id after each turn. Not where the second track began long before, or two may be the vessel."""
    later = [
        (20 + k, 0, 1 + k, 5.0 + 5.0 * k, -1, 5, 0.0, start_s)
        for k, start_s in enumerate((begins_s, *(begins_s + x for x in more)))
    ]
    losing = [[(1, 0, 0, 0.0, -1, 5, 3.0 * k), *later] for k in range(1, 6)]
    out = play([[RADAR]] * 20 + losing + [[(number, source, vessel - 1, *rest) for number, source, vessel, *rest in later]] * 5)
    assert ids(out)[10] == [1]
    assert (1 in out[-1][0].vessel_id[(out[-1][0].flags & Flag.COASTING) == 0]) == returns


def test_a_vessel_with_live_ais_keeps_its_id_when_a_source_renumbers_its_track():
    """The old number is only predicted: it kept the id, and took it along when it ended."""
    new = [(9, 1, 1, 0.0, -1, 5, 0.0, 60.0), (9, 1, 0, 0.0, -1, 5, 0.0, 60.0)]  # beside the vessel, then in it
    lost = [[(2, 1, vessel, 0.0, -1, 5, 3.0 * k), AIS, new[vessel]] for k, vessel in ((1, 0), (2, 0), (3, 1), (4, 1), (5, 1))]
    script = [[OTHER_RADAR, AIS]] * 20 + lost + [[new[1], AIS]] * 5
    one, here = np.ones(1), sensors()
    source = TrackSources(np.array(["vts"], "U32"), SITE[None], one, one, one, 30.0 * one)
    radars = here.radars.take(np.array([0]))
    vts = replace(here, radars=radars, region_names=("west",), region_origin_deg=SITE[None], track_sources=source)
    out = play(script, where=vts)
    assert {members.vessel_id[members.track_id == AIS[0]].tolist()[0] for _, members in out} == {1}
    assert out[-1][1].vessel_id.tolist() == [1, 1]
    # Two radar tracks of a region may be of two ships at one berth: the old one keeps the id of its vessel.
    out = play(script)
    assert out[24][1].vessel_id[out[24][1].track_id == OTHER_RADAR[0]].tolist() == [1]


@pytest.mark.parametrize(("began_s", "kept"), [(60.0, 1), (0.0, 2)])
def test_a_ship_that_changes_its_mmsi_under_radar_keeps_its_id(began_s, kept):
    """Not where the other AIS was heard beside it before: then radar has gone to another ship."""
    other = [(8, 2, vessel, 0.0, 235000002, 5, 0.0, began_s) for vessel in (1, 0)]
    before = [RADAR, AIS] if began_s else [RADAR, AIS, other[0]]
    silent = [(3, 2, vessel, 0.0, 235000001, 5, 3.0 * k) for k, vessel in ((1, 0), (2, 0), (3, 1), (4, 1))]
    apart = [[RADAR, track, other[0]] for track in silent[:2]] + [[RADAR, other[1], track] for track in silent[2:]]
    out = play([before] * 20 + apart + [[RADAR, other[1]]] * 5)
    assert {members.vessel_id[members.track_id == RADAR[0]].tolist()[0] for _, members in out[-5:]} == {kept}


def test_a_track_that_splits_from_its_ais_again_and_again_has_one_id_beside_it():
    """It had a new one at each split: sixty in fifty minutes."""
    apart, together = [RADAR, (3, 2, 1, 0.0, 235000001, 5)], [RADAR, AIS]
    seen = {vessel for now in ids(play([together] * 10 + ([apart] * 5 + [together] * 5) * 6)) for vessel in now}
    assert len(seen) == 2


def test_ais_alone_returns_by_its_mmsi_after_minutes():
    script = [[AIS]] * 3 + [[]] * 200 + [[(77, 2, 0, 0.0, 235000001, 5)]]
    out = play(script)
    assert out[-1][0].vessel_id.tolist() == [1]
    assert len(out[150][0]) == 0, "it is not shown for ever"


def test_a_far_return_with_the_same_mmsi_is_another_vessel():
    out = play([[AIS]] * 3 + [[]] * 20 + [[(77, 2, 0, 90e3, 235000001, 6)]])
    assert out[-1][0].vessel_id.tolist()[-1] == 2


def test_of_a_ship_and_a_clone_that_return_together_the_nearer_has_the_id():
    for ship, clone in ((0, 1), (1, 0)):
        two = sorted([(77 + ship, 2, ship, 0.0, 235000001, 5), (77 + clone, 2, clone, 5000.0, 235000001, 6)])
        picture, members = play([[AIS]] * 40 + [[]] * 60 + [two] * 3)[-1]
        assert picture.vessel_id.tolist() == [1, 2]
        assert members.vessel_id[members.track_id == 77 + ship].tolist() == [1]


def test_a_vessel_joined_in_error_gets_its_id_back():
    stranger = (4, 2, 1, 400.0, 235000002, 6)
    script = [[RADAR, stranger]] * 3 + [[RADAR, (4, 2, 0, 400.0, 235000002, 6)]] * 2 + [[RADAR, stranger]] * 3
    out = play(script)
    assert ids(out)[0] == [1, 2]
    assert len(ids(out)[3]) == 1
    assert ids(out)[-1] == [1, 2]
    assert {m.vessel_id[m.track_id == 4][0] for _, m in out[-2:]} == {2}


def test_a_swap_of_radar_tracks_leaves_the_ids_with_ais():
    a, b = (3, 2, 0, 0.0, 235000001, 5), (4, 2, 1, 500.0, 235000002, 6)
    before = [(1, 0, 0, 0.0, -1, 5), a, (2, 0, 1, 500.0, -1, 6), b]
    after = [(2, 0, 0, 0.0, -1, 5), a, (1, 0, 1, 500.0, -1, 6), b]
    out = play([before] * 4 + [after] * 2)
    for picture, _ in out:
        assert dict(zip(picture.mmsi.tolist(), picture.vessel_id.tolist(), strict=True)) == {235000001: 1, 235000002: 2}


def flagged(out, flag):
    return [bool((p.flags & flag).any()) for p, _ in out]


def test_dark_only_after_a_while_and_only_where_ais_is_heard():
    script = [[RADAR, AIS]] * 5 + [[RADAR]] * 30
    up = flagged(play(script), Flag.DARK)
    assert up.index(True) == 5 + 20, "sixty seconds of three"
    assert not any(flagged(play(script, where=sensors(ais_range_m=100.0, radar_range_m=50e3)), Flag.DARK))


def test_the_last_ais_report_of_a_vessel_is_known_while_it_is_shown():
    method, heard_s = Identity(coast_s=10.0), []
    memory = method.init()
    for cycle, rows in enumerate([[RADAR]] * 2 + [[RADAR, AIS]] * 3 + [[RADAR]] * 3 + [[]] * 2):
        tracks, associations, fused = cycle_of(cycle, rows)
        memory, (picture, _) = method.step(
            memory, PictureInput(tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors())
        )
        assert memory.flags.ais_heard_s.shape == (len(picture),)
        heard_s += memory.flags.ais_heard_s.tolist()
    assert heard_s == [-np.inf, -np.inf, 6.0, 9.0, *[12.0] * 6]


def test_ais_without_radar_only_where_a_radar_sees():
    script = [[AIS]] * 30
    assert flagged(play(script), Flag.AIS_WITHOUT_RADAR)[-1]
    assert not any(flagged(play(script, where=sensors(radar_range_m=10.0)), Flag.AIS_WITHOUT_RADAR))
    assert not any(flagged(play([[RADAR, AIS]] * 30), Flag.AIS_WITHOUT_RADAR))


def test_ais_without_radar_only_with_a_report_since_it_was_missed():
    """One report in the first cycle, another one in cycle 40 of 3 s: it is 60 s after the radar was missed, the first one is not."""
    script = [[(*AIS, PERIOD_S * cycle)] for cycle in range(40)]
    assert not any(flagged(play(script), Flag.AIS_WITHOUT_RADAR))
    up = flagged(play(script + script[:20]), Flag.AIS_WITHOUT_RADAR)
    assert (up.index(True), all(up[40:])) == (40, True)
    missed_late = [[RADAR, (*AIS, PERIOD_S * cycle)] for cycle in range(39)]
    assert not any(flagged(play(missed_late + script), Flag.AIS_WITHOUT_RADAR))


def test_ais_without_radar_only_where_most_other_vessels_are_detected():
    script = [[AIS]] * 30
    for probability, is_set in ((0.6, True), (0.4, False)):
        detection = AisDetection(np.array([3]), np.array([probability]))
        assert flagged(play(script, detection=detection), Flag.AIS_WITHOUT_RADAR)[-1] == is_set
    assert not any(flagged(play(script, detection=AisDetection.empty()), Flag.AIS_WITHOUT_RADAR)), "beyond all radars"


def test_contradicted_when_ais_leaves_its_radar():
    away = (3, 2, 1, 600.0, 235000001, 5)
    out = play([[RADAR, AIS]] * 15 + [[RADAR, away]] * 10)
    up = [sorted((p.flags & Flag.AIS_CONTRADICTED > 0).tolist()) for p, _ in out]
    assert not any(any(u) for u in up[:15])
    assert up[-1] == [True, True]
    near = (3, 2, 1, 50.0, 235000001, 5)
    assert not any(flagged(play([[RADAR, AIS]] * 15 + [[RADAR, near]] * 10), Flag.AIS_CONTRADICTED))


def test_contradicted_only_where_most_other_vessels_are_detected():
    """Where no radar would see the vessel, a radar track elsewhere proves nothing against its AIS."""
    script = [[RADAR, AIS]] * 15 + [[RADAR, (3, 2, 1, 600.0, 235000001, 5)]] * 10
    for probability, is_set in ((0.6, True), (0.4, False)):
        detection = AisDetection(np.array([3]), np.array([probability]))
        assert flagged(play(script, detection=detection), Flag.AIS_CONTRADICTED)[-1] == is_set


def test_contradicted_not_when_ais_found_its_true_radar():
    other = (8, 0, 1, 600.0, -1, 6)
    out = play([[RADAR, AIS, other]] * 15 + [[RADAR, (3, 2, 1, 600.0, 235000001, 6), other]] * 10)
    assert not any(flagged(out, Flag.AIS_CONTRADICTED))


@pytest.mark.parametrize(("alarm", "flag"), [("twice", Flag.MMSI_TWICE), ("impossible", Flag.IMPOSSIBLE_SPEED)])
def test_alarms_become_flags(alarm, flag):
    out = play([[RADAR, AIS]], **{alarm: (3,)})
    assert flagged(out, flag) == [True]
    assert not any(flagged(play([[RADAR, AIS]]), flag))


def test_members_name_every_track_of_every_vessel():
    ((_, members),) = play([[RADAR, OTHER_RADAR, AIS, (9, 0, 1, 5000.0, -1, 6)]])
    rows = list(zip(members.vessel_id.tolist(), members.source.tolist(), members.track_id.tolist(), strict=True))
    assert rows == [(1, 0, 1), (1, 1, 2), (1, 2, 3), (2, 0, 9)]


def test_no_track_at_all():
    ((picture, members),) = play([[]])
    assert len(picture) == len(members) == 0


AGAIN = (9, *RADAR[1:])


def cycles_with(out, flag):
    return np.flatnonzero(flagged(out, flag)).tolist()


@pytest.mark.parametrize(("seen", "lost"), [(15, 5), (10, 25)])
def test_the_time_without_ais_goes_on_while_radar_loses_a_vessel(seen, lost):
    """It coasts for 15 s, or is hidden for 45 s more. No vessel becomes dark while no radar sees it."""
    out = play([[RADAR]] * seen + [[]] * lost + [[AGAIN]] * 3)
    assert cycles_with(out, Flag.DARK) == list(range(seen + lost, seen + lost + 3))
    assert ids(out)[-1] == [1]
    assert not cycles_with(play([[RADAR]] * seen + [[]] * 40), Flag.DARK)


@pytest.mark.parametrize(("shown", "wait"), [(5, 20), (10, 20), (15, 15), (20, 10), (40, 10)])
def test_what_a_slow_radar_shows_late_is_dark_sooner(shown, wait):
    """Tracks began in cycle 0. What is beyond 30 s until one is shown counts, up to 30 s of the 60 s without AIS."""
    assert cycles_with(play([[]] * shown + [[RADAR]] * 25), Flag.DARK)[0] == shown + wait


def test_a_radar_track_that_splits_from_its_ais_was_shown_all_the_time():
    """So it has no head start, as one has that a slow radar shows late: the association may fail for half a minute."""
    apart = (3, 2, 1, 40.0, 235000001, 5)
    assert cycles_with(play([[RADAR, AIS]] * 100 + [[RADAR, apart]] * 25), Flag.DARK)[0] == 120


@pytest.mark.parametrize(("oldest_s", "after_s"), [(120.0, 198.0), (540.0, 240.0)])
def test_a_ship_far_away_that_is_silent_delays_the_flag_of_a_slow_vessel_by_three_minutes_at_most(
    oldest_s, after_s, monkeypatch
):
    """A slow vessel waits for its own interval of 180 s and a tenth, and as long as ships at anchor pause, after 9 minutes 180 s."""
    monkeypatch.setitem(globals(), "EAST_M_S", 0.0)
    near, far = (8, 2, 2, 3000.0, 235000008, 8, 0.0), (9, 2, 1, 40e3, 235000009, 7)
    script = [[RADAR, AIS, (*far, 0.0), near]] * 60
    script += [[RADAR, (*far, min(3.0 * k, oldest_s)), near] for k in range(85)]
    first = next(k for k, (picture, _) in enumerate(play(script)) if picture.flags[picture.vessel_id == 1] & Flag.DARK)
    assert PERIOD_S * (first - 60) == pytest.approx(after_s, abs=2.0 * PERIOD_S)


def test_a_dark_vessel_is_shown_for_longer_without_radar():
    script = [[RADAR]] * 25 + [[]] * 50
    assert cycles_with(play(script), Flag.DARK) == list(range(20, 65)), "`dark_after_s` to `dark_coast_s` after cycle 24"
    back = play(script[:60] + [[AIS]] * 3)
    assert cycles_with(back, Flag.DARK) == list(range(20, 60)), "AIS ends it"


def test_a_dark_vessel_whose_radar_was_wrong_is_shown_no_longer_than_others():
    out = play([[RADAR]] * 25 + [[]] * 50, jump=25)
    assert cycles_with(out, Flag.DARK) == list(range(20, 25))
    assert [len(p) for p, _ in out].index(0) == 35, "`coast_s` after cycle 24"


def test_what_stays_is_stationary_and_dark_only_if_it_once_had_ais(monkeypatch):
    """Errors of 5 m an axis: 25 m is the limit, and two minutes."""
    under_way = play([[RADAR]] * 60)
    assert not any(flagged(under_way, Flag.STATIONARY))
    assert flagged(under_way, Flag.DARK)[-1]
    monkeypatch.setattr(sys.modules[__name__], "EAST_M_S", 0.0)
    quay = play([[RADAR]] * 60)
    assert flagged(quay, Flag.STATIONARY).index(True) == 40, "two minutes of three seconds"
    assert not flagged(quay, Flag.DARK)[-1]
    silenced = play([[RADAR, AIS]] * 10 + [[RADAR]] * 90)
    assert flagged(silenced, Flag.STATIONARY)[-1]
    assert flagged(silenced, Flag.DARK)[-1]


def test_what_never_sent_ais_is_dark_among_three_ships_at_anchor(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "EAST_M_S", 0.0)

    def is_dark(*east_m):
        ships = [(10 + k, 2, 1 + k, east, 235000001 + k, 6 + k) for k, east in enumerate(east_m)]
        return flagged(play([[RADAR, *ships]] * 100), Flag.DARK)[-1]

    assert is_dark(400.0, 700.0, 990.0)
    assert not is_dark(400.0, 700.0, 1010.0)


def test_at_the_start_what_is_slow_is_not_dark_before_ships_at_anchor_had_their_turn(monkeypatch):
    """They send each 180 s: a third of the moored ships of a harbour was dark at each start."""
    monkeypatch.setattr(sys.modules[__name__], "EAST_M_S", 0.0)
    ships = [(10 + k, 2, 1 + k, 400.0 + 100.0 * k, 235000001 + k, 6 + k) for k in range(3)]
    dark = flagged(play([[RADAR, *ships]] * 150), Flag.DARK)
    assert dark.index(True) == (60 + 180) // 3
    assert all(dark[80:])
    few = [(track, source, vessel - 1, *rest) for track, source, vessel, *rest in ships]
    later = flagged(play([few] * 150 + [[RADAR, *ships]] * 60), Flag.DARK)
    assert later.index(True) < 150 + 30, "then by the longest pause of those at anchor"


def test_what_a_vessel_of_one_knot_could_leave_is_no_proof_of_rest(monkeypatch):
    """With 100 m of noise a vessel at 1 kn needs ten minutes to be seen moving."""
    monkeypatch.setattr(sys.modules[__name__], "EAST_M_S", 0.0)
    noisy = Identity(under_way_kn=0.1)
    assert not any(flagged(play([[RADAR]] * 60, method=noisy), Flag.STATIONARY)), "25 m at 0.1 kn take eight minutes"


def test_a_vessel_has_the_size_of_the_longest_echo_of_its_tracks():
    tracks, associations, fused = cycle_of(0, [RADAR, OTHER_RADAR, AIS, (9, 0, 1, 5000.0, -1, 6)])
    sized = replace(
        tracks,
        echo_length_m=np.array([180.0, 210.0, np.nan, np.nan]),
        echo_width_m=np.array([30.0, 34.0, np.nan, np.nan]),
        echo_axis_deg=np.array([80.0, 82.0, np.nan, np.nan]),
    )
    _, (picture, _) = Identity().step(
        Identity().init(), PictureInput(sized, associations, fused, alarms(tracks), 0.0, sensors())
    )
    np.testing.assert_array_equal(picture.echo_length_m, [210.0, np.nan])
    np.testing.assert_array_equal(picture.echo_width_m, [34.0, np.nan])
    np.testing.assert_array_equal(picture.echo_axis_deg, [82.0, np.nan])
