"""The AIS vessels that a radar is compared with: a fixed draw in its cover, spread over azimuth, kept while their AIS lasts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import registration_world as world

from coastwatch.batches import RegistrationState, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.registration import OnlineRegistration
from coastwatch.registration.references import References, draw_references

pytestmark = pytest.mark.contract

SECTORS = 24
COUNT = 48


def sea(**more):
    """300 AIS vessels round two radars, two thirds of them in one sixth of the horizon."""
    made = world.Sea(11, vessels=300, ais=300, radars=2, errors=((0.0, 0.0, 0.0),) * 2, **more)
    crowd = np.arange(300) % 3 > 0
    distance = np.hypot(*made.start_m.T)
    angle = np.where(crowd, np.radians(60.0) * np.random.default_rng(5).random(300), np.arctan2(*made.start_m.T))
    made.start_m = distance[:, None] * np.column_stack([np.sin(angle), np.cos(angle)])
    return made


def draw(former: References, tracks: Tracks, alarmed=None, count=COUNT, silent=()):
    where = world.sensors(2)
    site = where.radars.site_deg.copy()
    site[list(silent)] = np.nan
    alarmed = np.zeros(len(tracks), np.bool_) if alarmed is None else alarmed
    return draw_references(former, tracks, alarmed, site, where, count)


def of_radar(drawn: References, radar: int) -> set[int]:
    return set(drawn.track_id[drawn.radar == radar].tolist())


def test_as_many_as_asked_in_cover_and_spread_over_azimuth():
    tracks, where = sea().ais_tracks(0), world.sensors(2)
    drawn, compared = draw(References.empty(), tracks)
    for radar in (0, 1):
        row = compared.row[compared.radar == radar]
        assert len(row) == COUNT
        at = to_plane(tracks.position_deg[row], where.radars.site_deg[radar])
        assert np.hypot(*at.T).max() <= where.radars.range_m[radar]
        crowd = (np.arctan2(at[:, 0], at[:, 1]) % (2.0 * np.pi) < np.radians(60.0)).mean()
        assert crowd < 0.5, "two thirds of the vessels are there"
        assert set(tracks.track_id[row].tolist()) == of_radar(drawn, radar)


def test_few_vessels_are_all_drawn():
    tracks = sea().ais_tracks(0)
    drawn, _ = draw(References.empty(), tracks, count=1000)
    inside = np.hypot(*to_plane(tracks.position_deg, world.sensors(2).radars.site_deg[0]).T) <= 11_000.0
    assert of_radar(drawn, 0) == set(tracks.track_id[inside].tolist())


def test_the_order_of_tracks_has_no_effect():
    tracks = sea().ais_tracks(0)
    mixed = tracks.take(np.random.default_rng(1).permutation(len(tracks)))
    (drawn, compared), (again, other) = draw(References.empty(), tracks), draw(References.empty(), mixed)
    assert np.array_equal(drawn.track_id, again.track_id)
    assert np.array_equal(tracks.track_id[compared.row], mixed.track_id[other.row])


def test_a_vessel_stays_while_its_ais_lasts_and_is_then_replaced():
    moving = sea(speed_m_s=2.0)
    first, _ = draw(References.empty(), moving.ais_tracks(0).take(np.arange(100, 300)))
    later, _ = draw(first, moving.ais_tracks(1))
    for radar in (0, 1):
        assert len(of_radar(later, radar) & of_radar(first, radar)) >= COUNT - 2, (
            "others join, the drawn stay, but at the border"
        )
    tracks = moving.ais_tracks(1)
    lost = np.isin(tracks.track_id, list(of_radar(later, 0))[:10])
    after, _ = draw(later, tracks.take(~lost))
    assert len(of_radar(after, 0)) == COUNT
    assert of_radar(later, 0) - of_radar(after, 0) == set(tracks.track_id[lost].tolist())


def test_vessels_with_an_alarm_or_an_uncertain_position_are_not_compared():
    tracks = sea().ais_tracks(0)
    drawn, _ = draw(References.empty(), tracks)
    alarmed = np.isin(tracks.track_id, list(of_radar(drawn, 0))[:5])
    again, _ = draw(drawn, tracks, alarmed)
    assert not of_radar(again, 0) & set(tracks.track_id[alarmed].tolist())
    wide = tracks.covariance.copy()
    wide[alarmed] *= 1e6
    same, compared = draw(drawn, replace(tracks, covariance=wide))
    assert of_radar(same, 0) == of_radar(drawn, 0), "it may be certain again soon"
    assert not np.isin(compared.row, np.flatnonzero(alarmed)).any()


def test_a_radar_without_plots_keeps_its_draw():
    tracks = sea().ais_tracks(0)
    drawn, _ = draw(References.empty(), tracks)
    kept, compared = draw(drawn, tracks.take(np.zeros(0, np.int64)), silent=(1,))
    assert of_radar(kept, 1) == of_radar(drawn, 1)
    assert not of_radar(kept, 0)
    assert len(compared) == 0


def test_a_draw_of_forty_finds_the_errors():
    errors = ((5.0, 30.0, 1.5),)
    scene = world.Sea(12, vessels=400, ais=300, errors=errors, clutter=20)
    memory, given, course = world.run(OnlineRegistration(reference_vessels=40), scene, 40)
    assert given.state.tolist() == [RegistrationState.SETTLED]
    assert sum(bool(c.jumped[0]) for c in course) == 1
    assert np.abs(world.errors_of(given, errors)).max() < 4.5
    assert len(memory.references) == 40
