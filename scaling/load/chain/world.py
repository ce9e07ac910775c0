"""The constant part of a coast of radar regions: its scenario, and the true motion and transponders of its vessels.

A region is a square of `density` vessels, with its radars near the middle and one sonar in the middle. One region of 1,000 vessels has
the geometry of the scenario `context-driven-1000`; a larger one has longer ranges. Regions lie in rows from south to north, so
that the radars of a region also see the near parts of its neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from pydantic import BaseModel

from coastwatch.batches import AisStatics, Bools, Floats, Ints, Sensors
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, offset_deg, to_plane, within_any
from coastwatch.scenario import Scenario, ScenarioError
from coastwatch.scenario.reading import make_scenario
from coastwatch.sensors.simulated.ais import Transponders, transmit_static_data, transponders
from coastwatch.sensors.simulated.simulation import Simulated
from coastwatch.sensors.simulated.trajectories import PiecewiseMotion, draw_motion
from coastwatch.stage import Plan

START = datetime(2025, 6, 1, 12, tzinfo=UTC)
SIDE_NM, RANGE_NM, STATION_NM = 10.0, 6.0, 20.0  # of a region of 1,000 vessels; they grow with the root of the vessels
SITES_NM = (
    (-5.82, 2.5),
    (-5.82, -2.5),
    (2.0, 0.0),
)  # of each radar, east and north of the middle; nearer in smaller regions
RPM = 15.0, 20.0, 24.0
SONAR_RANGE_NM = 3.99  # at any size: about 500 vessels
SOUTH_DEG, WEST_DEG = -23.05, -43.10  # middle of the first region
ROW_DEG, NEXT_ROW_DEG = 60.0, 24.0  # latitude of a row of regions, at most; longitude from one row to the next
DETECTION_PROBABILITY, CLUTTER_PER_M2 = 0.9, 5e-7
INPUT = {
    "radar.detection_probability": DETECTION_PROBABILITY,
    "ais.intervals": "itu",
    "ais.class_b_share": 0.3,
    "ais.latency_s": 1.0,
    "ais.latency_spread_s": 1.0,
}
"""Settings of the input that differ from those of `simulated`; `Size.clutter_per_m2` comes to them."""
OBEYED = {
    "input": {"motion", "radar", "radars", "ais", "sonar", "sonars"},
    "input.radar": {
        *("name", "detection_probability", "clutter_per_m2", "noise_factor"),
        *("range_bias_m", "azimuth_bias_deg", "time_bias_s", "latency_s"),
    },
    "input.ais": {
        *("share", "class_b_share", "intervals", "interval_s", "position_sigma_m", "velocity_sigma_kn", "wire_steps"),
        *("whole_seconds", "loss", "latency_s", "latency_spread_s", "static_interval_s", "static_within_s"),
        *("type_missing_share", "type_wrong_share"),
    },
    "input.sonar": {"name", "miss_probability", "noise_factor", "bias_deg", "latency_s"},
}
"""Settings of the input that the coast obeys. The others must have their default."""
POSITIONS = 51  # stream of random numbers


@dataclass(frozen=True)
class Size:
    """How large a coast is."""

    vessels: int
    cycles: int  # in all
    region_vessels: int = 16_000  # at most
    radars: int = 2  # of a region, 2 or 3
    clutter_per_m2: float = CLUTTER_PER_M2  # false plots a turn of each radar
    apart: bool = False  # regions that do not see each other's vessels

    @property
    def regions(self) -> int:
        """Number of regions, of as many vessels each as possible."""
        return max(1, -(-self.vessels // self.region_vessels))


@dataclass(frozen=True, eq=False)
class World:
    """What does not change from cycle to cycle: V vessels, C transponders."""

    seed: int
    scenario: Scenario
    input: Simulated  # of the scenario
    sensors: Sensors
    plan: Plan
    vessels: PiecewiseMotion
    senders: Transponders
    heard: Ints  # (C,) 1 if in range of an AIS station
    statics: AisStatics  # of the whole run
    seen: tuple[Ints, ...]  # rows of the vessels that each radar may see
    audible: tuple[Ints, ...]  # of the vessels that each sonar may hear

    @property
    def count(self) -> int:
        """Number of vessels."""
        return len(self.vessels.anchor_deg)


def build_world(size: Size, settings: Mapping[str, str], seed: int) -> World:
    """The world of a run.

    Args: settings: of the scenario, as in `--set`, over those of the coast. Raises: ScenarioError that names the setting.
    """
    middles, side_m = _regions(size)
    scenario = make_scenario(scenario_document(size, seed), "chain", settings)
    if not isinstance(scenario.input, Simulated):
        raise ScenarioError(f"input.method: got {scenario.input.method!r}, needed simulated")
    _refuse_what_is_not_obeyed(scenario.input)
    feed, sensors, plan = scenario.input, scenario.sensors(), scenario.plan()
    start_s, stop_s = plan.start_s, plan.instant_s(plan.cycles - 1)
    anchor_deg = _positions(size, middles, side_m, seed)
    vessels = draw_motion(feed.motion, anchor_deg, start_s, stop_s - start_s, seed)
    senders = transponders(feed.ais, size.vessels, seed)
    stations = sensors.stations.site_deg, sensors.stations.range_m
    margin_m = 2.0 * feed.motion.speed_to_kn * KNOT_M_S * (stop_s - start_s) + 200.0
    statics = transmit_static_data(feed.ais, senders, senders.mmsi, start_s, stop_s, seed)
    return World(
        seed,
        scenario,
        feed,
        sensors,
        plan,
        vessels,
        senders,
        within_any(anchor_deg[senders.row], *stations).astype(np.int64),
        statics,
        tuple(_near(anchor_deg, *one, margin_m) for one in zip(sensors.radars.site_deg, sensors.radars.range_m, strict=True)),
        tuple(_near(anchor_deg, *one, margin_m) for one in zip(sensors.sonars.site_deg, sensors.sonars.range_m, strict=True)),
    )


def conditions(size: Size, settings: Mapping[str, str]) -> str:
    """One line that names the input and the settings that differ from a scenario's defaults, to be printed with every figure."""
    coast = (
        f"{size.regions} regions{' apart' if size.apart else ''} of {size.radars} radars, clutter {size.clutter_per_m2:g} a m2"
    )
    every = " ".join(f"input.{key}={value}" for key, value in INPUT.items())
    more = "".join(f" {key}={value}" for key, value in settings.items())
    return f"coast from plots: {coast}; non-default settings: {every}{more}"


def _regions(size: Size) -> tuple[Floats, float]:
    """Middles of the regions (R, 2), degrees, and the side of a region, metres."""
    scale = float(np.sqrt(size.vessels / size.regions / 1000.0))
    side_m = scale * SIDE_NM * NAUTICAL_MILE_M
    pitch_m = side_m + (2.0 * (RANGE_NM * scale + SITES_NM[0][1]) * NAUTICAL_MILE_M if size.apart else 0.0)
    pitch_deg = pitch_m / NAUTICAL_MILE_M / 60.0
    column, row = np.divmod(np.arange(size.regions), max(1, int(ROW_DEG / pitch_deg)))
    return np.stack([SOUTH_DEG + row * pitch_deg, WEST_DEG + column * NEXT_ROW_DEG], axis=-1), side_m


def _positions(size: Size, middles: Floats, side_m: float, seed: int) -> Floats:
    """Positions of the vessels at the start, region by region. (V, 2)"""
    parts = []
    for k, rows in enumerate(np.array_split(np.arange(size.vessels), len(middles))):
        draws = np.random.default_rng([seed, POSITIONS, k]).uniform(-0.5, 0.5, (len(rows), 2))
        parts.append(offset_deg(middles[k], side_m * draws))
    return np.concatenate(parts)


def _near(anchor_deg: Floats, site_deg: Floats, range_m: float, margin_m: float) -> Ints:
    """Rows of the vessels that may come into a range during the run."""
    reach_m = range_m + margin_m
    rows = np.flatnonzero(np.abs(anchor_deg[:, 0] - site_deg[0]) * 110_000.0 <= 1.02 * reach_m)
    in_reach: Bools = np.linalg.norm(to_plane(anchor_deg[rows], site_deg), axis=1) <= reach_m
    return rows[in_reach]


def scenario_document(size: Size, seed: int) -> dict[str, Any]:
    """The scenario of a coast as a document, before overrides."""
    middles, side_m = _regions(size)
    side_nm = side_m / NAUTICAL_MILE_M
    scale = side_nm / SIDE_NM
    feed: dict[str, Any] = {
        "method": "simulated",
        "count": 0,  # the coast places its vessels itself
        "area_latitude_deg": SOUTH_DEG,
        "area_longitude_deg": WEST_DEG,
        "radar": {"clutter_per_m2": size.clutter_per_m2},
    }
    for key, value in INPUT.items():
        table, _, name = key.partition(".")
        feed.setdefault(table, {})[name] = value
    radars, stations, sonars = [], [], []
    for k, middle in enumerate(middles):
        for j in range(size.radars):
            site = offset_deg(middle, min(scale, 1.0) * np.array(SITES_NM[j]) * NAUTICAL_MILE_M)
            radars.append({"name": f"radar-{k}-{j}", "region": f"region-{k}", **_site(site, RANGE_NM * scale), "rpm": RPM[j]})
        stations.append({"name": f"ais-{k}", **_site(middle, STATION_NM * scale)})
        sonars.append({"name": f"sonar-{k}", **_site(middle, SONAR_RANGE_NM)})
    return {
        "name": "chain",
        "title": f"{size.vessels} vessels in {len(middles)} radar regions of a coast",
        "start_utc": START.isoformat(),
        "seed": seed,
        "cycles": size.cycles,
        "warmup_s": 0.0,
        "area": {"latitude_deg": SOUTH_DEG, "longitude_deg": WEST_DEG, "width_nm": side_nm, "height_nm": side_nm},
        "radars": radars,
        "stations": stations,
        "sonars": sonars,
        "input": feed,
    }


def _site(site_deg: Floats, range_nm: float) -> dict[str, float]:
    return {"latitude_deg": float(site_deg[0]), "longitude_deg": float(site_deg[1]), "range_nm": range_nm}


def _refuse_what_is_not_obeyed(feed: Simulated) -> None:
    """Raises: ScenarioError: a setting that the coast does not obey is not at its default."""
    tables: list[tuple[str, BaseModel]] = [("input", feed), ("input.radar", feed.radar), ("input.ais", feed.ais)]
    tables += [("input.radar", one) for one in feed.radars]
    tables += [("input.sonar", one) for one in (feed.sonar, *feed.sonars)]
    ours = {"method", "count", "area_latitude_deg", "area_longitude_deg"}
    for path, table in tables:
        for name, field in type(table).model_fields.items():
            got = getattr(table, name)
            if name in ours and path == "input":
                continue
            if name not in OBEYED[path] and got != field.default:
                raise ScenarioError(
                    f"{path}.{name}: got {got!r}, needed its default {field.default!r}: this load does not obey it"
                )
    if feed.count:
        raise ScenarioError(f"input.count: got {feed.count}, needed --vessels")
