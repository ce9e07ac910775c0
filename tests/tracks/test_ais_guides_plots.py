"""AIS messages guide which plots a radar track takes, and are not in the track that is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from radar_world import ORIGIN_DEG, PERIOD_S, cut, plots_of, two_radars, world

from coastwatch.batches import Messages
from coastwatch.geodesy import to_plane
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, TableTracker

pytestmark = pytest.mark.contract

GUIDED = TableTracker(method="guided_vimmjipda")
SIGMA_M = 3.0
CYCLES = 24


def messages_of(truth, vessels, every_s=6.0, cycles=CYCLES):
    """Messages of these vessels, MMSI 1000 + vessel, sorted by time."""
    rng = np.random.default_rng(5)
    time = np.concatenate([np.arange(rng.uniform(0.0, every_s), PERIOD_S * cycles, every_s) for _ in vessels])
    vessel = np.repeat(vessels, len(time) // len(vessels))
    time = time[: len(vessel)]
    order = np.argsort(time, kind="stable")
    time, vessel = time[order], vessel[order]
    place = truth.at(vessel, time)[0] + SIGMA_M * rng.standard_normal((len(time), 2))
    return Messages(time, place, np.tile(SIGMA_M**2 * np.eye(2), (len(time), 1, 1)), 1000 + vessel, vessel)


def run(method, plots, messages, memory=None, cycles=range(CYCLES)):
    """Memory and the tracks of each cycle."""
    memory, out = method.init() if memory is None else memory, []
    for cycle in cycles:
        now = messages.take((messages.time_s > PERIOD_S * cycle) & (messages.time_s <= PERIOD_S * (cycle + 1)))
        given = RegionInput.of_plots(cut(plots, cycle), PERIOD_S * (cycle + 1), two_radars())
        memory, (tracks, *_) = method.step(memory, given._replace(messages=now))
        out.append(tracks)
    return memory, out


def errors_m(tracks, truth):
    """Distance of each track from its vessel."""
    where, _ = truth.at(tracks.origin, tracks.time_s)
    return np.hypot(*(to_plane(tracks.position_deg, ORIGIN_DEG) - where).T)


@pytest.fixture(scope="module")
def column():
    """Ten ships in column 100 m apart, by radars that err by 87 m across the beam, and their messages: truth, plots, messages."""
    still = np.zeros(10)
    truth = replace(
        world(10, 1, kick_m_s=0.0),
        start_m=np.column_stack([still, 100.0 * np.arange(10) - 500.0]),
        velocity_m_s=np.column_stack([still, still + 4.0]),
    )
    plots = plots_of(truth, two_radars(azimuth_sigma_deg=0.5), PERIOD_S * CYCLES, 7, detection=0.8)
    return truth, plots, messages_of(truth, np.arange(10), every_s=9.0)


def test_ships_closer_than_the_noise_keep_their_plots_and_report_them_alone(column):
    truth, plots, messages = column
    _, out = run(GUIDED, plots, messages)
    last = out[-1]
    assert len(last) == 10
    assert (last.held_mmsi == 1000 + last.origin).all()
    _, unguided = run(TableTracker(method="sided_vimmjipda"), plots, messages)
    assert errors_m(last, truth).mean() < 0.6 * errors_m(unguided[-1], truth).mean()
    # of plots alone: ten times as uncertain as the messages, and no message is as new as a plot
    assert np.sqrt(last.covariance[:, 1, 1]).min() > 3.0 * SIGMA_M
    assert set(last.updated_s.tolist()) <= set(plots.time_s.tolist())
    half, _ = run(GUIDED, plots, messages, cycles=range(12))
    _, rest = run(GUIDED, plots, messages, load(save(half)), range(12, CYCLES))
    assert np.array_equal(rest[-1].covariance, last.covariance)
    assert np.array_equal(rest[-1].position_deg, last.position_deg)


@pytest.mark.parametrize("seed", [35, 37])
def test_a_radar_with_a_bias_of_three_sigmas_makes_few_second_tracks(seed):
    """Ranges that are 30 m too long, of a radar that states 10 m: its plots lie beside the AIS of their vessels for good."""
    truth = world(20, seed, kick_m_s=0.0, side_nm=6.0)
    every = plots_of(truth, two_radars(), PERIOD_S * 2 * CYCLES, seed, detection=0.9)
    plots = every.take(every.sensor == 0)
    off_m = plots.position_m - plots.site_m
    too_far = replace(plots, position_m=plots.position_m + 30.0 * off_m / np.hypot(*off_m.T)[:, None])
    messages = messages_of(truth, np.arange(20), cycles=2 * CYCLES)
    second = []
    for registration in (1.0, 0.0):
        method = TableTracker(method="guided_vimmjipda", messages={"method": "guiding", "registration": registration})
        _, out = run(method, too_far, messages, cycles=range(2 * CYCLES))
        second.append(sum(len(tracks) - len(np.unique(tracks.origin)) for tracks in out))
    assert second[1] > 20  # of some 370 shown in all cycles
    assert second[0] < 0.35 * second[1]


def test_particles_cannot_be_guided():
    with pytest.raises(ValueError, match=r"bank.method: got 'particles', needed 'compiled' with messages.method = 'guiding'"):
        TableTracker(method="bp_particles", messages={"method": "guiding"})


def test_a_memory_of_plots_alone_can_be_guided_from_now_on(column):
    _, plots, messages = column
    unguided = TableTracker(method="vimmjipda")
    half, _ = run(unguided, plots, messages, cycles=range(12))
    _, out = run(GUIDED, plots, messages, half, range(12, CYCLES))
    assert (out[-1].held_mmsi >= 0).sum() >= 5  # of ten: tracks had swapped ships before


def test_a_filter_that_is_not_finite_contradicts_nothing_and_ends_no_run(column):
    """Its covariance could reach an eigenvalue routine, which raises an error."""
    _, plots, messages = column
    memory, before = run(GUIDED, plots, messages, cycles=range(12))
    memory.plots_alone.covariance[memory.table.live[0]] = np.nan
    _, out = run(GUIDED, plots, messages, memory, range(12, CYCLES))
    assert len(out[-1]) >= len(before[-1]) - 1
    assert (out[0].held_mmsi >= 0).sum() >= (before[-1].held_mmsi >= 0).sum() - 1
