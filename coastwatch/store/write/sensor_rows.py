"""The sensors and sources of a run as rows, written once when it begins."""

from __future__ import annotations

from typing import Any

import numpy as np

from coastwatch.batches import Radars, Sensors, Sonars, SourceKind, Stations, TrackSources


def sensor_rows(run_id: int, sensors: Sensors) -> list[dict[str, Any]]:
    """One row a radar, AIS receiver and sonar. `number` is the index that its reports carry."""
    return [
        {"run_id": run_id, "kind": kind, "number": k, **row}
        for kind, rows in (
            ("radar", _radars(sensors.radars, sensors.region_names)),
            ("ais", [_common(sensors.stations, k) for k in range(len(sensors.stations))]),
            ("bearing", _sonars(sensors.sonars)),
        )
        for k, row in enumerate(rows)
    ]


def track_source_rows(run_id: int, sources: TrackSources) -> list[dict[str, Any]]:
    """One row a track source. `number` is the index that its reports carry."""
    sites = [[value if np.isfinite(value) else None for value in site] for site in sources.site_deg.tolist()]
    return [
        {"run_id": run_id, "number": k, "name": str(name), "latitude_deg": latitude, "longitude_deg": longitude}
        for k, (name, (latitude, longitude)) in enumerate(zip(sources.name, sites, strict=True))
    ]


def source_rows(run_id: int, sensors: Sensors) -> list[dict[str, Any]]:
    """One row for each source of tracks. `number` is the source that tracks carry."""
    kinds = [SourceKind(kind).name.lower() for kind in sensors.source_kinds.tolist()]
    named = enumerate(zip(sensors.source_names, kinds, strict=True))
    return [{"run_id": run_id, "number": k, "name": name, "kind": kind} for k, (name, kind) in named]


def _common(of: Radars | Stations | Sonars, k: int) -> dict[str, Any]:
    return {
        "name": str(of.name[k]),
        "latitude_deg": float(of.site_deg[k, 0]),
        "longitude_deg": float(of.site_deg[k, 1]),
        "range_m": float(of.range_m[k]),
        "region": None,
        "spec": {},
    }


def _radars(radars: Radars, regions: tuple[str, ...]) -> list[dict[str, Any]]:
    return [
        {
            **_common(radars, k),
            "region": regions[radars.region[k]],
            "spec": {
                "period_s": float(radars.period_s[k]),
                "range_sigma_m": float(radars.range_sigma_m[k]),
                "azimuth_sigma_deg": float(np.degrees(radars.azimuth_sigma_rad[k])),
            },
        }
        for k in range(len(radars))
    ]


def _sonars(sonars: Sonars) -> list[dict[str, Any]]:
    return [
        {
            **_common(sonars, k),
            "spec": {
                "bearing_sigma_deg": float(np.degrees(sonars.bearing_sigma_rad[k])),
                "interval_s": float(sonars.interval_s[k]),
                "arc_from_deg": float(sonars.arc_from_deg[k]),
                "arc_to_deg": float(sonars.arc_to_deg[k]),
            },
        }
        for k in range(len(sonars))
    ]
