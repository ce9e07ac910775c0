"""Registration and the newest arrival of each sensor are found again as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.batches import RadarReports
from coastwatch.errors import StoreError
from coastwatch.operators import presentation
from coastwatch.scenario import StoreSettings
from coastwatch.store.schema.database import reading

pytestmark = pytest.mark.contract


def test_sensors_as_they_were(url: str) -> None:
    """Registration and the newest arrival of each sensor, now and at an instant; rows come at an interval and on change."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        keep = StoreSettings(registration_every=8)
        for number in range(23):
            world.write(store, run, number, keep=keep)
        with reading(store) as connection:
            cycles = connection.execute(text("SELECT DISTINCT cycle FROM sensor_registration ORDER BY cycle")).scalars().all()
        assert cycles == [0, 8, 16, 20]  # in cycle 20 the first radar settles
        now, before = (kept.sensor_states(store, run, at_s) for at_s in (None, world.instant_s(9)))
        assert now.column("name") == ["hill", "mouth", "fort", "island"]
        assert now.column("state") == [None, None, "settled", "unknown"]
        assert now.column("azimuth_bias_deg")[2] == pytest.approx(5.02)
        assert now.column("site_north_m") == [None, None, -2.0, None]
        assert now.column("range_noise_factor") == [None, None, 1.25, None]
        assert now.column("azimuth_noise_factor") == [None, None, 1.0, None]
        assert before.column("state") == [None, None, "acquiring", "unknown"]
        assert before.column("azimuth_bias_deg")[2] == pytest.approx(5.008)
        assert before.column("azimuth_bias_deg")[1] == 0.0
        with pytest.raises(StoreError, match="holds nothing up to"):
            kept.sensor_states(store, run, world.START_S - 1.0)
        empty = kept.sensor_states(store, world.begin(store, "other"))
        assert empty.column("state") == [None] * 4


def test_when_a_sensor_was_heard_outlasts_its_silence(url: str) -> None:
    one = np.array([world.START_S + 1.0])
    said = RadarReports(np.array([1]), one, one + 0.5, one * 0.0, one * 0.0, np.zeros((1, 2)), np.array([-1]))
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, reports=replace(world.reports_of(0, 30), radar=said))
    with kept.open_store(url) as store:
        world.write(store, run, 1)
        assert kept.sensor_states(store, run).column("heard_s") == [None, None, None, world.START_S + 1.5]


def test_the_cover_of_radars_is_found_again(url: str) -> None:
    """The newest one, written at an interval, and gone with the cycles that a run repeats."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        assert kept.radar_covers(store, run)[0] == []
        keep = StoreSettings(cover_every_s=4 * world.PERIOD_S)
        for number in range(7):
            world.write(store, run, number, keep=keep)
        names, cover = kept.radar_covers(store, run)
        stored_at = int(cover.turns[0])
        assert names == ["fort", "island"]
        assert 2 < stored_at <= 6
        said = world.cover_of(stored_at)
        for name, array in vars(said).items():
            np.testing.assert_allclose(getattr(cover, name), array, rtol=1e-6)
        echoes = kept.standing_echoes(store, run)
        assert echoes.columns == ("name", "latitude_deg", "longitude_deg", "extent_m", "plots_per_turn", "turns")
        assert echoes.rows == [("fort", -22.9, -43.1, 8.0, 0.9, stored_at), ("island", -22.8, -43.0, 120.0, 2.5, stored_at)]
        world.write(store, run, 1, keep=keep)
        assert kept.standing_echoes(store, run).rows == []
        assert (kept.radar_covers(store, run)[1].turns <= 1.0).all()


def test_the_health_of_radar_video_is_found_again(url: str) -> None:
    """With the rows of registration and in the last cycle; a sensor without video has none."""
    keep, shape = StoreSettings(registration_every=4), (2, len(kept.VIDEO_VALUES))
    video = np.full(shape, np.nan)
    video[0] = 2.4, 512, 7, 1, 0.012, 23.5, 9.25, 0.97, 4.1
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, keep=keep)
        for number in range(1, 5):
            world.write(store, run, number, keep=keep, video=video)
        video[0, 2] = 9
        world.write(store, run, 5, keep=keep, video=video, last=True)
        now, before, begun = (presentation.sensors(store, run, at) for at in (None, *map(world.instant_s, (4, 1))))
        table = presentation.registration(now, kept.run(store, run))
    assert now.column("name") == ["hill", "mouth", "fort", "island"]
    of = [now.column(name) for name in kept.VIDEO_VALUES]
    assert [values[2] for values in of] == [2.4, 512, 9, 1, 0.012, 23.5, 9.25, 0.97, 4.1]
    assert all(values[k] is None for values in of for k in (0, 1, 3))
    assert (before.column("spokes_lost")[2], begun.column("spokes_lost")[2]) == (7, None)
    assert table.column("video") == [
        None, None, "turn 2.40 s; 512 spokes a turn; lost 9 spokes, 1 parts, 1.2 % of the last minute; 23.5 plots a turn; "
        "threshold 9.2 dB; P_D 0.97; 4.1 false plots a turn", None,
    ]  # fmt: skip


def test_cover_for_people(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        seen, clutter = (presentation.radar_cover(store, run, what, 72, 16) for what in (False, True))
        coarse = presentation.radar_cover(store, run, False, 12, 4)
    assert seen.columns == ("name", "from_deg", "to_deg", "from_nm", "to_nm", *presentation.COVER_COLUMNS)
    assert seen.rows == [("fort", 35.0, 40.0, 1.875, 2.5, 0.5, 10.0, None, 0.0)]
    assert clutter.rows == [("island", 350.0, 355.0, 11.25, 12.0, 2.0, 0.0)]
    assert coarse.rows == [("fort", 30.0, 60.0, 0.0, 2.5, 0.5, 10.0, None, 0.0)]
