"""AIS tracks: one IMM filter a vessel. Late reports are replayed in order; two ships with one MMSI are two tracks."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.batches import ID_STRIDE, AisAlarms, AisReports, Floats, Ints, Measurements, Tracks
from coastwatch.geodesy import KNOT_M_S
from coastwatch.stage import Method, NotNegative, Positive, Settings
from coastwatch.tracks.ais.out_of_sequence import (
    SLOTS,
    AisMemory,
    KernelSettings,
    Rows,
    admit,
    end_cycle,
    initial_memory,
    update_tracks,
)
from coastwatch.tracks.inputs import AisInput, AisOutput

WIRE_POSITION_M = 0.185  # ITU-R M.1371: latitude and longitude in 1/10,000 minute
WIRE_SOG_KN = 0.1
WIRE_COG_DEG = 0.1
POLAR_SPEED_KN = 2.0  # at this speed half of the velocity variance across the course of a slow vessel is left
STILL_SPEED_KN = 0.5  # a report slower than this that has no COG is of a vessel at rest
STAMP_S = 1.0  # error of the time between two reports: whole seconds of UTC, and the wait for a slot
REACH_M = 20e3  # from the anchor of a track's plane: the plane's scale is wrong by 5e-6 there


class Motion(Settings):
    """One model of an IMM."""

    kind: Literal["straight", "turning"]  # constant velocity, or coordinated turn
    noise_m2_s3: NotNegative  # density of white acceleration
    turn_noise_rad2_s3: NotNegative = 0.0  # density of the drift of the turn rate
    turn_sigma_rad_s: Positive = 0.01  # standard deviation of the turn rate before anything is known
    sojourn_s: Positive  # mean time in this model
    share: Positive  # of the time, at the start


STEADY = Motion(kind="straight", noise_m2_s3=1e-4, sojourn_s=60.0, share=0.8)
KICKED = Motion(kind="straight", noise_m2_s3=0.2, sojourn_s=3.0, share=0.1)
TURNING = Motion(kind="turning", noise_m2_s3=1e-3, turn_noise_rad2_s3=1e-6, sojourn_s=60.0, share=0.1)


class AisFilter(Method):
    """One IMM a vessel over its AIS reports, each in its own tangent plane.

    - A report up to `lateness_s` late gives the same tracks, bit for bit, as if it had arrived in order. A later one is taken only if
      it is the newest of its vessel, and no older than the longest time that a silent vessel is predicted.
    - A report that implies an impossible speed opens a second, tentative track of its MMSI. The next report that fits confirms it.
    - A report is flagged as of an impossible speed too if its vessel could not have come there by the speeds that it said before
      and after a silence: another sender may have taken its MMSI. It stays in the track.
    - A vessel whose newest report was late is silent from its receipt on: a feed may be late by a minute all the time.
    - A silent vessel is predicted for `patience_s` + `patience_intervals` times its expected interval, the longer of the nominal
      and the learned one. A vessel that reports again within `return_s` keeps its track id.
    """

    method: Literal["ais_filter"] = "ais_filter"
    position_sigma_m: Positive = 3.33  # of one report, per axis: of high accuracy (10 m is three), or if it states none
    unaided_sigma_m: Positive = 5.0  # of a message with low accuracy whose receiver does not monitor its errors (no RAIM)
    low_accuracy_sigma_m: Positive = 10.0  # of a message with low accuracy whose receiver expects more than 10 m (RAIM)
    sog_sigma_kn: Positive = 0.2  # of a reported speed
    cog_sigma_deg: Positive = 2.0  # of a reported course at speed; near rest it widens to what the speed's noise allows
    time_jitter_s: NotNegative | None = None  # of the time of a fix; none: estimated of each feed, 0.5 s or more
    stamp_error_s: NotNegative = 15.0  # a report off by up to this along the way of its vessel has a wrong stamp
    max_acceleration_m_s2: Positive = 3.0  # a velocity that needs more is not believed until positions show it
    start_speed_sigma_kn: Positive = 10.0  # of a first report without a speed
    models: tuple[Motion, ...] = Field((STEADY, KICKED, TURNING), min_length=1, max_length=3)  # of the IMM
    lateness_s: NotNegative = 10.0  # longest delay from fix to receipt of a report that is older than the newest of its vessel
    ahead_s: NotNegative = 5.0  # a report stamped up to this much after its receipt is held until then
    repeat_s: NotNegative = 1.5  # the same position again within this time is a repetition
    max_speed_kn: Positive = 60.0  # no ship goes faster from one report to the next
    jump_kn: Positive = 5.0  # by which a vessel may have been faster than it says before and after a silence
    jump_m: Positive = 1000.0  # a report nearer to the one before is no jump
    jump_s: Positive = 300.0  # after a longer silence the margin `jump_kn` grows with its square
    alarm_s: Positive = 60.0  # how long an impossible speed stays flagged
    patience_s: Positive = 20.0  # a silent vessel is predicted for this time
    patience_intervals: Positive = 3.0  # and for this many of its expected intervals more
    interval_moving_s: Positive = 10.0  # class A under way: the slowest that ITU-R M.1371 has
    interval_moving_b_s: Positive = 30.0  # class B under way
    interval_slow_s: Positive = 180.0  # at anchor, moored, or class B slower than 2 kn; distress devices
    interval_first_s: Positive = 30.0  # of a vessel with one report, at least
    slow_kn: Positive = 1.0  # below this speed `interval_slow_s` is expected
    anchor_kn: Positive = 3.0  # below this speed it is expected of a vessel with status at anchor, moored or aground
    return_s: Positive = 3600.0  # a lost vessel keeps its track id for this time

    @model_validator(mode="after")
    def _memory_outlasts_lateness(self) -> Self:
        if self.return_s <= 2.0 * self.lateness_s:
            raise ValueError(f"return_s: got {self.return_s}, needed more than twice lateness_s ({self.lateness_s})")
        return self

    def init(self) -> AisMemory:
        return initial_memory()

    def step(self, memory: AisMemory, given: AisInput) -> tuple[AisMemory, AisOutput]:
        """The memory after a cycle, and tracks with alarms. Raises: ValueError: the time is not after that of the cycle before."""
        time_s = given.time_s
        settings = self.kernel_settings()
        memory, live, fresh = self.update(memory, given.reports, time_s, settings)
        known = memory.now.tracks
        estimate = kernels.filters.ais_tracker.estimates(known, live, time_s, settings.rules, settings.models)
        tracks, alarms = report(known, live, time_s, given.sensors.ais_source, *estimate)
        return memory, AisOutput(tracks, alarms, measurements_of(fresh, tracks, settings.rules))

    def update(
        self, memory: AisMemory, reports: AisReports, time_s: float, settings: KernelSettings
    ) -> tuple[AisMemory, Ints, Rows]:
        """The memory after these reports, the rows of `memory.now.tracks` that are not lost at `time_s`, the reports in time.

        Those are the admitted ones that are at most `lateness_s` late.
        """
        if not time_s > memory.now.time_s:
            raise ValueError(f"{self.method} time_s: got {time_s}, needed a time after the last cycle's, {memory.now.time_s}")
        before_s = memory.now.time_s if np.isfinite(memory.now.time_s) else time_s - self.lateness_s
        oldest_s = max(self.patience_s + self.patience_intervals * self.interval_slow_s, self.lateness_s)
        fresh, memory = admit(memory, reports, time_s, self.lateness_s, oldest_s, self.ahead_s, settings)
        believed = fresh
        if len(fresh):
            memory, believed = update_tracks(memory, fresh, settings)
        tracks = memory.now.tracks
        forgotten = time_s - tracks["updated"] > self.return_s + self.lateness_s
        if forgotten.any():
            tracks = tracks[~forgotten]
        nameless = (tracks["confirmed"] == 1) & (tracks["number"] < 0)
        counter = memory.counter + int(nameless.sum())
        if counter > memory.counter:
            tracks = tracks.copy()
            tracks["number"][nameless] = np.arange(memory.counter, counter)
        memory = end_cycle(memory, fresh, tracks, counter, time_s, self.lateness_s)
        memory = replace(memory, delays=memory.delays.after(reports, tracks, time_s, self.lateness_s))
        silent_s = time_s - tracks["updated"]
        if len(memory.delays):
            silent_s -= memory.delays.of(tracks["mmsi"])
        live = np.flatnonzero((tracks["confirmed"] == 1) & (silent_s <= tracks["patience"]))
        return memory, live, believed[believed["time"] > before_s - self.lateness_s]

    def kernel_settings(self) -> KernelSettings:
        """The settings as the kernel takes them."""
        knot2 = KNOT_M_S**2
        one = {
            "sog_variance": (self.sog_sigma_kn**2 + WIRE_SOG_KN**2 / 12.0) * knot2,
            "cog_variance": np.radians(1.0) ** 2 * (self.cog_sigma_deg**2 + WIRE_COG_DEG**2 / 12.0),
            "still_speed": STILL_SPEED_KN * KNOT_M_S,
            "polar_speed": POLAR_SPEED_KN * KNOT_M_S,
            "start_speed_variance": self.start_speed_sigma_kn**2 * knot2,
            "max_speed": self.max_speed_kn * KNOT_M_S,
            "acceleration": self.max_acceleration_m_s2,
            "stamp": STAMP_S,
            "stamp_most": self.stamp_error_s,
            "repeat": self.repeat_s,
            "patience_least": self.patience_s,
            "patience_factor": self.patience_intervals,
            "moving_a": self.interval_moving_s,
            "moving_b": self.interval_moving_b_s,
            "slow": self.interval_slow_s,
            "first": self.interval_first_s,
            "slow_speed": self.slow_kn * KNOT_M_S,
            "anchor_speed": self.anchor_kn * KNOT_M_S,
            "forget": self.return_s,
            "alarm": self.alarm_s,
            "jump_speed": self.jump_kn * KNOT_M_S,
            "jump_least": self.jump_m,
            "jump_time": self.jump_s,
            "reach": REACH_M,
        }
        rules = np.zeros(1, kernels.filters.ais_records.RULES)
        for name, value in one.items():
            rules[name] = value
        sigmas = self.position_sigma_m, self.unaided_sigma_m, self.position_sigma_m, self.low_accuracy_sigma_m
        models, share = kernels.filters.motion_models, np.array([m.share for m in self.models])
        table = models.table(
            kind=[models.TURNING if m.kind == "turning" else models.STRAIGHT for m in self.models],
            noise=[m.noise_m2_s3 for m in self.models],
            manoeuvre_sigma=[m.turn_sigma_rad_s for m in self.models],
            manoeuvre_noise=[m.turn_noise_rad2_s3 for m in self.models],
            prior_probability=share / share.sum(),
            sojourn=[m.sojourn_s for m in self.models],
        )
        return KernelSettings(rules[0], table, np.square(sigmas) + WIRE_POSITION_M**2 / 12.0, self.time_jitter_s)


def report(
    tracks: Rows, live: Ints, time_s: float, source: int, position: Floats, velocity: Floats, covariance: Floats
) -> tuple[Tracks, AisAlarms]:
    """Tracks and alarms of the rows that are not lost.

    Args: live: (N,) these rows; position (N, 2) deg, velocity (N, 2), covariance (N, 4, 4): at `time_s`.
    """
    names = ("mmsi", "number", "origin", "updated", "started", "alarm", "status", "expected", "ee", "en", "nn")
    known = {name: tracks[name][live] for name in names}
    out = Tracks(
        track_id=source * ID_STRIDE + known["number"],
        source=np.full(len(live), source, np.int64),
        time_s=np.full(len(live), float(time_s)),
        position_deg=position,
        velocity_m_s=velocity,
        covariance=covariance,
        report_covariance=np.stack([known[name] for name in ("ee", "en", "en", "nn")], axis=-1).reshape(-1, 2, 2),
        updated_s=known["updated"],
        started_s=known["started"],
        mmsi=known["mmsi"],
        origin=known["origin"],
    )
    mmsi, started, updated, twice = out.mmsi, out.started_s, out.updated_s, np.zeros(len(live), np.bool_)
    for k in range(1, SLOTS):  # tracks of one MMSI that overlap in time; those before and after a jump do not
        same = (mmsi[k:] == mmsi[:-k]) & (updated[k:] > started[:-k]) & (updated[:-k] > started[k:])
        twice[k:] |= same
        twice[:-k] |= same
    alarms = AisAlarms(
        track_id=out.track_id,
        mmsi=out.mmsi,
        impossible_speed=known["alarm"] > time_s,
        twice=twice,
        nav_status=known["status"],
        interval_s=known["expected"],
    )
    return out, alarms


def measurements_of(fresh: Rows, tracks: Tracks, rules: np.void) -> Measurements:
    """The reports that fit one of these tracks, sorted by track, then time.

    Args: fresh: REPORT rows sorted by MMSI, then time; tracks: after these reports, sorted by MMSI, all at one time; rules: of the
    AIS kernel.
    Where one MMSI has several tracks the nearest takes the report.
    """
    time_s = float(tracks.time_s[0]) if len(tracks) else 0.0
    track = kernels.filters.ais_plausibility.nearest_tracks(
        fresh, (tracks.mmsi, tracks.updated_s, tracks.position_deg, tracks.velocity_m_s), time_s, rules
    )
    again = np.zeros(len(fresh), np.bool_)
    soon = fresh["time"][1:] - fresh["time"][:-1] <= rules["repeat"]
    for name in ("mmsi", "lat", "lon"):
        soon &= fresh[name][1:] == fresh[name][:-1]
    again[1:] = soon
    taken = np.flatnonzero((track >= 0) & ~again)
    reports, track = fresh[taken], track[taken]
    order = np.lexsort((reports["time"], tracks.track_id[track]))
    reports, track = reports[order], track[order]
    velocity, covariance = kernels.filters.ais_tracker.measured(reports, rules)
    n = len(reports)
    return Measurements(
        track_id=tracks.track_id[track],
        sensor=np.full(n, -1, np.int64),
        time_s=reports["time"],
        position_deg=np.column_stack([reports["lat"], reports["lon"]]),
        velocity_m_s=velocity,
        covariance=covariance,
        site_deg=np.full((n, 2), np.nan),
    )
