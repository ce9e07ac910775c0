"""What a wrong command line, file or database is answered with: one sentence of ours that says where, what was found, what was needed."""

import re
import sqlite3
from pathlib import Path

import pytest

from coastwatch.operators.cli import main
from coastwatch.store import open_store

pytestmark = pytest.mark.contract

FOREIGN = re.compile(
    r"pydantic|alembic|sqlalchemy|polars|Errno|codec|Traceback|Input should|Field required|Extra inputs|Error\b"
)
"""Words of the libraries below, and names of exceptions."""

SCENARIO = """
name = "mine"
title = "Mine"
cycles = 2
[area]
latitude_deg = 50.0
longitude_deg = -1.0
[[radars]]
name = "north"
latitude_deg = 50.0
longitude_deg = -1.0
range_nm = 12.0
rpm = 20.0
[input]
method = "simulated"
area_latitude_deg = 50.0
area_longitude_deg = -1.0
"""
FILES = {
    "mine.toml": SCENARIO.encode(),
    "radar.toml": SCENARIO.replace("[[radars]]", "[[radar]]").encode(),
    "twice.toml": (SCENARIO + SCENARIO[SCENARIO.index("[[radars]]") : SCENARIO.index("[input]")]).encode(),
    "areas.toml": SCENARIO.replace("[area]", "[aera]").encode(),
    "bytes.toml": b'name = "x"\ntitle = "\xff"\n',
    "round.toml": b"radars are round\n",
    "empty.toml": b"",
    "empty.csv": b"",
    "empty.db": b"",
    "bytes.csv": b"time,mmsi,latitude,longitude\n\xff\xfe1,219000001,50.0,-1.0\n",
    "noise.db": bytes(range(1, 251)) * 20,
    "not.geojson": b"land\n",
}
NORTH = "north,50,-1,12,24"

CASES: dict[str, tuple[str, int, str]] = {
    "a scenario": ("run guanabra", 2, "scenario: got 'guanabra', needed one of .*; did you mean 'guanabara'?"),
    "a method": (
        "run guanabara --set tracks.method=imn", 2,
        "--set tracks.method: got 'imn', needed one of sided_imm, imm, .*; did you mean 'imm'?",
    ),
    "a key": ("run guanabara --set tracks.metod=imm", 2, "--set tracks.metod: got 'imm' .*; did you mean 'method'?"),
    "a table": ("run guanabara --set traks.method=imm", 2, ": traks: got .* for an unknown setting, needed .*; did you mean 'tracks'?"),
    "radar for radars": ("run radar.toml", 2, "radar.toml: radar: got .* for an unknown setting, needed .*; did you mean 'radars'?"),
    "two radars of one name": ("run twice.toml", 2, "twice.toml: radars: got the name 'north' 2 times, needed each once"),
    "a missing area": ("run areas.toml", 2, r"areas.toml: area: got nothing, needed a table \[area\] with latitude_deg, longitude_deg"),
    "a misspelt area": ("run areas.toml", 2, "aera: got .* for an unknown setting, needed .*; did you mean 'area'?"),
    "bytes in TOML": ("run bytes.toml", 2, "bytes.toml: line 2: got the byte 0xff, needed text in UTF-8"),
    "no TOML": ("run round.toml", 2, r"round.toml: got text that is not TOML, needed \[table\] and key = value: .*line 1"),
    "empty TOML": ("run empty.toml", 2, "empty.toml: got a file without settings, needed name, title"),
    "no such file": ("run none.toml", 2, "none.toml: there is no such file"),
    "a folder": ("run folder", 2, "folder: got a folder without scenario.toml, needed one with it"),
    "a recording": ("run bytes.csv", 2, "bytes.csv: got a file that is no .toml, needed a scenario; `coastwatch fuse`"),
    "a short period": ("run guanabara --set period_s=1e-9", 2, "--set period_s: got 1e-09, needed 0.01 or more"),
    "many cycles": ("run guanabara --set cycles=100000000000", 2, "--set cycles: got 100000000000, needed 100000000 or less"),
    "a long warm-up": ("run guanabara --set warmup_s=1e12", 2, "warmup_s: got 1e.12 with period_s = 3 .* needed at most 100000000 cycles"),
    "many workers": ("run guanabara --workers 1000000", 2, "--workers: got '1000000', needed 1 to 4096"),
    "a large seed": ("run guanabara --seed 99999999999999999999", 2, "--seed: got '9{20}', needed 0 to 9223372036854775807"),
    "text for a number": ("run guanabara --set radars.0.rpm=fast", 2, "--set radars.0.rpm: got 'fast', needed a number"),
    "a radar that is not there": ("run guanabara --set radars.9.rpm=3", 2, "--set radars.9: got '9', needed a number from 0 to 1"),
    "bytes in CSV": ("fuse --ais bytes.csv", 2, "bytes.csv:2, column time: got .*, which is no time"),
    "a file without its option": ("fuse ais.csv", 2, "fuse: got 'ais.csv', .*; a file follows --ais, --plots, --bearings or --tracks"),
    "a table to send as AIS": ("feed bytes.csv --to ais+udp://127.0.0.1:22510", 2, "bytes.csv: got no AIS sentence in 2 lines, needed"),
    "nothing to send": ("feed empty.csv --to ais+tcp://127.0.0.1:22510", 2, "empty.csv: got no AIS sentence in 0 lines"),
    "noise to send": ("feed noise.db --to ais+tcp://127.0.0.1:22510", 2, "noise.db: got no AIS sentence in 2."),
    "no file to send": ("feed none.nmea --to ais+udp://127.0.0.1:22510", 2, "none.nmea: there is no such file"),
    "no path to send": ("feed ./none --to ais+udp://127.0.0.1:22510", 2, "none: there is no such file"),
    "no scenario to send": ("feed guanabra --to ais+udp://127.0.0.1:22510", 2, "scenario: got 'guanabra', needed one of"),
    "an option of a feed": (
        "serve guanabara --feed ais+file:l.nmea?form=start", 2, "got the option form in .* of name, from; did you mean 'from'?"
    ),
    "an option of another format": ("serve guanabara --feed ais+tcp://h:1?25/1=north", 2, "got the option 25/1 in .*, needed one of name$"),
    "an option of no format": ("feed guanabara --to ais+tcp://127.0.0.1:22511?bogus", 2, "got the option bogus in .*, needed one of name$"),
    "an option of video": ("serve guanabara --feed video+udp://:1?25-1=north", 2, "got the option 25-1 .* name, SAC/SIC, date, interface"),
    "an option of a broker": ("serve guanabara --feed ais+mqtt://h/t?usr=me", 2, "option usr .* user, password-file; did you mean 'user'"),
    "an option of a file": ("fuse --feed json+file:a.jsonl?prot=3", 2, "option prot in .*, needed one of name, port, source"),
    "an option of an output": ("serve guanabara --out cot+udp://h:1?rat=2", 2, "out: got the option rat in .*, needed one of rate;"),
    "an option of a region": ("serve guanabara --role centre --region ws://h:1?nam=a", 2, r"region: got .* .unknown: nam., needed"),
    "where a file is read from": ("serve guanabara --feed ais+file:l.nmea?from=end", 2, "feed: got from=end in .*, needed from=start"),
    "a token of the past": ("token add ana --expires 2020-01-01", 2, "--expires: got 2020-01-01T00:00:00.000Z, needed .* after now"),
    "a format as an option": ("picture --gpx", 2, "got '--gpx', .*; did you mean '--format gpx'?"),
    "an empty CSV": ("fuse --ais empty.csv", 2, "empty.csv: got an empty file"),
    "a folder for a CSV": ("fuse --ais folder", 2, "folder: got a folder, needed a file"),
    "a longitude": (
        f"fuse --plots empty.csv --radar {NORTH.replace('-1', '1000')}", 2, "--radar north: longitude_deg: got 1000.0, needed 180 or less"
    ),
    "two radars": (f"fuse --plots empty.csv --radar {NORTH} --radar {NORTH}", 2, "--radar: got the name 'north' 2 times, needed it once"),
    "a column": (
        "fuse --ais bytes.csv --columns mmsy=mmsi", 2, "--columns: got 'mmsy', needed one of ais: .*; did you mean 'mmsi'?"
    ),
    "an unknown kind of database": ("picture --db postgres://x/y", 2, "a database of 'postgres', needed .*; did you mean 'postgresql'?"),
    "another kind of database": ("picture --db mysql://x/y", 2, "database: got 'mysql://x/y', a database of 'mysql', needed"),
    "an empty database name": ("picture --db=", 2, "--db: got an empty text, needed a URL or the path of an SQLite file"),
    "an empty database name of a run": ("run guanabara --db=", 2, "--db: got an empty text, needed"),
    "an empty database name of a server": ("serve --db=", 2, "--db: got an empty text, needed"),
    "an upgrade of nothing": ("db upgrade --db foo://bar", 2, "database: got 'foo://bar', a database of 'foo', needed the path"),
    "no database": ("picture --db none.db", 1, "none.db: there is no such database; `coastwatch run` makes one"),
    "a folder for a database": ("picture --db folder", 1, "folder: is a folder, needed a database file"),
    "an empty database": ("picture --db empty.db", 1, "empty.db: holds no tables"),
    "bytes for a database": ("picture --db noise.db", 1, "noise.db: is not an SQLite database"),
    "another program's database": ("picture --db other.db", 1, "other.db: not a Coastwatch database: it has cargo"),
    "the same, upgraded": ("db upgrade --db other.db", 1, "other.db: not a Coastwatch database: it has cargo"),
    "a database of a newer version": ("db upgrade --db newer.db", 1, "newer.db: schema: got 9999, needed .* newer Coastwatch"),
    "a run": ("picture --db ours.db --run 7", 1, "ours.db: there is no run 7, the database holds none; `coastwatch runs` lists all"),
    "a vessel": ("track 9999 --db ours.db --run 7", 1, "there is no run 7"),
    "a question": ("query dark_vesels --db ours.db", 2, "query: got 'dark_vesels', needed one of .*; did you mean 'dark_vessels'?"),
    "a parameter": (
        "query dark_vessels --set min_sog=3 --db ours.db", 2, "query dark_vessels: got min_sog, needed .*; did you mean 'min_sog_kn'?"
    ),
    "an option of another question": (
        "query dark_vessels --from 2025-06-01 --db ours.db", 2, "query dark_vessels: got --from, needed --set with min_sog_kn"
    ),
    "a limit of all rows": ("track 1 --format csv --limit 2 --db ours.db", 2, "track --limit: got it with --format csv, needed"),
    "a picture that is no PNG": ("plot --output a.jpg --db ours.db", 2, "--output: got 'a.jpg', needed a name that ends with .png"),
    "a kind of alarm": ("query alarms --kind darc --db ours.db", 2, "parameter kind: got 'darc', needed .*; did you mean 'dark'?"),
    "a command": ("pictur", 2, "COMMAND: got 'pictur', needed one of run, .*; did you mean 'picture'?"),
    "an option": ("picture --bbix 1,2,3,4", 2, "picture: got '--bbix 1,2,3,4', which it does not take; did you mean '--bbox'?"),
    "a format": ("picture --format geojsn", 2, "--format: got 'geojsn', needed one of .*; did you mean 'geojson'?"),
    "an instant": ("picture --at yesterday", 2, "--at: got 'yesterday', needed an instant such as"),
    "a paper": ("reproduce rangle", 2, "reproduce: got 'rangle', needed one of .*rangel.*; did you mean 'rangel'?"),
    "no coastline": ("plot --db ours.db --run 7 --coastline not.geojson", 1, "there is no run 7"),
    "a folder for the output": ("query --output folder", 2, "folder: got a folder, needed a file"),
    "no folder for the output": ("query --output none/x.csv", 2, "none/x.csv: there is no folder none"),
}  # fmt: skip


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with wrong files."""
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "folder").mkdir()
    for name, sql in (
        ("other.db", "CREATE TABLE cargo (x)"),
        ("newer.db", "CREATE TABLE coastwatch_revision (version_num TEXT); INSERT INTO coastwatch_revision VALUES ('9999')"),
    ):
        raw = sqlite3.connect(tmp_path / name)
        raw.executescript(sql)
        raw.close()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_in_a_sentence_of_ours(case: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line, code, wanted = CASES[case]
    if "ours.db" in line:
        open_store(str(here / "ours.db")).close()
    assert main(line.split()) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("coastwatch: error: ")
    assert err.count("\n") == 1
    assert re.search(wanted.replace("?", r"\?"), err), err
    assert not FOREIGN.search(err.removeprefix("coastwatch: error: ")), err


@pytest.mark.parametrize("command", ["runs", "sensors"])
def test_the_help_of_a_command_is_of_its_own_formats(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    said = capsys.readouterr().out
    assert "csv" in said
    assert not re.search("gpx|parquet", said, re.IGNORECASE)


def test_control_characters_of_what_was_typed_are_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "\x1b[2Jgone"]) == 2
    assert r"\x1b[2Jgone" in capsys.readouterr().err
