"""AIS reports of made-up vessels, and a run of AisFilter over them."""

from dataclasses import fields

import numpy as np

from coastwatch.batches import AisReports, Radars, Sensors, Sonars, Stations
from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.tracks import AisInput

PERIOD_S = 3.0
START_S = 1.7e9
HOME = np.array([50.8, -1.1])
SENSORS = Sensors(Radars.empty(), Stations.empty(), Sonars.empty(), ("west", "east"), np.zeros((2, 2)))


def reports(rows, error_s=None):
    """AisReports of (time, received, mmsi, lat, lon, sog, cog) rows, in order of receipt. Args: error_s: of some times, by time."""
    a = np.array(sorted(rows, key=lambda r: r[1]), float).reshape(-1, 7)
    return AisReports(
        time_s=a[:, 0],
        received_s=a[:, 1],
        mmsi=a[:, 2].astype(np.int64),
        position_deg=a[:, 3:5].copy(),
        sog_kn=a[:, 5],
        cog_deg=a[:, 6],
        class_b=np.zeros(len(a), bool),
        origin=a[:, 2].astype(np.int64) % 1000,
        time_error_s=np.array([(error_s or {}).get(t, np.nan) for t in a[:, 0].tolist()]),
    )


def sail(mmsi, times, start=HOME, speed_kn=12.0, course_deg=40.0, delay=None, seed=0, sigma_m=3.0):
    """Rows of a vessel on a straight course."""
    rng = np.random.default_rng([seed, mmsi])
    times = np.asarray(times, float)
    speed, course = speed_kn * KNOT_M_S, np.radians(course_deg)
    way = (times - START_S)[:, None] * speed * np.array([np.sin(course), np.cos(course)])
    place = offset_deg(np.asarray(start, float), way + rng.normal(0.0, sigma_m, way.shape))
    delay = np.zeros(len(times)) if delay is None else np.asarray(delay, float)
    return [(t, t + d, mmsi, p[0], p[1], speed_kn, course_deg) for t, p, d in zip(times, place, delay, strict=True)]


def run(method, rows, cycles, memory=None, first=0, outputs=None, error_s=None):
    """The memory and the last output after so many cycles from START_S on."""
    memory = method.init() if memory is None else memory
    every = reports(rows, error_s)
    for k in range(first, first + cycles):
        lo, hi = START_S + k * PERIOD_S, START_S + (k + 1) * PERIOD_S
        part = every.take((every.received_s > lo) & (every.received_s <= hi))
        memory, (tracks, alarms, _) = method.step(memory, AisInput(part, hi, SENSORS))
        if outputs is not None:
            outputs.append((tracks, alarms))
    return memory, tracks, alarms


def same(a, b, but=()):
    """Whether two batches are the same to the bit."""
    return all(getattr(a, f.name).tobytes() == getattr(b, f.name).tobytes() for f in fields(a) if f.name not in but)


def fleet(n=12, until_s=60.0, seed=5):
    rng = np.random.default_rng([seed, 1])
    rows = []
    for i in range(n):
        times = START_S + np.arange(rng.uniform(0.1, 3.0), until_s, rng.choice([2.0, 3.0, 10.0]))
        start = HOME + rng.uniform(-0.1, 0.1, 2)
        rows += sail(
            235000001 + i, times, start, rng.uniform(0.0, 20.0), rng.uniform(0.0, 360.0), rng.uniform(0.0, 8.0, len(times))
        )
    return rows
