"""The world of a national picture, its input cycle by cycle, its truth, and the scenario of the centre that receives it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from coastwatch.batches import AisAlarms, AisStatics, Bools, Floats, Ints, Measurements, Sensors, Tracks, Truth
from coastwatch.centre import Received
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.scenario import Scenario, make_scenario
from coastwatch.tracks import BearingInput, BearingWindow
from scaling.load.national.coasts import Coasts, build_coasts, radar_sites, to_geodetic
from scaling.load.national.sonars import Sonars, bearing_reports, place_sonars
from scaling.load.national.tracks import (
    AZIMUTH_SIGMA_RAD,
    RANGE_SIGMA_M,
    Channels,
    ChannelState,
    draw_channels,
    next_tracks,
    slots_for,
)
from scaling.load.national.traffic import VESSELS_PER_METRE, Slots, draw_slots, true_motion

START_S = 1_748_736_000.0  # 2025-06-01T00:00:00Z
LEAD_S = 60.0  # age of the world at the first cycle: no report is older than the world
RADAR_RANGE_NM, RADAR_RPM = 24.0, 20.0
RADARS_PER_STATION, STATION_RANGE_NM = 2, 40.0  # an AIS receiver at every other radar
INPUT = "finished tracks, no plots"
NON_DEFAULT_SETTINGS = {"fused_tracks.method": "convex"}  # the default method filters plots, and there are none


@dataclass(frozen=True, eq=False)
class World:
    """The constant part of a national picture."""

    seed: int
    period_s: float
    coasts: Coasts
    slots: Slots
    channels: Channels
    sonars: Sonars

    def time_s(self, cycle: int) -> float:
        """Time of a cycle, seconds since the Unix epoch."""
        return START_S + self.elapsed_s(cycle)

    def elapsed_s(self, cycle: int) -> float:
        """Time of a cycle, seconds since the start."""
        return LEAD_S + self.period_s * (cycle + 1)

    def traffic_of(self, origin: Ints) -> Ints:
        """The `Traffic` kind of true vessels. Args: origin: (n,). Returns: (n,)."""
        return self.slots.kind[origin % len(self.slots)].astype(np.int64)


@dataclass(frozen=True, eq=False)
class State:
    """The part that changes from cycle to cycle."""

    cycle: int  # the next one
    channels: ChannelState
    bearings: Any  # memory of the bearing tracker of the sonars


def build_world(tracks: int, seed: int, period_s: float = 3.0) -> World:
    """The world with about this number of tracks; the length of coast grows with it, so the density of traffic is constant."""
    count = slots_for(tracks)
    coasts = build_coasts(count / VESSELS_PER_METRE)
    slots = draw_slots(coasts, count, seed)
    sonars = place_sonars(slots, coasts, tracks, LEAD_S, period_s, seed)
    return World(seed, period_s, coasts, slots, draw_channels(slots, coasts, seed), sonars)


def initial_state(world: World) -> State:
    """The state before the first cycle."""
    return State(0, ChannelState.initial(len(world.channels)), BearingWindow().init())


def next_cycle(world: World, state: State, sensors: Sensors) -> tuple[State, Received]:
    """The state after a cycle, and the input of the high-level centre in it."""
    elapsed_s = world.elapsed_s(state.cycle)
    of_tracks, of_bearings = (np.random.Generator(np.random.SFC64([world.seed, stream, state.cycle])) for stream in (1, 2))
    channels, tracks = next_tracks(world.slots, world.channels, world.coasts, state.channels, elapsed_s, START_S, of_tracks)
    reports = bearing_reports(world.sonars, world.slots, world.coasts, elapsed_s, START_S, of_bearings)
    bearings, bearing_tracks = BearingWindow().step(state.bearings, BearingInput(reports, START_S + elapsed_s, sensors))
    received = Received(tracks, Measurements.empty(), _no_alarms(tracks), bearing_tracks, AisStatics.empty())
    return State(state.cycle + 1, channels, bearings), received


def truth(world: World, origin: Ints, time_s: Floats) -> Truth:
    """True positions and velocities of vessels. Args: origin: (V,); time_s: (V,) of each vessel, since the Unix epoch."""
    rows = origin % len(world.slots)
    true = true_motion(world.slots, world.coasts, rows, time_s - START_S)
    shore = true.along_m, true.offshore_m, true.along_m_s, true.offshore_m_s
    position, velocity = to_geodetic(world.coasts, world.slots.coast[rows], *shore)
    return Truth(true.generation * len(world.slots) + rows, time_s, position, velocity)


def _no_alarms(tracks: Tracks) -> AisAlarms:
    """AIS alarms of these tracks, none of them set."""
    ais = np.flatnonzero(tracks.mmsi >= 0)
    none: Bools = np.zeros(len(ais), np.bool_)
    return AisAlarms(tracks.track_id[ais], tracks.mmsi[ais], none, none)


def conditions(overrides: Mapping[str, str]) -> str:
    """One line that names the input and every non-default setting, to be printed with every figure."""
    settings = " ".join(f"{key}={value}" for key, value in (NON_DEFAULT_SETTINGS | dict(overrides)).items())
    return f"national picture; input: {INPUT}; non-default settings: {settings}"


def scenario_of(world: World, overrides: Mapping[str, str]) -> Scenario:
    """The scenario of the high-level centre: the sensors of the world, `NON_DEFAULT_SETTINGS`, then the overrides."""
    sites = radar_sites(world.coasts)
    radars = [
        {
            "name": f"radar-{k}",
            "region": f"region-{k // world.coasts.radars}",
            **_site(site, RADAR_RANGE_NM),
            "rpm": RADAR_RPM,
            "range_noise_m": RANGE_SIGMA_M,
            "azimuth_noise_deg": float(np.degrees(AZIMUTH_SIGMA_RAD)),
        }
        for k, site in enumerate(sites)
    ]
    stations = [{"name": f"ais-{k}", **_site(site, STATION_RANGE_NM)} for k, site in enumerate(sites[::RADARS_PER_STATION])]
    range_nm = world.sonars.range_m / NAUTICAL_MILE_M
    sonars = [
        {"name": f"sonar-{k}", **_site(site, float(range_nm[k])), "interval_s": world.period_s}
        for k, site in enumerate(world.sonars.site_deg)
    ]
    middle = _site(sites[len(sites) // 2], 0.0)
    document = {
        "name": "national",
        "title": f"National picture of {len(world.slots)} vessel slots",
        "start_utc": datetime.fromtimestamp(START_S, UTC).isoformat(),
        "period_s": world.period_s,
        "seed": world.seed,
        "area": {key: middle[key] for key in ("latitude_deg", "longitude_deg")},
        "radars": radars,
        "stations": stations,
        "sonars": sonars,
        "input": {"method": "simulated", "count": 0, "area_latitude_deg": 0.0, "area_longitude_deg": 0.0},
    }
    return make_scenario(document, "national", NON_DEFAULT_SETTINGS | dict(overrides))


def _site(site_deg: Any, range_nm: float) -> dict[str, float]:
    return {"latitude_deg": float(site_deg[0]), "longitude_deg": float(site_deg[1]), "range_nm": range_nm}
