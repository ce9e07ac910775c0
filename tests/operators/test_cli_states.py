"""Every command that reads a database, on one that holds a vessel in every state, in every format."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import polars
import pytest
import states_world as world

from coastwatch import store
from coastwatch.batches import Flag
from coastwatch.operators import plot, presentation, scene
from coastwatch.operators.cli import main
from coastwatch.operators.cli.parser import make_parsers

pytestmark = pytest.mark.contract

SPAN = ["--bbox=-24,-44,-22,-42", "--from", "2025-06-01T12:00:00Z", "--to", "2025-06-01T12:01:00Z"]
PAST = ["--at", "2025-06-01T12:00:10Z"]
READS: dict[str, list[list[str]]] = {
    "runs": [[], ["--json"], ["keep", "1"]],
    "picture": [[], PAST, ["--bbox=-24,-44,-22,-42"]],
    "track": [[str(number), *more] for number in world.ID_OF.values() for more in ([], ["--json"])],
    "traffic": [SPAN],
    "encounters": [[*SPAN, "--within", "2000", "--min-sog", "0"]],
    "replay": [[], [*SPAN]],
    "sensors": [[], ["--json"], PAST],
    "plot": [[], PAST, ["--bbox=-23.1,-43.3,-22.9,-43.1"]],
    "query": [[], *[[name] for name in store.operator_queries()]],
    "db check": [[]],
    "db upgrade": [[]],
}
WRITES = {"run", "fuse", "db backup", "db restore", "db prune"}
LASTS = {"serve"}  # until it is stopped: tests/server
FORMATS = {
    "picture": ("table", "csv", "geojson", "parquet"),
    "traffic": ("table", "csv", "geojson", "parquet"),
    "encounters": ("table", "csv", "geojson", "parquet"),
    "query": ("table", "csv", "parquet"),
    "replay": ("csv", "parquet"),
}
PARAMETERS = {"mmsi": str(world.mmsi_of("radar and AIS")), "latitude_deg": "-22.98", "longitude_deg": "-43.2"}
IN_NOW = {state.name for state in world.STATES if state.last_cycle == world.CYCLES}


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> str:
    return world.write(tmp_path_factory.mktemp("states") / "x.db")


def with_database() -> list[str]:
    """Names of the commands that take a database, verbs after their group."""
    return [n for n, parser in make_parsers().items() if any("--db" in action.option_strings for action in parser.arguments)]


NO_POSITION = {"audit", "load", "sensor_coverage", "sensor_registration"}
"""Questions whose answer has no position."""


def test_the_answer_to_a_question_is_geojson_if_it_has_a_position(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    refused = set()
    for name, question in store.operator_queries().items():
        given = [f"--set={key}={PARAMETERS[key]}" for key, p in question.parameters.items() if p.default is None]
        code = main(["query", name, "--db", url, *given, "--format", "geojson"])
        out, err = capsys.readouterr()
        if code:
            assert "GeoJSON needs a position" in err
            refused.add(name)
        else:
            assert json.loads(out)["type"] == "FeatureCollection"
    assert refused == NO_POSITION


def test_every_command_that_takes_a_database_is_tried() -> None:
    assert set(with_database()) == set(READS) | WRITES | LASTS


def answer(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    code = main(arguments)
    out, err = capsys.readouterr()
    assert (code, err) == (0, ""), arguments
    return out


@pytest.mark.parametrize("command", READS)
def test_a_command_answers(command: str, url: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for given in READS[command]:
        for form in FORMATS.get(command, ("",)):
            line = [*command.split(), *given, "--db", url]
            if command == "query" and given:
                takes = store.operator_queries()[given[0]].parameters
                line += [f"--set={key}={PARAMETERS[key]}" for key, p in takes.items() if p.default is None]
            if command == "plot":
                line += ["--output", str(tmp_path / "picture.png")]
            if form == "parquet":
                line += ["--output", str(tmp_path / "rows.parquet")]
            said = answer([*line, "--format", form] if form else line, capsys)
            if form == "parquet":
                assert len(polars.read_parquet(tmp_path / "rows.parquet").columns) > 0
            elif form == "geojson":
                assert json.loads(said)["type"] == "FeatureCollection"
            else:
                assert said


@pytest.mark.parametrize("at", [[], PAST])
def test_the_picture_has_every_state(at: list[str], url: str, capsys: pytest.CaptureFixture[str]) -> None:
    rows: dict[int, Any] = {}
    for row in csv.DictReader(io.StringIO(answer(["picture", "--db", url, "--format", "csv", *at], capsys))):
        rows[int(row["vessel_id"])] = row
    expected = IN_NOW if not at else set(world.ID_OF)
    assert set(rows) == {world.ID_OF[name] for name in expected}
    name_of = {world.RADAR: "guanabara", world.AIS: "ais", world.SONAR: "copacabana"}
    for state in world.STATES:
        if state.name in expected:
            row = rows[world.ID_OF[state.name]]
            assert row["flags"] == presentation.flag_words(state.flags), state
            assert row["sources"] == ",".join(name_of[k] for k in sorted(set(state.sources))), state
            assert row["mmsi"] == (str(world.mmsi_of(state.name)) if state.mmsi else ""), state
            assert (row["sog_kn"] == "") == (not state.velocity), state
            assert (row["major_m"] == "") == (not state.covariance), state


@pytest.mark.parametrize("at_s", [None, 1748779210.0])
def test_the_plot_counts_each_vessel_as_what_it_is(at_s: float | None, url: str) -> None:
    with presentation.opened(url) as opened:
        made = scene.load(opened, presentation.run(opened, None), at_s, None, None)
        vessels = opened_ids(opened, at_s)
    kinds = dict(zip(vessels, made.kind.tolist(), strict=True))
    for state in world.STATES:
        if world.ID_OF[state.name] in kinds:
            assert kinds[world.ID_OF[state.name]] == kind_of(state), state
    legend = plot.draw(made).axes[0].get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    for kind in (scene.AIS_ONLY, scene.RADAR_ONLY, scene.SONAR_ONLY, scene.FUSED, scene.COASTING):
        assert f"{kind} ({list(kinds.values()).count(kind)})" in texts
    assert set(kinds.values()) == {scene.AIS_ONLY, scene.RADAR_ONLY, scene.SONAR_ONLY, scene.FUSED, scene.COASTING}


def opened_ids(opened: store.Store, at_s: float | None) -> list[int]:
    return [int(k) for k in store.picture(opened, 1, at_s).column("vessel_id")]


def kind_of(state: world.State) -> str:
    """The symbol of a vessel is that of its radar and AIS tracks; a sonar counts only if it is alone."""
    kinds = {
        (): scene.COASTING,
        (world.SONAR,): scene.SONAR_ONLY,
        (world.AIS,): scene.AIS_ONLY,
        (world.RADAR,): scene.RADAR_ONLY,
        (world.RADAR, world.RADAR): scene.RADAR_ONLY,
        (world.RADAR, world.SONAR): scene.RADAR_ONLY,
        (world.RADAR, world.AIS): scene.FUSED,
        (world.RADAR, world.AIS, world.SONAR): scene.FUSED,
    }
    return kinds[state.sources]


QUESTIONS_OF_FLAGS = {
    "dark_vessels": Flag.DARK,
    "ais_without_radar": Flag.AIS_WITHOUT_RADAR,
    "contradicted": Flag.AIS_CONTRADICTED,
    "mmsi_twice": Flag.MMSI_TWICE,
    "impossible_speed": Flag.IMPOSSIBLE_SPEED,
    "stationary": Flag.STATIONARY,
}


@pytest.mark.parametrize("question", QUESTIONS_OF_FLAGS)
def test_a_question_about_a_flag_finds_the_vessels_that_have_it(
    question: str, url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = answer(["query", question, "--db", url, "--format", "csv"], capsys)
    found = {int(row["vessel_id"]) for row in csv.DictReader(io.StringIO(said))}
    flag = QUESTIONS_OF_FLAGS[question]
    assert found == {world.ID_OF[s.name] for s in world.STATES if s.flags & flag and s.name in IN_NOW}


@pytest.mark.parametrize("again", ["--resume", "--restart"])
def test_a_run_goes_into_a_database_that_holds_others(again: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = world.write(tmp_path / "x.db")
    small = ["--set", "input.count=14", "--set", "cycles=3", "--set", "warmup_s=0"]
    assert main(["run", "context-driven-100", "--db", url, again, *small]) == 0
    capsys.readouterr()
    answer(["db", "check", "--db", url], capsys)
    first = answer(["picture", "--db", url, "--run", "1", "--format", "csv"], capsys)
    assert len(first.splitlines()) == 1 + len(IN_NOW)


def test_files_are_fused_into_a_database_that_holds_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url, table = world.write(tmp_path / "x.db"), tmp_path / "ais.csv"
    lines = ["time,mmsi,latitude,longitude,sog,cog", *(f"{1.7e9 + 3 * k},235070762,50.7,-1.2,0.0,0.0" for k in range(20))]
    table.write_text("\n".join(lines) + "\n")
    assert main(["fuse", "--ais", str(table), "--station=mast,50.7,-1.2,30", "--db", url]) == 0
    capsys.readouterr()
    answer(["db", "check", "--db", url], capsys)
    assert len(answer(["picture", "--db", url, "--format", "csv"], capsys).splitlines()) == 2
