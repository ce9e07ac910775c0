"""`coastwatch query`: the questions an operator asks on watch, each a file in db/operator."""

from __future__ import annotations

import argparse
from typing import Any

from coastwatch.operators.bad_input import BadInput
from coastwatch.operators.cli.arguments import add_db, add_format, add_run, add_set


def add(commands: Any) -> None:
    """Adds `query` to the parser."""
    text = "Answer one of the questions in db/operator; without a name, list them with their parameters."
    query = commands.add_parser("query", help="answer a question, or list the questions", description=text)
    query.add_argument("name", metavar="NAME", nargs="?", help="the question; none: list them")
    add_db(query)
    add_run(query)
    add_set(query, "a parameter of the question, e.g. --set count=20; repeatable")
    add_format(query)
    query.set_defaults(act=_query)


def _query(options: argparse.Namespace) -> int:
    from coastwatch.operators import export, stored

    if options.name is None:
        export.write(stored.questions(), options.format, options.output)
        return 0
    parameters = dict(options.settings)
    if options.run is not None and parameters.setdefault("run", str(options.run)) != str(options.run):
        raise BadInput(f"query: got --run {options.run} and --set run={parameters['run']}, needed one of them")
    with stored.opened(options.db) as store:
        rows = stored.answer(store, options.name, parameters)
    export.write(rows, options.format, options.output)
    return 0
