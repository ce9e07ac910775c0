"""The command line answers before anything heavy is imported, and a command imports only what it needs."""

import json
import subprocess
import sys
from pathlib import Path

from coastwatch.store import open_store

NOT_TO_READ = {
    "numba",
    "llvmlite",
    "scipy",
    "sklearn",
    "matplotlib",
    "polars",
    "pyais",
    "filterpy",
    "pydantic",
    "alembic",
    "tqdm",
    "gpxpy",
    "shtab",
    "sqlalchemy.orm",
    "sqlalchemy.dialects.postgresql",
}
HEAVY = NOT_TO_READ | {"numpy", "sqlalchemy"}
MODELS = {f"coastwatch.{name}" for name in ("scenario", "sensors", "tracks", "picture", "cycle", "server", "workers")}
CODE = """
import json, sys
from coastwatch.operators.cli import main
for arguments in json.loads(sys.argv[1]):
    try:
        main(arguments)
    except SystemExit:
        pass
print("LOADED", *sorted(sys.modules))
"""


def loaded(commands: list[list[str]]) -> set[str]:
    """The modules inside packages, and these packages, that commands have imported; a lazy package that nobody used has no modules."""
    done = subprocess.run(
        [sys.executable, "-c", CODE, json.dumps(commands)], capture_output=True, text=True, check=True, timeout=60
    )
    names = {name for name in done.stdout.rpartition("LOADED")[2].split() if "." in name}
    assert names, done.stderr
    return names | {name.partition(".")[0] for name in names}


def test_help_and_refusals_import_nothing_heavy() -> None:
    asked = [["--help"], ["--version"], ["run", "--help"], ["run"], ["picture", "--bbox", "1"]]
    assert loaded(asked) & HEAVY == set()


MOST_MODULES = 520
"""Of commands that read, the standard library included: what is imported is most of its time."""


def test_commands_that_read_import_no_compiled_kernel_and_no_model(tmp_path: Path) -> None:
    """They run every few seconds on a watch: what they import is most of their time."""
    url = f"sqlite:///{tmp_path / 'x.db'}"
    open_store(url).__enter__()
    commands = [["picture"], ["track", "1"], ["sensors"], ["query", "alarms"], ["query"], ["runs"]]
    found = loaded([[*command, "--db", url] for command in commands])
    assert found & (NOT_TO_READ | MODELS) == set()
    assert len(found) < MOST_MODULES


def test_a_run_loads_what_reads_tables_and_what_scores_only_to_do_so() -> None:
    """Polars, scipy and pyais take 100 MB of every process and two seconds of its start."""
    code = """
import sys, coastwatch.cycle, coastwatch.scenario, coastwatch.scores
print(*[name for name in ("polars.dataframe", "scipy.optimize", "scipy.spatial", "scipy.special", "pyais") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "\n"


def test_one_spot_needs_no_clustering() -> None:
    """A picture of one spot starts without scikit-learn."""
    code = """
import sys, numpy as np
from coastwatch.spots.kmeans import KMeansSpots
position = np.arange(30.0).reshape(10, 3)
print(KMeansSpots()._fitted(position, np.arange(10), 1, None).tolist(), "sklearn" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "[[13.5, 14.5, 15.5]] False\n"
