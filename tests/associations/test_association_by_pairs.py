"""The array code of the default association against the same done pair by pair: the same pairs, whatever the water and the settings."""

import copy

import numpy as np
import pytest
from association_by_pairs import Rules, earth_centred, step
from hypothesis import given, strategies as st

from coastwatch.associations import AssociationInput, WindowedCovariance, pairing, step_with_candidates
from coastwatch.associations.pairing import gated
from coastwatch.associations.windowed_covariance import score_spots
from coastwatch.batches import Spots, Tracks
from coastwatch.geodesy import offset_deg
from coastwatch.kernels.association.prune_pairs import hopeless_steps, possible_pairs
from coastwatch.kernels.threads import threads
from coastwatch.server.checkpoint import save
from coastwatch.stage import serial
from coastwatch.workers import open_workers

pytestmark = pytest.mark.oracle

ORIGINS = ((-23.0, 179.998), (60.0, 5.0), (-84.9, -20.0), (0.0, 0.0))
PERIOD_S = 3.0


class Port:
    """Ships at anchor in rows, a convoy and strays, seen by some of several sources; tracks end and begin, and come in any order."""

    def __init__(self, seed, count=40, sources=3):
        self.rng, self.sources = np.random.default_rng([seed, 0]), sources
        rng = self.rng
        self.origin = np.array(ORIGINS[seed % len(ORIGINS)])
        kind = rng.integers(0, 3, count)
        row = np.stack([np.arange(count) % 6 * 130.0, np.arange(count) // 6 * 150.0], axis=1)
        line = np.stack([np.arange(count) * 60.0 - 900.0, np.full(count, -300.0)], axis=1)
        self.start = np.choose(kind[:, None], [row, line, rng.uniform(-1500.0, 1500.0, (count, 2))])
        heading, speed = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.0, 14.0, count)
        stray = speed[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1)
        self.velocity = np.choose(kind[:, None], [np.zeros((count, 2)), np.full((count, 2), 4.0), stray])
        sees = rng.random((count, sources)) < 0.7
        self.vessel, self.source = np.nonzero(sees)
        self.ids = rng.permutation(10**6)[: len(self.vessel)]
        self.sigma = rng.uniform(2.0, 30.0, len(self.vessel))

    def tracks(self, cycle):
        rng, n = self.rng, len(self.vessel)
        ended = rng.random(n) < 0.05
        self.ids = np.where(ended, 10**6 * (cycle + 1) + np.arange(n), self.ids)
        metres = (self.start + PERIOD_S * cycle * self.velocity)[self.vessel] + 0.7 * rng.normal(
            0.0, self.sigma[:, None], (n, 2)
        )
        root = 0.3 * rng.normal(0.0, 1.0, (n, 4, 4)) + np.eye(4)
        scale = np.stack([self.sigma, self.sigma, 0.05 * self.sigma, 0.05 * self.sigma], axis=1)[:, :, None]
        covariance = (scale * root) @ (scale * root).swapaxes(1, 2)
        covariance[rng.random(n) < 0.1] = np.nan
        covariance[rng.random(n) < 0.02] *= -1.0
        report = np.array([[900.0, 120.0], [120.0, 400.0]]) * rng.uniform(0.1, 1.0, (n, 1, 1))
        ais = self.source == self.sources - 1
        made = Tracks(
            self.ids,
            self.source,
            np.full(n, PERIOD_S * cycle),
            offset_deg(np.broadcast_to(self.origin, (n, 2)), metres),
            self.velocity[self.vessel] + rng.normal(0.0, 0.1 * self.sigma[:, None], (n, 2)),
            covariance,
            report,
            np.full(n, PERIOD_S * cycle),
            np.zeros(n),
            np.where(ais, self.vessel, -1),
            self.vessel,
        )
        here = np.flatnonzero(rng.random(n) < 0.93)
        return made.take(rng.permutation(here) if cycle % 3 == 2 else here)


def spots_of(tracks, count, reach_m, seed):
    """Spots drawn by chance, so that every pair may be across a border; halos of what is within reach of a member."""
    rng, points = np.random.default_rng([seed, 9]), earth_centred(tracks.position_deg)
    spot = rng.integers(0, count, len(tracks))
    halo = []
    for k in range(count):
        gap = np.linalg.norm(points[:, None] - points[None, spot == k], axis=2).min(axis=1, initial=np.inf)
        halo.append(np.flatnonzero((gap <= reach_m) & (spot != k)))
    sizes = [len(h) for h in halo]
    return Spots(np.zeros((count, 3)), spot, np.repeat(np.arange(count), sizes), np.concatenate(halo).astype(np.int64))


def one_spot(tracks):
    none = np.zeros(0, np.int64)
    return Spots(np.zeros((1, 3)), np.zeros(len(tracks), np.int64), none, none)


ROUNDING = (
    1e-12  # of a score: 20 steps of up to 100, whose logarithms differ from the library's by a few units in the last place
)


def assert_equal(found, wanted):
    assert found.tested == wanted.tested
    if wanted.unique:
        for name in ("first", "second", "vessel"):
            assert getattr(found, name).tolist() == list(getattr(wanted, name)), name
        np.testing.assert_allclose(found.statistic, wanted.statistic, rtol=0.0, atol=ROUNDING)


def assert_scores_equal(method, memory, tracks, spots, wanted):
    """Of all pairs that are within the gate, taken or not."""
    *_, every = step_with_candidates(method, copy.deepcopy(memory), AssociationInput(tracks, spots))
    scores = {pair: value for pair, value in wanted.scores.items() if value > -np.inf}
    pairs = zip(every.first.tolist(), every.second.tolist(), strict=True)
    assert dict(zip(pairs, every.score.tolist(), strict=True)) == pytest.approx(scores, rel=0.0, abs=ROUNDING)


RULES = st.builds(
    Rules,
    window=st.sampled_from([1, 2, 4, 20]),
    gate_m=st.sampled_from([80.0, 400.0, 1000.0, 5000.0]),
    prior=st.sampled_from([0.0, 10.0]),
    floor=st.sampled_from([0.2, 0.5, 1.0]),
    cap=st.sampled_from([1.0, 2.0]),
    forgetting=st.sampled_from([0.0, 0.5, 0.9, 1.0]),
    rival_forgetting=st.sampled_from([0.0, 0.5, 0.9]),
    registration=st.sampled_from([0.0, 0.5]),
    step_limit=st.sampled_from([0.5, 3.0, 20.0, 100.0]),
    misled_share=st.sampled_from([0.01, 0.3]),
    threshold=st.sampled_from([-15.0, -1.0, 0.0, 4.0]),
)


@given(st.integers(0, 10**6), RULES, st.sampled_from([1, 4]), st.sampled_from([0.0, 1.0]))
def test_any_settings_and_spots(seed, rules, count, halo):
    """With a halo that is wide enough or none, in which case pairs across a border are lost."""
    port, method = Port(seed, count=20), WindowedCovariance(**vars(rules))
    windows, memory = {}, method.init()
    for cycle in range(7):
        tracks = port.tracks(cycle)
        spots = spots_of(tracks, count, halo * rules.gate_m, seed)
        windows, wanted = step(windows, tracks, spots, rules)
        assert_scores_equal(method, memory, tracks, spots, wanted)
        memory, found = method.step(memory, AssociationInput(tracks, spots, serial))
        assert_equal(found, wanted)


def test_full_windows_and_what_is_screened():
    """The default, until windows have been full for some cycles: pairs given up early are none that count."""
    port, method, rules = Port(0, count=40), WindowedCovariance(), Rules()
    windows, memory, given_up = {}, method.init(), 0
    seen = []

    def counted(work, settings, arrays, spots):
        assert work is score_spots
        seen.append(arrays)
        return serial(work, settings, arrays, spots)

    for cycle in range(26):
        tracks = port.tracks(cycle)
        before = copy.deepcopy(memory)
        windows, wanted = step(windows, tracks, one_spot(tracks), rules)
        memory, found = method.step(memory, AssociationInput(tracks, one_spot(tracks), counted))
        assert wanted.unique
        assert_equal(found, wanted)
        assert_scores_equal(method, before, tracks, one_spot(tracks), wanted)
        given_up += found.tested - survivors(method, seen[-1])
    assert given_up > 2000
    assert max(len(entries) for entries in windows.values()) == 20


def survivors(method, arrays):
    """Pairs that are not given up."""
    pair = gated(0, len(arrays["place"]), np.arange(len(arrays["place"])), arrays, method.gate_m)
    return possible_pairs(pair, arrays["bound"], hopeless_steps(method.rule(), method.window), method.unrelated_speed_m_s).sum()


@pytest.mark.parametrize("how", ["threads", pytest.param("processes", marks=pytest.mark.slow)])
def test_threads_and_processes_change_no_bit(how, monkeypatch):
    monkeypatch.setattr("coastwatch.kernels.threads.BLOCKS_A_THREAD", 40)
    method, answers = WindowedCovariance(window=6), []
    for many in (False, True):
        port, memory = Port(7, count=40), method.init()
        with open_workers(how if many else "threads", 3 if many else 1) as workers:
            for cycle in range(5):
                tracks = port.tracks(cycle)
                memory, found = method.step(
                    memory, AssociationInput(tracks, spots_of(tracks, 5, method.gate_m, 1), workers.spots)
                )
                answers.append((many, save((found.first, found.second, found.statistic, found.vessel, found.tested))))
            answers.append((many, save(memory)))
    one, other = ([answer for many, answer in answers if many is which] for which in (False, True))
    assert one == other


def test_blocks_of_threads_meet_at_any_row():
    """Every track a block of its own."""
    port, method = Port(5, count=50), WindowedCovariance(window=4)
    memory = method.init()
    for cycle in range(5):
        tracks = port.tracks(cycle)
        seen = []

        def kept(work, settings, arrays, spots, seen=seen):
            seen.append((settings, arrays, spots))
            return serial(work, settings, arrays, spots)

        memory, _ = method.step(memory, AssociationInput(tracks, spots_of(tracks, 3, method.gate_m, 2), kept))
        whole = score_spots(*seen[0])
        with pytest.MonkeyPatch.context() as patch, threads(2):
            least_one = pairing.LEAST_TRACKS
            patch.setattr(pairing, "LEAST_TRACKS", 1)
            patch.setattr("coastwatch.kernels.threads.BLOCKS_A_THREAD", 10**6)
            parts = score_spots(*seen[0])
        assert least_one > 1
        for a, b in zip(whole[:3], parts[:3], strict=True):
            assert a.tobytes() == b.tobytes()
        assert whole[3].sum() == parts[3].sum()


@pytest.mark.parametrize("position", [(89.9999, 0.0), (-90.0, 0.0), (0.0, 180.0), (0.0, -180.0)])
def test_poles_and_the_antimeridian_are_places_like_others(position):
    method, rng = WindowedCovariance(), np.random.default_rng([3, 0])
    n = 60
    where = np.empty((n, 2))
    where[:, 0] = np.clip(position[0] + rng.normal(0.0, 0.003, n), -90.0, 90.0)
    where[:, 1] = rng.uniform(-180.0, 180.0, n) if abs(position[0]) > 80.0 else position[1] + rng.normal(0.0, 0.003, n)
    where[:, 1] = (where[:, 1] + 180.0) % 360.0 - 180.0
    source = np.arange(n) % 2
    made = Port(0, count=4).tracks(0).take(np.zeros(n, np.int64))
    tracks = Tracks(
        np.arange(n),
        source,
        made.time_s,
        where,
        made.velocity_m_s,
        np.tile(np.eye(4), (n, 1, 1)),
        made.report_covariance,
        made.updated_s,
        made.started_s,
        np.where(source == 1, np.arange(n), -1),
        np.arange(n),
    )
    gap = np.linalg.norm(earth_centred(where)[:, None] - earth_centred(where)[None], axis=2)
    near = (gap <= method.gate_m) & (source[:, None] < source[None])
    _, found = method.step(method.init(), AssociationInput(tracks, one_spot(tracks), serial))
    assert found.tested == near.sum() > 100
