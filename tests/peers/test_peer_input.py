"""What peers are given: seeded, as good as it says; and the files between driver and adapter."""

from dataclasses import fields

import numpy as np
import pytest

from coastwatch.geodesy import to_plane
from scaling.peers.exchange import AIS, RADAR, Answer, Given, Watch, load, save
from scaling.peers.input import ORIGIN_DEG, make

FAR = 6.0  # standard deviations of a mean that chance does not reach


def test_the_same_seed_gives_the_same_tracks() -> None:
    first, again, other = make(60, 4, 2, 1), make(60, 4, 2, 1), make(60, 4, 2, 2)
    assert all(np.array_equal(getattr(first, f.name), getattr(again, f.name)) for f in fields(Given))
    assert not np.array_equal(first.position_m, other.position_m)


def test_half_of_the_tracks_is_radar_and_half_of_the_vessels_has_both() -> None:
    given = make(1200, 2, 1, 1)
    assert np.bincount(given.source).tolist() == [600, 600]
    tracks = np.bincount(given.vessel)
    assert (len(tracks), int((tracks == 2).sum())) == (800, 400)
    assert all(len(set(given.source[given.vessel == v])) == 2 for v in np.flatnonzero(tracks == 2)[:20])


def test_errors_are_as_large_as_the_covariances_say() -> None:
    given = make(3000, 2, 1, 1)
    off = np.concatenate(
        [
            given.position_m - given.true_position_m[:, given.vessel],
            given.velocity_m_s - given.true_velocity_m_s[:, given.vessel],
        ],
        axis=2,
    )[-1]
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(given.covariance), off)
    for source in (RADAR, AIS):
        mine = square[given.source == source]
        assert abs(mine.mean() - 4.0) < FAR * np.sqrt(8.0 / len(mine))


def test_degrees_and_metres_are_the_same_places() -> None:
    given = make(60, 3, 1, 1)
    assert np.abs(to_plane(given.position_deg, ORIGIN_DEG) - given.position_m).max() < 1e-3


def test_files_come_back_as_they_went(tmp_path) -> None:
    given = make(30, 3, 1, 1)
    pairs = np.array([[2, 0, 1]])
    answer = Answer(np.array([0.5]), np.array([0.25]), {"numpy": "2"}, "pair", 7, pairs)
    for what in (given, answer):
        save(tmp_path / "file.npz", what)
        back = load(tmp_path / "file.npz", type(what))
        for f in fields(what):
            went, came = getattr(what, f.name), getattr(back, f.name)
            assert np.array_equal(went, came) if isinstance(went, np.ndarray) else went == came, f.name


def test_a_file_of_another_kind_is_refused(tmp_path) -> None:
    save(tmp_path / "given.npz", make(30, 2, 1, 1))
    with pytest.raises(KeyError, match="wall_s"):
        load(tmp_path / "given.npz", Answer)


def test_a_lap_is_shared_out_among_its_cycles() -> None:
    watch = Watch()
    with watch.lap():
        sum(range(200_000))
    with watch.lap(1000):
        sum(range(200_000))
    answer = watch.answer(("numpy",))
    assert answer.versions == {"numpy": np.__version__}
    assert answer.wall_s[1] < answer.wall_s[0]
    assert len(answer.cpu_s) == 2
