"""What the trackers say went into their tracks."""

import numpy as np
import pytest
from ais_world import HOME, PERIOD_S, SENSORS, START_S, reports, sail
from radar_world import cut, plots_of, run as run_radar, two_radars, world

from coastwatch.batches import AisReports
from coastwatch.geodesy import offset_deg, to_plane
from coastwatch.kernels.filters.ais_records import TRACK
from coastwatch.kernels.filters.ais_tracker import measure
from coastwatch.tracks import AisFilter, AisInput, RegionInput, TableTracker
from coastwatch.tracks.ais.out_of_sequence import records
from coastwatch.tracks.radar.life import ExistenceManagement, TrackManagement

pytestmark = pytest.mark.contract

NEAR_M = 1e-3  # the trip through the region's plane and back
MMSI = 235000001


def step(method, memory, rows, cycle):
    every = reports(rows)
    lo, hi = START_S + cycle * PERIOD_S, START_S + (cycle + 1) * PERIOD_S
    part = every.take((every.received_s > lo) & (every.received_s <= hi))
    memory, output = method.step(memory, AisInput(part, hi, SENSORS))
    return memory, *output


@pytest.mark.parametrize(("sog", "cog"), [(12.0, 40.0), (0.2, 90.0), (0.1, np.nan), (4.0, np.nan), (np.nan, 10.0)])
def test_a_report_measures_what_the_kernel_takes_from_it(sog, cog):
    method = AisFilter(time_jitter_s=0.5)
    rows = [(START_S + 1.0, START_S + 1.0, MMSI, *HOME, sog, cog)]
    _, _, _, taken = step(method, method.init(), rows, 0)
    track = np.zeros(1, TRACK)[0]
    track["anchor_lat"], track["anchor_lon"] = HOME
    z, noise = np.zeros(4), np.zeros((4, 4))
    settings = method.kernel_settings()
    measured = measure(track, records(reports(rows), settings, np.zeros(1))[0], settings.rules, z, noise)
    assert len(taken) == 1
    assert np.isfinite(taken.velocity_m_s).all() == (measured == 4)
    known = slice(0, measured)
    np.testing.assert_allclose(taken.covariance[0][known, known], noise[known, known], rtol=1e-9, atol=1e-12)
    if measured == 4:
        np.testing.assert_allclose(taken.velocity_m_s[0], z[2:], atol=1e-9)
    else:
        assert np.isnan(taken.covariance[0, 2:]).all()


def test_every_report_is_of_its_track_and_a_lie_or_a_repeat_of_none():
    method = AisFilter()
    honest = [row for k in range(3) for row in sail(MMSI + k, START_S + np.arange(0.5, 12.0, 1.5), HOME + 0.01 * k)]
    memory, t = method.init(), START_S + 10.2
    lie = (t, t, MMSI, *offset_deg(HOME, np.array([9000.0, 0.0])), 12.0, 40.0)
    repeat = (honest[6][0] + 0.5, honest[6][0] + 0.5, *honest[6][2:])
    for cycle in range(4):
        memory, tracks, _, taken = step(method, memory, [*honest, lie, repeat], cycle)
        assert (np.diff(taken.track_id) >= 0).all()
        expected = [r for r in honest if START_S + 3.0 * cycle < r[0] <= START_S + 3.0 * (cycle + 1)]
        assert len(taken) == len(expected)
        row = np.searchsorted(tracks.track_id, taken.track_id)
        ours = {(tracks.mmsi[r], float(s)) for r, s in zip(row, taken.time_s, strict=True)}
        assert ours == {(r[2], r[0]) for r in expected}
    _, nothing = method.step(memory, AisInput(AisReports.empty(), START_S + 15.0, SENSORS))
    assert len(nothing.measurements) == 0


@pytest.mark.parametrize("origin", ["known", "estimated"])
def test_plots_are_of_the_tracks_that_took_them(origin):
    sensors = two_radars()
    plots = plots_of(world(40, 5), sensors, 30.0, 5, detection=0.9, clutter_per_m2=1e-7)
    method = TableTracker(method="imm", plot_origin=origin)
    memory, _ = run_radar(method, plots, 8)
    _, (tracks, taken, *_) = method.step(memory, RegionInput.of_plots(cut(plots, 8), 9 * PERIOD_S, sensors))
    row = np.searchsorted(tracks.track_id, taken.track_id)
    assert (tracks.track_id[row] == taken.track_id).all()
    assert (np.lexsort((taken.time_s, taken.track_id)) == np.arange(len(taken))).all()
    cycle = cut(plots, 8)
    which = np.abs(cycle.time_s[None] - taken.time_s[:, None]).argmin(axis=1)
    assert len(np.unique(which)) == len(taken) >= 0.8 * (cycle.origin >= 0).sum()
    same_vessel = cycle.origin[which] == tracks.origin[row]
    assert same_vessel.mean() >= (1.0 if origin == "known" else 0.97)
    back = to_plane(taken.position_deg, sensors.region_origin_deg[0])
    assert np.abs(back - cycle.position_m[which]).max() < NEAR_M
    assert np.isfinite(taken.site_deg).all()
    assert np.isnan(taken.velocity_m_s).all()


ECHO_M = 6.0
WITH_ECHO = (
    TableTracker(method="imm", upkeep=TrackManagement(echo_sigma_m=ECHO_M, confirm_hits=2)),
    TableTracker(method="vimmjipda", upkeep=ExistenceManagement(echo_sigma_m=ECHO_M, confirm_existence=0.5)),
)


@pytest.mark.parametrize("method", WITH_ECHO, ids=lambda m: m.method)
def test_plots_in_tracks_have_the_noise_of_the_echo_too(method):
    """Fusion over these plots would be too sure without it."""
    plots = plots_of(world(5, 5), two_radars(), 9.0, 5)
    memory, _ = run_radar(method, plots, 2)
    now = cut(plots, 2)
    _, (_, taken, *_) = method.step(memory, RegionInput.of_plots(now, 3 * PERIOD_S, two_radars()))
    which = np.abs(now.time_s[None] - taken.time_s[:, None]).argmin(axis=1)
    spread, of_radar = (np.trace(c[:, :2, :2], axis1=1, axis2=2) for c in (taken.covariance, now.covariance[which]))
    assert len(taken) >= 3
    np.testing.assert_allclose(spread - of_radar, 2.0 * ECHO_M**2, atol=0.01)
