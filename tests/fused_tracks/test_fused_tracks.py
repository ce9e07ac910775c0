"""Every method of the fused_tracks stage: one row a vessel, pure, resumable, indifferent to the order of tracks."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from unions import methods_in

from coastwatch.batches import Associations, Measurements, Tracks
from coastwatch.fused_tracks import (
    Convex,
    CovarianceIntersection,
    Fuser,
    FusionInput,
    ImmOfTracksLiteral,
    WeightedAverage,
)
from coastwatch.fused_tracks.imm_of_tracks_literal import Window
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

METHODS = [
    *methods_in(Fuser),
    Convex(registration=0.1),
    WeightedAverage(weights="fixed"),
    ImmOfTracksLiteral(window=6, scatter="values"),
]
KINDS = np.array([0, 0, 1, 2], np.int64)
ROUNDING_M = 1e-6


def tracks(vessel, source, seed=0, time_s=0.0):
    rng = np.random.default_rng([seed, 3])
    n = len(vessel)
    at = offset_deg(np.array([-23.0, 179.9995]), 2000.0 * np.asarray(vessel)[:, None] + rng.normal(0.0, 10.0, (n, 2)))
    root = rng.normal(0.0, 1.0, (n, 4, 4)) * np.array([10.0, 10.0, 0.5, 0.5])[:, None]
    ids = 1000 * np.asarray(source) + np.asarray(vessel)
    return Tracks(
        ids,
        np.asarray(source),
        np.full(n, time_s),
        at,
        rng.normal(0.0, 3.0, (n, 2)),
        root @ root.transpose(0, 2, 1) + 0.01 * np.eye(4),
        np.tile(np.eye(2) * 100.0, (n, 1, 1)),
        np.full(n, time_s),
        np.zeros(n),
        np.where(np.asarray(source) == 2, ids, -1),
        np.asarray(vessel),
    )


def associated(vessel):
    none = np.zeros(0, np.int64)
    return Associations(none, none, np.zeros(0), np.asarray(vessel))


VESSEL, SOURCE = np.array([0, 1, 2, 2, 0, 3, 2]), np.array([0, 0, 0, 1, 2, 2, 2])


@pytest.mark.parametrize("method", METHODS, ids=lambda m: f"{m.method}-{getattr(m, 'weights', '')}")
def test_one_row_a_vessel_and_a_lone_track_is_itself(method):
    t = tracks(VESSEL, SOURCE)
    _, fused = method.step(method.init(), FusionInput(t, Measurements.empty(), associated(VESSEL), 0.0, KINDS))
    assert len(fused) == 4
    lone = {1: 1, 3: 5}
    for vessel, row in lone.items():
        assert np.linalg.norm(difference_m(fused.position_deg[vessel], t.position_deg[row])) < ROUNDING_M
        np.testing.assert_allclose(fused.velocity_m_s[vessel], t.velocity_m_s[row])
        np.testing.assert_allclose(fused.covariance[vessel], t.covariance[row])
    assert (np.linalg.eigvalsh(fused.covariance) > 0.0).all()


@pytest.mark.parametrize("method", METHODS, ids=lambda m: f"{m.method}-{getattr(m, 'weights', '')}")
def test_pure_and_resumable_and_indifferent_to_order(method):
    memory = method.init()
    rng = np.random.default_rng([5, 0])
    for cycle in range(8):
        t = tracks(VESSEL, SOURCE, seed=cycle, time_s=3.0 * cycle)
        before = save(memory)
        again, fused = method.step(load(before), FusionInput(t, Measurements.empty(), associated(VESSEL), 3.0 * cycle, KINDS))
        memory_1, fused_1 = method.step(memory, FusionInput(t, Measurements.empty(), associated(VESSEL), 3.0 * cycle, KINDS))
        assert save(memory) == before
        assert save(again) == save(memory_1)
        np.testing.assert_array_equal(fused.position_deg, fused_1.position_deg)
        order = rng.permutation(len(VESSEL))
        _, shuffled = method.step(
            memory, FusionInput(t.take(order), Measurements.empty(), associated(VESSEL[order]), 3.0 * cycle, KINDS)
        )
        assert np.abs(difference_m(shuffled.position_deg, fused.position_deg)).max() < ROUNDING_M
        memory = memory_1


@pytest.mark.parametrize("method", METHODS, ids=lambda m: f"{m.method}-{getattr(m, 'weights', '')}")
def test_no_track(method):
    none = np.zeros(0, np.int64)
    _, fused = method.step(method.init(), FusionInput(Tracks.empty(), Measurements.empty(), associated(none), 0.0, KINDS))
    assert len(fused) == 0


@pytest.mark.parametrize("method", METHODS, ids=lambda m: f"{m.method}-{getattr(m, 'weights', '')}")
def test_a_source_without_covariance_counts_with_its_specification(method):
    t = tracks(np.array([0, 0]), np.array([0, 2]))
    t.covariance[0] = np.nan
    _, fused = method.step(method.init(), FusionInput(t, Measurements.empty(), associated(np.array([0, 0])), 0.0, KINDS))
    assert np.isfinite(fused.position_deg).all()
    assert np.isfinite(fused.covariance).all()


def test_round_trip_through_settings():
    for method in METHODS:
        assert TypeAdapter(Fuser).validate_python(method.model_dump()) == method


def test_fixed_weights_are_the_papers():
    t = tracks(np.array([0, 0]), np.array([0, 2]))
    _, fused = WeightedAverage(weights="fixed").step(
        None, FusionInput(t, Measurements.empty(), associated(np.array([0, 0])), 0.0, KINDS)
    )
    between = difference_m(t.position_deg[1], t.position_deg[0])
    np.testing.assert_allclose(difference_m(fused.position_deg[0], t.position_deg[0]), 0.8 * between, atol=1e-4)
    np.testing.assert_allclose(fused.velocity_m_s[0], 0.2 * t.velocity_m_s[0] + 0.8 * t.velocity_m_s[1])


def test_calibrated_weights_at_an_rmse_of_four_to_one():
    t = tracks(np.array([0, 0]), np.array([0, 2]))
    t.covariance[0], t.covariance[1] = 16.0 * np.eye(4), np.eye(4)
    _, fused = WeightedAverage().step(None, FusionInput(t, Measurements.empty(), associated(np.array([0, 0])), 0.0, KINDS))
    share = difference_m(fused.position_deg[0], t.position_deg[0]) / difference_m(t.position_deg[1], t.position_deg[0])
    np.testing.assert_allclose(share, 16.0 / 17.0, atol=1e-4)


def test_two_weights_of_zero_are_refused():
    with pytest.raises(ValidationError, match="at least one above 0"):
        WeightedAverage(radar_weight=0.0, ais_weight=0.0)


def test_intersection_has_the_smallest_determinant_and_stays_consistent():
    method, pairs = CovarianceIntersection(steps=30), np.repeat(np.arange(40), 2)
    t = tracks(pairs, np.tile([0, 2], 40))
    _, fused = method.step(None, FusionInput(t, Measurements.empty(), associated(pairs), 0.0, KINDS))
    a, b = t.covariance[::2], t.covariance[1::2]
    grid = np.linspace(0.0, 1.0, 401)[:, None, None, None]
    best = -np.linalg.slogdet(grid * np.linalg.inv(a) + (1.0 - grid) * np.linalg.inv(b))[1].max(axis=0)
    assert (np.linalg.slogdet(fused.covariance)[1] <= best + 1e-4).all()


def test_tracks_that_are_known_alike_intersect_half_way():
    t = tracks(np.array([0, 0]), np.array([0, 2]))
    t.covariance[1] = t.covariance[0]
    _, fused = CovarianceIntersection().step(
        None, FusionInput(t, Measurements.empty(), associated(np.array([0, 0])), 0.0, KINDS)
    )
    np.testing.assert_allclose(fused.covariance[0], t.covariance[0], rtol=1e-9)
    between = difference_m(t.position_deg[1], t.position_deg[0])
    np.testing.assert_allclose(difference_m(fused.position_deg[0], t.position_deg[0]), 0.5 * between, atol=1e-4)
    np.testing.assert_allclose(fused.velocity_m_s[0], t.velocity_m_s.mean(axis=0))


@pytest.mark.parametrize("about_line", [False, True])
def test_the_window_has_the_sample_covariance_of_the_last_states(about_line):
    window, shown = Window.empty(p=7), []
    for cycle in range(10):
        t = tracks(VESSEL, SOURCE, seed=cycle, time_s=3.0 * cycle)
        window = window.extended(t, 3.0 * cycle)
        shown.append((t.position_deg, t.velocity_m_s))
    found = window.covariance(t.track_id, about_line=about_line)
    for k in range(len(t)):
        metres = [difference_m(p[k], t.position_deg[k]) for p, _ in shown[-7:]]
        state = np.column_stack([np.array(metres), [v[k] for _, v in shown[-7:]]])
        if about_line:
            time = np.arange(7.0)
            state = state - np.stack([np.polyval(np.polyfit(time, x, 1), time) for x in state.T], axis=1)
        np.testing.assert_allclose(found[k], np.cov(state.T), rtol=1e-6, atol=1e-6)


def test_the_window_of_a_track_that_was_away_begins_again():
    window = Window.empty(p=6)
    for cycle in range(6):
        t = tracks(VESSEL, SOURCE, seed=cycle)
        window = window.extended(t.take(np.arange(6)) if cycle == 2 else t, 3.0 * cycle)
    found = window.covariance(t.track_id, about_line=False)
    assert np.isfinite(found[:6]).all()
    assert np.isnan(found[6]).all()


def test_the_literal_imm_believes_the_smoother_track_however_wrong_it_is():
    """A radar track 10 m off without scatter against an AIS track that scatters by 3 m about the truth."""
    method, rng = ImmOfTracksLiteral(), np.random.default_rng([4, 0])
    memory, off = method.init(), []
    for cycle in range(30):
        t = tracks(np.array([0, 0]), np.array([0, 2]))
        where = offset_deg(np.array([-23.0, 179.9995]), np.array([[10.0, 0.0], rng.normal(0.0, 3.0, 2)]))
        t = replace(t, position_deg=where, velocity_m_s=0.01 * rng.normal(size=(2, 2)))
        memory, fused = method.step(
            memory, FusionInput(t, Measurements.empty(), associated(np.array([0, 0])), 3.0 * cycle, KINDS)
        )
        off.append(difference_m(fused.position_deg[0], np.array([-23.0, 179.9995]))[0])
    assert np.abs(np.array(off[:5])).max() < 8.0
    assert np.mean(off[20:]) > 9.0
