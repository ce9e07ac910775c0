"""Adapters compute what their READMEs say: the same arithmetic as ours, or their own; quality figures count errors."""

import subprocess
import sys
from dataclasses import fields
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from scaling.peers import ours
from scaling.peers.environment import CHECKOUT, ENVIRONMENTS, MARK
from scaling.peers.exchange import AIS, RADAR, PlotHistory, Stopwatch, TaskResult, TrackHistory, load, run_adapter, save
from scaling.peers.filterpy import adapter as filterpy
from scaling.peers.filterpy import method
from scaling.peers.input import make_history
from scaling.peers.plots import in_cover, make_plots
from scaling.peers.quality import decisions, quality, track_figures
from scaling.peers.scipy import adapter as scipy
from scaling.peers.scipy import pairs

pytestmark = pytest.mark.contract

SAME_M = 1e-6  # two ways to write one filter in double precision
PLANE_M = 0.01  # between one plane for all and a plane a vessel
SMALL = make_history(90, 24, 3, 1)


def test_filterpy_and_numpy_are_one_filter_and_ours_is_the_same_but_for_the_plane() -> None:
    both = np.bincount(SMALL.vessel) > 1
    by_object, by_batch, compiled = (task(SMALL, Stopwatch()) for task in (filterpy.imm, scipy.imm, ours.imm))
    assert np.abs(by_object.position_m - by_batch.position_m).max() < SAME_M
    assert np.abs(by_object.position_m - compiled.position_m)[:, both].max() < PLANE_M
    assert np.abs(by_object.velocity_m_s - compiled.velocity_m_s)[:, both].max() < PLANE_M


def test_fusion_by_numpy_is_ours() -> None:
    theirs, mine = scipy.fusion(SMALL, Stopwatch()), ours.fusion(SMALL, Stopwatch())
    assert np.abs(theirs.position_m - mine.position_m).max() < PLANE_M
    assert np.abs(theirs.velocity_m_s - mine.velocity_m_s).max() < SAME_M


def test_estimates_are_better_than_the_tracks() -> None:
    both = np.bincount(SMALL.vessel)[SMALL.vessel] > 1
    error = (SMALL.position_m - SMALL.true_position_m[:, SMALL.vessel])[SMALL.first :, both & (SMALL.source == AIS)]
    of_ais = float(np.sqrt((error**2).sum(axis=2).mean()))
    for kind in ("imm", "fusion"):
        figure, value = quality(kind, SMALL, ours.TASKS[kind](SMALL, Stopwatch()))
        assert figure == "RMSE m"
        assert 0.0 < value < of_ais


def test_the_statistic_in_batches_is_that_a_pair() -> None:
    window = np.random.default_rng([1, 0]).normal(size=(6, 20, 4))
    first, second = np.array([0, 0, 3]), np.array([4, 5, 1])
    assert np.allclose(
        pairs.statistic_by_pair(window, first, second), pairs.statistic_by_batch(window, first, second), rtol=1e-9
    )


def test_the_assignment_is_the_cheapest_of_all() -> None:
    rng = np.random.default_rng([2, 0])
    first, second = (side.ravel() for side in np.meshgrid(np.arange(4), np.arange(4, 8), indexing="ij"))
    x = rng.uniform(0.0, 10.0, 16)
    cost = x.reshape(4, 4)
    best = min(sum(cost[k, column] for k, column in enumerate(order)) for order in permutations(range(4)))
    chosen = pairs.one_to_one(first, second, x)
    assert len(chosen) == 4
    assert x[chosen].sum() == pytest.approx(best)
    assert pairs.one_to_one(first[:0], second[:0], x[:0]).tolist() == []


@pytest.mark.parametrize("task", [ours.association, scipy.association, scipy.association_batched])
def test_pairs_are_of_radar_and_ais_one_to_one_and_nearly_all_right(task) -> None:
    result = task(SMALL, Stopwatch())
    assert len(result.wall_s) == SMALL.measured
    for cycle in range(SMALL.first, len(SMALL.time_s)):
        now = result.pairs[result.pairs[:, 0] == cycle]
        assert (SMALL.source[now[:, 1]] == RADAR).all()
        assert (SMALL.source[now[:, 2]] == AIS).all()
        assert len(set(now[:, 1])) == len(set(now[:, 2])) == len(now) > 0
    assert quality("association", SMALL, result)[1] > 95.0


def test_a_swap_counts_as_missed_and_as_false() -> None:
    last = len(SMALL.time_s) - 1
    row = {(s, v): k for k, (s, v) in enumerate(zip(SMALL.source.tolist(), SMALL.vessel.tolist(), strict=True))}
    first, second = np.flatnonzero(np.bincount(SMALL.vessel) > 1)[:2].tolist()
    swapped = [(last, row[RADAR, first], row[AIS, second]), (last, row[RADAR, second], row[AIS, second])]
    counts = decisions(SMALL, np.array(swapped))
    exist = SMALL.measured * int((np.bincount(SMALL.vessel) > 1).sum())
    assert (counts.tp, counts.fp, counts.fn) == (1, 1, exist - 1)


@pytest.mark.parametrize("task", [ours.spots, scipy.spots])
def test_spots_are_compact(task) -> None:
    history = make_history(1200, 3, 1, 1)
    figure, value = quality("spots", history, task(history, Stopwatch()))
    everywhere = np.sqrt(history.position_m[-1].var(axis=0).sum())
    assert figure == "RMS to centre m"
    assert value < 0.8 * everywhere


def by_stone_soup(task: str, history: TrackHistory | PlotHistory, folder: Path) -> TaskResult:
    python = ENVIRONMENTS / "stonesoup" / "bin" / "python"
    if not (ENVIRONMENTS / "stonesoup" / MARK).is_file():
        pytest.skip("no environment of Stone Soup; python -m scaling.peers.run --peer stonesoup makes one")
    save(folder / "input.npz", history)
    words = [str(python), "-m", "scaling.peers.stonesoup.adapter", task, str(folder / "input.npz"), str(folder / "result.npz")]
    subprocess.run(words, cwd=CHECKOUT, check=True)
    result: TaskResult = load(folder / "result.npz", TaskResult)
    return result


def test_stone_soup_pairs_radar_with_ais(tmp_path) -> None:
    history = make_history(24, 12, 4, 1)
    result = by_stone_soup("association", history, tmp_path)
    assert result.units * len(history.time_s) == pytest.approx(12 * 12)
    assert quality("association", history, result)[1] > 90.0


PLOTS = make_plots(60, 14, 4, 1)


@pytest.mark.parametrize("task", ["tracking", "tracking_jpda"])
def test_stone_soup_tracks_the_vessels_in_cover(task, tmp_path) -> None:
    few = make_plots(24, 9, 2, 1)
    figures = track_figures(few, by_stone_soup(task, few, tmp_path))
    assert figures["completeness"] > 0.8
    assert figures["rmse_m"] < 20.0


@pytest.mark.parametrize("task", [ours.tracking, method.tracking])
def test_ours_and_filterpy_track_the_vessels_in_cover(task) -> None:
    result = task(PLOTS, Stopwatch())
    figures = track_figures(PLOTS, result)
    assert len(result.cpu_s) == PLOTS.measured
    assert figures["completeness"] > 0.9
    assert figures["false_tracks"] < 2.0
    assert figures["rmse_m"] < 15.0
    assert figures["gospa_m"] >= figures["rmse_m"] * np.sqrt(figures["completeness"])


def test_tracks_that_are_missed_false_and_off_are_counted() -> None:
    rows = []
    for cycle in range(PLOTS.first, len(PLOTS.time_s)):
        seen = np.flatnonzero(in_cover(PLOTS, PLOTS.true_position_m[cycle]))
        at = PLOTS.true_position_m[cycle][seen[1:]] + np.array([3.0, 4.0])
        far = PLOTS.site_m[:1] + 500.0 * np.eye(2)[:1]
        for k, position in enumerate(np.concatenate([at, far])):
            rows.append([cycle, k, *position, 0.0, 0.0])
    figures = track_figures(PLOTS, TaskResult(np.zeros(0), np.zeros(0), {}, tracks=np.array(rows)))
    vessels = sum(int(in_cover(PLOTS, PLOTS.true_position_m[c]).sum()) for c in range(PLOTS.first, len(PLOTS.time_s)))
    assert figures["completeness"] == pytest.approx(1.0 - PLOTS.measured / vessels, abs=2.5 / vessels)
    assert figures["false_tracks"] == pytest.approx(1.0, abs=0.3)
    assert figures["rmse_m"] == pytest.approx(5.0, abs=0.5)


def test_plots_are_the_same_for_a_seed_and_in_one_plane_in_both_forms() -> None:
    again, other = make_plots(60, 14, 4, 1), make_plots(60, 14, 4, 2)
    assert all(np.array_equal(getattr(PLOTS, f.name), getattr(again, f.name)) for f in fields(PLOTS))
    assert len(other.cycle) != len(PLOTS.cycle) or not np.array_equal(other.position_m, PLOTS.position_m)
    gap = PLOTS.position_m - PLOTS.site_m[PLOTS.radar]
    np.testing.assert_allclose(np.hypot(gap[:, 0], gap[:, 1]), PLOTS.range_m, rtol=1e-3)
    turned = (np.arctan2(gap[:, 0], gap[:, 1]) - PLOTS.azimuth_rad + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(turned).max() < 1e-3
    across = PLOTS.range_m * np.radians(0.3)
    np.testing.assert_allclose(np.trace(PLOTS.covariance, axis1=1, axis2=2), 100.0 + across**2, rtol=1e-2)


def test_an_adapter_names_its_tasks(monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["adapter", "fusion", "input.npz", "result.npz"])
    with pytest.raises(SystemExit, match=r"needed a task of \['imm'\]"):
        run_adapter(filterpy.TASKS)
