"""Vessels on straight courses, radars that are off by what is asked, and AIS tracks with a known error: what registration is given."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coastwatch.batches import (
    AisAlarms,
    BearingAssociations,
    BearingTracks,
    Floats,
    HullOffsets,
    Ints,
    Measurements,
    Members,
    Picture,
    Plots,
    RadarCorrections,
    Radars,
    Sensors,
    Sonars,
    Stations,
    Tracks,
)
from coastwatch.geodesy import from_plane, to_plane
from coastwatch.registration import RegistrationInput
from tests.oracles.polar_textbook import polar_to_plane

CENTRE = np.array([-23.0, -43.2])
START_S = 1_750_000_000.0
PERIOD_S = 3.0
RANGE_SIGMA_M, AZIMUTH_SIGMA = 10.0, np.radians(0.3)


def sensors(radars: int = 1) -> Sensors:
    """Radars 4 km apart in one region, that reach 11 km and turn in 3 s."""
    site = from_plane(np.column_stack([np.zeros(radars), 4000.0 * np.arange(radars)]), CENTRE)
    one = np.ones(radars)
    return Sensors(
        Radars(
            np.array([f"r{k}" for k in range(radars)], "U32"), np.zeros(radars, np.int64), site, 11_000.0 * one, 3.0 * one,
            RANGE_SIGMA_M * one, AZIMUTH_SIGMA * one,
        ),
        Stations.empty(), Sonars.empty(), ("sea",), CENTRE[None],
    )  # fmt: skip


@dataclass
class Sea:
    """A sea with one seed. Errors are one row a radar: azimuth deg, range m, lag s; stated site east, north m; scale."""

    seed: int
    vessels: int = 60
    ais: int = 40  # the first so many vessels
    silent: int = 0  # the first so many AIS vessels, of which the radars see nothing
    radars: int = 1
    errors: Any = ((5.0, 30.0, 1.5),)
    detection: float = 0.9
    clutter: int = 5
    ais_sigma_m: float = 3.0  # constant for each vessel
    speed_m_s: float = 6.0
    moves_m_s: float = 0.0  # at which the radars go east
    start_m: Floats = field(init=False)
    velocity: Floats = field(init=False)
    off_m: Floats = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng([self.seed, 1])
        angle, distance = rng.uniform(0, 2 * np.pi, self.vessels), 10_000.0 * np.sqrt(rng.uniform(0.01, 1, self.vessels))
        self.start_m = np.column_stack([distance * np.sin(angle), distance * np.cos(angle)])
        course = rng.uniform(0, 2 * np.pi, self.vessels)
        speed = rng.uniform(0.3, 1.7, self.vessels) * self.speed_m_s
        self.velocity = np.column_stack([np.sin(course), np.cos(course)]) * speed[:, None]
        self.off_m = self.ais_sigma_m * rng.standard_normal((self.vessels, 2))

    def at(self, time_s: Floats) -> Floats:
        """(T, V, 2) m in the plane of the region."""
        return self.start_m + (time_s[..., None, None] - START_S) * self.velocity

    def plots(self, cycle: int, given: RadarCorrections, errors: Any = None) -> Plots:
        """The plots of a cycle with the corrections taken out."""
        where, parts = sensors(self.radars), []
        site = np.column_stack([np.zeros(self.radars), 4000.0 * np.arange(self.radars)])
        for r, (bias_deg, bias_m, lag_s, *others) in enumerate(self.errors if errors is None else errors):
            east_m, north_m, scale = [*others, 0.0, 0.0, 0.0][:3]
            true_site, taken_site = site[r] - [east_m, north_m], site[r] - given.site_error_m[r]
            rng = np.random.default_rng([self.seed, 2, cycle, r])
            beam = START_S + PERIOD_S * cycle + rng.uniform(0, PERIOD_S, self.vessels)
            run = np.column_stack([self.moves_m_s * (beam - START_S), np.zeros(self.vessels)])
            at = self.start_m + (beam - START_S)[:, None] * self.velocity - true_site - run
            seen = (rng.random(self.vessels) < self.detection) & (np.arange(self.vessels) >= self.silent)
            false = 10_000.0 * rng.uniform(-0.7, 0.7, (self.clutter, 2))
            at, beam = np.concatenate([at[seen], false]), np.concatenate([beam[seen], beam[: self.clutter]])
            run = np.concatenate([run[seen], run[: self.clutter]])
            noise = rng.standard_normal((len(at), 2))
            measured = np.hypot(at[:, 0], at[:, 1]) * (1.0 + scale) + RANGE_SIGMA_M * noise[:, 0] + bias_m
            distance = (measured - given.range_bias_m[r]) / (1.0 + given.range_scale[r])
            azimuth = np.arctan2(at[:, 0], at[:, 1]) + AZIMUTH_SIGMA * noise[:, 1] + np.radians(bias_deg)
            azimuth = azimuth - given.azimuth_bias_rad[r]
            n = len(at)
            metres, covariance = polar_to_plane(distance, azimuth, np.full(n, RANGE_SIGMA_M), np.full(n, AZIMUTH_SIGMA))
            place = to_plane(from_plane(metres, from_plane(-given.site_error_m[r], where.radars.site_deg[r])), CENTRE) + run
            number = np.full(n, r, np.int64)
            stamp = beam + lag_s - given.time_lag_s[r]
            sites, nobody = taken_site + run, number * 0 - 1
            parts.append(Plots(number, number * 0, stamp, place, covariance, sites, distance, azimuth, nobody))
        return Plots.join(parts)

    def ais_tracks(self, cycle: int, shift_m: Floats | None = None) -> Tracks:
        """AIS tracks at the end of a cycle. Args: shift_m: (ais, 2) by which vessels lie about their place."""
        time_s = START_S + PERIOD_S * (cycle + 1)
        n = self.ais
        place = self.at(np.array(time_s))[:n] + self.off_m[:n] + (0.0 if shift_m is None else shift_m)
        covariance = np.tile(np.diag([self.ais_sigma_m**2 / 4.0] * 2 + [1e-3] * 2), (n, 1, 1))
        time, number = np.full(n, time_s), np.arange(n)
        return Tracks(
            number + 2**40, number * 0 + 1, time, from_plane(place, CENTRE), self.velocity[:n], covariance,
            np.tile(np.eye(2) * 9.0, (n, 1, 1)), time, time - 100.0, number + 200_000_000, number,
        )  # fmt: skip


def quiet(tracks: Tracks) -> AisAlarms:
    """Nothing odd."""
    no = np.zeros(len(tracks), np.bool_)
    return AisAlarms(tracks.track_id, tracks.mmsi, no, no)


def others() -> tuple[Any, ...]:
    """What registration is given besides where there is no bearing sensor."""
    none: Ints = np.zeros(0, np.int64)
    bearings = BearingAssociations(none, none, np.zeros(0), np.zeros(0))
    return Measurements.empty(), Picture.empty(), Members.empty(), BearingTracks.empty(), bearings


def run(method: Any, sea: Sea, cycles: int, first: int = 0, memory: Any = None, given: Any = None, **more: Any) -> Any:
    """Memory and corrections after some cycles, each with the corrections of the one before taken out; `course` collects them.

    Args: errors, shift_m, hulls: functions of the cycle, the last one of the AIS tracks too.
    """
    where = sensors(sea.radars)
    memory = method.init() if memory is None else memory
    given = RadarCorrections.empty(R=sea.radars) if given is None else given
    course = []
    for cycle in range(first, first + cycles):
        tracks = sea.ais_tracks(cycle, more["shift_m"](cycle) if "shift_m" in more else None)
        plots = sea.plots(cycle, given, more["errors"](cycle) if "errors" in more else None)
        if "order" in more:
            plots = plots.take(np.random.default_rng(cycle).permutation(len(plots)))
        time_s = START_S + PERIOD_S * (cycle + 1)
        hulls = more["hulls"](cycle, tracks) if "hulls" in more else HullOffsets.empty()
        seen = RegistrationInput(plots, tracks, quiet(tracks), *others(), time_s, where, given, hulls)
        memory, given = method.step(memory, seen)
        course.append(given)
    return memory, given, course


def errors_of(given: RadarCorrections, true: Any) -> Floats:
    """Corrections less the true errors over the standard deviations. (R, 3)"""
    got = np.column_stack([given.azimuth_bias_rad, given.range_bias_m, given.estimated_lag_s])
    want = np.array([[np.radians(a), m, s] for a, m, s, *_ in true])
    return (got - want) / np.column_stack([given.azimuth_sigma_rad, given.range_sigma_m, given.lag_sigma_s])
