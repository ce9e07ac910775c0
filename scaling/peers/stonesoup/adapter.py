"""Stone Soup: `python -m scaling.peers.stonesoup.adapter association|tracking|tracking_jpda INPUT.npz RESULT.npz`."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithLBP
from stonesoup.dataassociator.tracktotrack import TrackToTrackCounting
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState, State
from stonesoup.types.track import Track
from stonesoup.updater.kalman import KalmanUpdater

from scaling.peers.exchange import (
    AIS,
    COUNTING,
    RADAR,
    Ints,
    PlotHistory,
    Stopwatch,
    Task,
    TaskResult,
    TrackHistory,
    run_adapter,
)

THRESHOLD_M = 70.0  # of the RMS of the differences east and north, its default measure; README.md: how it was chosen
NO_PAIR_M = 1e6
# Of the trackers: README.md says how they were chosen.
NOISE_M2_S3 = 0.02  # density of the white acceleration
GATE_SIGMA = 4.0
POINTS, HELD_S, DELETED_S = 4, 9.0, 12.0  # plots of a confirmed track; a track without a plot for so long is deleted
BATCH_S = 0.5
START_SPEED_M_S = 4.0  # standard deviation per axis
CLUTTER_PER_M2, DETECTION_PROBABILITY, GATE_PROBABILITY = 5e-7, 0.9, 0.999  # of the input; of the gate
START = datetime(2027, 1, 15)


def association(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """By the peer's default measure; its threshold is of the RMS of two differences."""
    return _counted(history, watch, TrackToTrackCounting(association_threshold=THRESHOLD_M, pos_map=[0, 1]))


def counting(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """With the settings of ours; the default measure is the distance over the root of 2."""
    threshold, hits, misses = COUNTING["threshold_m"] / np.sqrt(2.0), COUNTING["hits"], COUNTING["misses"]
    settings = {"consec_pairs_confirm": hits, "consec_misses_end": misses}
    return _counted(history, watch, TrackToTrackCounting(association_threshold=threshold, pos_map=[0, 1], **settings))


def _counted(history: TrackHistory, watch: Stopwatch, counting: TrackToTrackCounting) -> TaskResult:
    """One call over all cycles; a cycle has its mean time. The nearest of the returned pairs are chosen one to one, untimed."""
    seconds = history.time_s - history.time_s[0]
    times = [START + timedelta(seconds=float(s)) for s in seconds]
    radar, ais = ({k: _track(history, k, times) for k in np.flatnonzero(history.source == s).tolist()} for s in (RADAR, AIS))
    rows = {id(track): row for side in (radar, ais) for row, track in side.items()}
    with watch.lap(len(times)):
        associations = counting.associate_tracks(set(radar.values()), set(ais.values()))
    with_rows = [
        (*sorted((rows[id(track)] for track in one.objects), key=lambda row: history.source[row]), one) for one in associations
    ]
    pairs = [np.zeros((0, 3), np.int64)]
    for cycle in range(history.first, len(times)):
        now = np.array([(first, second) for first, second, one in with_rows if times[cycle] in one.time_range], np.int64)
        pairs.append(_nearest(history, cycle, now.reshape(-1, 2)))
    return watch.result(
        ("stonesoup", "numpy"),
        unit=f"pair of tracks over {len(times)} cycles",
        units=len(radar) * len(ais) / len(times),
        pairs=np.concatenate(pairs),
    )


def _nearest(history: TrackHistory, cycle: int, pairs: Ints) -> Ints:
    """The one-to-one assignment of least mean distance over the window. Args: pairs: (B, 2) rows. Returns: (A, 3)."""
    window = history.position_m[max(0, cycle + 1 - history.settings["window"]) : cycle + 1]
    off = window[:, pairs[:, 1]] - window[:, pairs[:, 0]]
    (left, row), (right, column) = (np.unique(pairs[:, k], return_inverse=True) for k in range(2))
    cost = np.full((len(left), len(right)), NO_PAIR_M)
    cost[row, column] = np.hypot(off[..., 0], off[..., 1]).mean(axis=0)
    row, column = linear_sum_assignment(cost)
    real = cost[row, column] < NO_PAIR_M
    row, column = row[real], column[real]
    return np.stack([np.full(len(row), cycle), left[row], right[column]], axis=1)


def _track(history: TrackHistory, row: int, times: list[datetime]) -> Track:
    positions = history.position_m[:, row]
    return Track([State(StateVector(p), timestamp=when) for p, when in zip(positions, times, strict=True)])


def tracking(history: PlotHistory, watch: Stopwatch) -> TaskResult:
    """Global nearest neighbour by 2-D assignment, a Kalman filter a track."""
    return _track_plots(history, watch, MultiTargetTracker, GNNWith2DAssignment(_by_distance()))


def tracking_jpda(history: PlotHistory, watch: Stopwatch) -> TaskResult:
    """Joint probabilistic data association, its marginals by belief propagation: all joint events of 100 tracks are too many."""
    predictor, updater = _filter()
    hypothesiser = PDAHypothesiser(
        predictor=predictor,
        updater=updater,
        clutter_spatial_density=CLUTTER_PER_M2,
        prob_detect=DETECTION_PROBABILITY,
        prob_gate=GATE_PROBABILITY,
    )
    return _track_plots(history, watch, MultiTargetMixtureTracker, JPDAwithLBP(hypothesiser=hypothesiser))


def _filter() -> tuple[KalmanPredictor, KalmanUpdater]:
    """A nearly constant velocity: east, its rate, north, its rate."""
    one = ConstantVelocity(NOISE_M2_S3)
    return KalmanPredictor(CombinedLinearGaussianTransitionModel([one, one])), KalmanUpdater(None)


def _by_distance() -> DistanceHypothesiser:
    predictor, updater = _filter()
    return DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=GATE_SIGMA)


def _track_plots(history: PlotHistory, watch: Stopwatch, tracker_type: Any, associator: Any) -> TaskResult:
    """Batches of one radar and half a second, each at its mean time, so that a batch has one plot of a vessel at most.

    Making the detections is not timed, nor is the prediction of the tracks to the end of a cycle.
    """
    predictor, updater = _filter()
    prior = GaussianState([0.0] * 4, np.diag([0.0, START_SPEED_M_S**2, 0.0, START_SPEED_M_S**2]))
    batches = _batches(history)
    initiator = MultiMeasurementInitiator(
        prior_state=prior,
        deleter=UpdateTimeDeleter(timedelta(seconds=HELD_S)),
        data_associator=GNNWith2DAssignment(_by_distance()),
        updater=updater,
        min_points=POINTS,
    )
    tracker = tracker_type(
        initiator=initiator,
        deleter=UpdateTimeDeleter(timedelta(seconds=DELETED_S)),
        detector=[(when, plots) for of_cycle in batches for when, plots in of_cycle],
        data_associator=associator,
        updater=updater,
    )
    steps, numbers, found = iter(tracker), dict[int, int](), [np.zeros((0, 6))]
    tracks: set[Track] = set()
    for cycle, of_cycle in enumerate(batches):
        timed = cycle >= history.first
        with (watch if timed else Stopwatch()).lap():
            for _ in of_cycle:
                _, tracks = next(steps)
        if timed:
            now = _when(history, float(history.time_s[cycle]))
            for track in tracks:
                state = predictor.predict(track, timestamp=now).state_vector.ravel().astype(float)[[0, 2, 1, 3]]
                found.append(np.array([[cycle, numbers.setdefault(id(track), len(numbers)), *state]]))
    units = round((history.cycle >= history.first).sum() / history.measured)
    return watch.result(("stonesoup", "numpy"), unit="plot", units=units, tracks=np.concatenate(found))


def _batches(history: PlotHistory) -> list[list[tuple[datetime, set[Detection]]]]:
    """The detections of each cycle, by batch, in order of time."""
    out: list[list[tuple[datetime, set[Detection]]]] = []
    for cycle in range(len(history.time_s)):
        lo, hi = np.searchsorted(history.cycle, [cycle, cycle + 1])
        rows = np.arange(lo, hi)
        part = np.floor(history.plot_time_s[rows] / BATCH_S).astype(np.int64)
        keys, of = np.unique(np.column_stack([part, history.radar[rows]]), axis=0, return_inverse=True)
        made = []
        for k in range(len(keys)):
            mine = rows[of.ravel() == k]
            mean_s = float(history.plot_time_s[mine].mean())
            when = _when(history, mean_s)
            made.append((when, {_detection(history, row, when) for row in mine.tolist()}))
        out.append(sorted(made, key=lambda batch: batch[0]))
    return out


def _detection(history: PlotHistory, row: int, when: datetime) -> Detection:
    model = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=history.covariance[row])
    return Detection(history.position_m[row], timestamp=when, measurement_model=model)


def _when(history: PlotHistory, time_s: float) -> datetime:
    return START + timedelta(seconds=time_s - float(history.time_s[0]))


TASKS: dict[str, Task] = {
    "association": association,
    "counting": counting,
    "tracking": tracking,
    "tracking_jpda": tracking_jpda,
}

if __name__ == "__main__":
    run_adapter(TASKS)
