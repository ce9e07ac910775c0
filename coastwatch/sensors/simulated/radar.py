"""Simulated radars: `observe` makes the reports of radars from the true positions of vessels.

`position_at(row, time_s)` returns latitude and longitude (M, 2) of vessels (M,) at times (M,), NaN if a vessel is absent.
`interpolated` makes such a function from sampled Trajectories.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import AzimuthReference, Bools, Floats, Ints, RadarReports, Radars, Trajectories
from coastwatch.errors import InputError
from coastwatch.geodesy import KNOT_M_S, from_plane, to_plane, wrap_deg, wrap_rad
from coastwatch.sensors.simulated.trajectories import chosen
from coastwatch.stage import CountOrZero, NotNegative, Positive, PositiveShare, Settings, Share

PositionAt = Callable[[Ints, Floats], Floats]

# Streams of random numbers: a change of one does not change the others.
NOISE, DETECTION, CLUTTER, PHASE, UNSEEN, OUTAGE, VISIBLE, STANDING, BURST = 11, 12, 13, 14, 15, 16, 17, 18, 19
TURN_RAD = 2.0 * np.pi
BLOCK = 4096  # vessels at a time: bounds memory, does not change the result
BEAM_ROUNDS = 3  # iterations; each multiplies the error of the beam time by azimuth rate x turn period, under 0.1 beyond 300 m


class Burst(Settings):
    """Clutter that comes at times on top of all other, as in a squall."""

    per_m2: Annotated[float, Field(ge=0.0, le=1e-3)] = 0.0  # false plots in a turn while it lasts; 0: no burst
    first_s: NotNegative = 50.0  # its start, after the start of the run
    duration_s: Positive = 30.0
    every_s: Positive | None = Field(default=None, description="from the start of one to that of the next; none: it comes once")

    def density(self, after_s: Floats) -> Floats:
        """False plots per m2 and turn. Args: after_s: (T,) after the start of the run. Returns: (T,)."""
        since_s = after_s - self.first_s
        phase_s = np.mod(since_s, self.every_s) if self.every_s else since_s
        return np.where((since_s >= 0.0) & (phase_s < self.duration_s), self.per_m2, 0.0)


Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class RadarTruth(Settings):
    """What a simulated radar does beyond its specification."""

    name: str = ""  # of the radar in [[radars]]; empty in [input.radar], which is for all radars without an entry of their own
    detection_probability: Share = 1.0  # of a vessel in range, per turn
    unseen_share: Share = 0.0  # of the vessels are never detected, the same ones by all radars with this share
    unseen: tuple[CountOrZero, ...] = ()  # numbers, from 0, of more vessels that are never detected
    visible_share: PositiveShare = (
        1.0  # of the time that the others are visible; each has a share of its own, 0.3 to 1.7 times this, at most 1
    )
    visible_s: Positive = 60.0  # time constant with which a vessel comes into view and is lost again
    clutter_per_m2: Annotated[float, Field(ge=0.0, le=1e-4)] = 0.0  # false plots per turn, uniform over the disc of its range
    burst: Burst = Burst()  # clutter that comes at times, on top of that
    noise_factor: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0  # true noise divided by the specified noise
    range_bias_m: Metres = 0.0  # added to each range: positive is too long, e.g. 40
    azimuth_bias_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = (
        0.0  # added to azimuths: positive is clockwise, e.g. 3 makes 90 93
    )
    azimuth_drift_deg_h: Annotated[float, Field(ge=-3600.0, le=3600.0)] = (
        0.0  # growth of the azimuth bias from the start of the run: positive is clockwise
    )
    azimuth_step_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = (
        0.0  # by which the azimuth bias jumps once, as when a gyro is set: positive is clockwise, e.g. 4
    )
    azimuth_step_s: NotNegative = 0.0  # when it jumps, after the start of the run
    time_bias_s: Annotated[float, Field(ge=-60.0, le=60.0)] = (
        0.0  # added to the true time of the beam: positive is late, e.g. 1.5
    )
    latency_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0  # from the beam to the arrival of the report
    start_s: NotNegative = 0.0  # switched on, after the start of the run
    stop_s: float | None = Field(default=None, ge=0.0, description="switched off, after the start of the run; none: never")
    outage_s: NotNegative = 0.0  # duration of repeated outages
    outage_every_s: Positive = 60.0  # period of the outages; the first is at a random time
    blind_from_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # start of a sector without plots, clockwise
    blind_to_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # end of the sector; equal to its start: no such sector
    course_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # of a moving platform
    speed_kn: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0  # of a moving platform; 0: on shore
    site_error_m: tuple[Metres, Metres] = (0.0, 0.0)  # positive: the stated site is east, north of the antenna, e.g. [50, 0]

    @model_validator(mode="after")
    def _it_works_between_outages_and_after_its_start(self) -> Self:
        if self.outage_s >= self.outage_every_s:
            raise InputError(f"outage_s: got {self.outage_s}, needed less than outage_every_s = {self.outage_every_s}")
        if self.stop_s is not None and self.stop_s < self.start_s:
            raise InputError(f"stop_s: got {self.stop_s}, needed start_s = {self.start_s} or more")
        return self

    def looks_at(self, azimuth_deg: Floats) -> Bools:
        """Whether azimuths are outside the blind sector. Args: azimuth_deg: (M,), NaN counts as outside. Returns: (M,)."""
        width = (self.blind_to_deg - self.blind_from_deg) % 360.0
        return np.asarray(~((azimuth_deg - self.blind_from_deg) % 360.0 < width))


def interpolated(trajectories: Trajectories) -> PositionAt:
    """A `position_at` by linear interpolation of sampled trajectories; NaN if one of the two neighbouring samples is absent."""
    time, position, present = trajectories.time_s, trajectories.position_deg, trajectories.present

    def position_at(row: Ints, time_s: Floats) -> Floats:
        hi = np.clip(np.searchsorted(time, time_s), 1, max(len(time) - 1, 1))
        lo, hi = hi - 1, np.minimum(hi, len(time) - 1)
        weight = np.clip((time_s - time[lo]) / np.where(hi > lo, time[hi] - time[lo], 1.0), 0.0, 1.0)[:, None]
        step = position[row, hi] - position[row, lo]
        step[:, 1] = wrap_deg(step[:, 1])
        out = position[row, lo] + weight * step
        out[:, 1] = wrap_deg(out[:, 1])
        outside = (time_s < time[0]) | (time_s > time[-1])
        out[outside | ~present[row, lo] | ~present[row, hi]] = np.nan
        return out

    return position_at


def plots_of_positions(position_m: Floats, time_s: Floats, origin: Ints, site_deg: Floats) -> RadarReports:
    """The plots of the first radar at positions east and north of it, as they come. Args: (M, 2), (M,), (M,), (2,)."""
    return RadarReports(
        sensor=np.zeros(len(time_s), np.int64),
        time_s=time_s,
        received_s=time_s,
        range_m=np.hypot(*position_m.T),
        azimuth_deg=np.degrees(np.arctan2(position_m[:, 0], position_m[:, 1])) % 360.0,
        site_deg=np.tile(site_deg, (len(time_s), 1)),
        origin=origin,
    )


def require_usable_radars(radars: Radars, method: str, least: int = 1) -> None:
    """Raises: InputError: there are too few radars for a simulation, or one counts azimuths from elsewhere than true north.

    Args: method: of the input; least: number of radars.
    """
    if len(radars) < least:
        raise InputError(f"radars: got none, needed one where input.method is {method}")
    for row in np.flatnonzero(radars.azimuth_reference > AzimuthReference.TRUE)[:1]:
        reference = AzimuthReference(radars.azimuth_reference[row]).name.lower()
        raise InputError(
            f"radars.{row}.azimuth_reference: got {reference!r} of {radars.name[row]}, needed 'true' where input.method is "
            f"{method}: simulated azimuths are true"
        )


def observe(
    radars: Radars,
    truths: Sequence[RadarTruth],
    position_at: PositionAt,
    vessel: Ints,
    start_s: float,
    stop_s: float,
    seed: int,
    standing: tuple[Floats, Floats] | None = None,
) -> RadarReports:
    """Reports of the radars between two times, in order of arrival.

    The time of a plot is when the beam passed the vessel; the antenna starts at a random phase. `site_deg` is the position of the
    antenna at that time. Clutter and standing echoes have origin -1.

    Args: radars: specifications (R); truths: one per radar; position_at: as in the docstring of this module, called with rows
    0..V-1; vessel: (V,) becomes `origin`; start_s, stop_s: since the epoch; standing: positions (E, 2) deg of standing echoes and the
    probability (E,) that each is detected in a turn.
    """
    parts = []
    for r, truth in enumerate(truths):
        on = start_s + truth.start_s
        off = stop_s if truth.stop_s is None else min(stop_s, start_s + truth.stop_s)
        period = float(radars.period_s[r])
        phase = float(np.random.default_rng([seed, PHASE, r]).random())
        turns = np.arange(np.floor((on - start_s) / period) - 2, np.ceil((off - start_s) / period) + 3)
        antenna = Antenna(radars, r, truth, start_s, start_s - phase * period, turns, seed)
        still = [] if standing is None else [antenna.standing_echoes(*standing)]
        for made in (antenna.echoes(position_at, vessel), antenna.clutter(), *still):
            beam = made.time_s - truth.time_bias_s
            parts.append(made.take((beam >= on) & (beam <= off) & antenna.works(beam)))
    joined = RadarReports.join(parts)
    return joined.take(np.lexsort((joined.sensor, joined.time_s, joined.received_s)))


@dataclass(frozen=True, eq=False)
class Antenna:
    """One radar in one run."""

    radars: Radars
    r: int
    truth: RadarTruth
    start_s: float  # of the run
    first_s: float  # when the beam of turn 0 pointed north
    turns: Floats
    seed: int

    def site_at(self, time_s: Floats) -> Floats:
        """True position of the antenna. Args: time_s: (M,). Returns: (M, 2) deg."""
        error_m, stated = np.array(self.truth.site_error_m), self.radars.site_deg[self.r]
        return self._moved(time_s, from_plane(-error_m, stated) if error_m.any() else stated)

    def _moved(self, time_s: Floats, here: Floats) -> Floats:
        """Where the platform is. Args: time_s: (M,); here: (2,) deg at the start. Returns: (M, 2) deg."""
        if self.truth.speed_kn == 0.0:
            return np.tile(here, (len(time_s), 1))
        course = np.radians(self.truth.course_deg)
        run = self.truth.speed_kn * KNOT_M_S * np.array([np.sin(course), np.cos(course)])
        return from_plane((time_s - self.start_s)[:, None] * run, here)

    def works(self, time_s: Floats) -> Bools:
        """Whether it works at these times. Args: time_s: (M,). Returns: (M,)."""
        every = self.truth.outage_every_s
        phase = float(np.random.default_rng([self.seed, OUTAGE, self.r]).random()) * every
        return np.asarray((time_s - self.start_s + phase) % every >= self.truth.outage_s)

    def echoes(self, position_at: PositionAt, vessel: Ints) -> RadarReports:
        """Plots of vessels, vessel by vessel."""
        truth, streams = self.truth, (DETECTION, NOISE, VISIBLE)
        detection, noise, visible = (np.random.default_rng([self.seed, stream, self.r]) for stream in streams)
        hidden = np.zeros(len(vessel), np.bool_)
        hidden[chosen(len(vessel), truth.unseen_share, np.random.default_rng([self.seed, UNSEEN]))] = True
        if max(truth.unseen, default=-1) >= len(vessel):
            raise InputError(
                f"input.radar.unseen: got vessel {max(truth.unseen)}, needed numbers below input.count = {len(vessel)}"
            )
        hidden[list(truth.unseen)] = True
        parts = []
        for lo in range(0, len(vessel), BLOCK):
            row = np.arange(lo, min(lo + BLOCK, len(vessel)))
            time, distance, azimuth = self._beams(position_at, row)
            found = detection.random(len(time)) < truth.detection_probability
            found &= ~np.repeat(hidden[row], len(self.turns))
            if truth.visible_share < 1.0:
                found &= self._visible(len(row), visible)
            errors = noise.standard_normal((len(time), 2))
            parts.append(self._measured(found, (time, distance, azimuth), errors, np.repeat(vessel[row], len(self.turns))))
        return RadarReports.join(parts)

    def standing_echoes(self, position_deg: Floats, probability: Floats) -> RadarReports:
        """Plots of things that do not move. Args: (E, 2); (E,) of detection in a turn."""
        rng, n = np.random.default_rng([self.seed, STANDING, self.r]), len(probability)
        if n == 0:
            return RadarReports.empty()
        beams = self._beams(lambda row, _: position_deg[row], np.arange(n))
        found = rng.random(n * len(self.turns)) < np.repeat(probability, len(self.turns))
        return self._measured(found, beams, rng.standard_normal((len(found), 2)), np.full(len(found), -1, np.int64))

    def _visible(self, count: int, rng: np.random.Generator) -> Bools:
        """Whether vessels are in view at each turn, vessel by vessel: two states, each left at a constant rate. (count * turns,)"""
        share = np.minimum(self.truth.visible_share * rng.uniform(0.3, 1.7, count), 1.0)
        rate = min(float(self.radars.period_s[self.r]) / self.truth.visible_s, 1.0)
        draws, now = rng.random((len(self.turns), count)), rng.random(count) < share
        out = np.empty((count, len(self.turns)), np.bool_)
        for k in range(len(self.turns)):
            now = np.where(draws[k] < rate, draws[k] < rate * share, now)
            out[:, k] = now
        return out.ravel()

    def _measured(self, found: Bools, beams: tuple[Floats, Floats, Floats], errors: Floats, origin: Ints) -> RadarReports:
        """Reports of the echoes that were found. Args: beams: of `_beams`; errors: standard normal, of range and azimuth."""
        time, distance, azimuth = beams
        errors = errors * self.truth.noise_factor
        seen = found & (distance <= self.radars.range_m[self.r])  # an absent vessel is NaN far
        seen &= self.truth.looks_at(np.degrees(azimuth))
        measured = distance + errors[:, 0] * self.radars.range_sigma_m[self.r] + self.truth.range_bias_m
        turned = np.degrees(azimuth + errors[:, 1] * self.radars.azimuth_sigma_rad[self.r]) + self.truth.azimuth_bias_deg
        turned = turned + self.truth.azimuth_drift_deg_h * (time - self.start_s) / 3600.0
        stepped = (self.truth.azimuth_step_deg != 0.0) & (time - self.start_s >= self.truth.azimuth_step_s)
        turned = np.where(stepped, turned + self.truth.azimuth_step_deg, turned)
        return self._reports(time[seen], measured[seen], turned[seen], origin[seen])

    def clutter(self) -> RadarReports:
        """False plots: their number is Poisson each turn, their places uniform over the disc."""
        reach, period_s = float(self.radars.range_m[self.r]), float(self.radars.period_s[self.r])
        steady = np.full(len(self.turns), self.truth.clutter_per_m2)
        burst, parts = self.truth.burst.density(self.first_s + self.turns * period_s - self.start_s), []
        for stream, per_m2 in ((CLUTTER, steady), (BURST, burst)):
            rng = np.random.default_rng([self.seed, stream, self.r])
            count = rng.poisson(per_m2 * np.pi * reach**2)
            total = int(count.sum())
            part, distance = rng.random(total), np.sqrt(rng.random(total)) * reach
            parts.append((self.first_s + (np.repeat(self.turns, count) + part) * period_s, distance, 360.0 * part))
        time, distance, azimuth = (np.concatenate(column) for column in zip(*parts, strict=True))
        made = self._reports(time, distance, azimuth, np.full(len(time), -1, np.int64))
        return made.take(self.truth.looks_at(made.azimuth_deg))

    def _beams(self, position_at: PositionAt, row: Ints) -> tuple[Floats, Floats, Floats]:
        """Time at which the beam passes each vessel, and distance and azimuth at that time: each (rows * turns,).

        The azimuth is continuous over the turns, so that a vessel that crosses north is detected once per turn.
        """
        vessels, turns, row = len(row), np.tile(self.turns, len(row)), np.repeat(row, len(self.turns))
        period = float(self.radars.period_s[self.r])
        at = self._relative(position_at, row, self.first_s + (turns + 0.5) * period)
        azimuth = _unwrapped(np.arctan2(at[:, 0], at[:, 1]).reshape(vessels, len(self.turns))).ravel()
        for _ in range(BEAM_ROUNDS):
            time = self.first_s + (turns + azimuth / TURN_RAD) * period
            at = self._relative(position_at, row, time)
            azimuth = azimuth + np.nan_to_num(wrap_rad(np.arctan2(at[:, 0], at[:, 1]) - azimuth))
        return time, np.hypot(at[:, 0], at[:, 1]), azimuth

    def _relative(self, position_at: PositionAt, row: Ints, time_s: Floats) -> Floats:
        return to_plane(position_at(row, time_s), self.site_at(time_s))

    def _reports(self, beam_s: Floats, range_m: Floats, azimuth_deg: Floats, origin: Ints) -> RadarReports:
        return RadarReports(
            sensor=np.full(len(beam_s), self.r, np.int64),
            time_s=beam_s + self.truth.time_bias_s,
            received_s=beam_s + self.truth.latency_s,
            range_m=np.maximum(range_m, 0.0),
            azimuth_deg=azimuth_deg % 360.0,
            site_deg=self._moved(beam_s, self.radars.site_deg[self.r]),
            origin=origin,
        )


def _unwrapped(azimuth: Floats) -> Floats:
    """The azimuths of each row without jumps of a full turn; the last known one replaces NaN."""
    known = np.isfinite(azimuth)
    newest = np.maximum.accumulate(np.where(known, np.arange(azimuth.shape[1]), 0), axis=1)
    held = np.nan_to_num(np.take_along_axis(azimuth, newest, axis=1)) % TURN_RAD
    return np.asarray(np.unwrap(held, axis=1))
