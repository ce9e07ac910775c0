"""Pictures of whole turns to plots by OpenCV: where and when they lie, any cut of the stream, shapes, masks, without OpenCV."""

from __future__ import annotations

import sys
from importlib.util import find_spec

import numpy as np
import pytest

from coastwatch.batches import RadarReports, RadarVideo, Videos
from coastwatch.errors import InputError
from coastwatch.plots.video import BlobExtraction, ExtractionInput, over_background
from coastwatch.plots.video.blobs import PictureScale, layout_of
from coastwatch.plots.video.masks import Masks, Sector
from coastwatch.scenario.sites import Radar, sensors_of
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

SITE = np.array([54.3, 12.0])
START_S, PERIOD_S, CELL_M, CELLS, SPOKES = 1.7e9, 2.4, 10.0, 120, 512
ECHOES = ((30.0, 500.0), (200.0, 800.0), (290.0, 400.0))  # azimuth deg, range m
PIXELS = 240  # of 10 m
METHOD = BlobExtraction(pixels=PIXELS)
SENSORS = sensors_of(
    [Radar(name="r", latitude_deg=SITE[0], longitude_deg=SITE[1], range_nm=1.0, rpm=25.0, beam_deg=2.0, blind_m=100.0)], [], []
)


def turns(count: float, echoes=ECHOES, spokes=SPOKES, cells=CELLS, long_m=25.0, **columns) -> RadarVideo:
    """Echoes in noise, from north on: half as wide as long."""
    rng = np.random.default_rng(1)
    turned = (np.arange(round(count * spokes)) + 0.5) / spokes
    level, range_m = rng.integers(5, 25, (len(turned), cells)).astype(float), (np.arange(cells) + 0.5) * CELL_M
    for azimuth_deg, far_m in echoes:
        off = (turned * 360.0 - azimuth_deg + 180.0) % 360.0 - 180.0
        across_m = np.radians(off) * far_m
        level += 100.0 * np.exp(-0.5 * ((across_m[:, None] / 25.0) ** 2 + ((range_m - far_m) / long_m) ** 2))
    time_s = START_S + turned * PERIOD_S
    base = {"received_s": time_s + 0.01, "azimuth_rad": turned * 2.0 * np.pi % (2.0 * np.pi)}
    level = np.clip(level, 0, 255).astype(np.uint8)
    return RadarVideo(0, 0.0, CELL_M, time_s, site_deg=np.tile(SITE, (len(turned), 1)), level=level, **base | columns)


def plots_of(method, video, memory=None):
    memory, (plots, _) = method.step(method.init() if memory is None else memory, ExtractionInput(Videos((video,)), SENSORS))
    return memory, plots


needs_opencv = pytest.mark.skipif(find_spec("cv2") is None, reason="the extra blobs (OpenCV) is not installed")


@needs_opencv
def test_a_plot_lies_on_its_echo_with_the_time_of_the_beam_and_comes_when_the_turn_is_complete():
    vessel_m = np.where(np.abs(np.arange(2 * SPOKES) % SPOKES / SPOKES * 360.0 - 200.0) < 5.0, 800.0, np.nan)[:, None]
    _, plots = plots_of(METHOD, turns(2.0, vessel_m=vessel_m))
    assert plots.azimuth_deg == pytest.approx([30.0, 200.0, 290.0] * 2, abs=0.7)
    assert plots.range_m == pytest.approx([500.0, 800.0, 400.0] * 2, abs=5.0)
    beam_s = START_S + (plots.azimuth_deg / 360.0 + np.repeat([0.0, 1.0], 3)) * PERIOD_S
    assert plots.time_s == pytest.approx(beam_s, abs=0.006)
    complete_s = START_S + np.repeat([1.0, 2.0], 3) * PERIOD_S
    assert plots.received_s == pytest.approx(complete_s, abs=0.02)
    assert plots.origin.tolist() == [-1, 0, -1] * 2
    assert plots.azimuth_sigma_deg[1] == pytest.approx(np.hypot(0.3, np.degrees(10.0 / 800.0) / np.sqrt(12.0)), rel=1e-3)
    assert np.isnan(plots.extent).all()


@needs_opencv
def test_any_cut_of_the_stream_gives_the_same_plots_to_the_bit():
    rng = np.random.default_rng(2)
    whole = turns(3.3).take(np.sort(rng.choice(round(3.3 * SPOKES), 1600, replace=False)))  # some spokes are lost
    _, want = plots_of(METHOD, whole)
    assert len(want) == 9
    for cuts in ([700], np.sort(rng.integers(0, 1600, 30))):
        memory, parts = METHOD.init(), []
        for rows in np.split(np.arange(1600), cuts):
            memory, plots = plots_of(METHOD, whole.take(rows), memory)
            memory = load(save(memory))
            parts.append(plots)
        got = RadarReports.join(parts)
        for name in ("time_s", "received_s", "range_m", "azimuth_deg", "range_sigma_m", "site_deg"):
            np.testing.assert_array_equal(getattr(got, name), getattr(want, name), name)


@needs_opencv
def test_blobs_of_the_wrong_size_or_shape_are_none():
    video = turns(1.0, echoes=((100.0, 600.0), (250.0, 600.0)), long_m=120.0)
    assert len(plots_of(METHOD, video)[1]) == 2
    for settings in (
        {"least_inertia": 0.5},
        {"least_circularity": 0.9},
        {"most_pixels": 40.0},
        {"least_level": 150, "most_level": 250},
        {"least_thresholds": 100},
    ):
        found = plots_of(BlobExtraction(pixels=PIXELS, **settings), video)[1]
        assert len(found) == 0, settings


@needs_opencv
def test_masks_and_what_did_not_come_are_dark_and_a_new_range_scale_begins_again():
    sectors = (Sector(from_deg=190.0, to_deg=210.0),)
    masked = BlobExtraction(pixels=PIXELS, masks=Masks(sectors=sectors))
    assert plots_of(masked, turns(1.0))[1].azimuth_deg == pytest.approx([30.0, 290.0], abs=0.7)
    missing = np.zeros((SPOKES, 2), np.int64)
    missing[: SPOKES // 4] = 40, CELLS
    assert plots_of(METHOD, turns(1.0, missing=missing))[1].azimuth_deg == pytest.approx([200.0, 290.0], abs=0.7)
    memory, none = plots_of(METHOD, turns(0.5))
    memory, found = plots_of(METHOD, turns(1.0, cells=100), memory)
    assert len(none) == 0
    assert found.range_m == pytest.approx([500.0, 800.0, 400.0], abs=5.0)
    assert memory.pictures[0].cells == 100


@needs_opencv
def test_memory_is_a_picture_whatever_the_spokes_and_a_checkpoint_is_small():
    method, video = BlobExtraction(), turns(1.5, spokes=4096, cells=700)
    memory, _ = plots_of(method, video)
    assert len(save(memory)) < 1.5e6
    excess = over_background(memory, ExtractionInput(Videos((video.take(slice(0, 20)),)), SENSORS))[0]
    assert not excess.half_db.any()


@needs_opencv
def test_every_pixel_in_range_is_painted_by_a_turn_of_few_spokes():
    memory, _ = plots_of(METHOD, turns(0.99, spokes=200))
    layout = layout_of(PictureScale(0.0, CELL_M, CELLS, 100.0), PIXELS)
    seen = layout.azimuth > np.radians(2.0)  # the first spoke has no spoke before it
    seen &= layout.azimuth < np.radians(354.0)
    assert (memory.pictures[0].picture.ravel()[layout.pixel[seen]] > 0).mean() == 1.0


def test_without_opencv_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=r"opencv-python-headless: pip install 'coastwatch\[blobs\]'"):
        METHOD.init()
    with pytest.raises(ValueError, match="needed more than least_level, 90"):
        BlobExtraction(least_level=90, most_level=90)
