"""The questions an operator asks on watch: each a file db/operator/<name>.sql, portable over SQLite and PostgreSQL.

The first line of a file is `-- <title>`; then comment lines say what comes back, and
`-- parameter: radius_nm = 2, nautical miles around the position` declares a parameter with its default and meaning (`= required`
where there is none). `:run` is a parameter of a question; its default is the latest run. A question without it is of no run. What
a value may be is decided by the parameter's name or its unit, the last word of the name: LIMITS. A question without SQL is answered
by its function in COMPUTED.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from sqlalchemy import Connection, text

from coastwatch.batches import ALARM_KINDS
from coastwatch.errors import InputError, StoreError
from coastwatch.shipped import operator_queries_folder
from coastwatch.spelling import did_you_mean
from coastwatch.store.read.close_pairs import closest_approach, closest_pairs
from coastwatch.store.read.history_queries import history_of_mmsi
from coastwatch.store.read.past_tables import as_of
from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.runs import latest_run, run_exists
from coastwatch.store.schema.database import Store, reading

PARAMETER = re.compile(r"^-- parameter: (?P<name>\w+) = (?P<default>[^,]+), (?P<meaning>.+)$")
OF_RUN = re.compile(r"(?<![:\w]):run\b")
Value = int | float | str

LARGEST = 2**31 - 1  # both databases hold it, in every column
END_S = 253_402_300_800.0  # the end of the year 9999
LIMITS: dict[str, tuple[float, float]] = {
    "run": (1, LARGEST),
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 180.0),
    **dict.fromkeys(("from_s", "to_s"), (0.0, END_S)),
    **dict.fromkeys(("m", "nm", "kn", "seconds", "minutes", "cycles", "count", "intervals"), (0, LARGEST)),
}
"""Lowest and highest value, by name or by unit."""

COMPUTED: dict[str, Callable[[Connection, int, Mapping[str, Value]], Rows]] = {
    "closest_approach": closest_approach,
    "closest_pairs": closest_pairs,
    "history_of_mmsi": history_of_mmsi,
}
"""Questions answered in Python, because SQL would compare every pair of rows, or read and sort whole tables."""

ALARMS = "alarms"
"""Value of parameter `kind` for every kind of alarm."""

MMSI = re.compile(r"[0-9]{9,10}")
MOST_MMSI = 2**30 - 1  # the field of a message has 30 bits


class QuestionError(StoreError, InputError):
    """An unknown question or parameter, or one that is missing, of the wrong kind or out of its limits: exit code 2."""


class Parameter(NamedTuple):
    """A value that a question asks for. A default of None: it must be given."""

    default: Value | None
    meaning: str


class Question(NamedTuple):
    """One file of db/operator."""

    title: str
    parameters: dict[str, Parameter]
    explanation: str
    sql: str  # without comments; empty: the question is in COMPUTED

    @property
    def needed(self) -> str:
        """What a refusal says that it takes."""
        return f"--set with {', '.join((*self.parameters, 'run'))}"

    @property
    def of_run(self) -> bool:
        """Whether it is about a run. Else its rows belong to none, and it has a parameter `to_s`."""
        return not self.sql.strip() or OF_RUN.search(self.sql) is not None


def operator_queries() -> dict[str, Question]:
    """Every question by its name, sorted."""
    return {path.stem: _read_question(path) for path in sorted(operator_queries_folder().glob("*.sql"))}


def operator_query(
    store: Store, name: str, parameters: Mapping[str, Value | None] | None = None, at_s: float | None = None
) -> Rows:
    """The answer to one question; the database is only read.

    Args: parameters: by name, as numbers or as text; what is not given has its default. `run`: the number of a run; at_s: answer as
    it would have been then, seconds since 1970 UTC. A question of no run leaves out what is later.
    Raises: QuestionError: an unknown name or parameter, or a value of the wrong kind, out of its limits, or missing; StoreError.
    """
    questions = operator_queries()
    if name not in questions:
        raise QuestionError(f"query: got {name!r}, needed one of {', '.join(questions)}{did_you_mean(name, questions)}")
    question, arguments = questions[name], {key: value for key, value in (parameters or {}).items() if value is not None}
    run_id, takes = arguments.pop("run", None), question.parameters
    unknown = [key for key in arguments if key not in takes]
    missing = [key for key, parameter in takes.items() if parameter.default is None and key not in arguments]
    if unknown or missing:
        got, hint = (", ".join(unknown), did_you_mean(unknown[0], takes)) if unknown else (f"no {', '.join(missing)}", "")
        raise QuestionError(f"query {name}: got {got}, needed {question.needed}{hint}")
    values = {key: _value(name, key, arguments.get(key), parameter.default) for key, parameter in takes.items()}
    if not question.of_run:
        if run_id is not None:
            raise QuestionError(f"query {name}: got run {run_id}, needed none: its rows belong to no run")
        values["to_s"] = min(values["to_s"], values["to_s"] if at_s is None else at_s)
        with reading(store) as connection:
            return _fetched(connection, question.sql, values)
    run = latest_run(store) if run_id is None else int(_value(name, "run", run_id, 1))
    with reading(store) if at_s is None else as_of(store, run, at_s) as connection:
        run_exists(connection, store, run)
        if name in COMPUTED:
            return COMPUTED[name](connection, run, values)
        return _fetched(connection, question.sql, values | {"run": run})


def _fetched(connection: Connection, sql: str, values: Mapping[str, Value]) -> Rows:
    """The rows of a question in SQL, which cannot write."""
    if connection.dialect.name != "sqlite":
        return fetch_rows(connection, text(sql).bindparams(**values))
    connection.exec_driver_sql("PRAGMA query_only = ON")
    try:
        return fetch_rows(connection, text(sql).bindparams(**values))
    finally:
        connection.exec_driver_sql("PRAGMA query_only = OFF")


def limits(key: str) -> tuple[float, float]:
    """The lowest and the highest value of a parameter; without any where neither its name nor its unit is known."""
    return LIMITS.get(key) or LIMITS.get(key.rsplit("_", 1)[-1], (float("-inf"), float("inf")))


def _read_question(path: Path) -> Question:
    lines = path.read_text("utf-8").splitlines()
    comments = [line for line in lines if line.startswith("--")]
    parameters = [
        (match["name"], match["default"].strip(), match["meaning"]) for match in map(PARAMETER.match, comments) if match
    ]
    prose = [line[2:].strip() for line in comments[1:] if not PARAMETER.match(line)]
    return Question(
        title=comments[0][2:].strip(),
        parameters={
            name: Parameter(None if default == "required" else _number(default), meaning)
            for name, default, meaning in parameters
        },
        explanation=" ".join(prose),
        sql="\n".join(line.split("--")[0] for line in lines),
    )


def _number(written: str) -> Value:
    for kind in (int, float):
        try:
            return kind(written)
        except ValueError:
            continue
    return written


def _value(question: str, key: str, argument: Value | None, default: Value | None) -> Value:
    """What was given as the kind of number that the default is; the default where nothing was given."""
    if argument is None:
        assert default is not None  # else it is missing
        return default
    mmsi = f"{argument:09d}" if isinstance(argument, int) else str(argument)
    if key == "mmsi" and (not MMSI.fullmatch(mmsi) or int(mmsi) > MOST_MMSI):
        raise QuestionError(f"query {question}: parameter {key}: got {argument!r}, needed nine digits")
    kinds = (ALARMS, *ALARM_KINDS)
    if key == "kind" and argument not in kinds:
        needed = f"{', '.join(kinds)}{did_you_mean(str(argument), kinds)}"
        raise QuestionError(f"query {question}: parameter kind: got {argument!r}, needed one of {needed}")
    value = _number(argument) if isinstance(argument, str) else argument
    wants_number = not isinstance(default, str)
    if wants_number and (isinstance(value, str) or value != value or value in (float("inf"), float("-inf"))):
        raise QuestionError(f"query {question}: parameter {key}: got {argument!r}, needed a number")
    if isinstance(default, int) and value != int(value):
        raise QuestionError(f"query {question}: parameter {key}: got {argument!r}, needed a whole number")
    low, high = limits(key)
    if not isinstance(value, str) and not low <= value <= high:
        needed = f"{low:g} or more" if value < low and high == LARGEST else f"{low:g} to {high:.12g}"
        raise QuestionError(f"query {question}: parameter {key}: got {argument!r}, needed {needed}")
    return int(value) if isinstance(default, int) else float(value) if isinstance(default, float) else value
