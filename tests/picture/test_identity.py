"""Kernels of identity, and the known vessels they work on."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.batches import Picture
from coastwatch.geodesy import offset_deg
from coastwatch.kernels.identity.lifecycle import COASTING, DELETED, HIDDEN, MERGED, PRESENT, lifecycle
from coastwatch.kernels.identity.match import (
    AS_FIRST,
    AS_PREVIOUS,
    FIRST_VESSEL_SHARE,
    NOT_REMEMBERED,
    count_votes,
    settle_uncontested,
)
from coastwatch.picture.vessels import KnownVessels, predict

pytestmark = pytest.mark.oracle

NOW_S, COAST_S, HOLD_S, RETURN_S = 1000.0, 30.0, 120.0, 3600.0


def picture(seed: int, rows: int) -> Picture:
    rng = np.random.default_rng([seed, 8])
    made = {f.name: getattr(Picture.empty(), f.name) for f in fields(Picture)}
    return Picture(**{name: (40.0 * rng.random((rows, *a.shape[1:]))).astype(a.dtype) for name, a in made.items()})


@pytest.mark.parametrize(
    ("group", "remembered", "silent_s", "mmsi", "state"),
    [
        (7, AS_PREVIOUS, 0.0, -1, PRESENT),
        (7, NOT_REMEMBERED, 500.0, 211, PRESENT),
        (-1, NOT_REMEMBERED, 30.0, -1, COASTING),
        (-1, NOT_REMEMBERED, 120.0, -1, HIDDEN),
        (-1, NOT_REMEMBERED, 121.0, -1, DELETED),
        (-1, NOT_REMEMBERED, 3600.0, 211, HIDDEN),
        (-1, NOT_REMEMBERED, 3601.0, 211, DELETED),
        (-1, AS_PREVIOUS, 0.0, 211, MERGED),
        (-1, AS_FIRST, 30.0, -1, COASTING),
        (-1, AS_FIRST, 121.0, -1, MERGED),
        (-1, AS_FIRST, np.inf, -1, MERGED),
        (-1, NOT_REMEMBERED, np.inf, -1, DELETED),
    ],
)
def test_life_cycle(group: int, remembered: int, silent_s: float, mmsi: int, state: int) -> None:
    out = np.full(3, -1, np.int8)
    columns = (np.full(3, x) for x in (group, remembered, NOW_S - silent_s, mmsi))
    lifecycle(1, 2, *columns, (NOW_S, COAST_S, HOLD_S, RETURN_S), out)
    assert out.tolist() == [-1, state, -1]


@given(st.integers(0, 12), st.integers(0, 10**6))
def test_votes_are_counted_and_what_is_uncontested_is_settled(tracks: int, seed: int) -> None:
    rng = np.random.default_rng([seed, 9])
    group = np.sort(np.unique(rng.integers(0, 5, tracks), return_inverse=True)[1])
    groups, vessels = int(group.max(initial=-1)) + 1, 6
    previous, first = rng.integers(-1, vessels, tracks), rng.integers(0, vessels, tracks)
    first[previous < 0] = -1
    weight, seniority, vessel_id = rng.choice([1.0, 1.2], tracks), rng.choice([0.0, 0.3], vessels), rng.permutation(vessels)
    start = np.searchsorted(group, np.arange(groups + 1))
    middle, given = groups // 2, ((start, np.arange(tracks)), previous, first, weight, seniority)
    parts = count_votes(0, middle, *given), count_votes(middle, groups, *given)
    votes = tuple(np.concatenate(part) for part in zip(*parts, strict=True))

    gain: dict[tuple[int, int], float] = {}
    for g, p, f, w in zip(group.tolist(), previous.tolist(), first.tolist(), weight.tolist(), strict=True):
        if p >= 0:
            for vessel, part in ((p, w), (f, FIRST_VESSEL_SHARE * w)):
                gain[g, vessel] = gain.get((g, vessel), seniority[vessel]) + part
    counted = dict(zip(zip(*(v.tolist() for v in votes[:2]), strict=True), votes[2].tolist(), strict=True))
    assert counted == pytest.approx(gain)

    chosen = np.full(groups, -1)
    contested = settle_uncontested(*votes, vessel_id, chosen)
    for g in range(groups):
        mine = {v: counted[k, v] for k, v in counted if k == g}
        shared = any((k, v) in counted for k in range(groups) if k != g for v in mine)
        assert contested[votes[0] == g].all() if shared else not contested[votes[0] == g].any()
        if shared or not mine:
            assert chosen[g] == -1
        else:
            assert chosen[g] == min(mine, key=lambda v: (-mine[v], vessel_id[v]))


def test_known_vessels_are_the_shown_then_the_hidden_then_the_merged() -> None:
    shown, hidden, merged = picture(1, 20), picture(2, 9), np.array([77, 78])
    known, every = KnownVessels(shown, hidden, merged), Picture.join([shown, hidden])
    rows = np.array([0, 28, 19, 20, 5, 5])
    for field in fields(Picture):
        np.testing.assert_array_equal(getattr(known.take(rows), field.name), getattr(every, field.name)[rows])
    columns = known.columns()
    assert columns.vessel_id.tolist() == [*every.vessel_id.tolist(), 77, 78]
    assert columns.updated_s[-2:].tolist() == [-np.inf, -np.inf]
    assert columns.mmsi[-3:].tolist() == [int(hidden.mmsi[-1]), -1, -1]


def test_a_vessel_without_tracks_goes_straight_on_and_grows_uncertain() -> None:
    vessels, drift = picture(3, 5), 0.2
    at = predict(vessels, NOW_S, drift)
    for k in range(len(vessels)):
        dt = NOW_S - vessels.time_s[k]
        move = np.eye(4) + dt * np.eye(4, k=2)
        noise = np.kron([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]], drift**2 * np.eye(2))
        np.testing.assert_allclose(at.covariance[k], move @ vessels.covariance[k] @ move.T + noise, rtol=1e-9)
        np.testing.assert_allclose(
            at.position_deg[k], offset_deg(vessels.position_deg[k], dt * vessels.velocity_m_s[k]), rtol=1e-12
        )
