"""Coastwatch on a peer's input: `python -m scaling.peers.ours TASK GIVEN.npz ANSWER.npz`. Only `step` of the methods is called."""

from __future__ import annotations

import numpy as np

from coastwatch.associations import WindowedCovariance
from coastwatch.batches import Associations, Measurements, SourceKind, Tracks
from coastwatch.fused_tracks import Convex, ImmOfTracks
from coastwatch.geodesy import to_plane
from coastwatch.spots import KMeansSpots
from coastwatch.workers import spread_over
from scaling.peers.exchange import AIS, RADAR, Answer, Floats, Given, Task, Watch, answer_command
from scaling.peers.input import ORIGIN_DEG

KINDS = np.array([SourceKind.RADAR, SourceKind.AIS], np.int64)


def tracks_at(given: Given, cycle: int) -> Tracks:
    """The tracks of one cycle."""
    count, ais = len(given.track_id), given.source == AIS
    now = np.full(count, float(given.time_s[cycle]))
    return Tracks(
        given.track_id,
        given.source,
        now,
        given.position_deg[cycle],
        given.velocity_m_s[cycle],
        given.covariance,
        given.report_covariance,
        now,
        np.full(count, float(given.time_s[0])),
        np.where(ais, 200_000_000 + given.track_id, -1),
        np.full(count, -1),
    )


def association(given: Given, watch: Watch) -> Answer:
    """Spots and windowed covariance: `KMeansSpots` and `WindowedCovariance` at their defaults."""
    grouper, associator = KMeansSpots(), WindowedCovariance()
    spots_memory, memory = grouper.init(), associator.init()
    pairs = [np.zeros((0, 3), np.int64)]
    with spread_over("threads", 1) as spread:
        for cycle in range(len(given.time_s)):
            tracks, timed = tracks_at(given, cycle), cycle >= given.first
            with (watch if timed else Watch()).lap():
                spots_memory, spots = grouper.step(spots_memory, tracks)
                memory, found = associator.step(memory, tracks, spots, spread)
            if timed:
                pairs.append(np.stack([np.full(len(found.first), cycle), found.first, found.second], axis=1))
    return watch.answer(("coastwatch",), unit="track", units=len(given.track_id), pairs=np.concatenate(pairs))


def imm(given: Given, watch: Watch) -> Answer:
    """Filters over the tracks of each vessel: `ImmOfTracks`."""
    return _fused(given, watch, ImmOfTracks())


def fusion(given: Given, watch: Watch) -> Answer:
    """Tracks of each vessel combined: `Convex`."""
    return _fused(given, watch, Convex())


def _fused(given: Given, watch: Watch, method: ImmOfTracks | Convex) -> Answer:
    order = np.argsort(given.vessel, kind="stable")
    pair = np.flatnonzero(given.vessel[order][1:] == given.vessel[order][:-1])
    radar_first = np.where(given.source[order[pair]] == RADAR, 0, 1)
    first, second = order[pair + radar_first], order[pair + 1 - radar_first]
    known = Associations(first, second, np.zeros(len(first)), given.vessel)
    memory, none = method.init(), Measurements.empty()
    position: list[Floats] = []
    velocity: list[Floats] = []
    for cycle in range(len(given.time_s)):
        tracks, timed = tracks_at(given, cycle), cycle >= given.first
        with (watch if timed else Watch()).lap():
            memory, fused = method.step(memory, tracks, none, known, float(given.time_s[cycle]), KINDS)  # type: ignore[arg-type]
        if timed:
            position.append(to_plane(fused.position_deg, ORIGIN_DEG))
            velocity.append(fused.velocity_m_s)
    vessels = given.true_position_m.shape[1]
    return watch.answer(
        ("coastwatch",), unit="vessel", units=vessels, position_m=np.array(position), velocity_m_s=np.array(velocity)
    )


def spots(given: Given, watch: Watch) -> Answer:
    """Spots, with their halo: `KMeansSpots`."""
    grouper = KMeansSpots()
    memory = grouper.init()
    for cycle in range(len(given.time_s)):
        tracks = tracks_at(given, cycle)
        with (watch if cycle >= given.first else Watch()).lap():
            memory, found = grouper.step(memory, tracks)
    return watch.answer(("coastwatch",), unit="track", units=len(given.track_id), spot=found.spot)


TASKS: dict[str, Task] = {"association": association, "imm": imm, "fusion": fusion, "spots": spots}

if __name__ == "__main__":
    answer_command(TASKS)
