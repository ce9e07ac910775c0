"""Recorded files of one's own, fused without a scenario: one ship by radar and AIS, one by radar alone, a camera that sees both."""

import csv
import gzip
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nmea_sentences import with_sum

from coastwatch.batches import Fault, FileContent, RadarCorrections
from coastwatch.errors import InputError
from coastwatch.formats.intake.accounts import UNUSED
from coastwatch.formats.intake.ais_validation import AisIntake
from coastwatch.formats.intake.faults import Tally
from coastwatch.geodesy import KNOT_M_S, offset_deg, to_plane
from coastwatch.operators import recorded
from coastwatch.operators.cli import inputs, main
from coastwatch.operators.cli.common_vessels import CommonVessels
from coastwatch.scenario import make_scenario
from coastwatch.scenario.sites import TrackSource, sensors_of
from coastwatch.sensors.recorded.files import has_sentences
from coastwatch.sensors.recorded.merging import DAY_S, FileTimes, check_gaps
from coastwatch.sensors.recorded.nmea.targets import target_reports
from coastwatch.sensors.recorded.tables.feed import Tables

pytestmark = pytest.mark.contract

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
    assert main(["query", "alarms", "--db", url, "--json"]) == 0
    (alarm,) = json.loads(capsys.readouterr().out)
    assert re.search(r"seen by region \(\d+\.\d kn, \d+ s old\)", alarm["evidence"])
    assert main(["track", "235070762", "--db", url]) == 1
    assert f"it is the MMSI of vessel {both['vessel_id']}: `coastwatch track" in capsys.readouterr().err
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
        (["--ais", "empty.nmea"], "empty.nmea: got an empty file"),
        (["--ais", "random.log"], "random.log: got bytes that are not text"),
        (["--ais", "wide.nmea"], "wide.nmea: got NMEA 0183 in UTF-16, needed ASCII or UTF-8: save it again as UTF-8"),
        (
            ["--ais", "marked.csv"],
            "marked.csv: got bytes that begin as UTF-16 and are no text, needed a table in CSV or Parquet",
        ),
        (
            ["--ais", "long.csv"],
            f"long.csv: got columns {60 * 'x'}, {', '.join(f'c{k}' for k in range(39))} and 461 more, needed",
        ),
        (["--ais", "."], "got a folder, needed a file"),
        (["--ais", "random.parquet"], "random.parquet: got bytes that are not Parquet"),
        (["--ais", "random.gz"], "random.gz: got gzip that cannot be decompressed"),
        (["--ais", "packed.xz"], "packed.xz: got a file compressed by xz, needed text, gzip or Parquet: unpack it first"),
        (["--plots", "packed.zst", RADAR], "packed.zst: got a file compressed by zstd"),
        (["--plots", "random.log", RADAR], "random.log: got bytes that are not text"),
        (["--ais", "untimed.nmea"], "--set input.assume_start_utc=2026-07-01T12:00:00Z"),
        (["--plots", "plots.csv", RADAR], "when"),
        (["--plots", "plots.csv", RADAR, "--columns", "time=when,mmsi=ship"], "mmsi"),
        (["--ais", "nothing.csv"], "nothing.csv: there is no such file"),
        (["--plots", "pyproject.toml", RADAR], "pyproject.toml: there is no such file"),  # it is in the checkout
        (["--bearings", "pyproject.toml", CAMERA], "pyproject.toml: there is no such file"),
        (["--plots", "ais.csv", RADAR], "it is a table of decoded AIS (columns mmsi): use --ais"),
        (["--plots", "tracks.csv", RADAR], "it is a table of finished tracks (columns track_id, sog, cog): use --tracks"),
        (["--ais", "tracks.csv"], "it is a table of finished tracks (columns track_id, sog, cog): use --tracks"),
        (["--tracks", "plots.csv"], "it is a table of radar plots (columns range, azimuth): use --plots"),
        (["--ais", "targets.nmea"], "it holds 3 TTM sentences and no VDM or VDO: use --tracks"),
        (["--tracks", "untimed.nmea"], "it holds 1 VDM sentences and no TTM or TLL: use --ais"),
        (["--plots", "dist.csv", RADAR], "needed one of range_m, range: --columns plots.range_m=dist names yours"),
        (["--ais", "bare.csv"], "1 table without a row under its header (first at bare.csv)"),
        (["--plots", "bare.csv", RADAR], "1 table without a row under its header (first at bare.csv)"),
        (["--bearings", "rowless.csv", CAMERA], "1 table without a row under its header (first at rowless.csv)"),
        (["--tracks", "bare.csv"], "1 table without a row under its header (first at bare.csv)"),
        (
            ["--plots", "south.csv", RADAR],
            "south.csv:2, column radar: got unknown radar in every row, 'Hil', needed one of hill; did you mean 'hill'?",
        ),
        (
            ["--ais", "values.csv"],
            "values.csv: got no header, its first line begins with '1700000000.0,235070762,-17.0': needed",
        ),
        (["--plots", "values.csv", RADAR, "--columns", "time=when"], "values.csv: got no header"),
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
    contents["targets.nmea"] = 3 * b"$RATTM,11,11.4,13.6,T,7.0,20.0,T,0.0,0.0,N,TGT1,T,,100021.00,A*46\n"
    contents |= {"packed.xz": b"\xfd7zXZ\x00" + noise, "packed.zst": b"\x28\xb5\x2f\xfd" + noise}
    contents["wide.nmea"] = SENTENCE.encode("utf-16")
    contents["marked.csv"] = b"\xff\xfe" + 100 * noise
    contents["long.csv"] = f"{10**5 * 'x'},{','.join(f'c{k}' for k in range(500))}\n".encode()
    contents["tracks.csv"] = b"time,track_id,lat,lon,sog,cog\n"
    contents["dist.csv"] = b"time,radar,dist,azimuth\n1700000000,hill,1000,10\n"
    contents["bare.csv"] = b"time,mmsi,track,latitude,longitude,range,azimuth,bearing,sog,cog\n"
    contents["rowless.csv"] = b"time,bearing\n"
    contents["south.csv"] = b"time,radar,range,azimuth\n1700000000,Hil,1000,10\n1700000003,Hil,1000,10\n"
    contents["values.csv"] = b"1700000000.0,235070762,-17.0,179.98,5.0,90.0\n1700000010.0,235070762,-17.0,179.98,5.0,90.0\n"
    if "mmsi=" not in str(arguments):
        ais = (files / "ais.csv").read_bytes()
        contents["ais.csv"] = ais.replace(b"ship", b"mmsi")
    for name, content in {**contents, "random.log": noise, "random.parquet": noise}.items():
        (files / name).write_bytes(content)
    assert main(["fuse", *arguments]) == 2
    err = capsys.readouterr().err
    assert wanted in err
    assert err.count("\n") == 1
    assert len(err) < 1500


def test_sentences_are_told_from_tables(tmp_path: Path) -> None:
    plain, packed, table = tmp_path / "a.log", tmp_path / "b.gz", tmp_path / "c.csv"
    plain.write_text(SENTENCE)
    packed.write_bytes(gzip.compress(b"\\s:2573238,c:1733782034*0A\\!BSVDM,1,1,,A,13o4g`00000I2ENRH4g83S0L088C,0*3F\n"))
    table.write_text("time,mmsi,lat,lon\n")
    assert [has_sentences(p, "ais") for p in (plain, packed, table)] == [True, True, False]


def test_other_files_are_another_run(tmp_path: Path) -> None:
    first, second = tmp_path / "one.csv", tmp_path / "two.csv"
    for path in (first, second):
        path.write_text("time,mmsi,lat,lon\n")
    names = {recorded.document(recorded.Files((str(p),), None, None, (), {}), {}, 3.0)["name"] for p in (first, second, first)}
    assert len(names) == 2
    assert all(len(name) <= 32 for name in names)


def test_the_area_holds_what_the_sensors_cover_across_the_antimeridian() -> None:
    sensors = [
        {"name": "a", "latitude_deg": -17.0, "longitude_deg": 179.9, "range_nm": 6.0, "rpm": 20.0},
        {"name": "b", "latitude_deg": -17.1, "longitude_deg": -179.9, "range_nm": 6.0, "rpm": 20.0},
    ]
    files = recorded.Files((), __file__, None, (), {})
    made = recorded.framed(make_scenario(recorded.document(files, {"radars": sensors}, 3.0), "trial", {})).area
    assert abs(made.longitude_deg) == pytest.approx(180.0, abs=1e-3)
    assert made.latitude_deg == pytest.approx(-17.05, abs=1e-3)
    assert made.width_nm == pytest.approx(1.1 * (12.0 + 0.2 * 60.0 * np.cos(np.radians(17.05))), rel=0.01)
    assert made.height_nm == pytest.approx(1.1 * (12.0 + 6.0), rel=0.01)


def sentence_of(body: str) -> str:
    return with_sum(body).decode()


def ttm(number: int, metres: np.ndarray, velocity: np.ndarray, time_s: float, relative_to_deg: float | None = None) -> str:
    """A sentence of a target, its bearing from the bow if a heading is given."""
    reach, bearing = np.hypot(*metres) / 1852.0, np.degrees(np.arctan2(*metres)) % 360.0
    speed, course = np.hypot(*velocity) / KNOT_M_S, np.degrees(np.arctan2(*velocity)) % 360.0
    form, bearing = ("T", bearing) if relative_to_deg is None else ("R", (bearing - relative_to_deg) % 360.0)
    body = f"RATTM,{number:02d},{reach:.4f},{bearing:.2f},{form},{speed:.2f},{course:.2f},T,,,N,,T,,,A"
    return f"{time_s:.1f} {sentence_of(body)}"


def test_finished_tracks_and_ais_become_two_ships(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = ["time,track,lat,lon,ve,vn"]
    targets = []
    for step in range(60):
        time_s = START_S + 3.0 * step
        at, speed = ships(time_s)
        place = offset_deg(np.tile(SITE, (2, 1)), at)
        table += [f"{time_s},{7 + k},{place[k, 0]:.6f},{place[k, 1]:.6f},{speed[k, 0]},{speed[k, 1]}" for k in range(2)]
        targets += [ttm(k, at[k], speed[k], time_s) for k in range(2)]
    (files / "tracks.csv").write_text("\n".join(table) + "\n")
    (files / "targets.nmea").write_text("\n".join(targets) + "\n")
    url = f"sqlite:///{files / 'x.db'}"
    line = ["fuse", "--ais", str(files / "ais.csv"), "--columns", "ais.time=when,mmsi=ship", "--db", url, "--json"]
    given = ["--tracks", str(files / "tracks.csv"), str(files / "targets.nmea"), f"--track-site={SITE[0]},{SITE[1]}"]
    assert main([*line, *given]) == 0
    assert json.loads(capsys.readouterr().out)["vessels"] == 2
    assert main(["picture", "--db", url, "--format", "csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert sorted(row["sources"] for row in rows) == ["tracks,targets", "tracks,targets,ais"]
    wanted = offset_deg(np.tile(SITE, (2, 1)), ships(START_S + 177.0)[0])
    for row in rows:
        gap = to_plane(wanted, np.array([float(row["latitude_deg"]), float(row["longitude_deg"])]))
        assert np.hypot(*gap.T).min() < POSITION_M
    assert main(["sensors", "--db", url, "--json"]) == 0
    table, sentences = (row for row in json.loads(capsys.readouterr().out) if row["kind"] == "tracks")
    assert [sentences[k] for k in ("name", "states", "dropped", "tracks")] == ["targets", 120, 0, 2]
    assert [table[k] for k in ("name", "tracks", "latitude_deg", "range_m")] == ["tracks", 2, SITE[0], None]
    assert main(["sensors", "--db", url]) == 0
    assert "2 tracks, 120 states, 0 dropped; " in capsys.readouterr().out


def test_a_file_of_tracks_that_is_named_as_ais_or_a_sonar_is_a_source_of_another_name(tmp_path: Path) -> None:
    paths = [str(tmp_path / name) for name in ("ais.csv", "camera.csv", "vts.csv")]
    for path in paths:
        Path(path).write_text("time,track,lat,lon\n")
    sources = recorded.track_sources(recorded.Files((), None, None, tuple(paths), {}), None, ["camera"])
    assert [source["name"] for source in sources] == ["ais-tracks", "camera-tracks", "vts"]


def test_bearings_from_the_bow_need_position_and_heading(tmp_path: Path) -> None:
    at, velocity = np.array([3000.0, 1000.0]), np.array([4.0, -2.0])
    own = sentence_of("GPGGA,221320.00,1700.0000,S,17958.8000,E,1,8,1.0,1,M,,M,,")
    lines = [f"{START_S:.1f} {own}", f"{START_S:.1f} {ttm(5, at, velocity, START_S, 30.0)[13:]}"]
    lines += [f"{START_S + 1:.1f} {sentence_of('HEHDT,30.0,T')}", ttm(5, at, velocity, START_S + 1, 30.0)]
    lines += [
        ttm(6, at, velocity, START_S + 2, 30.0).replace(",A*", ",B*"),
        sentence_of("RATLL,09,1700.0000,S,17958.8000,E,X,221321.00,T,"),
    ]
    file = tmp_path / "own.nmea"
    file.write_text("\n".join(lines) + "\n")
    sources = sensors_of((), (), (), [TrackSource(name="ship")])
    tally = Tally()
    found = target_reports(file, 0, sources.track_sources, math.nan, AisIntake(), tally)
    assert [f.kind for f in tally.faults()] == ["no position or heading of own ship", "checksum", "time missing"]
    assert found.number.tolist() == [5]
    np.testing.assert_allclose(to_plane(found.position_deg, SITE), [at], atol=30.0)  # 0.01 deg at 3 km, 1e-4 NM
    np.testing.assert_allclose(found.velocity_m_s, [velocity], atol=0.05)


def test_columns_records_and_spans_of_every_file_are_listed(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = f"sqlite:///{files / 'x.db'}"
    text = (files / "plots.csv").read_text().splitlines()
    (files / "wind.csv").write_text("\n".join([text[0] + ",gust", *(line + ",3.5" for line in text[1:])]) + "\n")
    given = ["--plots", str(files / "wind.csv"), RADAR, "--ais", str(files / "ais.csv"), "--columns", "time=when,mmsi=ship"]
    assert main(["fuse", *given, "--db", url, "--set", "cycles=5"]) == 0
    out = capsys.readouterr().out
    assert "wind.csv: 120 radar plots, 2023-11-14T22:13:20Z to 2023-11-14T22:16:17Z" in out
    assert "columns read: time=when, range_m=range, azimuth\n    columns ignored: gust" in out
    assert "ais.csv: 60 AIS reports, 2023-11-14T22:13:21Z to 2023-11-14T22:16:18Z" in out


def test_files_that_do_not_overlap_in_time_are_warned_of_with_both_spans(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = [line.split(",") for line in (files / "ais.csv").read_text().splitlines()]
    (files / "late.csv").write_text(
        "\n".join([",".join(late[0]), *(",".join([f"{float(r[0]) + 400}", *r[1:]]) for r in late[1:])])
    )
    given = ["--plots", str(files / "plots.csv"), RADAR, "--ais", str(files / "late.csv"), "--columns", "time=when,mmsi=ship"]
    assert main(["fuse", *given, "--db", f"sqlite:///{files / 'x.db'}", "--json", "--set", "cycles=5"]) == 0
    found = capsys.readouterr()
    wanted = (
        "late.csv and plots.csv do not overlap in time: 2023-11-14T22:20:01Z to 2023-11-14T22:22:58Z, and "
        "2023-11-14T22:13:20Z to 2023-11-14T22:16:17Z, 0.06 h apart"
    )
    assert found.err.startswith(f"coastwatch: warning: {wanted}"), "before the first cycle: there may be hours of them"
    assert found.err.count(wanted) == 1
    assert wanted in json.loads(found.out)["warnings"][0]


@pytest.mark.parametrize(("gap_s", "warned"), [(1.0, False), (3_500.0, False), (3_700.0, True)])
def test_parts_of_one_recording_follow_each_other_within_an_hour(gap_s: float, warned: bool) -> None:
    begins = START_S, START_S + 600.0 + gap_s
    parts = [FileContent(f"p{begin}.csv", "AIS reports", 5, begin, begin + 600.0) for begin in begins]
    scenario: Any = SimpleNamespace(radars=(), stations=())
    assert any("do not overlap" in said for said in inputs.warnings_of_files(scenario, parts, ())) == warned
    other = [parts[0], replace(parts[1], kind="radar plots")]
    assert "do not overlap" in inputs.warnings_of_files(scenario, other, ())[0]


@pytest.mark.parametrize("part", ["plots", "ais"])
def test_a_run_over_years_without_reports_is_refused(part: str, files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head, *lines = (files / f"{part}.csv").read_text().splitlines()
    later = [f"{float(line.partition(',')[0]) + 4e7},{line.partition(',')[2]}" for line in lines]
    (files / f"{part}.csv").write_text("\n".join([head, *later]) + "\n")
    given = ["fuse", "--plots", str(files / "plots.csv"), RADAR, "--ais", str(files / "ais.csv")]
    given += ["--columns", "time=when,mmsi=ship", "--db", str(files / "x.db")]
    assert main(given) == 2
    err = capsys.readouterr().err
    assert f"{part}.csv (2025-02-19T21:20:0" in err
    assert "with no report between 2023-11-14T22:16:1" in err
    assert err.count("\n") == 1
    assert not (files / "x.db").exists()
    begin = re.findall(r"--set (\S+)", err)[0]
    assert main([*given, "--set", begin, "--set", "cycles=20"]) == 0


def test_long_recordings_with_reports_are_not_refused() -> None:
    days = START_S + DAY_S * np.arange(0.0, 100.0, 0.9)
    check_gaps([FileTimes("a.csv", days), FileTimes("b.nmea", days[[0, -1]] + 90.0 * DAY_S, is_stream=True)], -math.inf)
    ends = [FileTimes(f"{k}.nmea", START_S + DAY_S * np.array([40.0 * k, 40.0 * k + 1.0]), is_stream=True) for k in range(2)]
    check_gaps(ends, START_S + 2.0 * DAY_S)
    with pytest.raises(InputError, match=r"0\.nmea .*, 1\.nmea .*needed less than 31 days"):
        check_gaps(ends, -math.inf)


@pytest.mark.parametrize(
    ("lags_s", "sigma_s", "wanted"),
    [
        (
            [-5.2, -5.1],
            0.2,
            "the 2 radars seem to be off by the same -5.2 s against AIS: more likely the times of AIS are 5.2 s late",
        ),
        ([4.0, 4.5, 4.2], 0.2, "more likely the times of AIS are 4.2 s ahead"),
        ([-5.2, 0.1], 0.2, None),
        ([-5.2, -5.1], 3.0, None),
        ([-0.4, -0.5], 0.2, None),
        ([-5.2], 0.2, None),
    ],
)
def test_radars_that_are_all_off_by_the_same_time_are_warned_of(
    lags_s: list[float], sigma_s: float, wanted: str | None
) -> None:
    """Radars that were right were pulled along by a table of AIS that was late, and nothing was said."""
    none = RadarCorrections.empty(R=len(lags_s))
    known = replace(none, estimated_lag_s=np.array(lags_s), lag_sigma_s=np.full(len(lags_s), sigma_s))
    scenario, result = (
        SimpleNamespace(radars=(), stations=()),
        SimpleNamespace(contents=(), faults=(), vessels=1, corrections=known),
    )
    found = inputs.warnings(scenario, result)
    assert len(found) == (wanted is not None)
    assert wanted is None or wanted in found[0]


def test_a_radar_whose_site_seems_wrong_is_warned_of() -> None:
    sigma_m = np.array([[np.nan, np.nan], [1.0, 1.0]])
    known = replace(RadarCorrections.empty(R=2), site_error_m=np.array([[3.0, 0.0], [50.0, -20.0]]), site_sigma_m=sigma_m)
    radars = [SimpleNamespace(name=name, latitude_deg=50.0, longitude_deg=-1.0, range_nm=6.0) for name in ("fort", "island")]
    result = SimpleNamespace(contents=(), faults=(), vessels=1, corrections=known)
    (found,) = inputs.warnings(SimpleNamespace(radars=radars, stations=()), result)
    assert "island: its stated site seems to be 50 m east and 20 m south of the antenna" in found
    assert "latitude_deg = 50.00018 and longitude_deg = -1.00070" in found


@pytest.mark.parametrize(
    ("name", "taken", "wanted"),
    [
        (
            "swapped.csv",
            {"box_deg": (-1.2, 50.7, -1.1, 50.8)},
            "swapped.csv lies far from every sensor, .* and longitude swapped",
        ),
        (
            "away.csv",
            {"box_deg": (10.0, 20.0, 11.0, 21.0)},
            "away.csv lies far from every sensor, .* one of the positions wrong",
        ),
        (
            "clock.csv",
            {"first_s": 0.0, "last_s": 46217.5},
            "clock.csv: its times are 1970-01-01T00:00:00Z to 1970-01-01T12:50:17Z",
        ),
        ("none.csv", {}, "60 rows are left out: unknown radar .first at none.csv:2, column radar: north, known"),
        ("none.csv", {"records": 0}, "none.csv: no record was taken: 60 unknown radar .*north, known"),
        (
            "swift.csv",
            {"doubts": ("the positions move 1.94 times as fast",)},
            "swift.csv: the positions move 1.94 times as fast",
        ),
        ("good.csv", {}, None),
    ],
)
def test_files_of_odd_times_or_places_are_warned_of(name: str, taken: dict[str, Any], wanted: str | None) -> None:
    good = FileContent("ais.csv", "AIS reports", 9, START_S, START_S + 60.0, box_deg=(50.7, -1.2, 50.8, -1.1))
    fault = Fault("unknown radar", 60, "none.csv:2, column radar", "north, known: ['hill']")
    odd = replace(good, name=name, **taken)
    scenario = SimpleNamespace(radars=(), stations=(SimpleNamespace(latitude_deg=50.8, longitude_deg=-1.1, range_nm=30.0),))
    found = inputs.warnings(
        scenario, SimpleNamespace(contents=(good, odd), faults=(fault,), vessels=1, corrections=RadarCorrections.empty(R=2))
    )
    found = [line for line in found if "overlap" not in line]
    assert len(found) == (wanted is not None)
    assert wanted is None or re.match(wanted, found[0])


def test_an_empty_picture_says_why(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "\n".join(f"{START_S + 3 * k},{1000 + 700 * (k % 5)},{40 * k % 360}" for k in range(20))
    (files / "clutter.csv").write_text(f"time,range,azimuth\n{rows}\n")
    url = f"sqlite:///{files / 'x.db'}"
    assert main(["fuse", "--plots", str(files / "clutter.csv"), RADAR, "--db", url]) == 0
    assert "warning: 0 vessels from 20 radar plots: no plots of a radar followed one another" in capsys.readouterr().err
    assert main(["fuse", "--bearings", str(files / "bearings.csv"), CAMERA, "--columns", "time=when", "--db", url]) == 0
    assert "0 vessels from 120 bearings: bearings alone place no vessel" in capsys.readouterr().err


def test_a_radar_that_moves_needs_no_place_of_its_own(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header, *lines = (files / "plots.csv").read_text().splitlines()
    rows = [f"{line},{SITE[0]},{SITE[1]}" for line in lines]
    (files / "moving.csv").write_text("\n".join([f"{header},own_latitude,own_longitude", *rows]) + "\n")
    given = ["--columns", "time=when", "--db", f"sqlite:///{files / 'x.db'}", "--json", "--set", "cycles=20"]
    moves = "--radar=ship,,,12,20,10,0.3"
    assert main(["fuse", "--plots", str(files / "moving.csv"), moves, *given]) == 0
    assert json.loads(capsys.readouterr().out)["vessels"] == 2
    assert main(["fuse", "--plots", str(files / "plots.csv"), moves, *given]) == 2
    assert "radar 'ship': got no position, needed latitude_deg and longitude_deg, or the columns" in capsys.readouterr().err


def test_a_radar_may_count_azimuths_from_magnetic_north(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    variation_deg, url = 11.0, f"sqlite:///{files / 'x.db'}"
    header, *lines = (line.split(",") for line in (files / "plots.csv").read_text().splitlines())
    rows = [f"{when},{reach},{(float(azimuth) - variation_deg) % 360.0}" for when, reach, azimuth in lines]
    (files / "magnetic.csv").write_text("\n".join([",".join(header), *rows]) + "\n")
    given = ["fuse", "--plots", str(files / "magnetic.csv"), RADAR, "--columns", "time=when", "--db", url, "--json"]
    said = ["--set", "radars.0.azimuth_reference=magnetic", "--set", f"radars.0.magnetic_variation_deg={variation_deg}"]
    assert main([*given, *said]) == 0, capsys.readouterr().err
    capsys.readouterr()
    assert main(["picture", "--db", url, "--format", "csv"]) == 0
    vessels = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    places = np.array([[float(row["latitude_deg"]), float(row["longitude_deg"])] for row in vessels])
    apart = to_plane(places, SITE)[:, None] - ships(START_S + 180.0)[0]
    assert len(places) == 2
    assert np.hypot(*apart.transpose(2, 0, 1)).min(axis=0).max() < POSITION_M


def test_what_became_of_every_record_is_said_and_a_lost_one_fails_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run of a file whose end is taken too early, as one of 26,000 sentences was, is not done."""
    path = tmp_path / "ais.csv"
    rows = [f"{START_S + 10 * k:.0f},235070{762 + k % 3},50.7{k % 10},-1.1,5,90,A" for k in range(30)]
    path.write_text("\n".join(["time,mmsi,latitude,longitude,sog,cog,name", *rows, "x,1,50,1,5,90,", "1"]))
    arguments = ["fuse", "--ais", str(path), "--db", f"sqlite:///{tmp_path}/x.db"]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "records: 35 read = 30 in reports + 3 names and sizes + 2 refused + 0 set aside" in said
    whole = Tables.span
    monkeypatch.setattr(Tables, "span", lambda tables, *given, **named: (whole(tables, *given, **named)[0], START_S + 200.0))
    assert main([*arguments, "--restart", "--json"]) == 1
    out, err = capsys.readouterr()
    assert f"9 {UNUSED}" in err
    made = json.loads(out)
    assert [(fault["kind"], fault["count"]) for fault in made["faults"] if fault["kind"] == UNUSED] == [(UNUSED, 9)]
    assert made["records"]["unaccounted"] == 0


@pytest.mark.parametrize(("apart", "wanted"), [(True, 1), (False, 0)])
@pytest.mark.parametrize("far", [False, True])
def test_a_radar_and_ais_without_a_vessel_in_common_are_warned_of(apart: bool, wanted: int, far: bool) -> None:
    """AIS two hours off made every ship two, in silence. AIS vessels farther away than those of the radar say nothing."""
    radars = [{"name": "hill", "latitude_deg": -17.0, "longitude_deg": 179.98, "range_nm": 12, "rpm": 20}]
    document = {"name": "x", "title": "x", "area": {"latitude_deg": -17.0, "longitude_deg": 179.98}, "radars": radars}
    sensors = make_scenario(document, "test", {}).sensors()
    position = SITE + np.array([[0.01, 0.0], [0.0, 0.03], [0.02, 0.0], [0.0, 0.04]]) * np.array([1.0, 0.5])
    every = np.concatenate([position, position[:3] + (0.1 if far else -0.001)])
    vessel = np.arange(7)
    picture = SimpleNamespace(vessel_id=vessel, position_deg=every, mmsi=np.where(vessel > 3, vessel, -1))
    source = np.where(vessel > 3, sensors.ais_source, 0)
    both = (vessel, source) if apart else (np.append(vessel, 5), np.append(source, 0))
    common = CommonVessels(sensors)
    for _ in range(100):
        common.add(SimpleNamespace(picture=picture, members=SimpleNamespace(vessel_id=both[0], source=both[1])))
    found = list(common.warnings())
    assert len(found) == (wanted and not far)
    assert not found or found[0].startswith(
        "radar hill and AIS have no vessel in common, though 3 AIS vessels were among those"
    )
