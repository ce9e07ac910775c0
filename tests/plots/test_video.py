"""Video to plots: the echoes of scipy.ndimage, the same wherever the stream is cut, with masks, gaps and levels of every kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import video_textbook
from hypothesis import example, given, strategies as st

from coastwatch.batches import RadarReports, RadarVideo, Videos
from coastwatch.geodesy import NAUTICAL_MILE_M, offset_deg
from coastwatch.plots import CfarExtraction, ExtractionInput
from coastwatch.plots.video import AbsoluteExtraction, over_background
from coastwatch.plots.video.masks import Masks, MaskScale, Sector, mask_of
from coastwatch.plots.video.spokes import BEAM_IN_MOMENT, FWHM, PULSE_IN_MOMENT, VideoRadar
from coastwatch.scenario.sites import Radar, sensors_of
from coastwatch.server.checkpoint import load, save

SITE = np.array([54.3, 12.0])
START_S, PERIOD_S = 1.7e9, 2.4
CELL_M = 10.85


def radars(beam_deg=5.0, **settings):
    """A radar whose beam is three spokes wide."""
    radar = Radar(name="r", latitude_deg=SITE[0], longitude_deg=SITE[1], range_nm=6.0, rpm=25.0, beam_deg=beam_deg, **settings)
    return sensors_of([radar], [], [])


def video(level, azimuth=None, **columns):
    """A stream of spokes; azimuths go on from turn to turn, 256 to a turn where none are given."""
    turned = 2.0 * np.pi * (np.arange(len(level)) + 0.5) / 256 if azimuth is None else azimuth
    time = START_S + turned / (2.0 * np.pi) * PERIOD_S
    base = {"received_s": time, "azimuth_rad": turned % (2.0 * np.pi), "site_deg": np.tile(SITE, (len(level), 1))}
    return RadarVideo(0, 0.0, CELL_M, time, level=level, **base | columns)


def sea(spokes, cells, seed, ships=3):
    """Levels of noise, half a decibel each, with a few echoes; one of them north."""
    rng = np.random.default_rng(seed)
    power = rng.standard_exponential((spokes, cells))
    for k in range(ships):
        row, cell = (0, cells // 2) if k == 0 else (rng.integers(0, 256), rng.integers(0, cells))
        for turn in range(-1, spokes // 256 + 2):
            rows, columns = np.ogrid[:spokes, :cells]
            power += 3e3 * np.exp(-(((rows - row - 256 * turn) / 2.0) ** 2) - ((columns - cell) / 3.0) ** 2)
    return np.clip(20.0 + 20.0 * np.log10(power), 0, 255).astype(np.uint8)


def plots_of(method, some, sensors, memory=None):
    memory = method.init() if memory is None else memory
    memory, (plots, _) = method.step(memory, ExtractionInput(Videos((some,)), sensors))
    return memory, plots


def same(one: RadarReports, other: RadarReports) -> None:
    for name in (
        "time_s",
        "received_s",
        "range_m",
        "azimuth_deg",
        "range_sigma_m",
        "azimuth_sigma_deg",
        "extent",
        "weight",
        "origin",
    ):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


def against_textbook(level, azimuth=None, masks=None, gap=None, kind=CfarExtraction, **settings):
    """Compare the plots of a stream with those of the textbook. Returns: how many there are."""
    sensors, method = radars(blind_m=60.0), kind(masks=masks or Masks(), **settings)
    some = video(level, azimuth)
    if gap is not None:
        some = some.take(~gap)
    _, plots = plots_of(method, some, sensors)
    radar = VideoRadar.of(sensors, 0)
    masked = np.zeros(some.level.shape, bool)
    if masks is not None:
        scale = MaskScale(0.0, CELL_M, level.shape[1], radar.beam_rad, radar.pulse_m)
        mask = mask_of(masks.of("r"), masks.land_deg, tuple(SITE.tolist()), scale)
        masked = mask[(some.azimuth_rad / (2.0 * np.pi) * len(mask)).astype(int)] > 0
    rules = method._detection(radar, some).rules
    if kind is AbsoluteExtraction:
        on, db, looked = video_textbook.over_level(some.level, masked, rules)
    else:
        on, db, looked = video_textbook.excesses(some.level, masked, some.azimuth_rad, rules)
    want = video_textbook.echoes(on, db, some.azimuth_rad, radar.beam_rad)
    want = want[(want[:, 0] >= method.least_cells) & (want[:, 7] < looked - 1)]
    want = want[np.lexsort((want[:, 2], want[:, 3] % (2.0 * np.pi), want[:, 7]))]
    got = np.column_stack(
        [
            plots.range_m / CELL_M - 0.5,
            np.radians(plots.azimuth_deg),
            (plots.extent[:, 0] + PULSE_IN_MOMENT * (radar.pulse_m / FWHM) ** 2) / CELL_M**2,
            plots.extent[:, 2] / plots.range_m**2 + BEAM_IN_MOMENT * (radar.beam_rad / FWHM) ** 2,
            plots.extent[:, 1] / plots.range_m / CELL_M,
            plots.weight,
        ]
    )
    assert len(got) == len(want)
    ours = got[np.lexsort((np.round(got[:, 0], 6), np.round(got[:, 1], 6)))]
    theirs = np.column_stack([want[:, 2], want[:, 3] % (2.0 * np.pi), want[:, 4:7], want[:, 1]])
    theirs = theirs[np.lexsort((np.round(theirs[:, 0], 6), np.round(theirs[:, 1], 6)))]
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    return len(got)


@pytest.mark.oracle
def test_echoes_are_those_of_the_textbook():
    assert against_textbook(sea(700, 90, 1)) >= 7


KINDS = ("zero", "full", "coarse", "jitter", "gaps", "mask", "land")


def stream_of(seed, spokes, cells, kinds):
    """A stream with some of KINDS. Returns: what `against_textbook` takes: levels, azimuths, masks, lost spokes."""
    rng, azimuth, masks, gap = np.random.default_rng(seed), None, Masks(), None
    level = sea(spokes, cells, seed)
    if kinds & {"zero", "full"}:
        level = np.full_like(level, 255 if "full" in kinds else 0)
    if "coarse" in kinds:
        level = level // 16
    if "jitter" in kinds:
        azimuth = 2.0 * np.pi * (np.arange(spokes) + rng.uniform(0.0, 1.6, spokes)) / 256
    if "gaps" in kinds:
        gap = rng.random(spokes) < 0.1
        gap[spokes // 3 : spokes // 3 + 5] = True
        gap[0] = False
    if "mask" in kinds:
        masks = Masks(sectors=(Sector(radar="r", from_deg=340.0, to_deg=20.0, from_m=100.0, to_m=350.0),))
    if "land" in kinds:
        corners = offset_deg(SITE, np.array([[-200.0, 150.0], [300.0, 200.0], [250.0, 450.0], [-150.0, 500.0]]))
        masks = masks.model_copy(update={"land_deg": (tuple(map(tuple, corners.tolist())),)})
    return level, azimuth, masks, gap


@pytest.mark.oracle
@given(st.integers(1, 2**32), st.integers(1, 400), st.integers(1, 60), st.sets(st.sampled_from(KINDS), max_size=3))
@example(1, 300, 40, {"zero"})
@example(1, 300, 40, {"full"})
@example(1, 400, 50, {"gaps"})
@example(1, 400, 60, {"mask"})
@example(1, 400, 60, {"land"})
@example(1, 400, 60, {"jitter", "gaps", "land"})
def test_echoes_are_those_of_the_textbook_at_any_size(seed, spokes, cells, kinds):
    against_textbook(*stream_of(seed, spokes, cells, kinds))


@pytest.mark.oracle
@given(
    st.integers(1, 2**32),
    st.integers(1, 700),
    st.integers(1, 60),
    st.sets(st.sampled_from(KINDS), max_size=4),
    st.integers(1, 255),
    st.integers(1, 9),
)
@example(1, 700, 60, set(), 40, 4)
@example(1, 700, 60, {"jitter", "gaps", "mask", "land"}, 20, 1)
@example(1, 300, 40, {"zero"}, 1, 1)
@example(1, 300, 40, {"full"}, 255, 1)
@example(1, 700, 40, {"full", "gaps"}, 9, 1)  # an echo of most of a turn
def test_echoes_over_a_level_are_those_of_the_textbook_at_any_size(seed, spokes, cells, kinds, level, least_cells):
    stream = stream_of(seed, spokes, cells, kinds)
    against_textbook(*stream, kind=AbsoluteExtraction, least_level=level, least_cells=least_cells)


@pytest.mark.contract
@pytest.mark.parametrize("method", [CfarExtraction(), AbsoluteExtraction(least_level=60)], ids=["cfar", "absolute"])
def test_any_cut_of_the_stream_gives_the_same_plots_to_the_bit(method):
    sensors, whole = radars(), video(sea(900, 80, 2, ships=8))
    _, want = plots_of(method, whole, sensors)
    assert len(want) >= 10
    rng = np.random.default_rng(3)
    for cuts in ([450], np.sort(rng.integers(0, 900, 40)), np.arange(900)):
        memory, parts = method.init(), []
        for rows in np.split(np.arange(900), cuts):
            memory, plots = plots_of(method, whole.take(rows), sensors, memory)
            memory = load(save(memory)) if len(cuts) < 100 else memory
            parts.append(plots)
        same(RadarReports.join(parts), want)


@pytest.mark.contract
def test_a_plot_comes_when_the_window_has_passed_it():
    _, plots = plots_of(CfarExtraction(), video(sea(900, 80, 4)), radars())
    late_s = plots.received_s - plots.time_s
    assert late_s.min() > 0.0
    assert late_s.max() < 0.2


@pytest.mark.contract
def test_a_plot_lies_on_its_echo_with_the_time_of_the_beam_and_its_moments():
    rows, columns = np.mgrid[:600, :90]
    level = np.full((600, 90), 20.0) + 60.0 * np.exp(-(((rows - 400.0) / 3.0) ** 2) - ((columns - 50.0) / 4.0) ** 2)
    _, plots = plots_of(CfarExtraction(), video(level.astype(np.uint8), vessel_m=np.full((600, 1), 50.5 * CELL_M)), radars())
    assert len(plots) == 1
    assert plots.range_m[0] == pytest.approx(50.5 * CELL_M, abs=0.1)
    assert plots.azimuth_deg[0] == pytest.approx((400.5 / 256 * 360.0) % 360.0, abs=0.01)
    assert plots.time_s[0] == pytest.approx(START_S + 400.5 / 256 * PERIOD_S, abs=0.005)
    assert plots.origin.tolist() == [0]
    in_echo = np.square([45.0 / FWHM, plots.range_m[0] * np.radians(5.0) / FWHM]) * [PULSE_IN_MOMENT, BEAM_IN_MOMENT]
    along, across = np.sqrt(plots.extent[0, [0, 2]] + in_echo)
    assert along > CELL_M
    assert across > plots.range_m[0] * np.radians(360.0 / 256)
    assert plots.weight[0] > 100.0


@pytest.mark.contract
def test_linear_video_gives_the_plots_of_its_logarithm():
    logarithmic = np.minimum(sea(600, 80, 5), 96)
    linear = np.round(10.0 ** (logarithmic * 0.5 / 20.0)).astype(np.uint8)
    back = np.round(40.0 * np.log10(np.maximum(linear, 1))).astype(np.uint8)
    same(
        plots_of(CfarExtraction(), video(linear), radars(db_per_level=0.0))[1],
        plots_of(CfarExtraction(), video(back), radars())[1],
    )


@pytest.mark.contract
def test_a_new_range_scale_begins_again_and_a_beam_that_stands_fills_no_memory():
    sensors, method = radars(), CfarExtraction()
    memory, _ = plots_of(method, video(sea(400, 80, 6)), sensors)
    memory, _ = plots_of(method, video(sea(100, 60, 6)), sensors, memory)
    assert memory.radars[0].level.shape[1] == 60
    standing = video(sea(3000, 60, 7), azimuth=np.full(3000, 3.0))
    memory, _ = plots_of(method, standing, sensors, memory)
    assert len(memory.radars[0].level) < 50


@pytest.mark.contract
def test_nothing_is_found_in_a_mask():
    sectors = (Sector(from_deg=350.0, to_deg=10.0),)
    level = sea(900, 80, 8, ships=1)
    _, free = plots_of(CfarExtraction(), video(level), radars())
    _, masked = plots_of(CfarExtraction(masks=Masks(sectors=sectors)), video(level), radars())
    assert len(free) > 0
    assert len(masked) == 0


@pytest.mark.contract
def test_cells_that_are_absurdly_short_take_no_more_memory():
    one = video(sea(300, 40, 5))
    small = RadarVideo(0, 0.0, 1e-7, one.time_s, one.received_s, one.azimuth_rad, one.site_deg, one.level)
    memory, _ = plots_of(CfarExtraction(), small, radars())
    assert memory.radars[0].level.shape[1] == 40


def test_what_did_not_come_of_a_spoke_is_not_looked_at():
    level = np.full((600, 200), 20, np.uint8)
    level[300:304, 100:104] = 200
    missing = np.zeros((600, 2), np.int64)
    _, found = plots_of(AbsoluteExtraction(least_level=100), video(level, missing=missing), radars())
    assert len(found) == 1
    missing[300:304] = 90, 200
    _, found = plots_of(AbsoluteExtraction(least_level=100), video(level, missing=missing), radars())
    assert len(found) == 0


@pytest.mark.contract
def test_levels_over_the_background_are_0_where_none_came():
    level, missing = sea(600, 80, 7), np.zeros((600, 2), np.int64)
    missing[500:600] = 30, 80
    level[500:600, 30:80] = 0
    some = video(level, missing=missing)
    memory, _ = plots_of(CfarExtraction(), some, radars())
    (over,) = over_background(memory, ExtractionInput(Videos((some,)), radars()))
    assert not over.half_db[500:600, 30:80].any()
    assert over.half_db[500:600, :30].any(axis=1).all()
    assert over.half_db[:500, 30:80].any(axis=1).all()


def test_nothing_is_found_on_the_land_of_the_sensors():
    level = sea(600, 80, 7)
    everywhere = offset_deg(SITE, np.array([[-2e3, -2e3], [2e3, -2e3], [2e3, 2e3], [-2e3, 2e3]]))
    land = replace(radars(), land_deg=(tuple(map(tuple, everywhere.tolist())),))
    assert len(plots_of(CfarExtraction(), video(level), radars())[1]) > 3
    assert len(plots_of(CfarExtraction(), video(level), land)[1]) == 0


@pytest.mark.contract
def test_the_checkpoint_of_a_radar_is_small():
    rng = np.random.default_rng(9)
    level = rng.integers(10, 40, (4096 + 200, 2048)).astype(np.uint8)
    azimuth = 2.0 * np.pi * (np.arange(len(level)) + 0.5) / 4096
    memory, _ = plots_of(CfarExtraction(), video(level, azimuth), radars())
    assert len(save(memory)) < 1.5e6


def test_the_range_of_a_radar_may_be_short():
    assert 6.0 * NAUTICAL_MILE_M > 80 * CELL_M
    memory, plots = plots_of(CfarExtraction(), video(sea(3, 5, 10)), radars())
    assert len(plots) == 0
    assert memory.radars[0].row == 0
