"""The Autoferry recordings: radar, lidar, infrared and visible cameras on a moving boat, two boats with GNSS truth."""

from __future__ import annotations

import gzip
import json
import math
import zlib
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from coastwatch.batches import (
    Array,
    BearingReports,
    Fault,
    FileContent,
    Floats,
    Ints,
    RadarReports,
    Recording,
    Reports,
    Sensors,
    Trajectories,
)
from coastwatch.errors import InputError
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.geodesy import from_plane
from coastwatch.sensors.recorded.files import Fingerprint, data_folder, fingerprint, opened
from coastwatch.sensors.recorded.merging import span_of
from coastwatch.stage import Count, Method, Plan

PIREN_DEG = np.array([63.4389029083, 10.39908278])
LIDAR, RADAR, INFRARED, VISIBLE = 1, 2, 3, 4
VELOCITY_OVER_S = (
    0.5  # true velocity is the mean over this time to each side: the fixes come at 10 Hz with noise of centimetres
)

MALFORMED = "not a detection"
NON_FINITE = "non-finite"
NOT_USED = "returns of sensors that are not used"
NO_SENSOR = SET_ASIDE + "no sensor for it in the scenario"

Seconds = Annotated[float, Field(ge=0.0, le=10.0)]


class Autoferry(Method):
    """One Autoferry scenario.

    The first radar is the radar, the second, with `use_lidar`, the lidar; the first sonar is the infrared, the second
    the visible camera.
    """

    method: Literal["autoferry"] = "autoferry"
    scenario: Count  # number of the scenario: 2, 3, 6, 13 or 17
    root: Path | None = None  # the folder of the dataset; none: shared/data/autoferry next to the checkout
    radar_time_lag_s: Seconds = 0.0  # delay of the time stamps of the radar
    lidar_time_lag_s: Seconds = 0.0  # delay of the time stamps of the lidar
    use_lidar: bool = False  # the lidar as second radar
    use_cameras: bool = True  # the infrared and the visible camera as first and second sonar

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The recording, in order of arrival, with the truth at the instants of the plan.

        Raises: FileNotFoundError that names the folder; InputError for a file that is not JSON.
        """
        frames, truth, faults = self._recorded()
        tally = Tally()
        radar, bearing = _radar_reports(frames, self, sensors, tally), _bearing_reports(frames, self, sensors, tally)
        faults += tally.faults()
        off = ((LIDAR,) if not self.use_lidar else ()) + ((INFRARED, VISIBLE) if not self.use_cameras else ())
        span = (float(frames.time_s.min()), float(frames.time_s.max())) if len(frames.time_s) else (math.nan, math.nan)
        beside = ((NOT_USED, int(np.isin(frames.sensor, off).sum())),)
        used = len(radar) + len(bearing)
        content = FileContent(frames.name, "returns and bearings", used, *span, read=frames.read, beside=beside)
        reports, true = Reports(radar=radar, bearing=bearing), _trajectories(truth, plan.instants_s)
        return Recording(reports, true, faults, contents=(content,))

    def span(self, sensors: Callable[[], Sensors], after_s: float, to_the_end: bool) -> tuple[float, float]:
        """Whole seconds before the first and after the last arrival."""
        frames, _, faults = self._recorded()
        return span_of(frames.received_s, faults=faults)

    def _recorded(self) -> tuple[_Returns, tuple[_Fixes, ...], tuple[Fault, ...]]:
        folder = data_folder(self.root, "autoferry") / f"scenario{self.scenario}"
        names = tuple(folder / f"scenario{self.scenario}_{part}.json.gz" for part in ("detections", "groundTruth"))
        return _read_files(fingerprint(names))


class _Returns(NamedTuple):
    """Single returns of all sensors, in order of arrival. North and east of a camera are a unit vector."""

    sensor: Ints
    time_s: Floats
    received_s: Floats
    own_ne_m: Floats
    ne_m: Floats
    name: str  # of the file
    read: int  # returns, and frames that hold none


class _Fixes(NamedTuple):
    """The true path of one boat."""

    target: int
    time_s: Floats
    ne_m: Floats


@lru_cache(maxsize=1)
def _read_files(files: Fingerprint) -> tuple[_Returns, tuple[_Fixes, ...], tuple[Fault, ...]]:
    tally = Tally()
    detections, truth = (_objects(path) for path, _, _ in files)
    name = files[0][0].name
    return _returns(detections, name, tally), _fixes(truth), tally.faults()


def _objects(path: Path) -> list[Any]:
    try:
        with opened(path) as file:
            objects = json.load(file)
    except (ValueError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(f"{path}: got {error}, needed JSON, compressed or not") from error
    if not isinstance(objects, list):
        raise InputError(f"{path}: got {type(objects).__name__}, needed a list")
    return objects


def _returns(detections: list[Any], name: str, tally: Tally) -> _Returns:
    sensors: list[int] = []
    times: list[float] = []
    own: list[Floats] = []
    frames: list[Floats] = []
    refused = 0
    for i, item in enumerate(detections):
        try:
            sensor, time_s, own_ne = int(item["sensorID"]), float(item["time"]), np.array(item["ownshipPosition"], float)
            ne = _measured(sensor, item["measurement"])
            if own_ne.shape != (2,):
                raise ValueError("ownshipPosition")
        except (KeyError, TypeError, ValueError):
            tally.add(MALFORMED, f"{name}, item {i}", str(item))
            refused += 1
            continue
        if not (np.isfinite(time_s) and np.isfinite(own_ne).all() and np.isfinite(ne).all()):
            tally.add(NON_FINITE, f"{name}, item {i}", str(item))
            refused += 1
            continue
        sensors.append(sensor)
        times.append(time_s)
        own.append(own_ne)
        frames.append(ne)
    stamp = np.array(times, np.float64)
    # A record arrives at the newest stamp so far: by grid time g came what stands before the first stamp later than g.
    received = np.maximum.accumulate(stamp)
    frame = np.repeat(np.arange(len(frames)), [len(f) for f in frames])
    return _Returns(
        sensor=np.array(sensors, np.int64)[frame],
        time_s=stamp[frame],
        received_s=received[frame],
        own_ne_m=np.array(own, np.float64).reshape(-1, 2)[frame],
        ne_m=np.concatenate([np.zeros((0, 2)), *frames]),
        name=name,
        read=refused + sum(map(len, frames)),
    )


def _measured(sensor: int, measurement: Any) -> Floats:
    """The returns of one frame as rows north, east, whatever shape they are written in. (M, 2)"""
    values = np.array(measurement, np.float64)
    if sensor in (INFRARED, VISIBLE):
        angle = values.reshape(-1)
        return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    if sensor not in (LIDAR, RADAR):
        raise ValueError("sensorID")
    return values.reshape(2, -1).T if values.size else np.zeros((0, 2))


def _fixes(truth: list[Any]) -> tuple[_Fixes, ...]:
    """The fixes of each boat, each once, in order of time. Their pairing with detections is not used."""
    by_target: dict[int, dict[float, tuple[float, float]]] = {}
    for item in truth:
        for fix in item if isinstance(item, list) else [item]:
            north, east = fix["position"][:2]
            by_target.setdefault(int(fix["targetID"]), {})[float(fix["time"])] = (float(north), float(east))
    fixes_of_target = []
    for target, fixes in sorted(by_target.items()):
        times = sorted(fixes)
        fixes_of_target.append(_Fixes(target, np.array(times), np.array([fixes[t] for t in times])))
    return tuple(fixes_of_target)


def _radar_reports(returns: _Returns, settings: Autoferry, sensors: Sensors, tally: Tally) -> RadarReports:
    wanted = [(RADAR, settings.radar_time_lag_s), (LIDAR, settings.lidar_time_lag_s)][: 2 if settings.use_lidar else 1]
    rows, number, azimuth_deg = _of_sensors(returns, [kind for kind, _ in wanted], len(sensors.radars), tally)
    lag_s = np.array([lag_s for _, lag_s in wanted])[number]
    return RadarReports(
        sensor=number,
        time_s=returns.time_s[rows] - lag_s,
        received_s=returns.received_s[rows],
        range_m=np.hypot(*returns.ne_m[rows].T),
        azimuth_deg=azimuth_deg,
        site_deg=_geodetic(returns.own_ne_m[rows]),
    )


def _bearing_reports(returns: _Returns, settings: Autoferry, sensors: Sensors, tally: Tally) -> BearingReports:
    cameras = (INFRARED, VISIBLE) if settings.use_cameras else ()
    rows, number, bearing_deg = _of_sensors(returns, cameras, len(sensors.sonars), tally)
    return BearingReports(
        sensor=number,
        time_s=returns.time_s[rows],
        received_s=returns.received_s[rows],
        bearing_deg=bearing_deg,
        contact=np.full(len(rows), -1, np.int64),
        site_deg=_geodetic(returns.own_ne_m[rows]),
    )


def _of_sensors(returns: _Returns, kinds: Sequence[int], sensors: int, tally: Tally) -> tuple[Ints, Ints, Floats]:
    """The rows of these kinds, the number of the sensor of each, and the direction, deg. Kinds without a sensor are counted."""
    number = np.full(len(returns.sensor), -1, np.int64)
    for i, kind in enumerate(kinds):
        mine = returns.sensor == kind
        if i < sensors:
            number[mine] = i
        else:
            tally.add_rows(NO_SENSOR, mine, lambda _: "detections", lambda _, k=kind: f"sensorID {k}")  # type: ignore[misc]
    rows = np.flatnonzero(number >= 0)
    north, east = returns.ne_m[rows].T
    return rows, number[rows], np.degrees(np.arctan2(east, north)) % 360.0


def _geodetic(ne_m: Array) -> Floats:
    return from_plane(ne_m[..., ::-1], PIREN_DEG)


def _trajectories(truth: tuple[_Fixes, ...], instants: Floats) -> Trajectories:
    position = np.zeros((len(truth), len(instants), 2))
    velocity = np.zeros_like(position)
    present = np.zeros((len(truth), len(instants)), np.bool_)
    for v, fixes in enumerate(truth):
        ahead, behind = (np.clip(instants + d, fixes.time_s[0], fixes.time_s[-1]) for d in (VELOCITY_OVER_S, -VELOCITY_OVER_S))
        present[v] = (instants >= fixes.time_s[0]) & (instants <= fixes.time_s[-1])
        position[v] = _geodetic(_interpolated(instants, fixes))
        step = _interpolated(ahead, fixes) - _interpolated(behind, fixes)
        velocity[v] = step[:, ::-1] / np.maximum(ahead - behind, 1e-3)[:, None]
    return Trajectories.without_model(np.array([f.target for f in truth], np.int64), instants, position, velocity, present)


def _interpolated(time_s: Floats, fixes: _Fixes) -> Floats:
    return np.stack([np.interp(time_s, fixes.time_s, fixes.ne_m[:, k]) for k in (0, 1)], axis=-1)
