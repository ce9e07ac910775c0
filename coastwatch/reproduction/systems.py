"""Complete systems against the true vessels: every vessel of the picture that a radar track is in, at each instant.

The whole chain of a scenario runs: tracks, association, fusion. So methods that fuse tracks and methods that take AIS messages as
measurements are scored alike. A vessel goes by the oldest of its radar tracks, whatever else joins it.

Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, chapter 14.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from coastwatch.batches import Floats, FusedTracks, Ints, SourceKind
from coastwatch.centre import Cycle
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import to_plane
from coastwatch.reproduction.side_by_side import errors_of, figures_of
from coastwatch.scenario import Scenario
from coastwatch.scores.ospa import Gospa, gospa, ospa2
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import Count, Positive, Settings, serial


class Systems(Settings):
    """Asks for the scores of complete systems, in place of those of a whole run."""

    near_m: Positive = 100.0  # an estimate farther from every vessel has no vessel
    gospa_cutoff_m: Positive = 200.0
    ospa2_cutoff_m: Positive = 100.0
    ospa2_window: Count = 10  # instants
    order: Annotated[float, Field(ge=1.0)] = 2.0  # of GOSPA and OSPA(2)
    windows: tuple[Count, ...] = (1, 5, 15, 20)  # of OSPA(2) too, each with the cutoff and order above
    cutoffs_m: tuple[Positive, ...] = (20.0, 50.0, 200.0, 300.0)  # the same of the cutoff
    orders: tuple[Annotated[float, Field(ge=1.0)], ...] = (1.0, 4.0, 8.0)  # the same of the order

    def swept(self) -> dict[str, tuple[int, float, float]]:
        """Window, cutoff and order of each OSPA(2) of the sweeps, by name: n20, c300, p4."""
        n, c, p = self.ospa2_window, self.ospa2_cutoff_m, self.order
        return {
            **{f"n{one}": (one, c, p) for one in self.windows},
            **{f"c{one:g}": (n, one, p) for one in self.cutoffs_m},
            **{f"p{one:g}": (n, c, one) for one in self.orders},
        }


def measure(scenario: Scenario, seed: int, asked: Systems) -> dict[str, float | int | dict[str, float] | None]:
    """The figures of one run: anees (4 is right), rmse of all four states, position_rmse_m and count, as of `figures_of`, over
    matched vessels; gospa_m and ospa2_m: means over instants; present: share of the instants of vessels that are matched; false: vessels
    without a true one at an instant; gospa_localisation_m, gospa_missed and gospa_false: root of the mean localisation part of GOSPA,
    and mean counts an instant; ospa2: the mean OSPA(2) of each point of the sweeps, by name; late_s: mean time from the first
    instant of a vessel to its first match, of vessels that have one.
    """
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, seed, plan)
    assert recording.truth is not None
    memory, before_s = start_run(scenario, sensors), -np.inf
    errors: list[Floats] = []
    gospas: list[Gospa] = []
    born: dict[int, float] = {}
    begun: dict[int, float] = {}
    points = {"": (asked.ospa2_window, asked.ospa2_cutoff_m, asked.order), **asked.swept()}
    ospas: dict[str, list[float]] = {point: [] for point in points}
    window: deque[dict[str, tuple[Ints, Floats]]] = deque(maxlen=max(n for n, _, _ in points.values()))
    matched = present = estimates = 0
    for number in range(plan.cycles):
        now_s = plan.instant_s(number)
        reports = recording.reports.between(before_s, now_s)
        memory, cycle = run_cycle(scenario, sensors, memory, reports, now_s, serial, Stopwatch())
        before_s, truth = now_s, recording.truth.at(now_s)
        name, estimate = _with_radar(cycle, sensors.source_kinds)
        place_m, true_m = (to_plane(p, sensors.region_origin_deg[0]) for p in (estimate.position_deg, truth.position_deg))
        gospas.append(gospa(place_m, true_m, asked.gospa_cutoff_m, asked.order))
        window.append({"estimate": (name, place_m), "truth": (truth.vessel, true_m)})
        lengths = {n for n, _, _ in points.values()}
        over = {n: [as_paths([one[key] for one in window][-n:]) for key in ("estimate", "truth")] for n in lengths}
        for point, (n, cutoff_m, order) in points.items():
            ospas[point].append(ospa2(over[n][0], over[n][1], cutoff_m, order))
        row, at = matches(place_m, true_m, asked.near_m)
        born = dict.fromkeys(truth.vessel.tolist(), now_s) | born
        begun = dict.fromkeys(truth.vessel[at].tolist(), now_s) | begun
        errors.append(errors_of(estimate.take(row), truth.take(at)))
        matched, present, estimates = matched + len(row), present + len(truth), estimates + len(estimate)
    return {
        **figures_of(np.concatenate(errors)),
        "gospa_m": float(np.mean([one.total_m for one in gospas])),
        "gospa_localisation_m": float(np.mean([one.localisation for one in gospas]) ** (1.0 / asked.order)),
        "gospa_missed": float(np.mean([one.missed_count for one in gospas])),
        "gospa_false": float(np.mean([one.false_count for one in gospas])),
        "late_s": float(np.mean([begun[vessel] - born[vessel] for vessel in begun])) if begun else None,
        "ospa2_m": float(np.mean(ospas.pop(""))),
        "ospa2": {point: float(np.mean(of)) for point, of in ospas.items()},
        "present": matched / present if present else None,
        "false": (estimates - matched) / len(gospas),
    }


def matches(estimate_m: Floats, true_m: Floats, near_m: float) -> tuple[Ints, Ints]:
    """Rows of both of the pairs of the best one-to-one assignment that are nearer than a distance. (B,), (B,)"""
    from scipy.optimize import linear_sum_assignment

    apart = np.hypot(*np.moveaxis(estimate_m[:, None] - true_m[None], 2, 0))
    row, column = linear_sum_assignment(np.minimum(apart, near_m) ** 2)
    near = apart[row, column] < near_m
    return row[near], column[near]


def _with_radar(cycle: Cycle, kinds: Ints) -> tuple[Ints, FusedTracks]:
    """The vessels with a radar track: the oldest of its radar tracks (B,), and the estimate (B)."""
    tracks, vessel = cycle.tracks, cycle.associations.vessel
    radar = np.flatnonzero(kinds[tracks.source] == SourceKind.RADAR)
    radar = radar[np.lexsort((tracks.track_id[radar], vessel[radar]))]
    number, first = np.unique(vessel[radar], return_index=True)
    return tracks.track_id[radar[first]], cycle.fused.take(number)


def as_paths(seen: Sequence[tuple[Ints, Floats]]) -> Floats:
    """The path of each name over the instants, by name, NaN where it is absent. (N, T, 2) Args: names (n,) and positions (n, 2)."""
    names = np.unique(np.concatenate([np.zeros(0, np.int64), *(name for name, _ in seen)]))
    out = np.full((len(names), len(seen), 2), np.nan)
    for t, (name, position_m) in enumerate(seen):
        out[np.searchsorted(names, name), t] = position_m
    return out
