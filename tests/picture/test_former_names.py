"""Under which MMSI a vessel goes on without AIS, and what is flagged when another sender takes an MMSI over."""

import numpy as np
import pytest
from ais_world import START_S, run, sail
from checkpoint_world import is_checked
from test_picture import AIS, OTHER_RADAR, PERIOD_S, RADAR, cycle_of, play, sensors
from test_picture_by_sorting import PATIENT, SHORT, Sea, sensors as sensors_of

from coastwatch.batches import AisAlarms, Flag, NavStatus
from coastwatch.geodesy import offset_deg
from coastwatch.picture import Identity, PictureInput
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks.ais.ais_filter import AisFilter

pytestmark = pytest.mark.contract

MMSI = 235000001
BESIDE_M = 2500.0


def names(out):
    """The MMSI of each vessel at the end, by vessel."""
    picture = out[-1][0]
    return dict(zip(picture.vessel_id.tolist(), picture.mmsi.tolist(), strict=True))


def flagged(out, flag):
    """For each cycle the vessels with a flag."""
    return [set(p.vessel_id[(p.flags & flag) != 0].tolist()) for p, _ in out]


def test_a_former_mmsi_goes_once_ais_of_it_is_in_another_vessel():
    other = (8, 0, 1, 120.0, -1, 6)
    together = [RADAR, AIS, other]
    moved = [RADAR, (3, 2, 1, 120.0, MMSI, 5), other]
    assert names(play([together] * 5 + [[RADAR, other]] * 5)) == {1: MMSI, 2: -1}, "it stays while nobody else has it"
    assert names(play([together] * 5 + [moved])) == {1: -1, 2: MMSI}
    assert names(play([together] * 5 + [[RADAR, other]] * 5 + [moved])) == {1: -1, 2: MMSI}
    assert names(play([together] * 5 + [moved] * 5 + [[RADAR, other]] * 3)) == {1: -1, 2: MMSI}, "it is history, not a name"


@pytest.mark.parametrize("later", [1, 2])
def test_of_two_vessels_that_lose_their_ais_the_one_heard_last_keeps_the_mmsi(later):
    other, age_s = (8, 0, 1, BESIDE_M, -1, 6), (0.0, 2.0) if later == 1 else (2.0, 0.0)
    both = [RADAR, (*AIS, age_s[0]), other, (77, 2, 1, BESIDE_M, MMSI, 6, age_s[1])]
    out = play([both] * 5 + [[RADAR, other]] * 2)
    assert flagged(out, Flag.MMSI_TWICE)[:5] == [{1, 2}] * 5
    assert names(out) == {later: MMSI, 3 - later: -1}


@pytest.mark.parametrize("mmsi", [970_000_001, 972_000_001])
def test_what_follows_from_a_former_mmsi_goes_with_it(mmsi):
    ais, other = (3, 2, 0, 0.0, mmsi, 5), (8, 0, 1, 120.0, -1, 6)
    script = [[RADAR, ais, other]] * 5 + [[RADAR, (3, 2, 1, 120.0, mmsi, 5), other]]
    out = play(script)
    device = Flag.AIS_SART if mmsi < 972_000_000 else Flag.MAN_OVERBOARD
    assert flagged(out, device)[-2:] == [{1}, {2}]


def test_navigational_status_goes_with_the_mmsi():
    other = (8, 0, 1, 120.0, -1, 6)
    script = [[RADAR, AIS, other]] * 3 + [[RADAR, other]] * 2 + [[RADAR, (3, 2, 1, 120.0, MMSI, 5), other]]
    method, memory, seen = Identity(), Identity().init(), []
    for cycle, rows in enumerate(script):
        tracks, associations, fused = cycle_of(cycle, rows)
        ais = tracks.take(tracks.mmsi >= 0)
        no = np.zeros(len(ais), bool)
        said = AisAlarms(ais.track_id, ais.mmsi, no, no, np.full(len(ais), int(NavStatus.NOT_UNDER_COMMAND)))
        memory, (picture, _) = method.step(memory, PictureInput(tracks, associations, fused, said, PERIOD_S * cycle, sensors()))
        seen.append((picture.nav_status.tolist(), (picture.flags & Flag.NOT_UNDER_COMMAND > 0).tolist()))
    assert seen[4] == ([2, -1], [True, False])
    assert seen[5] == ([-1, 2], [False, True])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("method", [SHORT, PATIENT])
def test_no_mmsi_is_on_two_vessels_but_of_two_live_ais_tracks(seed, method):
    """Over worlds in which tracks end, begin, split, join and change their names; and after a resume the same."""
    sea, where, memory, doubled = Sea(30, seed, 0.15), sensors_of(seed), method.init(), 0
    for cycle in range(30):
        given = sea.cycle(1.0 * cycle)
        again = method.step(load(save(memory)), PictureInput(*given, 1.0 * cycle, where)) if is_checked(cycle) else None
        memory, (picture, members) = method.step(memory, PictureInput(*given, 1.0 * cycle, where))
        assert again is None or save(again[0]) == save(memory)
        has_ais = np.isin(picture.vessel_id, members.vessel_id[members.source == where.ais_source])
        mmsi, count = np.unique(picture.mmsi[picture.mmsi >= 0], return_counts=True)
        twice = np.isin(picture.mmsi, mmsi[count > 1])
        doubled += int(twice.sum())
        assert has_ais[twice].all()
        assert (picture.flags[twice] & Flag.MMSI_TWICE != 0).all()
    assert doubled, "the world has such vessels"


def taken_over(silent_s, own_radar=True):
    """A vessel with AIS and radar falls silent; then a sender goes on under its MMSI 2.5 km off, a vessel of radar or of AIS alone."""
    other = [(8, 0, 1, BESIDE_M, -1, 6)] if own_radar else []
    silent = [[RADAR, *other]] * int(silent_s / 3.0)
    return play([[RADAR, AIS, *other]] * 20 + silent + [[RADAR, (3, 2, 1, BESIDE_M, MMSI, 6), *other]] * 5)


@pytest.mark.parametrize("own_radar", [True, False])
@pytest.mark.parametrize("minutes", [2, 10])
def test_a_taken_mmsi_contradicts_the_radar_track_of_its_vessel(minutes, own_radar):
    out = taken_over(60.0 * minutes, own_radar)
    up = flagged(out, Flag.AIS_CONTRADICTED)
    assert not any(up[:-5])
    assert up[-5:] == [{1, 2}] * 5
    assert names(out) == {1: -1, 2: MMSI}
    assert 1 in flagged(out, Flag.DARK)[-1]


def test_it_does_not_where_ais_was_never_long_with_that_radar_track_or_is_near():
    for apart_m, together in ((BESIDE_M, 8), (400.0, 20)):
        script = (
            [[RADAR, AIS]] * together + [[RADAR]] * 30 + [[RADAR, (3, 2, 1, apart_m, MMSI, 6), (8, 0, 1, apart_m, -1, 6)]] * 5
        )
        assert not any(flagged(play(script), Flag.AIS_CONTRADICTED))


def test_it_does_not_where_the_ais_track_moves_without_a_silence():
    """An association that is put right, as of radars whose registration is found, is no other sender."""
    other = (8, 0, 1, BESIDE_M, -1, 6)
    out = play([[RADAR, AIS, other]] * 20 + [[RADAR, (3, 2, 1, BESIDE_M, MMSI, 6), other]] * 5)
    assert not any(flagged(out, Flag.AIS_CONTRADICTED))


def test_it_does_where_a_new_track_begins_before_the_old_one_ends():
    other, taker = (8, 0, 1, BESIDE_M, -1, 6), (4, 2, 1, BESIDE_M, MMSI, 6)
    out = play([[RADAR, AIS, other]] * 20 + [[RADAR, AIS, other, taker]] * 5 + [[RADAR, other, taker]] * 3)
    assert flagged(out, Flag.MMSI_TWICE)[-8:] == [{1, 2}] * 5 + [set()] * 3
    assert flagged(out, Flag.AIS_CONTRADICTED)[-8:] == [set()] * 5 + [{1, 2}] * 3


def test_it_does_not_where_the_vessel_is_not_seen_any_more():
    """Without the radar track nothing contradicts: the vessel itself may have come there."""
    out = play([[RADAR, AIS]] * 20 + [[]] * 30 + [[(3, 2, 1, BESIDE_M, MMSI, 6), (*OTHER_RADAR[:3], BESIDE_M, -1, 6)]] * 5)
    assert not any(flagged(out, Flag.AIS_CONTRADICTED))


def heard_again(silent_s, beside_m, speed_kn=12.0, sog_kn=None):
    """The alarms of a vessel that sails for 3 minutes, is silent, and is heard again beside its way."""
    before = sail(MMSI, START_S + np.arange(1.0, 180.0, 6.0), speed_kn=speed_kn)
    after = sail(MMSI, START_S + 180.0 + silent_s + np.arange(1.0, 60.0, 6.0), speed_kn=speed_kn)
    aside = [offset_deg(np.array([row[3], row[4]]), np.array([-0.766, 0.643]) * -beside_m) for row in after]
    after = [(*row[:3], *at, row[5] if sog_kn is None else sog_kn, row[6]) for row, at in zip(after, aside, strict=True)]
    outputs = []
    run(AisFilter(), before + after, int((240.0 + silent_s) / 3.0), outputs=outputs)
    return [bool(alarms.impossible_speed.any()) for _, alarms in outputs]


@pytest.mark.parametrize("minutes", [1, 2, 3, 4, 5])
def test_a_sender_that_goes_on_2500_m_beside_the_way_is_flagged(minutes):
    up = heard_again(60.0 * minutes, BESIDE_M)
    first = int(60.0 * minutes / 3.0) + 60
    assert not any(up[: first - 1])
    assert up[first + 5]
    assert not any(heard_again(60.0 * minutes, 0.0)), "the same ship is not"


@pytest.mark.parametrize(("speed_kn", "sog_kn"), [(0.0, 9.0), (12.0, 3.0)])
@pytest.mark.parametrize("minutes", [1, 5, 10])
def test_a_ship_that_changed_its_speed_while_it_was_not_heard_is_not_flagged(minutes, speed_kn, sog_kn):
    way_m = 0.5 * max(speed_kn, sog_kn) * 0.5144 * 60.0 * minutes
    assert not any(heard_again(60.0 * minutes, way_m if speed_kn == 0.0 else 0.0, speed_kn, sog_kn))


@pytest.mark.parametrize("minutes", [10, 15, 20])
def test_a_ferry_that_is_heard_at_two_berths_5_km_apart_is_not_flagged(minutes):
    assert not any(heard_again(60.0 * minutes, 5000.0, 0.0))
