"""The table of `make bench`: rows from the JSON of its parts, a sentence for a part that fails."""

import re
from pathlib import Path

import pytest

from scaling import bench
from scaling.bench import (
    HEADS,
    Part,
    Row,
    as_markdown,
    as_text,
    chain_rows,
    cycle_rows,
    heading,
    kernel_rows,
    last_object,
    measure,
    peer_rows,
    stage_rows,
)

pytestmark = pytest.mark.contract

CHECKOUT = Path(bench.__file__).parents[1]
GROUPED = re.compile(r'group="([^"]+)"\)\ndef (test_\w+)\(')
STAGES = {"context-driven-1000": {"tracks": {"median": 0.009}, "spots": {"median": 0.001}, "store": {"median": 0.012}}}
CYCLE = {
    "tracks": 100321,
    "store": "sqlite",
    "compute_s": {"median": 0.06, "share_of_period": 0.02},
    "cycle_s": {"median": 0.12, "share_of_period": 0.04},
    "rows_written": 66000,
    "memory_mib": {"peak": 512.4},
    "decisions": {"all": {"f1": 0.99987}},
}
CHAIN = {
    "load": {"vessels": 16_000},
    "store": "sqlite",
    "plots": 26_500.0,
    "stages_s": {"plots": {"median": 0.001, "share": 0.1}, "store": {"median": 0.3, "share": None}},
    "compute_s": {"median": 0.3, "share_of_period": 0.1},
    "cycle_s": {"median": 0.6, "share_of_period": 0.2},
    "rows_written": 12_000,
    "memory_mib": {"peak": 812.4},
    "quality": {"tracks": {"completeness": 0.9971}, "associations": {"f1": 0.9987}},
}
PEERS = {
    "rows": [
        {
            "peer": "stonesoup",
            "task": "association",
            "tracks": 200,
            "size_of": "tracks",
            "versions": {"stonesoup": "1.9.1"},
            "peer_ms": 163.5,
            "ours_ms": 2.0,
            "ratio": 81.75,
            "figure": "F1 %",
            "peer_quality": 99.25,
            "ours_quality": 100.0,
        }
    ],
    "missing": [],
}


def timed(group: str, name: str, least: float, rows: int) -> dict:
    return {"group": group, "name": name, "stats": {"min": least}, "extra_info": {"rows": rows}}


KERNELS = {
    "benchmarks": [
        timed("imm: filters", "test_ours_three", 0.004, 4000),
        timed("imm: filters", "test_baseline_filterpy", 0.1, 100),
        timed("windows: pairs", "test_ours", 0.02, 20_000),
        timed("windows: pairs", "test_baseline_numpy", 0.1, 20_000),
    ]
}


def test_compute_is_the_sum_of_the_compute_stages() -> None:
    assert stage_rows(STAGES)[-1] == Row("stages", "context-driven-1000: compute, the sum", "10.00 ms", "0.33 %")
    assert [row.part for row in stage_rows(STAGES)] == ["stage", "stage", "stage", "stages"]


def test_the_chain_has_compute_stages_storage_memory_and_quality() -> None:
    compute, plots, whole, memory = chain_rows(CHAIN)
    assert compute[1:5] == ("16,000 vessels: compute", "300.00 ms", "10.00 %", "F1 99.870 %, completeness 0.9971")
    assert plots[:4] == ("stage", "16,000 vessels: plots", "1.00 ms", "0.03 %")
    assert whole[1:5] == ("16,000 vessels: whole cycle, sqlite", "600.00 ms", "20.00 %", "12,000 rows")
    assert memory[1:5] == ("16,000 vessels: peak memory", "812 MiB", "", "26,500 plots a cycle")
    assert len(chain_rows(CHAIN | {"store": "none"})) == 3


def test_a_load_has_compute_storage_and_memory() -> None:
    compute, whole, memory = cycle_rows(CYCLE)
    assert compute[1:5] == ("100,321 tracks: compute", "60.00 ms", "2.00 %", "F1 99.987 %")
    assert whole[1:5] == ("100,321 tracks: whole cycle, sqlite", "120.00 ms", "4.00 %", "66,000 rows")
    assert memory[1:3] == ("100,321 tracks: peak memory", "512 MiB")
    assert len(cycle_rows(CYCLE | {"store": "none"})) == 2


def test_peers_stand_beside_ours_with_quality() -> None:
    (row,) = peer_rows(PEERS)
    wanted = "association, 200 tracks", "2.00 ms", "", "F1 % 100.00", "stonesoup 1.9.1", "163.50 ms", "F1 % 99.25", "81.8 x"
    assert row == Row("peers", *wanted)


def test_kernels_are_compared_by_the_time_of_a_row() -> None:
    first, second = kernel_rows(KERNELS)
    assert first == Row("kernels", "imm: filters, three", "1 us each", "", "", "filterpy", "1,000 us each", "", "1,000 x")
    assert (second.what, second.ratio) == ("windows: pairs", "5 x")


def test_the_table_as_text_and_as_markdown() -> None:
    rows = [*cycle_rows(CYCLE), *peer_rows(PEERS)]
    single = stage_rows(STAGES)[:1]
    text = as_text(["machine and date"], rows, ["a part that is missing"])
    assert text.splitlines()[:2] == ["# make bench", "# machine and date"]
    assert text.splitlines()[2].split()[0] == HEADS[0]
    assert text.endswith("# a part that is missing\n")
    markdown = as_markdown(["machine and date"], [*single, *rows], ["a part that is missing"]).splitlines()
    table = [line for line in markdown if line.startswith("|")]
    assert len(table) == 2 + len(rows)
    assert {line.count("|") for line in table} == {len(HEADS) + 1}
    assert markdown[-1] == "a part that is missing"


def test_the_heading_names_input_and_non_default_settings() -> None:
    assert any("finished tracks, no plots; non-default settings: fused_tracks.method=convex" in line for line in heading())


def test_a_missing_part_is_a_sentence() -> None:
    rows, missing = measure(Part("load", "scaling.no_such_module", ("--json",), cycle_rows))
    assert rows == []
    assert len(missing) == 1
    assert missing[0].startswith("python -m scaling.no_such_module --json: ")
    assert "No module named" in missing[0]


def test_a_part_with_other_output_is_a_sentence() -> None:
    rows, missing = measure(Part("load", "json.tool", ("--help",), cycle_rows))
    assert rows == []
    assert missing[0].startswith("python -m json.tool --help: its output cannot be read: ValueError got ")


def test_comments_around_the_json_do_not_matter() -> None:
    assert last_object('# 2 processors\n{"a": 1}\n{"b": 2}\n') == {"b": 2}
    with pytest.raises(ValueError, match="needed a line with a JSON object"):
        last_object("# nothing\n")


@pytest.mark.parametrize("path", sorted((CHECKOUT / "scaling" / "kernels").glob("bench_*.py")), ids=lambda p: p.stem)
def test_every_problem_of_a_kernel_has_one_baseline_and_ours(path: Path) -> None:
    groups: dict[str, list[str]] = {}
    for group, name in GROUPED.findall(path.read_text("utf-8")):
        groups.setdefault(group, []).append(name)
    assert groups
    assert list((CHECKOUT / "coastwatch" / "kernels").glob(f"*/{path.name.removeprefix('bench_')}"))
    for group, names in groups.items():
        assert group.startswith(f"{path.stem.removeprefix('bench_')}: ")
        assert sum(n.startswith("test_baseline_") for n in names) == 1
        assert sum(n.startswith("test_ours") for n in names) == len(names) - 1 > 0


def test_the_makefile_starts_it() -> None:
    assert "bench: .venv/.warm" in (CHECKOUT / "Makefile").read_text("utf-8")
    assert "\t$(BIN)/python -m scaling.bench\n" in (CHECKOUT / "Makefile").read_text("utf-8")
