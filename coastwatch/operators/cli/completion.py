"""`completion`: the script with which a shell completes commands, options, scenarios and questions."""

from __future__ import annotations

import argparse

import shtab

from coastwatch.operators.cli.arguments import QUESTIONS, SCENARIOS
from coastwatch.operators.cli.parser import make_parser
from coastwatch.shipped import operator_queries_folder, scenarios_folder


def completion(options: argparse.Namespace) -> int:
    names = {
        SCENARIOS: sorted(path.parent.name for path in scenarios_folder().glob("*/scenario.toml")),
        QUESTIONS: sorted(path.stem for path in operator_queries_folder().glob("*.sql")),
    }
    words = {function: " ".join(of) for function, of in names.items()}
    preamble = {
        "bash": "".join(f'{function}() {{ compgen -W "{listed}" -- "$1"; }}\n' for function, listed in words.items()),
        "zsh": "".join(f"{function}() {{ _values name {listed} }}\n" for function, listed in words.items()),
    }
    print(shtab.complete(make_parser(), options.shell, preamble=preamble.get(options.shell, "")))
    return 0
