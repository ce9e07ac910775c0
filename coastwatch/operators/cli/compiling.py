"""`coastwatch compile`: all that a run needs compiled, before a run waits for it."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import Any

from coastwatch.operators.cli import progress
from coastwatch.operators.cli.arguments import count


def add(commands: Any) -> None:
    """Adds `compile` to the parser."""
    text = (
        "Compile what runs need, over all processors, and keep it on disk. Without it the first cycles of the first run take "
        "a minute longer, and that run keeps the memory of the compiler. Kernels that are there already are left as they are."
    )
    compiling = commands.add_parser("compile", help="compile what runs need before they need it", description=text)
    compiling.add_argument(
        "--processes", metavar="N", type=count, default=0, help="processes to compile in (default: one a processor)"
    )
    compiling.add_argument("--json", action="store_true", help="print one JSON object: kernels, compiled, elapsed_s and more")
    compiling.set_defaults(act=_compile)


def _compile(options: argparse.Namespace) -> int:
    from coastwatch.server.compiled import compile_known
    from coastwatch.workers import processors

    with progress.shown("kernel") as show:
        made = compile_known(processors(options.processes), show)
    if options.json:
        print(json.dumps(asdict(made)))
        return 0
    done = f"{made.compiled} functions compiled" if made.compiled else "all were compiled before"
    print(
        f"{made.kernels} kernels: {done}, {made.elapsed_s:.0f} s by {made.processes} processes; kept in {', '.join(made.folders)}"
    )
    return 0
