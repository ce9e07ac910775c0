"""Several methods of association, and of fusion, on the same radar and AIS tracks of a few targets.

All see the same tracks in each cycle. The methods of fusion all get the associations of the scenario's own method.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from coastwatch.associations import AssociationInput, Associator
from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Tracks, Truth
from coastwatch.fused_tracks import Fuser, FusionInput
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.reproduction.region_inputs import cycle_inputs
from coastwatch.scenario import Scenario
from coastwatch.scores.nees import nees
from coastwatch.scores.track_pairs import PairScores, TruePairs, true_vessels
from coastwatch.stage import Running, Settings, serial
from coastwatch.tracks import AisInput, RegionInput


class SideBySide(Settings):
    """Asks for the scores of several methods on the same tracks, in place of those of whole runs."""

    associations: dict[str, Associator]  # by name
    fused_tracks: dict[str, Fuser]  # by name
    lost_m: float = 100.0  # a track farther from its vessel is lost


def measure(scenario: Scenario, seed: int, asked: SideBySide) -> dict[str, dict[str, dict[str, float | int | None]]]:
    """Figures by method: `associations` as of `PairScores`; `fused_tracks` as of `figures_of`."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, seed, plan)
    assert recording.truth is not None
    methods: dict[str, Any] = {**asked.associations, "": scenario.associations}
    memories = {name: method.init() for name, method in methods.items()}
    fusers: dict[str, Any] = dict(asked.fused_tracks)
    fused: dict[str, Any] = {name: method.init() for name, method in fusers.items()}
    scores = dict.fromkeys(asked.associations, PairScores())
    errors: dict[str, list[Floats]] = {name: [] for name in ("radar", "ais", *fused)}
    radar, ais = scenario.tracks.init(), scenario.ais_tracks.init()
    spots_memory = scenario.spots.init()
    for now_s, plots, heard, video in cycle_inputs(scenario, recording, video=scenario.tracks.takes_video):
        given = RegionInput.of_plots(plots, now_s, sensors)._replace(video=video)
        radar, (radar_tracks, taken, *_) = Running(scenario.tracks, radar).next(given)
        ais, (ais_tracks, _, reported) = scenario.ais_tracks.step(ais, AisInput(heard, now_s, sensors))
        tracks = scenario.alignment.step(Tracks.join([radar_tracks, ais_tracks]), now_s)
        spots_memory, spots = scenario.spots.step(spots_memory, tracks)
        truth, kinds = recording.truth.at(now_s), sensors.source_kinds
        pairs = TruePairs.of(tracks, truth, kinds, asked.lost_m)
        for name, method in methods.items():
            memories[name], found = method.step(memories[name], AssociationInput(tracks, spots, serial))
            if name:
                scores[name] = scores[name].seen(pairs, found)
        vessel, of_truth, rows = _right_pairs(tracks, found, truth, kinds, asked.lost_m)
        measurements = Measurements.join([taken, reported])
        for name, fuser in fusers.items():
            fused[name], estimate = fuser.step(fused[name], FusionInput(tracks, measurements, found, now_s, kinds))
            errors[name].append(errors_of(estimate.take(vessel), truth.take(of_truth)))
        for side, name in enumerate(("radar", "ais")):
            alone = tracks.take(rows[:, side])
            lone = FusedTracks(alone.time_s, alone.position_deg, alone.velocity_m_s, alone.covariance)
            errors[name].append(errors_of(lone, truth.take(of_truth)))
    return {
        "pairs": {name: one.as_dict(scenario.period_s) for name, one in scores.items()},
        "fusion": {name: figures_of(np.concatenate(parts)) for name, parts in errors.items()},
    }


def _right_pairs(tracks: Tracks, found: Associations, truth: Truth, kinds: Ints, lost_m: float) -> tuple[Ints, Ints, Ints]:
    """Vessels of one radar and one AIS track of the same true vessel: number (B,), row of the truth (B,), rows of both (B, 2)."""
    true, radar = true_vessels(tracks, truth, lost_m), kinds[tracks.source] == 0
    first, second = found.first, found.second
    right = (true[first] == true[second]) & (true[first] >= 0) & (radar[first] != radar[second])
    right &= np.bincount(found.vessel, minlength=1)[found.vessel[first]] == 2
    first, second = first[right], second[right]
    rows = np.where(radar[first][:, None], np.column_stack([first, second]), np.column_stack([second, first]))
    return found.vessel[first], row_of(truth.vessel, true[first]), rows.astype(np.int64)


def errors_of(estimate: FusedTracks, truth: Truth) -> Floats:
    """NEES, and squared error of all four states and of the position, of each estimate. (B, 3)"""
    error = np.concatenate(
        [difference_m(estimate.position_deg, truth.position_deg), estimate.velocity_m_s - truth.velocity_m_s], axis=1
    )
    square = error**2
    return np.column_stack([nees(error, estimate.covariance), square.sum(axis=1), square[:, :2].sum(axis=1)])


def figures_of(rows: Floats) -> dict[str, float | int | None]:
    """anees: 4 is right; rmse of all four states; position_rmse_m; count."""
    if not len(rows):
        return {"anees": None, "rmse": None, "position_rmse_m": None, "count": 0}
    mean = rows.mean(axis=0)
    return {
        "anees": float(mean[0]),
        "rmse": float(np.sqrt(mean[1])),
        "position_rmse_m": float(np.sqrt(mean[2])),
        "count": len(rows),
    }
