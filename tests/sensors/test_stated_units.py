"""Tables whose columns do not state a unit: what is not in metres, degrees and knots is doubted, and how it is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from coastwatch.batches import Radars, Sensors, Sonars, Stations, TrackSources
from coastwatch.formats.intake.ais_validation import COG_RANGE, SOG_RANGE
from coastwatch.geodesy import from_plane
from coastwatch.sensors.recorded.tables.feed import Tables
from coastwatch.sensors.recorded.tables.tracks import TOO_FAST
from coastwatch.stage import Plan

pytestmark = pytest.mark.golden

T0 = 1_452_603_731.0
PLAN = Plan(start_s=T0, period_s=3.0, cycles=10)
NM = 1852.0
ROWS = 300
RANGE_M, AZIMUTH_DEG = np.linspace(900.0, 40_000.0, ROWS), np.linspace(0.0, 359.9, ROWS)


def sensors() -> Sensors:
    one, site = np.ones(1), np.array([[50.8, -1.1]])
    radars = Radars(
        np.array(["north"], "U32"), np.zeros(1, np.int64), site, 24.0 * NM * one, 3.0 * one, 10.0 * one, 0.005 * one
    )
    sonars = Sonars(np.array(["df"], "U32"), site, 1e4 * one, 0.02 * one, one, 0.0 * one, 360.0 * one)
    return Sensors(radars, Stations.empty(), sonars, ("region",), site)


def written(path: Path, header: str, *columns: np.ndarray, step_s: float = 0.01) -> Path:
    file = path / "table.csv"
    rows = np.stack([T0 + step_s * np.arange(len(columns[0])), *columns], axis=-1)
    file.write_text("\n".join([f"time,{header}", *(",".join(f"{cell:.12g}" for cell in row) for row in rows)]) + "\n")
    return file


def plots(file: Path, **named: str) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    recording = Tables(plots=(file,), plot_columns=named).load(sensors(), 1, PLAN)
    radar = recording.reports.radar
    return radar.range_m, radar.azimuth_deg, recording.contents[0].doubts


@pytest.mark.parametrize(
    ("unit", "key", "asked"),
    [
        (
            NM,
            "range_nm",
            "no range is above 21.6 m, of a radar of 24 NM: is it in nautical miles or km? --columns plots.range_nm=range",
        ),
        (1000.0, "range_km", "no range is above 40 m, of a radar of 24 NM: is it in km? --columns plots.range_km=range"),
        (1.0, "range_m", None),
    ],
)
def test_ranges_that_no_radar_would_have_are_doubted_and_read_in_their_unit(
    tmp_path: Path, unit: float, key: str, asked: str | None
) -> None:
    file = written(tmp_path, "range,azimuth", RANGE_M / unit, AZIMUTH_DEG)
    doubts = plots(file)[2]
    assert len(doubts) == (asked is not None)
    assert asked is None or doubts[0].startswith(asked)
    for read in (plots(file, **{key: "range"}), plots(written(tmp_path, f"{key},azimuth", RANGE_M / unit, AZIMUTH_DEG))):
        np.testing.assert_allclose(read[0], RANGE_M, rtol=1e-9)
        assert read[2] == ()


def test_short_ranges_are_not_doubted_where_metres_are_stated_or_plots_are_few(tmp_path: Path) -> None:
    assert plots(written(tmp_path, "range_m,azimuth", RANGE_M / NM, AZIMUTH_DEG))[2] == ()
    assert plots(written(tmp_path, "range,azimuth", RANGE_M / NM, AZIMUTH_DEG), range_m="range")[2] == ()
    assert plots(written(tmp_path, "range,azimuth", RANGE_M[:50] / NM, AZIMUTH_DEG[:50]))[2] == ()


def test_azimuths_in_radians_are_doubted_and_read(tmp_path: Path) -> None:
    radians = np.radians(AZIMUTH_DEG)
    file = written(tmp_path, "range_m,azimuth", RANGE_M, radians)
    wanted = "no azimuth in column azimuth is above 6.28 degrees: is it in radians? --columns plots.azimuth_rad=azimuth"
    assert plots(file)[2] == (wanted,)
    for read in (plots(file, azimuth_rad="azimuth"), plots(written(tmp_path, "range_m,azimuth_rad", RANGE_M, radians))):
        np.testing.assert_allclose(read[1], AZIMUTH_DEG, atol=1e-6)
        assert read[2] == ()
    assert plots(written(tmp_path, "range_m,azimuth_deg", RANGE_M, radians))[2] == ()


@pytest.mark.parametrize(
    ("turn", "unit"), [(6400.0, "mils"), (4096.0, "counts of 4096 a turn"), (400.0, "gradians"), (800.0, None)]
)
def test_angles_beyond_a_circle_are_doubted(tmp_path: Path, turn: float, unit: str | None) -> None:
    """The few below 360 are taken: they were taken in silence."""
    angle = AZIMUTH_DEG / 360.0 * turn
    asked = "in which unit are they?" if unit is None else f"are they in {unit}?"
    wanted = f"up to {angle[-1]:.6g}: {asked} needed azimuth in degrees"
    assert wanted in plots(written(tmp_path, "range_m,azimuth", RANGE_M, angle))[2][0]
    (content,) = Tables(bearings=(written(tmp_path, "bearing", angle),)).load(sensors(), 1, PLAN).contents
    assert wanted.replace("azimuth", "bearing") in content.doubts[0]
    none = np.where(np.arange(ROWS) % 3, AZIMUTH_DEG, 511.0)
    assert plots(written(tmp_path, "range_m,azimuth", RANGE_M, none))[2] == ()


@pytest.mark.parametrize("part", ["tracks", "ais"])
def test_courses_in_tenths_of_a_degree_are_doubted_and_counted(tmp_path: Path, part: str) -> None:
    """In tables of tracks they turned the velocity, uncounted; a speed of no vessel was believed there."""
    one, number = np.ones(ROWS), np.arange(ROWS) % 6
    header = "track,lat,lon,sog,cog" if part == "tracks" else "mmsi,lat,lon,sog,cog"
    file = written(
        tmp_path,
        header,
        number + 235_000_000,
        50.8 + 1e-3 * np.arange(ROWS),
        -1.1 * one,
        np.where(number, 5.0, 230.0),
        10.0 * AZIMUTH_DEG,
    )
    source = TrackSources(np.array(["t"], "U32"), np.full((1, 2), np.nan), *np.full((4, 1), np.nan))
    recording = Tables(**{part: (file,)}).load(replace(sensors(), track_sources=source), 1, PLAN)
    (doubt,) = recording.contents[0].doubts
    assert "up to 3599: are they in tenths of a degree or counts of 4096 a turn? needed course in degrees" in doubt
    counts = {fault.kind: fault.count for fault in recording.faults}
    assert counts == {TOO_FAST if part == "tracks" else SOG_RANGE: 50, COG_RANGE: int((10.0 * AZIMUTH_DEG >= 360.05).sum())}
    if part == "tracks":
        assert np.isnan(recording.reports.tracks.velocity_m_s[10.0 * AZIMUTH_DEG > 361.0]).all()


@pytest.mark.parametrize(
    ("slowest_kn", "asked"),
    [
        (
            4.0,
            'the positions move 0.10 times as fast as SOG says (median of 6 tracks): is it in 0.1 kn? --set "input.speed_unit=0.1 kn"',
        ),
        (25.0, "100% of the speeds in column sog are beyond "),
    ],
)
@pytest.mark.parametrize("part", ["tracks", "ais"])
def test_speeds_in_tenths_of_a_knot_are_doubted_and_read(tmp_path: Path, part: str, slowest_kn: float, asked: str) -> None:
    step, number = np.divmod(np.arange(ROWS), 6)
    north_m = np.arange(ROWS) * (slowest_kn + number + 0.05) * NM / 3600.0
    place = from_plane(np.stack([0.0 * north_m, north_m], axis=-1), np.array([50.8, -1.1]))
    columns = number + 235_000_000, *place.T, 10.0 * (slowest_kn + number) + step % 2, 0.0 * number
    file = written(tmp_path, f"{'track' if part == 'tracks' else 'mmsi'},lat,lon,sog,cog", *columns, step_s=1.0)
    source = TrackSources(np.array(["t"], "U32"), np.full((1, 2), np.nan), *np.full((4, 1), np.nan))
    wrong, right = (
        Tables(**{part: (file,)}, speed_unit=unit).load(replace(sensors(), track_sources=source), 1, PLAN)
        for unit in ("kn", "0.1 kn")
    )
    assert [doubt[: len(asked)] for doubt in wrong.contents[0].doubts] == [asked]
    assert right.contents[0].doubts == ()
    velocity = right.reports.tracks.velocity_m_s[0] if part == "tracks" else right.reports.ais.sog_kn[:1] * NM / 3600.0
    assert np.hypot(*velocity, *np.zeros(2 - len(velocity))) == pytest.approx(slowest_kn * NM / 3600.0)
