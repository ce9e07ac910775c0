"""Tracks by particles: every vessel is one track with its id, and a run resumes to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from radar_world import ORIGIN_DEG, plots_of, two_radars, world
from test_ais_in_radar_tracks import CYCLES, PERIOD_S, ids, messages_of, run

from coastwatch.geodesy import to_plane
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import TableTracker
from coastwatch.tracks.radar.bank import Particles
from coastwatch.tracks.radar.motion import Manoeuvres

pytestmark = pytest.mark.contract


def test_particles_hold_vessels_with_their_ids_and_resume():
    truth = world(4, 41, side_nm=4.0)
    plots, messages = plots_of(truth, two_radars(), PERIOD_S * CYCLES, 41, detection=0.9), messages_of(truth, range(2), 41)
    method = TableTracker(method="bp_particles", bank=Particles(particles=1000))
    _, out = run(method, plots, messages)
    assert sorted(out[-1].origin.tolist()) == [0, 1, 2, 3]
    assert [ids(out[-1])[k] for k in range(4)] == [219_001_000, 219_001_001, -1, -1]
    where, _ = truth.at(out[-1].origin, np.full(4, PERIOD_S * CYCLES))
    assert np.hypot(*(to_plane(out[-1].position_deg, ORIGIN_DEG) - where).T).max() < 60.0
    half, _ = run(method, plots, messages, cycles=range(6))
    _, rest = run(method, plots, messages, load(save(half)), range(6, CYCLES))
    assert np.array_equal(rest[-1].covariance, out[-1].covariance)
    _, other = run(method.model_copy(update={"bank": Particles(particles=1000, seed=1)}), plots, messages)
    assert not np.array_equal(other[-1].covariance, out[-1].covariance)


def test_more_than_one_model_is_refused():
    with pytest.raises(ValueError, match=r"motion\.models: got 9, needed 1"):
        TableTracker(method="bp_particles", motion=Manoeuvres())
