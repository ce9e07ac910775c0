"""A small seeded world for bearing association: vessels, what the picture knows of them, and what a sonar hears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import BearingReports, Floats, Ints, Picture, Radars, Sensors, Sonars, Stations
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, from_plane, to_plane

ORIGIN_DEG = np.array([-22.9, -43.15])
HALF_M = 5.0 * NAUTICAL_MILE_M
START_S = 1.7e9
PERIOD_S = 3.0
KICK_S = 60.0
CORRELATION_S = 20.0  # of position errors


@dataclass(frozen=True)
class World:
    """True vessels on a plane at 1 s steps, and which of them the picture knows how well."""

    position_m: Floats  # (V, T, 2)
    velocity_m_s: Floats
    error_m: Floats  # (V, T, 2) of the picture
    sigma_m: Floats  # (V,)
    known: Floats  # (V,) bool

    def picture(self, t: int) -> Picture:
        rows = np.flatnonzero(self.known)
        n = len(rows)
        covariance = np.zeros((n, 4, 4))
        covariance[:, [0, 1], [0, 1]] = self.sigma_m[rows, None] ** 2
        covariance[:, [2, 3], [2, 3]] = 0.3**2
        where = from_plane(self.position_m[rows, t] + self.error_m[rows, t], ORIGIN_DEG)
        stamp, none = np.full(n, START_S + t), np.full(n, -1)
        return Picture(
            rows * 7 + 100, stamp, where, self.velocity_m_s[rows, t], covariance, stamp - t, stamp, none, none * 0, rows
        )


def make_world(count: int, seconds: int, seed: int, kick: float = 0.1) -> World:
    """Vessels uniform in 10 x 10 NM, up to 15 kn, their velocity perturbed every minute; half have AIS, radar sees half."""
    rng = np.random.default_rng([seed, 1])
    start = rng.uniform(-HALF_M, HALF_M, (count, 2))
    speed, course = rng.uniform(0.0, 15.0 * KNOT_M_S, count), rng.uniform(0.0, 2.0 * np.pi, count)
    velocity = np.empty((count, seconds + 1, 2))
    velocity[:, 0] = np.column_stack([speed * np.sin(course), speed * np.cos(course)])
    phase = rng.integers(0, int(KICK_S), count)
    for t in range(1, seconds + 1):
        kicked = ((t + phase) % int(KICK_S) == 0)[:, None]
        velocity[:, t] = velocity[:, t - 1] + kicked * rng.normal(0.0, kick * 15.0 * KNOT_M_S, (count, 2))
    position = start[:, None] + np.cumsum(velocity, axis=1) - velocity[:, :1]
    ais = rng.uniform(size=count) < 0.5
    radar = rng.uniform(size=count) < 0.5
    sigma = np.where(ais, 3.0, 10.0)
    rho = np.exp(-1.0 / CORRELATION_S)
    error = np.empty((count, seconds + 1, 2))
    error[:, 0] = rng.normal(size=(count, 2))
    for t in range(1, seconds + 1):
        error[:, t] = rho * error[:, t - 1] + np.sqrt(1.0 - rho**2) * rng.normal(size=(count, 2))
    return World(position, velocity, error * sigma[:, None, None], sigma, ais | radar)


def sensors_of(sites_m: Floats, range_m: float, arc_deg: tuple[float, float], noise_deg: float = 1.0) -> Sensors:
    """One region, no radar, and a sonar at each site."""
    n = len(sites_m)
    sonars = Sonars(
        np.array([f"sonar{i}" for i in range(n)], "U32"),
        from_plane(sites_m, ORIGIN_DEG),
        np.full(n, range_m),
        np.full(n, np.radians(noise_deg)),
        np.full(n, PERIOD_S),
        np.full(n, arc_deg[0]),
        np.full(n, arc_deg[1]),
    )
    return Sensors(Radars.empty(), Stations.empty(), sonars, ("region",), ORIGIN_DEG[None])


def centre() -> Sensors:
    """A sonar in the middle that covers half of the area."""
    return sensors_of(np.zeros((1, 2)), np.sqrt(50.0 / np.pi) * NAUTICAL_MILE_M, (0.0, 360.0))


def coast() -> Sensors:
    """A sonar on the southern border that covers half of the area, seaward."""
    return sensors_of(np.array([[0.0, -HALF_M]]), 5.9 * NAUTICAL_MILE_M, (-90.0, 90.0))


def hear(
    world: World, sensors: Sensors, t: int, seed: int, bias_deg: float = 0.0, misses: float = 0.0, phase_s: float = 0.0
) -> BearingReports:
    """What the sonars say in the period that ends at second t; contacts are numbered by vessel."""
    parts = []
    for s in range(len(sensors.sonars)):
        rng = np.random.default_rng([seed, 2, s, t])
        now = t - phase_s
        i = min(int(now), world.position_m.shape[1] - 1)
        where = from_plane(world.position_m[:, i] + (now - i) * world.velocity_m_s[:, i], ORIGIN_DEG)
        off = to_plane(where, sensors.sonars.site_deg[s])
        bearing = np.degrees(np.arctan2(off[:, 0], off[:, 1]))
        width = (sensors.sonars.arc_to_deg[s] - sensors.sonars.arc_from_deg[s]) % 360.0 or 360.0
        heard = (np.hypot(*off.T) <= sensors.sonars.range_m[s]) & ((bearing - sensors.sonars.arc_from_deg[s]) % 360.0 <= width)
        heard &= rng.uniform(size=len(heard)) >= misses
        rows = np.flatnonzero(heard)
        noise = np.degrees(sensors.sonars.bearing_sigma_rad[s]) * rng.normal(size=len(heard))
        stamp = np.full(len(rows), START_S + now)
        site = np.broadcast_to(sensors.sonars.site_deg[s], (len(rows), 2)).copy()
        said = (bearing + noise + bias_deg)[rows] % 360.0
        parts.append(BearingReports(np.full(len(rows), s), stamp, stamp, said, rows, site, rows * 0 - 1, rows))
    return BearingReports.join(parts)


def count(pairs_bearing: Ints, pairs_vessel: Ints, bearing_origin: Ints, vessel_origin: Ints) -> Floats:
    """TP, FN, FP, TN of one cycle, one decision a bearing track; a swap is an FN and an FP."""
    partner = np.full(len(bearing_origin), -1)
    partner[pairs_bearing] = vessel_origin[pairs_vessel]
    exists, chosen, right = np.isin(bearing_origin, vessel_origin), partner >= 0, partner == bearing_origin
    return np.array([(right).sum(), (exists & ~right).sum(), (chosen & ~right).sum(), (~exists & ~chosen).sum()])


def f1(c: Floats) -> float:
    return float(2.0 * c[0] / (2.0 * c[0] + c[1] + c[2]))


def mcc(c: Floats) -> float:
    tp, fn, fp, tn = (float(x) for x in c)
    return float((tp * tn - fp * fn) / np.sqrt((tp + fp) * (tp + fn) * (tn + fp) * (tn + fn)))
