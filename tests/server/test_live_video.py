"""The newest turn of radar video for viewers: levels, cuts, lost spokes, range scales, and nothing where nobody looks."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from video_world import sensors

from coastwatch.batches import AzimuthReference, RadarVideo, Videos
from coastwatch.server.live_video import AZIMUTHS, RANGES, ROWS, LiveVideo

NOISE = 40  # level of the mean noise, of half decibels
CELL_M = 10.0


def spokes(level: np.ndarray, turns: int = 1, bits: int = 8, cell_m: float = CELL_M) -> RadarVideo:
    """Some turns with these levels. Args: level: (S, C)."""
    count, level = len(level), np.tile(level, (turns, 1))
    turn = (np.arange(len(level)) + 0.5) / count
    return RadarVideo(
        sensor=1, first_m=0.0, cell_m=cell_m, time_s=turn * 2.4, received_s=turn * 2.4, azimuth_rad=turn % 1.0 * 2.0 * np.pi,
        site_deg=np.tile([54.0, 12.0], (len(level), 1)), level=level, bits=bits,
    )  # fmt: skip


def looked_at() -> LiveVideo:
    made = LiveVideo(sensors().radars)
    made.ask([1])
    return made


def levels_of(video: LiveVideo) -> np.ndarray:
    turn = video.turn(1)
    assert turn is not None
    return np.concatenate([sector.levels() for sector in turn])


def noise(rng: np.random.Generator, count: int, cells: int) -> np.ndarray:
    return np.clip(NOISE + 20.0 * np.log10(np.maximum(rng.standard_exponential((count, cells)), 1e-3)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("cut", [1, 77, 5000])
def test_a_turn_is_the_greatest_level_of_its_cells_however_it_is_cut(cut: int) -> None:
    rng, made = np.random.default_rng(1), looked_at()
    level = rng.integers(0, 16, (2 * AZIMUTHS, 3 * RANGES)).astype(np.uint8) * (rng.random((2 * AZIMUTHS, 3 * RANGES)) < 0.1)
    video, told = spokes(level, turns=2, bits=4), list[int]()
    made.listen(lambda: told.append(1))
    for first in range(0, len(video) if cut > 1 else 2 * AZIMUTHS + 300, cut):
        made.take_as_sent(video.take(slice(first, first + cut)))
    newest = level.reshape(AZIMUTHS, 2, RANGES, 3).max((1, 3))
    assert (levels_of(made) == newest).all()
    assert len(made.since({1: 0})) == 16  # the newest of each sector alone
    assert told


def test_video_from_a_bow_is_shown_after_its_cycle_and_magnetic_video_at_once() -> None:
    level = np.zeros((AZIMUTHS, RANGES), np.uint8)
    level[0] = 15
    for reference, row in ((AzimuthReference.MAGNETIC, AZIMUTHS // 4), (AzimuthReference.HEADING, 0)):
        radars = sensors().radars
        variation = np.full(len(radars), 0.5 * np.pi)
        made = LiveVideo(replace(radars, azimuth_reference=np.full(len(radars), reference), variation_rad=variation))
        made.ask([1])
        video = spokes(level, turns=2, bits=4)
        made.take_as_sent(video)
        assert (made.turn(1) is None) == (reference == AzimuthReference.HEADING)
        made.take_by_heading(Videos((video,)))  # as it comes from a cycle, true
        assert set(np.flatnonzero(levels_of(made).any(axis=1)).tolist()) == {row}


def test_a_radar_that_is_silent_has_no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    made = looked_at()
    made.take_as_sent(spokes(np.full((AZIMUTHS, RANGES), 90, np.uint8), turns=2))
    assert len(made.since({1: 0})) == 16
    later_s = time.monotonic() + 16.0
    monkeypatch.setattr("coastwatch.server.live_video.time.monotonic", lambda: later_s)
    assert made.turn(1) is None
    assert made.since({1: 0}) == []


def test_levels_count_from_the_noise_whatever_is_land_or_blanked() -> None:
    rng, made = np.random.default_rng(2), looked_at()
    level = noise(rng, AZIMUTHS, RANGES)
    level[:256, 100:] = np.minimum(level[:256, 100:] + 60, 255)  # land of 30 dB
    level[300:400] = 0  # blanked
    level[500:510, 200:204] = NOISE + 80  # an echo of 40 dB
    made.take_as_sent(spokes(level, turns=2))
    found = levels_of(made)
    assert (found[500:510, 200:204] >= 6).all()
    assert (found[500:510, 200:204] <= 7).all()
    assert (found[600:] > 0).mean() < 0.01
    assert (found[300:400] == 0).all()
    assert (found[:256, 100:] > 0).mean() > 0.95


def test_linear_video_has_the_same_levels_and_video_that_the_radar_cleaned_shows_all_it_has() -> None:
    rng, radars = np.random.default_rng(3), sensors().radars
    made = LiveVideo(replace(radars, db_per_level=np.zeros(len(radars))))
    made.ask([1])
    level = np.clip(3.0 * np.sqrt(rng.standard_exponential((AZIMUTHS, RANGES))), 0, 255).astype(np.uint8)
    level[500, 200] = 255  # 38.6 dB over the mean noise
    made.take_as_sent(spokes(level, turns=2))
    assert (levels_of(made)[500, 200], (levels_of(made) > 0).mean() < 0.01) == (7, True)
    cleaned = looked_at()
    level = np.where(rng.random((AZIMUTHS, RANGES)) < 0.1, 30, 0).astype(np.uint8)
    cleaned.take_as_sent(spokes(level, turns=2))
    assert ((levels_of(cleaned) > 0) == (level > 0)).all()


def test_rare_spokes_fill_the_rows_between_them_and_lost_ones_are_dark() -> None:
    level = np.full((AZIMUTHS // 4, 100), 15, np.uint8)
    made, video = looked_at(), spokes(level, turns=3, bits=4)
    made.take_as_sent(video)
    assert (levels_of(made) == 15).all()
    lost = np.isin(np.arange(len(video)) % len(level), np.arange(60, 130))  # two sectors and parts of others
    made.take_as_sent(video.take(~lost))
    dark = (levels_of(made) == 0).all(axis=1)
    assert dark[4 * 61 : 4 * 129].all()
    assert not dark[: 4 * 59].any()
    assert not dark[4 * 131 :].any()


def test_a_new_range_scale_begins_anew_and_nothing_is_kept_where_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    made, level = looked_at(), np.full((AZIMUTHS, RANGES), 15, np.uint8)
    made.take_all(Videos((spokes(level, turns=2, bits=4),)))
    before = made.since({1: 0})[-1]
    assert before.range_m == RANGES * CELL_M
    made.take_as_sent(spokes(level[: 2 * ROWS], bits=4, cell_m=20.0))
    assert made.turn(1) is None
    after = made.since({1: 0})
    assert after
    assert {(one.begun == before.begun, one.range_m) for one in after} == {(False, RANGES * 20.0)}
    monkeypatch.setattr("coastwatch.server.live_video.LOOKED_S", 0.0)
    made.take_as_sent(spokes(level, turns=2, bits=4))
    assert made.since({1: 0}) == []
    never = LiveVideo(sensors().radars)
    never.take_as_sent(spokes(level, turns=2, bits=4))
    assert never.since({1: 0}) == []
