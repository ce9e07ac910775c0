"""HDF5 files of HAXR: invented ones are read as they were written, and wrong ones are refused."""

from __future__ import annotations

import math
import tracemalloc
from datetime import date
from itertools import pairwise

import numpy as np
import pytest
from spans import span_of
from video_world import START_S, sensors

from coastwatch.errors import InputError
from coastwatch.sensors import VideoFiles
from coastwatch.sensors.recorded.video import haxr
from coastwatch.sensors.recorded.video.haxr import HaxrFile

h5py = pytest.importorskip("h5py", reason="the package h5py is not installed")
pytestmark = pytest.mark.contract

SPOKES, CELLS, CELL_M = 300, 100, 20.0
STEP_S, BEGUN_S = 0.008, 86_398.8  # over midnight


def spokes() -> np.ndarray:
    """Levels of cleaned video: one cell in ten is not 0, and the first of each spoke."""
    rng = np.random.default_rng(1)
    level = np.where(rng.random((SPOKES, CELLS)) < 0.1, rng.integers(1, 256, (SPOKES, CELLS)), 0).astype(np.uint8)
    level[:, 0] = 9
    return level


def written(path, level, **changed):
    row, cell = np.nonzero(level)
    step = 360.0 / 250
    columns = {
        "tod": ((BEGUN_S + STEP_S * row) % 86_400.0).astype(np.float64),
        "az1": (row * step % 360.0).astype(np.float32),
        "az2": ((row + 1) * step % 360.0).astype(np.float32),
        "r1": (cell * CELL_M).astype(np.float32),
        "r2": ((cell + 1) * CELL_M).astype(np.float32),
        "amp": level[row, cell],
    } | changed
    with h5py.File(path, "w") as file:
        for name, column in columns.items():
            if column is not None:
                file[name] = column
    return path


def stream(path):
    feed = VideoFiles(haxr=(HaxrFile(file=path, day=date(2026, 6, 30), radar="south"),))
    return feed.load(sensors(), 1, None).reports, feed


@pytest.mark.parametrize(("block", "most"), [(1 << 18, 4096), (700, 4096), (1 << 18, 7)])
def test_a_file_is_read_as_it_was_written_wherever_it_is_cut(block, most, tmp_path, monkeypatch):
    monkeypatch.setattr(haxr, "BLOCK", block)
    monkeypatch.setattr(haxr, "MOST_SPOKES", most)
    level = spokes()
    path = written(tmp_path / "x.hdf5", level)
    found, feed = stream(path)
    edges = [-math.inf, START_S - 1.0, START_S, START_S + 0.5, math.inf]
    parts = [part for a, b in pairwise(edges) for part in found.between(a, b).video.parts]
    assert np.array_equal(np.concatenate([part.level[:, :CELLS] for part in parts]), level)
    assert not any(part.level[:, CELLS:].any() for part in parts)
    time_s = np.concatenate([part.time_s for part in parts])
    assert time_s == pytest.approx(START_S - 1.2 + STEP_S * np.arange(SPOKES), abs=1e-6)
    azimuth = np.degrees(np.concatenate([part.azimuth_rad for part in parts]))
    assert azimuth == pytest.approx((np.arange(SPOKES) + 0.5) * 1.44 % 360.0, abs=1e-3)
    assert {(part.sensor, part.cell_m) for part in parts} == {(1, CELL_M)}
    assert found.faults() == ()
    assert found.contents()[0].records == SPOKES
    assert span_of(feed, sensors()) == (START_S - 2.0, START_S + 2.0)


def test_cells_that_cannot_be_used_are_counted(tmp_path):
    level = spokes()
    row, cell = np.nonzero(level)
    r1, r2, amp = cell * CELL_M, (cell + 1) * CELL_M, level[row, cell].astype(np.float64)
    tod = (BEGUN_S + STEP_S * row) % 86_400.0
    r1[5], r2[6], r2[8], r2[9], amp[10], tod[11] = np.nan, -1e4, np.inf, 0.0, np.inf, 1e300
    r1[12], r1[13], r2[13], r2[14] = 1e6, 1e308, 1.7e308, 1e300
    found, _ = stream(written(tmp_path / "x.hdf5", level, r1=r1, r2=r2, amp=amp, tod=tod))
    cells = sum(int((part.level > 0).sum()) for part in found.between(-math.inf, math.inf).video.parts)
    assert {fault.kind: (fault.count, fault.where) for fault in found.faults()} == {
        haxr.BAD_CELL: (7, "x.hdf5: cell 5"),
        haxr.BEYOND: (2, "x.hdf5: cell 13"),
    }
    assert cells == len(row) - 9


def test_cells_of_absurd_length_are_refused_with_their_file(tmp_path):
    level = spokes()
    r1 = np.nonzero(level)[1] * CELL_M
    for length_m in (1e-300, 1e9):
        with pytest.raises(InputError, match=r"x\.hdf5: got cells of .* needed 0\.05 to 1000 m"):
            stream(written(tmp_path / "x.hdf5", level, r1=0.0 * r1, r2=0.0 * r1 + length_m))


def test_the_span_and_the_rest_of_a_file_are_read_in_pieces(tmp_path, monkeypatch):
    monkeypatch.setattr(haxr, "BLOCK", 4_000)
    level = np.zeros((20_000, 8), np.uint8)
    level[:, :2] = 9
    path = written(tmp_path / "x.hdf5", level)
    for read in (lambda found: found.span(), lambda found: found.rest(-math.inf), lambda found: found.between(1e10, 2e10)):
        found, _ = stream(path)
        tracemalloc.start()
        read(found)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 5e6  # 20,000 spokes of 556 cells: 11 MB


def test_links_and_missing_or_odd_sets_are_refused_with_their_name(tmp_path):
    level = spokes()
    whole = written(tmp_path / "whole.hdf5", level)
    for link in (h5py.ExternalLink(str(whole), "amp"), h5py.SoftLink("/tod")):
        with pytest.raises(InputError, match=r"x\.hdf5: got a link as amp"):
            stream(written(tmp_path / "x.hdf5", level, amp=link))
    with pytest.raises(InputError, match="needed tod, az1, az2, r1, r2, amp"):
        stream(written(tmp_path / "x.hdf5", level, r2=None))
    with pytest.raises(InputError, match="needed as many of each"):
        stream(written(tmp_path / "x.hdf5", level, amp=np.zeros(3, np.uint8)))
    with pytest.raises(InputError, match="needed one row of numbers"):
        stream(written(tmp_path / "x.hdf5", level, amp=np.zeros((3, 3), np.uint8)))
    with h5py.File(tmp_path / "outside.hdf5", "w") as file:
        for name in haxr.SETS:
            file.create_dataset(name, (4,), "u1", external=[(str(tmp_path / "raw.bin"), 0, 4)])
    (tmp_path / "raw.bin").write_bytes(b"1234")
    with pytest.raises(InputError, match="tod with data in another file"):
        stream(tmp_path / "outside.hdf5")
    (tmp_path / "text.hdf5").write_text("no HDF5")
    with pytest.raises(InputError, match="needed an HDF5 file of HAXR"):
        stream(tmp_path / "text.hdf5")
