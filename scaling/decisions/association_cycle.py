"""What does each part of the association of tracks cost, and do the grid and the bounds pay? Plain library code stands beside both.

    python -m scaling.decisions.association_cycle [TRACKS [CYCLES]]

Processor time on one thread of the last of CYCLES cycles over the national picture, least of five. Windows are full after 20.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from coastwatch.associations import AssociationInput, WindowedCovariance, pairing
from coastwatch.associations.windowed_covariance import score_spots
from coastwatch.batches import Array, Spots, Tracks
from coastwatch.geodesy import earth_centred
from coastwatch.kernels.association.pair_score import pair_scores
from coastwatch.kernels.association.places import sorted_places
from coastwatch.kernels.association.prune_pairs import hopeless_steps, possible_pairs, track_bounds
from coastwatch.operators.cli.arguments import count
from coastwatch.stage import Arrays, Groups, S, Work, serial
from scaling.load import national

REPEATS = 5
Cycle = tuple[dict[str, Any], Groups, Tracks, Spots, WindowedCovariance]


def last_cycle(tracks_asked: int, cycles: int) -> Cycle:
    """What the associator maps over spots in the last of these cycles."""
    world = national.build_world(tracks_asked, 1)
    scenario = national.scenario_of(world, {})
    method = scenario.associations
    assert isinstance(method, WindowedCovariance)
    state, sensors = national.initial_state(world), scenario.sensors()
    spots_memory, memory = scenario.spots.init(), method.init()
    given: list[tuple[dict[str, Any], Groups]] = []

    def noted(work: Work[S], settings: S, arrays: Arrays, spots: Groups) -> list[tuple[Array, ...]]:
        given[:] = [(dict(arrays), spots)]
        return serial(work, settings, arrays, spots)

    for cycle in range(cycles):
        state, received = national.next_cycle(world, state, sensors)
        tracks = scenario.alignment.step(received.tracks, world.time_s(cycle))
        spots_memory, spots = scenario.spots.step(spots_memory, tracks)
        memory, _ = method.step(memory, AssociationInput(tracks, spots, noted))
    arrays, groups = given[0]
    return arrays, groups, tracks, spots, method


def cost(name: str, run: Callable[[], Any]) -> Any:
    """Prints the least processor time of a call. Returns: what it returned."""
    seconds = []
    for _ in range(REPEATS):
        begun = time.process_time()
        out = run()
        seconds.append(time.process_time() - begun)
    print(f"{name:44s}{1e3 * min(seconds):8.1f} ms", flush=True)
    return out


def tree_pairs(tracks: Tracks, gate_m: float) -> Array:
    """The pairs of the grid by scipy's tree."""
    pair = cKDTree(earth_centred(tracks.position_deg)).query_pairs(gate_m, output_type="ndarray")
    return np.asarray(pair[tracks.source[pair[:, 0]] != tracks.source[pair[:, 1]]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracks", nargs="?", type=count, default=100_000, help="default: 100,000")
    parser.add_argument("cycles", nargs="?", type=count, default=22, help="default: 22")
    asked = parser.parse_args()
    arrays, groups, tracks, spots, method = last_cycle(asked.tracks, asked.cycles)
    rule, values, newest = method.rule(), arrays["values"], int(arrays["newest"])
    place, track, bound = arrays["place"], arrays["track"], arrays["bound"]
    cost("sort places into the grid", lambda: sorted_places(tracks.position_deg, tracks.source, spots.spot, rule.gate_m))
    member = np.flatnonzero(place["source"] < place["source"].max())
    pair = cost("pairs within the gate, grid", lambda: pairing.gated(0, len(member), member, arrays, rule.gate_m))
    found = cost("the same, scipy.spatial.cKDTree", lambda: tree_pairs(tracks, rule.gate_m))
    assert len(found) == len(pair)
    cost("bounds of tracks", lambda: track_bounds(0, len(track), track, values, newest, rule, bound))
    least = hopeless_steps(rule, values.shape[1])
    possible = cost("pairs that may score", lambda: possible_pairs(pair, bound, least, rule.null_speed_m_s))
    cost("scores of these", lambda: pair_scores(pair[possible], track, values, newest, rule))
    cost("scores of all pairs, without bounds", lambda: pair_scores(pair, track, values, newest, rule))
    cost("all that is mapped over spots", lambda: score_spots(method, arrays, groups))
    print(f"{len(tracks)} tracks, {len(pair)} pairs within the gate, {int(possible.sum())} of them may score")


if __name__ == "__main__":
    main()
