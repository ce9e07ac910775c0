"""Coastwatch on the common input: `python -m scaling.peers.ours TASK INPUT.npz RESULT.npz`. Calls only `step` of each method."""

from __future__ import annotations

import numpy as np

from coastwatch.associations import AssociationInput, Counting, WindowedCovariance
from coastwatch.batches import Associations, Measurements, Plots, SourceKind, Tracks
from coastwatch.fused_tracks import Convex, FusionInput, ImmOfTracks
from coastwatch.geodesy import to_plane
from coastwatch.spots import KMeansSpots
from coastwatch.tracks import RegionInput, TableTracker
from coastwatch.workers import open_workers
from scaling.peers.exchange import (
    AIS,
    COUNTING,
    RADAR,
    Floats,
    PlotHistory,
    Stopwatch,
    Task,
    TaskResult,
    TrackHistory,
    run_adapter,
)
from scaling.peers.input import ORIGIN_DEG
from scaling.peers.plots import plot_radars

KINDS = np.array([SourceKind.RADAR, SourceKind.AIS], np.int64)


def tracks_at(history: TrackHistory, cycle: int) -> Tracks:
    """The tracks of one cycle."""
    count, ais = len(history.track_id), history.source == AIS
    now = np.full(count, float(history.time_s[cycle]))
    return Tracks(
        history.track_id,
        history.source,
        now,
        history.position_deg[cycle],
        history.velocity_m_s[cycle],
        history.covariance,
        history.report_covariance,
        now,
        np.full(count, float(history.time_s[0])),
        np.where(ais, 200_000_000 + history.track_id, -1),
        np.full(count, -1),
    )


def association(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Association by `KMeansSpots` and `WindowedCovariance`, both with default settings."""
    grouper, associator = KMeansSpots(), WindowedCovariance()
    spots_memory, memory = grouper.init(), associator.init()
    pairs = [np.zeros((0, 3), np.int64)]
    with open_workers("threads", 1) as workers:
        for cycle in range(len(history.time_s)):
            tracks, timed = tracks_at(history, cycle), cycle >= history.first
            with (watch if timed else Stopwatch()).lap():
                spots_memory, spots = grouper.step(spots_memory, tracks)
                memory, found = associator.step(memory, AssociationInput(tracks, spots, workers.spots))
            if timed:
                pairs.append(np.stack([np.full(len(found.first), cycle), found.first, found.second], axis=1))
    return watch.result(("coastwatch",), unit="track", units=len(history.track_id), pairs=np.concatenate(pairs))


def counting(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Association by `Counting` with the settings of the peer; forming spots is not timed, because the peer has no such stage."""
    grouper, associator = KMeansSpots(), Counting(**COUNTING)
    spots_memory, memory = grouper.init(), associator.init()
    pairs = [np.zeros((0, 3), np.int64)]
    with open_workers("threads", 1) as workers:
        for cycle in range(len(history.time_s)):
            tracks, timed = tracks_at(history, cycle), cycle >= history.first
            spots_memory, spots = grouper.step(spots_memory, tracks)
            with (watch if timed else Stopwatch()).lap():
                memory, found = associator.step(memory, AssociationInput(tracks, spots, workers.spots))
            if timed:
                pairs.append(np.stack([np.full(len(found.first), cycle), found.first, found.second], axis=1))
    return watch.result(("coastwatch",), unit="track", units=len(history.track_id), pairs=np.concatenate(pairs))


def imm(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Fused estimates by `ImmOfTracks` with default settings."""
    return _fuse(history, watch, ImmOfTracks())


def fusion(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Fused estimates by `Convex` with default settings."""
    return _fuse(history, watch, Convex())


def _fuse(history: TrackHistory, watch: Stopwatch, method: ImmOfTracks | Convex) -> TaskResult:
    order = np.argsort(history.vessel, kind="stable")
    pair = np.flatnonzero(history.vessel[order][1:] == history.vessel[order][:-1])
    radar_first = np.where(history.source[order[pair]] == RADAR, 0, 1)
    first, second = order[pair + radar_first], order[pair + 1 - radar_first]
    known = Associations(first, second, np.zeros(len(first)), history.vessel)
    memory, none = method.init(), Measurements.empty()
    position: list[Floats] = []
    velocity: list[Floats] = []
    for cycle in range(len(history.time_s)):
        tracks, timed = tracks_at(history, cycle), cycle >= history.first
        with (watch if timed else Stopwatch()).lap():
            memory, fused = method.step(memory, FusionInput(tracks, none, known, float(history.time_s[cycle]), KINDS))  # type: ignore[arg-type]
        if timed:
            position.append(to_plane(fused.position_deg, ORIGIN_DEG))
            velocity.append(fused.velocity_m_s)
    vessels = history.true_position_m.shape[1]
    return watch.result(
        ("coastwatch",), unit="vessel", units=vessels, position_m=np.array(position), velocity_m_s=np.array(velocity)
    )


def spots(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Spots and their halo by `KMeansSpots` with default settings."""
    grouper = KMeansSpots()
    memory = grouper.init()
    for cycle in range(len(history.time_s)):
        tracks = tracks_at(history, cycle)
        with (watch if cycle >= history.first else Stopwatch()).lap():
            memory, found = grouper.step(memory, tracks)
    return watch.result(("coastwatch",), unit="track", units=len(history.track_id), spot=found.spot)


def tracking(history: PlotHistory, watch: Stopwatch) -> TaskResult:
    """Radar tracks by `sided_imm` with default settings."""
    return track(history, watch, TableTracker(method="sided_imm"))


def track(history: PlotHistory, watch: Stopwatch, method: TableTracker) -> TaskResult:
    """Confirmed radar tracks at the end of each measured cycle."""
    sensors, memory, found = plot_radars(history.settings), method.init(), [np.zeros((0, 6))]
    for cycle, now_s in enumerate(history.time_s.tolist()):
        plots, timed = _plots(history, cycle), cycle >= history.first
        with (watch if timed else Stopwatch()).lap():
            memory, (tracks, *_) = method.step(memory, RegionInput.of_plots(plots, now_s, sensors))
        if timed:
            number = np.column_stack([np.full(len(tracks), cycle), tracks.track_id])
            found.append(np.column_stack([number, to_plane(tracks.position_deg, ORIGIN_DEG), tracks.velocity_m_s]))
    plots_each = round((history.cycle >= history.first).sum() / history.measured)
    packages = ("coastwatch", "filterpy") if method.bank.method == "filterpy" else ("coastwatch",)
    return watch.result(packages, unit="plot", units=plots_each, tracks=np.concatenate(found))


def _plots(history: PlotHistory, cycle: int) -> Plots:
    """The plots of one cycle; of their vessels the tracker knows nothing."""
    lo, hi = np.searchsorted(history.cycle, [cycle, cycle + 1])
    mine, none = slice(lo, hi), np.full(hi - lo, -1)
    return Plots(
        sensor=history.radar[mine],
        region=np.zeros(hi - lo, np.int64),
        time_s=history.plot_time_s[mine],
        position_m=history.position_m[mine],
        covariance=history.covariance[mine],
        site_m=history.site_m[history.radar[mine]],
        range_m=history.range_m[mine],
        azimuth_rad=history.azimuth_rad[mine],
        origin=none,
    )


TASKS: dict[str, Task] = {
    "association": association,
    "counting": counting,
    "imm": imm,
    "fusion": fusion,
    "spots": spots,
    "tracking": tracking,
}

if __name__ == "__main__":
    run_adapter(TASKS)
