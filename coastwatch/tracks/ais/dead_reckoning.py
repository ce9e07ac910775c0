"""AIS tracks as in the paper: the newest report of each vessel, extrapolated by its own speed and course."""

from __future__ import annotations

from typing import Literal

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.geodesy import offset_deg
from coastwatch.stage import Method, NotNegative, Positive
from coastwatch.tracks.ais.ais_filter import STEADY, AisFilter, measurements_of, report
from coastwatch.tracks.ais.out_of_sequence import AisMemory, Rows, initial_memory
from coastwatch.tracks.inputs import AisInput, AisOutput


class AisDeadReckoning(Method):
    """The newest report of each vessel, raw, extrapolated by its speed and course over ground; no filter. Of a paper, for comparison.

    Refusals, alarms and the end of silent vessels are those of `ais_filter`. That filter runs here with one model, to decide which
    vessel sent a report. A late report changes a track only if it is the newest report of its vessel.
    A report without speed or course is not moved. The covariance is NaN: an AIS receiver gives none.
    `aligned = false` does not extrapolate. The paper does, but its AIS track can be read otherwise.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    sections III-E (extrapolation to align sensors) and IV-B (position accuracy).
    """

    method: Literal["dead_reckoning"] = "dead_reckoning"
    position_sigma_m: Positive = 3.33  # of one report, per axis, by its specification
    aligned: bool = True  # extrapolated to the time of the cycle
    lateness_s: NotNegative = 10.0  # longest delay from fix to receipt of a report that is older than the newest of its vessel
    patience_s: Positive = 20.0  # a silent vessel is extrapolated for this time
    patience_intervals: Positive = 3.0  # and for this many of its expected intervals more

    def init(self) -> AisMemory:
        return initial_memory()

    def step(self, memory: AisMemory, given: AisInput) -> tuple[AisMemory, AisOutput]:
        """The memory after a cycle, and tracks with alarms. Raises: ValueError: the time is not after that of the cycle before."""
        time_s = given.time_s
        same = {name: getattr(self, name) for name in ("position_sigma_m", "lateness_s", "patience_s", "patience_intervals")}
        tracker = AisFilter(models=(STEADY,), **same)  # it decides which vessel sent a report
        settings = tracker.kernel_settings()
        memory, live, fresh = tracker.update(memory, given.reports, time_s, settings)
        tracks = memory.now.tracks
        position, velocity = extrapolated(tracks, live, time_s if self.aligned else tracks["updated"][live])
        unknown = np.full((len(live), 4, 4), np.nan)
        out, alarms = report(tracks, live, time_s, given.sensors.ais_source, position, velocity, unknown)
        return memory, AisOutput(out, alarms, measurements_of(fresh, out, settings.rules))


def extrapolated(tracks: Rows, live: Ints, time_s: float | Floats) -> tuple[Floats, Floats]:
    """Positions extrapolated from the newest reports, (N, 2) deg, and reported velocities, (N, 2) m/s. Args: live: (N,) rows."""
    lat, lon, sog, cog, updated = (tracks[name][live] for name in ("lat", "lon", "sog", "cog", "updated"))
    velocity = sog[:, None] * np.column_stack([np.sin(cog), np.cos(cog)])
    velocity[~np.isfinite(velocity).all(axis=1)] = 0.0
    return offset_deg(np.column_stack([lat, lon]), (time_s - updated)[:, None] * velocity), velocity
