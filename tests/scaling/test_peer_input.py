"""The common input of peers is seeded and as accurate as its covariances; files between driver and adapter are read back equal."""

from dataclasses import fields

import numpy as np
import pytest

from coastwatch.geodesy import to_plane
from scaling.peers.exchange import AIS, RADAR, Stopwatch, TaskResult, TrackHistory, load, save
from scaling.peers.input import ORIGIN_DEG, make_history

pytestmark = pytest.mark.contract

FAR = 6.0  # standard deviations of a mean that chance does not reach


def test_the_same_seed_gives_the_same_tracks() -> None:
    first, again, other = make_history(60, 4, 2, 1), make_history(60, 4, 2, 1), make_history(60, 4, 2, 2)
    assert all(np.array_equal(getattr(first, f.name), getattr(again, f.name)) for f in fields(TrackHistory))
    assert not np.array_equal(first.position_m, other.position_m)


def test_half_of_the_tracks_is_radar_and_half_of_the_vessels_has_both() -> None:
    history = make_history(1200, 2, 1, 1)
    assert np.bincount(history.source).tolist() == [600, 600]
    tracks = np.bincount(history.vessel)
    assert (len(tracks), int((tracks == 2).sum())) == (800, 400)
    assert all(len(set(history.source[history.vessel == v])) == 2 for v in np.flatnonzero(tracks == 2)[:20])


def test_errors_are_as_large_as_the_covariances_say() -> None:
    history = make_history(3000, 2, 1, 1)
    off = np.concatenate(
        [
            history.position_m - history.true_position_m[:, history.vessel],
            history.velocity_m_s - history.true_velocity_m_s[:, history.vessel],
        ],
        axis=2,
    )[-1]
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(history.covariance), off)
    for source in (RADAR, AIS):
        mine = square[history.source == source]
        assert abs(mine.mean() - 4.0) < FAR * np.sqrt(8.0 / len(mine))


def test_degrees_and_metres_are_the_same_positions() -> None:
    history = make_history(60, 3, 1, 1)
    assert np.abs(to_plane(history.position_deg, ORIGIN_DEG) - history.position_m).max() < 1e-3


def test_files_are_read_back_equal(tmp_path) -> None:
    history = make_history(30, 3, 1, 1)
    pairs = np.array([[2, 0, 1]])
    result = TaskResult(np.array([0.5]), np.array([0.25]), {"numpy": "2"}, "pair", 7, pairs)
    for record in (history, result):
        save(tmp_path / "file.npz", record)
        back = load(tmp_path / "file.npz", type(record))
        for f in fields(record):
            written, read = getattr(record, f.name), getattr(back, f.name)
            assert np.array_equal(written, read) if isinstance(written, np.ndarray) else written == read, f.name


def test_a_file_of_another_kind_is_refused(tmp_path) -> None:
    save(tmp_path / "input.npz", make_history(30, 2, 1, 1))
    with pytest.raises(KeyError, match="wall_s"):
        load(tmp_path / "input.npz", TaskResult)


def test_a_lap_is_divided_among_its_cycles() -> None:
    watch = Stopwatch()
    with watch.lap():
        sum(range(200_000))
    with watch.lap(1000):
        sum(range(200_000))
    result = watch.result(("numpy",))
    assert result.versions == {"numpy": np.__version__}
    assert result.wall_s[1] < result.wall_s[0]
    assert len(result.cpu_s) == 2
