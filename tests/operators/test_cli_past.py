"""The past on the command line: traffic, encounters, and recorded pictures as they were computed."""

import csv
import io
from pathlib import Path

import numpy as np
import polars
import pytest

from coastwatch.batches import Picture
from coastwatch.operators.cli import main
from coastwatch.scenario import load_scenario
from coastwatch.server.run import run_scenario

pytestmark = pytest.mark.contract

SMALL = {"input.count": "14", "cycles": "6", "warmup_s": "18", "store.recording": "true"}
BOX = "-24,-44,-22,-42"
SPAN = ["--bbox", BOX, "--from", "2025-06-01T12:00:10Z", "--to", "2025-06-01T12:00:30Z"]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, list[Picture]]:
    """URL of a database with a recorded run, and its pictures."""
    url = f"sqlite:///{tmp_path_factory.mktemp('past') / 'x.db'}"
    pictures: list[Picture] = []
    run_scenario(
        load_scenario("context-driven-100", SMALL), seed=3, database=url, on_cycle=lambda cycle: pictures.append(cycle.picture)
    )
    return url, pictures


def rows(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> list[dict[str, str]]:
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return list(csv.DictReader(io.StringIO(out)))


def test_a_replay_has_every_number_as_it_was(ran: tuple[str, list[Picture]], capsys: pytest.CaptureFixture[str]) -> None:
    url, pictures = ran
    found = rows(["replay", "--db", url], capsys)
    assert [int(row["cycle"]) for row in found] == [n for n, p in enumerate(pictures) for _ in range(len(p))]
    whole = Picture.join(pictures)
    assert [float(row["latitude_deg"]) for row in found] == whole.position_deg[:, 0].tolist()
    assert [float(row["north_m_s"]) for row in found] == whole.velocity_m_s[:, 1].tolist()
    said = np.array([float(row["covariance_north_east_rate"] or "nan") for row in found])
    assert np.array_equal(said, whole.covariance[:, 1, 2], equal_nan=True)
    assert all(row["members"] for row in found if row["updated_utc"] == row["time_utc"])
    now = rows(["picture", "--db", url, "--format", "csv"], capsys)
    named = ("vessel_id", "mmsi", "flags")
    last = [row for row in found if row["cycle"] == found[-1]["cycle"]]
    assert [[row[name] for name in named] for row in last] == [[row[name] for name in named] for row in now]
    assert [round(float(row["sog_kn"]), 2) for row in last] == [float(row["sog_kn"]) for row in now]
    source, _, track = last[0]["members"].split()[0].partition(":")
    assert source in now[0]["sources"].split(",")
    assert track.isdigit()


def test_a_replay_of_a_span_and_a_box_as_parquet(ran: tuple[str, list[Picture]], tmp_path: Path) -> None:
    url, pictures = ran
    path = tmp_path / "x.parquet"
    line = ["replay", "--db", url, *SPAN, "--format", "parquet", "--output", str(path)]
    assert main(line) == 0
    found = polars.read_parquet(path)
    assert sorted(set(found["cycle"].to_list())) == [3, 4, 5, 6, 7, 8, 9]
    assert len(found) == sum(len(p) for p in pictures[3:10])
    assert found.schema["time_utc"] == polars.Datetime("us", "UTC")
    assert found.schema["flags"] == polars.List(polars.String)
    assert found["alternative_m"].null_count() == len(found), "absent, as in picture, and not NaN"


def test_a_picture_of_a_recorded_instant_is_exact(ran: tuple[str, list[Picture]], capsys: pytest.CaptureFixture[str]) -> None:
    url, pictures = ran
    found = rows(["picture", "--db", url, "--at", "2025-06-01T12:00:15Z", "--format", "csv"], capsys)
    then = pictures[4]
    assert [int(row["vessel_id"]) for row in found] == then.vessel_id.tolist()
    assert [float(row["latitude_deg"]) for row in found] == np.round(then.position_deg[:, 0], 6).tolist()
    assert all(row["sources"] for row in found if row["updated_utc"] == row["time_utc"])


def test_traffic_and_encounters(ran: tuple[str, list[Picture]], capsys: pytest.CaptureFixture[str]) -> None:
    url, pictures = ran
    found = rows(["traffic", "--db", url, *SPAN, "--format", "csv"], capsys)
    assert {int(row["vessel_id"]) for row in found} == set(Picture.join(pictures[2:10]).vessel_id.tolist())
    assert {"time_utc", "to_utc", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg"} <= set(found[0])
    near = rows(["encounters", "--db", url, *SPAN, "--within", "20000", "--min-sog", "0", "--format", "csv"], capsys)
    metres = [float(row["distance_m"]) for row in near]
    assert metres == sorted(metres)
    assert 5 < len(near) <= 100
    few = rows(
        ["encounters", "--db", url, *SPAN, "--within", "20000", "--min-sog", "0", "--count", "2", "--format", "csv"], capsys
    )
    assert few == near[:2]


def test_the_newest_instant_says_when_each_vessel_was_heard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also of vessels that sail straight on, of which no point of the history was due: they were said to be silent."""
    table, url = tmp_path / "ais.csv", f"sqlite:///{tmp_path / 'x.db'}"
    lines = ["time,mmsi,latitude,longitude,sog,cog"]
    for vessel in range(3):
        lines += [
            f"{1_700_000_000 + t},23500000{vessel},{50.0 + t * 1.5e-5:.6f},{-1.0 + vessel},3.2,0" for t in range(vessel, 200, 4)
        ]
    table.write_text("\n".join(lines))
    assert main(["fuse", "--ais", str(table), "--db", url]) == 0
    capsys.readouterr()
    columns = ["--columns", "mmsi,updated_utc", "--format", "csv"]
    now = rows(["picture", "--db", url, *columns], capsys)
    assert main(["picture", "--db", url, "--at", "2023-11-14T23:00:00Z", *columns]) == 0
    then = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert len(now) == 3
    assert then == now


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        (["traffic", "--bbox", BOX, "--from", "2025-06-01T13:00:00Z", "--to", "2025-06-01T12:00:00Z"], 2, "needed an instant before --to"),
        (["traffic", "--bbox", BOX, "--from", "2020-01-01", "--to", "2020-01-02"], 1, "holds nothing up to then"),
        (["query", "alarms", "--from", "2025-06-02", "--to", "2025-06-01"], 2, "needed an instant before --to"),
        (["encounters", *SPAN, "--within", "-1"], 2, "within_m: got -1, needed 0 or more"),
        (["replay", "--from", "2030-01-01"], 1, "has no recorded cycle in that time span"),
        (["replay", "--from", "2030-01-01", "--to", "2020-01-01"], 2, "--from"),
        (["replay", "--format", "parquet"], 2, "--output"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(
    ran: tuple[str, list[Picture]], line: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*line, "--db", ran[0]]) == code
    assert said in capsys.readouterr().err
