"""Write down which kernels runs call, and with what, for `coastwatch compile`: after an edit of a kernel's arguments, or of who calls it,

python -m scaling.load.signatures

Runs the national picture at two sizes, one and two threads, with a database and its recording, and scenarios with what can be asked of
them, each in a process of its own, again until all is compiled: what Python called is then all that is loaded.
"""

from __future__ import annotations

import argparse
import io
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from typing import Any

from numba.core import event

from coastwatch.server import compiled

HEAD = """\
# Kernels that runs call and the types of their arguments. Made by `python -m scaling.load.signatures`;
# tests/server/test_compiled.py says when it must be made again.
"""
NATIONAL = ((2_000, 1, 8), (20_000, 2, 6))  # tracks, threads, cycles
SCENARIOS = ("guanabara", "context-driven-100")
SHORT = {"cycles": "25", "warmup_s": "30.0", "store.recording": "true", "store.checkpoint_every": "5"}
ASKED: tuple[tuple[str, ...], ...] = (
    ("picture",),
    ("picture", "--at", "2025-06-01T12:01:00Z"),
    ("track", "1"),
    ("sensors",),
    ("query",),
)


def national(tracks: int, threads: int, cycles: int) -> None:
    """The national picture into a scratch database."""
    from scaling.load.running import Load, measured

    with tempfile.TemporaryDirectory() as folder:
        settings = {"store.recording": "true"}
        store = f"sqlite:///{folder}/national.db"
        for _ in measured(Load(tracks, cycles, 0, threads, store, settings=settings, score=False)):
            pass


def scenario(name: str) -> None:
    """A shipped scenario, shortened, and what an operator asks of it."""
    from coastwatch.operators.cli import main
    from coastwatch.operators.stored import questions

    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        db = ("--db", f"{folder}/run.db")
        main(["run", name, *db, *(word for k, v in SHORT.items() for word in ("--set", f"{k}={v}"))])
        with redirect_stderr(io.StringIO()):  # a question that needs to be told a place says so, and is not asked
            for words in (*ASKED, *(("query", str(question[0])) for question in questions().rows)):
                main([*words, *db])


def called() -> Iterator[str]:
    """Lines of all that this process has called or, where nothing was to be compiled, loaded."""
    from numba.core.dispatcher import Dispatcher

    for name, module in sorted(sys.modules.items()):
        for value in vars(module).values() if name.startswith("coastwatch.") else ():
            if isinstance(value, Dispatcher) and value.py_func.__module__ == name:
                yield from (compiled.as_line(value, types) for types in value.overloads)


def seen(case: tuple[Any, ...]) -> set[str]:
    """The lines of one case, of a process in which nothing was compiled."""
    asked = [sys.executable, "-m", "scaling.load.signatures", "--case", json.dumps(case)]
    compiled_first = True
    while compiled_first:
        *lines, count = subprocess.run(asked, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()
        compiled_first = int(count) > 0
    print(f"{case}: {len(lines)} kernels", file=sys.stderr)
    return set(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", help=argparse.SUPPRESS)
    case = parser.parse_args().case
    if case:
        given = json.loads(case)
        with event.install_recorder("numba:compile") as compilations:
            (scenario if isinstance(given[0], str) else national)(*given)
        print(*called(), len(compilations.buffer), sep="\n")
        return
    with ThreadPoolExecutor(2) as pool:
        lines = set().union(*pool.map(seen, (*NATIONAL, *((name,) for name in SCENARIOS))))
    compiled.SIGNATURES.write_text(HEAD + "".join(f"{line}\n" for line in sorted(lines)), "utf-8")


if __name__ == "__main__":
    main()
