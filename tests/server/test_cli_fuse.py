"""Recorded files of one's own, fused without a scenario: one ship by radar and AIS, one by radar alone, a camera that sees both."""

import csv
import gzip
import io
import json
from pathlib import Path

import numpy as np
import pytest

from coastwatch.geodesy import KNOT_M_S, offset_deg, to_plane
from coastwatch.operators import recorded
from coastwatch.operators.cli import main
from coastwatch.scenario import make_scenario

SEED = 4
SITE = np.array([-17.0, 179.98])  # the ships cross the antimeridian
START_S = 1_700_000_000.0
RADAR = "--radar=hill,-17.0,179.98,12,20,10,0.3"
STATION = "--station=mast,-17.0,179.98,30"
CAMERA = "--sonar=camera,-17.0,179.98,10,0.5"
SENTENCE = "!AIVDM,1,1,,A,33P;Tw0tjBQO22:E7dm66DrB20UP,0*2E\n"
POSITION_M = 60.0  # five times the radar's noise at 2 km: this is about the chain holding together, not about accuracy


def ships(time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Metres from the site, and m/s, of the two ships."""
    speed = np.array([[6.0, 1.0], [-1.0, -5.0]])
    return np.array([[1500.0, 1200.0], [2500.0, -1800.0]]) + speed * (time_s - START_S), speed


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with plots.csv, ais.csv and bearings.csv of three minutes."""
    rng = np.random.default_rng([SEED, 1, 0])
    plots, ais, bearings = ["when,range,azimuth"], ["when,ship,lat,lon,sog,cog"], ["when,bearing,contact"]
    for step in range(60):
        time_s = START_S + 3.0 * step
        at, speed = ships(time_s)
        for k in range(2):
            reach, angle = np.hypot(*at[k]), np.degrees(np.arctan2(*at[k])) % 360.0
            plots.append(f"{time_s},{reach + rng.normal(0, 10):.2f},{angle + rng.normal(0, 0.3):.4f}")
            bearings.append(f"{time_s},{angle + rng.normal(0, 0.5):.3f},{k}")
        lat, lon = offset_deg(SITE, at[0])
        sog, cog = np.hypot(*speed[0]) / KNOT_M_S, np.degrees(np.arctan2(*speed[0]))
        ais.append(f"{time_s + 1.0},235070762,{lat:.6f},{lon:.6f},{sog:.1f},{cog:.1f}")
    for name, lines in (("plots", plots), ("ais", ais), ("bearings", bearings)):
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_radar_ais_and_bearings_become_two_ships(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = f"sqlite:///{files / 'x.db'}"
    line = [
        "fuse",
        "--ais",
        str(files / "ais.csv"),
        "--plots",
        str(files / "plots.csv"),
        "--bearings",
        str(files / "bearings.csv"),
    ]
    line += [RADAR, STATION, CAMERA, "--columns", "time=when,ais.mmsi=ship", "--db", url, "--json"]
    assert main(line) == 0, capsys.readouterr().err
    made = json.loads(capsys.readouterr().out)
    assert made["vessels"] == 2
    assert main(["picture", "--db", url, "--format", "csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    both, alone = sorted(rows, key=lambda row: row["mmsi"] == "")
    assert both["mmsi"] == "235070762"
    assert "ais" in both["sources"]
    assert alone["flags"] == "dark"
    truth, _ = ships(START_S + 180.0)
    for k, row in enumerate((both, alone)):
        place = to_plane(np.array([float(row["latitude_deg"]), float(row["longitude_deg"])]), SITE)
        assert np.hypot(*(place - truth[k])) < POSITION_M
    path = files / "p.png"
    assert main(["plot", "--db", url, "--output", str(path)]) == 0
    assert path.is_file()


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["--plots", "plots.csv"], "--radar"),
        (["--bearings", "bearings.csv"], "--sonar"),
        (["--plots", "plots.csv", "--radar", "hill,-17.0"], "needed name"),
        (["--plots", "plots.csv", "--radar", "hill,-17.0,x,12"], "hill"),
        (
            ["--plots", "plots.csv", "--radar", "hill,-17.0,179,12"],
            "4 values, needed name,latitude_deg,longitude_deg,range_nm,rpm[",
        ),
        (["--plots", "plots.csv", "--radar", "hill,95,179,12,20"], "--radar hill: latitude_deg: got 95.0"),
        (["--plots", "plots.csv", RADAR, RADAR], "--radar: got the name 'hill' 2 times, needed it once\n"),
        (["--ais", "empty.nmea"], "empty.nmea: neither NMEA 0183 nor a table: got an empty file"),
        (["--ais", "random.log"], "random.log: neither NMEA 0183 nor a table: got bytes that are not text"),
        (["--ais", "random.parquet"], "random.parquet: neither NMEA 0183 nor a table"),
        (["--ais", "random.gz"], "random.gz: got gzip that cannot be decompressed"),
        (["--plots", "random.log", RADAR], "random.log: no table"),
        (["--ais", "untimed.nmea"], "--set input.assume_start_utc=2026-07-01T12:00:00Z"),
        (["--plots", "plots.csv", RADAR], "when"),
        (["--plots", "plots.csv", RADAR, "--columns", "time=when,mmsi=ship"], "mmsi"),
        (["--ais", "nothing.csv"], "nothing.csv"),
        (["--ais", "ais.csv", "--columns", "time=when,mmsi=vessel"], "vessel"),
        (["--ais", "ais.csv", "--columns", "time=when,mmsi=ship", "--period", "0"], "period_s"),
        (["--ais", "ais.csv", "--columns", "time=when,mmsi=ship", "--set", "tracks.gate=x"], "tracks"),
    ],
)
def test_what_is_wrong_is_named(
    arguments: list[str], wanted: str, files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    noise = np.random.default_rng([SEED, 2, 0]).bytes(3000)
    contents = {"empty.nmea": b"", "untimed.nmea": SENTENCE.encode(), "random.gz": b"\x1f\x8b" + noise}
    for name, content in {**contents, "random.log": noise, "random.parquet": noise}.items():
        (files / name).write_bytes(content)
    assert main(["fuse", *arguments]) == 2
    err = capsys.readouterr().err
    assert wanted in err
    assert err.count("\n") == 1


def test_sentences_are_told_from_tables(tmp_path: Path) -> None:
    plain, packed, table = tmp_path / "a.log", tmp_path / "b.gz", tmp_path / "c.csv"
    plain.write_text(SENTENCE)
    packed.write_bytes(gzip.compress(b"\\s:2573238,c:1733782034*0A\\!BSVDM,1,1,,A,13o4g`00000I2ENRH4g83S0L088C,0*3F\n"))
    table.write_text("time,mmsi,lat,lon\n")
    assert [recorded.is_nmea(str(p)) for p in (plain, packed, table)] == [True, True, False]


def test_other_files_are_another_run(tmp_path: Path) -> None:
    first, second = tmp_path / "one.csv", tmp_path / "two.csv"
    for path in (first, second):
        path.write_text("time,mmsi,lat,lon\n")
    names = {recorded.document(recorded.Files((str(p),), None, None, {}), {}, 3.0)["name"] for p in (first, second, first)}
    assert len(names) == 2
    assert all(len(name) <= 32 for name in names)


def test_the_area_holds_what_the_sensors_cover_across_the_antimeridian() -> None:
    sensors = [
        {"name": "a", "latitude_deg": -17.0, "longitude_deg": 179.9, "range_nm": 6.0, "rpm": 20.0},
        {"name": "b", "latitude_deg": -17.1, "longitude_deg": -179.9, "range_nm": 6.0, "rpm": 20.0},
    ]
    files = recorded.Files((), __file__, None, {})
    made = recorded.framed(make_scenario(recorded.document(files, {"radars": sensors}, 3.0), "trial", {})).area
    assert abs(made.longitude_deg) == pytest.approx(180.0, abs=1e-3)
    assert made.latitude_deg == pytest.approx(-17.05, abs=1e-3)
    assert made.width_nm == pytest.approx(1.1 * (12.0 + 0.2 * 60.0 * np.cos(np.radians(17.05))), rel=0.01)
    assert made.height_nm == pytest.approx(1.1 * (12.0 + 6.0), rel=0.01)
