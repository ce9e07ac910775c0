"""A small world of vessels and radars for tests of radar tracks: its own generator, independent of the simulator's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from coastwatch.batches import Floats, Ints, Plots, Radars, Sensors, Sonars, Stations, Tracks
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, from_plane, to_plane
from coastwatch.scenario.refusing import methods_of, models_of
from coastwatch.stage import Settings
from coastwatch.tracks import RadarTracker, RegionInput, TableTracker
from coastwatch.tracks.radar.bank import Particles
from coastwatch.tracks.radar.table import RadarMemory

PERIOD_S = 3.0
ORIGIN_DEG = np.array([-22.95, -43.1])


def every_tracker() -> list[TableTracker]:
    """A tracker of a table for each of its names, and for each part that none of these has. Particles are few, for speed."""
    made = [TableTracker(method=name) for name in methods_of(TableTracker)]
    for key, field in TableTracker.model_fields.items():
        for part in models_of(field.annotation)[0]:
            if not any(isinstance(getattr(tracker, key), part) for tracker in made):
                made.append(_with_part(key, part()))
    few = {"bank": Particles(particles=50)}
    return [m.model_copy(update=few) if isinstance(m.bank, Particles) else m for m in made]


def _with_part(key: str, part: Settings) -> TableTracker:
    """The tracker of the first name that this part fits."""
    for name in methods_of(TableTracker):
        try:
            return TableTracker(method=name, **{key: part})
        except ValidationError:
            continue
    raise AssertionError(f"{key}: no tracker has {part}")


def two_radars(region: int = 0, range_nm: float = 6.0, azimuth_sigma_deg: float = 0.3) -> Sensors:
    """Two radars of one region (the last of region + 1), 15 and 20 turns a minute, 10 m and 0.3 deg."""
    sites = np.array([[-5.4, 2.0], [-5.4, -2.0]]) * NAUTICAL_MILE_M
    origin = np.tile(ORIGIN_DEG, (region + 1, 1))
    radars = Radars(
        name=np.array(["north", "south"]),
        region=np.full(2, region, np.int64),
        site_deg=from_plane(sites, ORIGIN_DEG),
        range_m=np.full(2, range_nm * NAUTICAL_MILE_M),
        period_s=np.array([4.0, 3.0]),
        range_sigma_m=np.full(2, 10.0),
        azimuth_sigma_rad=np.full(2, np.radians(azimuth_sigma_deg)),
    )
    return Sensors(radars, Stations.empty(), Sonars.empty(), tuple(f"region {k}" for k in range(region + 1)), origin)


@dataclass(frozen=True)
class World:
    """Vessels that start at random places of a square and keep a turn rate, their velocity kicked once a minute."""

    start_m: Floats  # (V, 2)
    velocity_m_s: Floats  # (V, 2)
    rate_rad_s: Floats  # (V,)
    kick_s: Floats  # (V, C)
    kick_m_s: Floats  # (V, C, 2)

    def at(self, vessel: Ints, time_s: Floats) -> tuple[Floats, Floats]:
        """Position and velocity of these vessels, each at its own time."""
        place, velocity = self.start_m[vessel], self.velocity_m_s[vessel]
        before = np.zeros(len(vessel))
        for c in range(self.kick_s.shape[1] + 1):
            until = np.minimum(time_s, self.kick_s[vessel, c]) if c < self.kick_s.shape[1] else time_s
            place, velocity = _turned(place, velocity, self.rate_rad_s[vessel], np.maximum(until - before, 0.0))
            before = np.maximum(before, until)
            if c < self.kick_s.shape[1]:
                velocity = velocity + self.kick_m_s[vessel, c] * (time_s > self.kick_s[vessel, c])[:, None]
        return place, velocity


def _turned(place: Floats, velocity: Floats, rate: Floats, dt: Floats) -> tuple[Floats, Floats]:
    small = np.abs(rate) < 1e-9
    w = np.where(small, 1.0, rate)
    along = np.where(small, dt, np.sin(rate * dt) / w)
    across = np.where(small, 0.0, (1.0 - np.cos(rate * dt)) / w)
    east, north = velocity.T
    moved = place + np.column_stack([along * east - across * north, across * east + along * north])
    sin, cos = np.sin(rate * dt), np.cos(rate * dt)
    return moved, np.column_stack([cos * east - sin * north, sin * east + cos * north])


def world(
    vessels: int, seed: int, turning: bool = False, kick_m_s: float = 0.154, side_nm: float = 10.0, span_s: float = 240.0
) -> World:
    rng = np.random.default_rng([seed, 1])
    speed, course = rng.uniform(0.0, 15.0, vessels) * KNOT_M_S, rng.uniform(0.0, 2.0 * np.pi, vessels)
    kicks = int(np.ceil(span_s / 60.0))
    rate = np.radians(rng.uniform(0.2, 0.8, vessels)) * rng.choice([-1.0, 1.0], vessels)
    return World(
        rng.uniform(-0.5, 0.5, (vessels, 2)) * side_nm * NAUTICAL_MILE_M,
        speed[:, None] * np.column_stack([np.sin(course), np.cos(course)]),
        rate if turning else np.zeros(vessels),
        rng.uniform(0.0, 60.0, (vessels, 1)) + 60.0 * np.arange(kicks),
        rng.standard_normal((vessels, kicks, 2)) * kick_m_s,
    )


def plots_of(
    truth: World, sensors: Sensors, span_s: float, seed: int, detection: float = 1.0, clutter_per_m2: float = 0.0
) -> Plots:
    """All plots of a run from 0 to span_s, sorted by time."""
    parts = []
    region = int(sensors.radars.region[0])
    for radar in range(len(sensors.radars)):
        rng = np.random.default_rng([seed, 2, radar])
        period, reach = float(sensors.radars.period_s[radar]), float(sensors.radars.range_m[radar])
        site = to_plane(sensors.radars.site_deg[radar], sensors.region_origin_deg[region])
        turns, vessels = int(span_s // period), len(truth.start_m)
        vessel, turn = np.tile(np.arange(vessels), turns), np.repeat(np.arange(turns), vessels)
        time = turn * period + 0.5 * period
        for _ in range(3):
            gap = truth.at(vessel, time)[0] - site
            time = turn * period + np.arctan2(gap[:, 0], gap[:, 1]) % (2.0 * np.pi) / (2.0 * np.pi) * period
        gap = truth.at(vessel, time)[0] - site
        distance, azimuth = np.hypot(gap[:, 0], gap[:, 1]), np.arctan2(gap[:, 0], gap[:, 1])
        seen = (distance <= reach) & (rng.random(len(vessel)) < detection)
        sigma_r, sigma_a = float(sensors.radars.range_sigma_m[radar]), float(sensors.radars.azimuth_sigma_rad[radar])
        distance = distance[seen] + sigma_r * rng.standard_normal(int(seen.sum()))
        azimuth = azimuth[seen] + sigma_a * rng.standard_normal(int(seen.sum()))
        false = int(rng.poisson(clutter_per_m2 * np.pi * reach**2 * turns))
        false_azimuth = rng.uniform(0.0, 2.0 * np.pi, false)
        distance = np.concatenate([distance, reach * np.sqrt(rng.random(false))])
        azimuth = np.concatenate([azimuth, false_azimuth])
        time = np.concatenate([time[seen], (rng.integers(0, turns, false) + false_azimuth / (2.0 * np.pi)) * period])
        origin = np.concatenate([vessel[seen], np.full(false, -1)]).astype(np.int64)
        parts.append(_plots(radar, region, time, distance, azimuth, sigma_r, sigma_a, site, origin))
    every = Plots.join(parts)
    return every.take(np.argsort(every.time_s, kind="stable"))


def _plots(
    radar: int,
    region: int,
    time: Floats,
    distance: Floats,
    azimuth: Floats,
    sigma_r: float,
    sigma_a: float,
    site: Floats,
    origin: Ints,
) -> Plots:
    n = len(time)
    ahead = np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    across = np.column_stack([np.cos(azimuth), -np.sin(azimuth)])
    wide = (sigma_a * distance) ** 2
    return Plots(
        sensor=np.full(n, radar, np.int64),
        region=np.full(n, region, np.int64),
        time_s=time,
        position_m=site + distance[:, None] * ahead,
        covariance=sigma_r**2 * ahead[:, :, None] * ahead[:, None] + wide[:, None, None] * across[:, :, None] * across[:, None],
        site_m=np.tile(site, (n, 1)),
        range_m=distance,
        azimuth_rad=azimuth,
        origin=origin,
    )


def cut(plots: Plots, cycle: int) -> Plots:
    """The plots of one cycle."""
    return plots.take((plots.time_s > PERIOD_S * cycle) & (plots.time_s <= PERIOD_S * (cycle + 1)))


def run(
    method: RadarTracker,
    plots: Plots,
    cycles: int,
    sensors: Sensors | None = None,
    region: int = 0,
    memory: RadarMemory | None = None,
    first: int = 0,
) -> tuple[RadarMemory, list[Tracks]]:
    """Memory and the tracks of each cycle."""
    sensors = sensors or two_radars()
    memory = method.init() if memory is None else memory
    out = []
    for cycle in range(first, first + cycles):
        memory, (tracks, *_) = method.step(
            memory, RegionInput.of_plots(cut(plots, cycle), PERIOD_S * (cycle + 1), sensors, region)
        )
        out.append(tracks)
    return memory, out
