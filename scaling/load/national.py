"""A national picture for the high-level centre: coasts, ports, lanes, fleets, with truth; streamed, seeded, any number of tracks.

`lay_world` draws what stays, `first` is the state before the first cycle, `receive` takes it one cycle on. What a cycle gives depends
on seed, cycle and state alone; a state kept or pickled goes on bit for bit. README.md states what was chosen, and why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch.batches import AisAlarms, AisStatics, Bools, Floats, Ints, Measurements, Sensors, Tracks, Truth
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.pipeline import Received
from coastwatch.scenario import Scenario, make_scenario, utc_text
from coastwatch.tracks import BearingWindow
from scaling.load import listening
from scaling.load.carriers import Posts, appoint, places_for
from scaling.load.coasts import Coasts, geodetic, lay, radar_sites
from scaling.load.motion import courses
from scaling.load.reporting import AZIMUTH_SIGMA_RAD, RANGE_SIGMA_M, Journal, report
from scaling.load.waters import VESSELS_A_METRE, Places, settle

START_S = 1_748_736_000.0  # 2025-06-01T00:00:00Z
BEFORE_S = 60.0  # that the world is older than the first cycle: no report is older than the world
RADAR_RANGE_NM, RADAR_RPM = 24.0, 20.0
STATION_EACH, STATION_RANGE_NM = 2, 40.0  # an AIS receiver at every other radar


@dataclass(frozen=True, eq=False)
class World:
    """What stays as it is."""

    seed: int
    period_s: float
    coasts: Coasts
    places: Places
    posts: Posts
    sonars: listening.Sonars

    def time_s(self, cycle: int) -> float:
        """Of a cycle, since the Unix epoch."""
        return START_S + self.after_s(cycle)

    def after_s(self, cycle: int) -> float:
        return BEFORE_S + self.period_s * (cycle + 1)

    def water_of(self, origin: Ints) -> Ints:
        """The `Water` of true vessels. Args: origin: (n,). Returns: (n,)."""
        return self.places.water[origin % len(self.places)].astype(np.int64)


@dataclass(frozen=True, eq=False)
class State:
    """What changes from cycle to cycle: plain data."""

    cycle: int  # the next one
    journal: Journal
    bearings: Any  # memory of the bearing tracker of the sonars


def lay_world(tracks: int, seed: int, period_s: float = 3.0) -> World:
    """The world of about so many tracks: its coast grows with it, so that its waters are as crowded at any size."""
    count = places_for(tracks)
    coasts = lay(count / VESSELS_A_METRE)
    places = settle(coasts, count, seed)
    sonars = listening.lay_out(places, coasts, tracks, BEFORE_S, period_s, seed)
    return World(seed, period_s, coasts, places, appoint(places, coasts, seed), sonars)


def first(world: World) -> State:
    """The state before the first cycle."""
    return State(0, Journal.blank(len(world.posts)), BearingWindow().init())


def receive(world: World, state: State, sensors: Sensors) -> tuple[State, Received]:
    """The state after a cycle, and what the high-level centre receives in it."""
    after_s = world.after_s(state.cycle)
    of_tracks, of_bearings = (np.random.Generator(np.random.SFC64([world.seed, stream, state.cycle])) for stream in (1, 2))
    journal, tracks = report(world.places, world.posts, world.coasts, state.journal, after_s, START_S, of_tracks)
    heard = listening.listen(world.sonars, world.places, world.coasts, after_s, START_S, of_bearings)
    bearings, bearing_tracks = BearingWindow().step(state.bearings, heard, START_S + after_s, sensors)
    received = Received(tracks, Measurements.empty(), _no_alarms(tracks), bearing_tracks, AisStatics.empty())
    return State(state.cycle + 1, journal, bearings), received


def truth(world: World, origin: Ints, time_s: Floats) -> Truth:
    """What is true of vessels at times of their own. Args: origin: (V,); time_s: (V,) since the Unix epoch."""
    rows = origin % len(world.places)
    true = courses(world.places, world.coasts, rows, time_s - START_S)
    place = true.along_m, true.off_m, true.along_m_s, true.off_m_s
    position, velocity = geodetic(world.coasts, world.places.coast[rows], *place)
    return Truth(true.vessel * len(world.places) + rows, time_s, position, velocity)


def _no_alarms(tracks: Tracks) -> AisAlarms:
    """Nothing odd about any AIS track."""
    ais = np.flatnonzero(tracks.mmsi >= 0)
    none: Bools = np.zeros(len(ais), np.bool_)
    return AisAlarms(tracks.track_id[ais], tracks.mmsi[ais], none, none)


def scenario_of(world: World, overrides: Mapping[str, str]) -> Scenario:
    """The scenario of the high-level centre: the sensors of the world, tracks fused as tracks, everything else as by default."""
    sites = radar_sites(world.coasts)
    radars = [
        {
            "name": f"radar-{k}",
            "region": f"region-{k // world.coasts.radars}",
            **_placed(site, RADAR_RANGE_NM),
            "rpm": RADAR_RPM,
            "range_noise_m": RANGE_SIGMA_M,
            "azimuth_noise_deg": float(np.degrees(AZIMUTH_SIGMA_RAD)),
        }
        for k, site in enumerate(sites)
    ]
    stations = [{"name": f"ais-{k}", **_placed(site, STATION_RANGE_NM)} for k, site in enumerate(sites[::STATION_EACH])]
    reach_nm = world.sonars.range_m / NAUTICAL_MILE_M
    sonars = [
        {"name": f"sonar-{k}", **_placed(site, float(reach_nm[k])), "interval_s": world.period_s}
        for k, site in enumerate(world.sonars.site_deg)
    ]
    middle = _placed(sites[len(sites) // 2], 0.0)
    document = {
        "name": "national",
        "title": f"National picture of {len(world.places)} places",
        "start_utc": utc_text(START_S),
        "period_s": world.period_s,
        "seed": world.seed,
        "area": {key: middle[key] for key in ("latitude_deg", "longitude_deg")},
        "radars": radars,
        "stations": stations,
        "sonars": sonars,
        "input": {"method": "simulated", "count": 0, "area_latitude_deg": 0.0, "area_longitude_deg": 0.0},
        "fused_tracks": {"method": "convex"},
    }
    return make_scenario(document, "national", overrides)


def _placed(site_deg: Any, range_nm: float) -> dict[str, float]:
    return {"latitude_deg": float(site_deg[0]), "longitude_deg": float(site_deg[1]), "range_nm": range_nm}
