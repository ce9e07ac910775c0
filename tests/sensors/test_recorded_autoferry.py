"""The Autoferry JSON: ragged shapes, order of arrival, frames and truth, on a small file and on the five recordings."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from spans import span_of

from coastwatch.batches import Radars, Sensors, Sonars, Stations
from coastwatch.errors import InputError
from coastwatch.geodesy import to_plane
from coastwatch.sensors.recorded.datasets.autoferry import PIREN_DEG, Autoferry
from coastwatch.stage import Plan

pytestmark = pytest.mark.golden

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "autoferry"
SCENARIOS = (2, 3, 6, 13, 17)
T0 = 1_620_204_790.0
METRES = 1e-3  # to degrees and back
PLAN = Plan(start_s=T0, period_s=1.0, cycles=3)


def sensors(radars: int = 1, sonars: int = 2) -> Sensors:
    def many(n: int, *values: float) -> list[Any]:
        return [np.full(n, v) for v in values]

    r = Radars(
        np.array(["radar", "lidar"][:radars], "U32"),
        np.zeros(radars, np.int64),
        np.tile(PIREN_DEG, (radars, 1)),
        *many(radars, 5e2, 1.7, 3.0, 0.01),
    )
    s = Sonars(
        np.array(["ir", "eo"][:sonars], "U32"), np.tile(PIREN_DEG, (sonars, 1)), *many(sonars, 5e2, 0.03, 0.1, 0.0, 360.0)
    )
    return Sensors(r, Stations.empty(), s, ("harbour",), PIREN_DEG[None])


def frame(sensor: int, t: float, measurement: Any, own: Any = (10.0, 20.0)) -> dict[str, Any]:
    return {"sensorID": sensor, "time": T0 + t, "ownshipPosition": list(own), "measurement": measurement, "measurements": []}


def folder(path: Path, frames: list[Any], truth: list[Any] | None = None) -> Path:
    here = path / "scenario1"
    here.mkdir()
    fixes = truth or [[{"targetID": k, "time": T0 + i, "position": [i * k, -i, 0]} for k in (1, 2)] for i in range(5)]
    for name, content in (("detections", frames), ("groundTruth", fixes)):
        (here / f"scenario1_{name}.json.gz").write_bytes(gzip.compress(json.dumps(content).encode()))
    return path


def ne_m(range_m: Any, bearing_deg: Any, site_deg: Any) -> Any:
    """North and east of what was seen, in the plane of the dataset."""
    angle = np.radians(bearing_deg)
    return to_plane(site_deg, PIREN_DEG)[:, ::-1] + range_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def test_ragged_shapes_sensors_and_frames(tmp_path: Path) -> None:
    frames = [
        frame(2, 0.0, [[100.0, -50.0], [0.0, 50.0]]),
        frame(2, 1.0, [30.0, -40.0]),
        frame(2, 2.0, []),
        frame(3, 2.1, -1.0),
        frame(4, 2.2, [0.5, 3.0]),
        frame(4, 2.3, []),
        frame(1, 2.4, [5.0, 12.0]),
    ]
    feed = Autoferry(scenario=1, root=folder(tmp_path, frames), use_lidar=True, radar_time_lag_s=1.5)
    recording = feed.load(sensors(2), 1, PLAN)
    radar, bearing = recording.reports.radar, recording.reports.bearing
    assert radar.sensor.tolist() == [0, 0, 0, 1]
    assert (radar.time_s - T0).round(6).tolist() == [-1.5, -1.5, -0.5, 2.4]
    assert (radar.received_s - T0).round(6).tolist() == [0.0, 0.0, 1.0, 2.4]
    seen = ne_m(radar.range_m, radar.azimuth_deg, radar.site_deg)
    np.testing.assert_allclose(seen, [[110.0, 20.0], [-40.0, 70.0], [40.0, -20.0], [15.0, 32.0]], atol=METRES)
    assert bearing.sensor.tolist() == [0, 1, 1]
    np.testing.assert_allclose(bearing.bearing_deg, np.degrees([-1.0, 0.5, 3.0]) % 360.0)
    assert (bearing.contact == -1).all()
    assert not recording.faults


def test_bad_frames_are_counted_and_stop_nothing(tmp_path: Path) -> None:
    frames = [
        frame(2, 0.0, [1.0, 2.0]),
        {"sensorID": 2},
        frame(7, 0.5, [1.0, 2.0]),
        frame(2, 1.0, [1.0, 2.0, 3.0]),
        frame(2, 1.0, [float("nan"), 2.0]),
        5,
    ]
    recording = Autoferry(scenario=1, root=folder(tmp_path, frames)).load(sensors(1, 0), 1, PLAN)
    assert len(recording.reports.radar) == 1
    assert {f.kind: (f.count, f.where) for f in recording.faults} == {
        "not a detection": (4, "scenario1_detections.json.gz, item 1"),
        "non-finite": (1, "scenario1_detections.json.gz, item 4"),
    }


def test_truth_is_interpolated_inside_its_span_only(tmp_path: Path) -> None:
    feed = Autoferry(scenario=1, root=folder(tmp_path, [frame(2, 0.0, [1.0, 2.0])]))
    truth = feed.load(sensors(), 1, Plan(start_s=T0 - 0.5, period_s=1.5, cycles=4)).truth
    assert truth is not None
    assert truth.vessel.tolist() == [1, 2]
    assert truth.present.tolist() == [[False, True, True, True, False]] * 2
    np.testing.assert_allclose(
        to_plane(truth.position_deg[1, 1:4], PIREN_DEG), [[-1.0, 2.0], [-2.5, 5.0], [-4.0, 8.0]], atol=METRES
    )
    np.testing.assert_allclose(truth.velocity_m_s[1, 1:4], [[-1.0, 2.0]] * 3, atol=METRES)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere"):
        span_of(Autoferry(scenario=2, root=tmp_path / "nowhere"))
    with pytest.raises(FileNotFoundError, match="scenario99"):
        span_of(Autoferry(scenario=99, root=tmp_path))


def test_a_file_that_is_no_json_is_named(tmp_path: Path) -> None:
    root = folder(tmp_path, [])
    (root / "scenario1" / "scenario1_detections.json.gz").write_bytes(b"{half a li")
    with pytest.raises(InputError, match=r"scenario1_detections\.json\.gz"):
        span_of(Autoferry(scenario=1, root=root))


@pytest.mark.parametrize("number", SCENARIOS)
def test_recordings_are_causal_and_near_the_truth(number: int) -> None:
    if not DATA.is_dir():
        pytest.skip(f"{DATA} is not on this machine")
    items = json.loads(gzip.decompress((DATA / f"scenario{number}" / f"scenario{number}_detections.json.gz").read_bytes()))
    feed = Autoferry(scenario=number, radar_time_lag_s=1.5)
    start_s, stop_s = span_of(feed)
    recording = feed.load(sensors(), 1, Plan(start_s=start_s, period_s=1.0, cycles=round(stop_s - start_s)))
    radar, truth = recording.reports.radar, recording.truth
    assert truth is not None
    assert not recording.faults
    stamps = [item["time"] for item in items]
    counts = [np.size(item["measurement"]) // 2 if item["sensorID"] == 2 else 0 for item in items]
    for g in np.arange(start_s, stop_s, 7.0):
        first_later = next((i for i, t in enumerate(stamps) if t > g), len(stamps))
        assert np.searchsorted(radar.received_s, g, side="right") == sum(counts[:first_later])
    assert len(radar) == sum(counts)
    # With the lag taken off, the nearest plot of a scan is the boat; beyond 200 m it is missing from four scans in ten.
    seen = ne_m(radar.range_m, radar.azimuth_deg, radar.site_deg)
    near = []
    for k in np.flatnonzero(truth.present[0]):
        at = to_plane(truth.position_deg[0, k], PIREN_DEG)[::-1]
        now = np.abs(radar.time_s - truth.time_s[k]) < 0.5
        if now.any():
            near.append(np.hypot(*(seen[now] - at).T).min())
    assert np.median(near) < 12.0
