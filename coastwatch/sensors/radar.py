"""What radars would report of vessels that move as given: `observe`.

    observe(radars, truths, where, vessel, start_s, stop_s, seed) -> RadarReports

`where(row, time_s)` says where vessels are, (M,) and (M,) to (M, 2) latitude, longitude, NaN where a vessel is absent; `along`
makes one of Trajectories that are sampled finely enough to be straight between samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch.batches import Bools, Floats, Ints, RadarReports, Radars, Trajectories
from coastwatch.geodesy import KNOT_M_S, from_plane, to_plane, wrap_deg, wrap_rad
from coastwatch.sensors.vessels import Share, chosen
from coastwatch.stage import Settings

Where = Callable[[Ints, Floats], Floats]

NOISE, DETECTION, CLUTTER, PHASE, UNSEEN, OUTAGE = (
    11,
    12,
    13,
    14,
    15,
    16,
)  # streams of random numbers: a change of one leaves the others as they are
TURN_RAD = 2.0 * np.pi
BLOCK = 4096  # vessels at a time, which bounds memory and changes no number
BEAM_ROUNDS = 3  # each shrinks the error of the beam time by azimuth rate x turn period, under 0.1 beyond 300 m


class RadarTruth(Settings):
    """What a simulated radar does beyond its specification."""

    name: str = ""  # of the radar in [[radars]]; empty in [input.radar], which is of all radars that are not named
    detection_probability: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0  # of a vessel in range, each turn
    unseen_share: Share = 0.0  # of the vessels no radar ever sees, the same ones for all radars of this share
    clutter_per_m2: Annotated[float, Field(ge=0.0, le=1e-4)] = 0.0  # false plots each turn, uniform over the disc of the range
    noise_factor: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0  # real noise over that of the specification
    range_bias_m: Annotated[float, Field(ge=-1000.0, le=1000.0)] = 0.0  # added to what is measured
    azimuth_bias_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0  # added to what is measured
    azimuth_drift_deg_h: Annotated[float, Field(ge=-3600.0, le=3600.0)] = (
        0.0  # by which the bias grows from the start of the run
    )
    time_bias_s: Annotated[float, Field(ge=-60.0, le=60.0)] = 0.0  # added to the true time of the beam
    latency_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0  # from the beam to the arrival of the report
    start_s: Annotated[float, Field(ge=0.0)] = 0.0  # switched on, after the start of the run
    stop_s: float | None = Field(default=None, ge=0.0, description="switched off, after the start of the run; none: never")
    outage_s: Annotated[float, Field(ge=0.0)] = 0.0  # it is down for so long, again and again
    outage_every_s: Annotated[float, Field(gt=0.0)] = 60.0  # from one outage to the next, the first at a random time
    blind_from_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # sector without plots, clockwise
    blind_to_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # end of it; the same as its begin: none
    course_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 0.0  # of a moving platform
    speed_kn: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0  # of a moving platform; 0: on shore

    @model_validator(mode="after")
    def _it_works_between_outages(self) -> Self:
        if self.outage_s >= self.outage_every_s:
            raise ValueError(f"outage_s: got {self.outage_s}, needed less than outage_every_s = {self.outage_every_s}")
        return self

    def looks_at(self, azimuth_deg: Floats) -> Bools:
        """Whether azimuths lie outside the blind sector. Args: (M,), NaN is inside none. Returns: (M,)."""
        width = (self.blind_to_deg - self.blind_from_deg) % 360.0
        return np.asarray(~((azimuth_deg - self.blind_from_deg) % 360.0 < width))


def along(trajectories: Trajectories) -> Where:
    """A `where` that interpolates sampled trajectories linearly; absent where either sample next to the time is absent."""
    time, position, present = trajectories.time_s, trajectories.position_deg, trajectories.present

    def where(row: Ints, time_s: Floats) -> Floats:
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

    return where


def observe(
    radars: Radars, truths: Sequence[RadarTruth], where: Where, vessel: Ints, start_s: float, stop_s: float, seed: int
) -> RadarReports:
    """What the radars report between two times, in order of arrival.

    A plot carries the true time at which the beam passed the vessel, the antenna at a random phase at the start. `site_deg` is
    where the antenna was at that time. Clutter has origin -1.

    Args: radars: by specification (R); truths: one a radar; where: see the top of this module, asked for rows
    0..V-1; vessel: (V,) what becomes `origin`; start_s, stop_s: s since the epoch.
    """
    parts = []
    for r, truth in enumerate(truths):
        on = start_s + truth.start_s
        off = stop_s if truth.stop_s is None else min(stop_s, start_s + truth.stop_s)
        period = float(radars.period_s[r])
        phase = float(np.random.default_rng([seed, PHASE, r]).random())
        turns = np.arange(np.floor((on - start_s) / period) - 2, np.ceil((off - start_s) / period) + 3)
        antenna = Antenna(radars, r, truth, start_s, start_s - phase * period, turns, seed)
        for made in (antenna.echoes(where, vessel), antenna.clutter()):
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
        """Where the antenna is. Args: time_s: (M,). Returns: (M, 2) deg."""
        here = self.radars.site_deg[self.r]
        if self.truth.speed_kn == 0.0:
            return np.tile(here, (len(time_s), 1))
        course = np.radians(self.truth.course_deg)
        run = self.truth.speed_kn * KNOT_M_S * np.array([np.sin(course), np.cos(course)])
        return from_plane((time_s - self.start_s)[:, None] * run, here)

    def works(self, time_s: Floats) -> Bools:
        """Whether it is not down. Args: time_s: (M,). Returns: (M,)."""
        every = self.truth.outage_every_s
        phase = float(np.random.default_rng([self.seed, OUTAGE, self.r]).random()) * every
        return np.asarray((time_s - self.start_s + phase) % every >= self.truth.outage_s)

    def echoes(self, where: Where, vessel: Ints) -> RadarReports:
        """Plots of vessels, vessel by vessel."""
        detection, noise = (np.random.default_rng([self.seed, stream, self.r]) for stream in (DETECTION, NOISE))
        hidden = np.zeros(len(vessel), np.bool_)
        hidden[chosen(len(vessel), self.truth.unseen_share, np.random.default_rng([self.seed, UNSEEN]))] = True
        parts = []
        for lo in range(0, len(vessel), BLOCK):
            row = np.arange(lo, min(lo + BLOCK, len(vessel)))
            time, distance, azimuth = self._beams(where, row)
            found = detection.random(len(time)) < self.truth.detection_probability
            errors = noise.standard_normal((len(time), 2)) * self.truth.noise_factor
            seen = found & (distance <= self.radars.range_m[self.r])  # an absent vessel is NaN far
            seen &= ~np.repeat(hidden[row], len(self.turns)) & self.truth.looks_at(np.degrees(azimuth))
            measured = distance + errors[:, 0] * self.radars.range_sigma_m[self.r] + self.truth.range_bias_m
            turned = np.degrees(azimuth + errors[:, 1] * self.radars.azimuth_sigma_rad[self.r]) + self.truth.azimuth_bias_deg
            turned = turned + self.truth.azimuth_drift_deg_h * (time - self.start_s) / 3600.0
            origin = np.repeat(vessel[row], len(self.turns))
            parts.append(self._reports(time[seen], measured[seen], turned[seen], origin[seen]))
        return RadarReports.join(parts)

    def clutter(self) -> RadarReports:
        """False plots: their number is Poisson each turn, their places uniform over the disc."""
        rng = np.random.default_rng([self.seed, CLUTTER, self.r])
        reach = float(self.radars.range_m[self.r])
        count = rng.poisson(self.truth.clutter_per_m2 * np.pi * reach**2, len(self.turns))
        total = int(count.sum())
        part, distance = rng.random(total), np.sqrt(rng.random(total)) * reach
        time = self.first_s + (np.repeat(self.turns, count) + part) * self.radars.period_s[self.r]
        made = self._reports(time, distance, 360.0 * part, np.full(total, -1, np.int64))
        return made.take(self.truth.looks_at(made.azimuth_deg))

    def _beams(self, where: Where, row: Ints) -> tuple[Floats, Floats, Floats]:
        """When the beam passes each vessel, and its distance and azimuth then: each (rows * turns,).

        The azimuth is made continuous over the turns, so a vessel that crosses north is still hit once each time the beam passes.
        """
        turns, row = np.tile(self.turns, len(row)), np.repeat(row, len(self.turns))
        period = float(self.radars.period_s[self.r])
        at = self._relative(where, row, self.first_s + (turns + 0.5) * period)
        azimuth = _unwrapped(np.arctan2(at[:, 0], at[:, 1]).reshape(-1, len(self.turns))).ravel()
        for _ in range(BEAM_ROUNDS):
            time = self.first_s + (turns + azimuth / TURN_RAD) * period
            at = self._relative(where, row, time)
            azimuth = azimuth + np.nan_to_num(wrap_rad(np.arctan2(at[:, 0], at[:, 1]) - azimuth))
        return time, np.hypot(at[:, 0], at[:, 1]), azimuth

    def _relative(self, where: Where, row: Ints, time_s: Floats) -> Floats:
        return to_plane(where(row, time_s), self.site_at(time_s))

    def _reports(self, beam_s: Floats, range_m: Floats, azimuth_deg: Floats, origin: Ints) -> RadarReports:
        return RadarReports(
            sensor=np.full(len(beam_s), self.r, np.int64),
            time_s=beam_s + self.truth.time_bias_s,
            received_s=beam_s + self.truth.latency_s,
            range_m=np.maximum(range_m, 0.0),
            azimuth_deg=azimuth_deg % 360.0,
            site_deg=self.site_at(beam_s),
            origin=origin,
        )


def _unwrapped(azimuth: Floats) -> Floats:
    """The azimuths of each row made continuous, held where NaN."""
    known = np.isfinite(azimuth)
    newest = np.maximum.accumulate(np.where(known, np.arange(azimuth.shape[1]), 0), axis=1)
    held = np.nan_to_num(np.take_along_axis(azimuth, newest, axis=1)) % TURN_RAD
    return np.asarray(np.unwrap(held, axis=1))
