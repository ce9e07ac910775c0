"""The command line answers before anything heavy is imported (speed.md, section 7)."""

import subprocess
import sys

import pytest

HEAVY = {
    "numpy",
    "numba",
    "sklearn",
    "scipy",
    "polars",
    "matplotlib",
    "sqlalchemy",
    "alembic",
    "pydantic",
    "pyais",
    "filterpy",
    "tqdm",
}
CODE = """
import sys
from coastwatch.operators.cli import main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print("LOADED", *sorted({name.partition(".")[0] for name in sys.modules}))
"""


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["run", "--help"], ["run"], ["picture", "--bbox", "1"]])
def test_help_and_refusals_import_nothing_heavy(arguments: list[str]) -> None:
    done = subprocess.run([sys.executable, "-c", CODE, *arguments], capture_output=True, text=True, check=True, timeout=60)
    loaded = set(done.stdout.rpartition("LOADED")[2].split())
    assert loaded, done.stderr
    assert loaded & HEAVY == set()


def test_a_run_loads_what_reads_tables_and_what_scores_only_to_do_so() -> None:
    """Polars and scipy's optimisers take 50 MB of every process and a second and a half of its start."""
    code = """
import sys, coastwatch.pipeline, coastwatch.scenario, coastwatch.scores
print(*[name for name in ("polars", "scipy.optimize") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "\n"
