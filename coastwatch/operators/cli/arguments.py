"""Options that several commands share, and the types of option values: text to a time, a box, a number or a sensor."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from coastwatch.errors import InputError
from coastwatch.operators.typed import box, utc
from coastwatch.shipped import DEFAULT_DB
from coastwatch.spelling import did_you_mean

MOST_WORKERS = 4096
VIDEO = ("beam_deg", "pulse_m", "db_per_level")
"""What is needed to read the video of a radar."""

RADAR = ("name", "latitude_deg", "longitude_deg", "range_nm", "rpm", "range_noise_m", "azimuth_noise_deg", *VIDEO)
STATION = ("name", "latitude_deg", "longitude_deg", "range_nm")
SONAR = ("name", "latitude_deg", "longitude_deg", "range_nm", "bearing_noise_deg")
NEEDED = {RADAR: 5, STATION: 4, SONAR: 4}
"""How many of the values of a sensor must be given; the others have defaults."""

SCENARIOS, QUESTIONS = "_coastwatch_scenarios", "_coastwatch_questions"
"""Functions of a shell that complete a name; `parser.print_completion` defines them."""

FILES = {"bash": "_shtab_compgen_files", "zsh": "_files", "tcsh": "f"}


INVALID_CHOICE = re.compile(r"argument ([^:]+): invalid choice: '(.*)' \(choose from (.*)\)", re.DOTALL)
"""How argparse refuses an unknown command or choice."""


class Parser(argparse.ArgumentParser):
    """A parser that knows its arguments, and raises InputError instead of printing its usage: every error is printed in one way."""

    def __init__(self, **settings: Any) -> None:
        self.arguments: list[argparse.Action] = []
        super().__init__(**settings)

    def add_argument(self, *names: str, **settings: Any) -> argparse.Action:
        """As of argparse."""
        self.arguments.append(super().add_argument(*names, **settings))
        return self.arguments[-1]

    def add_one_of(self, options: Mapping[str, dict[str, Any]]) -> None:
        """Add options of which at most one is given. Args: options: as of `add_argument`, by name."""
        group = self.add_mutually_exclusive_group()
        self.arguments += [group.add_argument(name, **settings) for name, settings in options.items()]

    def error(self, message: str) -> NoReturn:
        if refused := INVALID_CHOICE.fullmatch(message):
            option, word, choices = refused.groups()
            words = [choice.strip("' ") for choice in choices.split(",")]
            message = f"{option}: got {word!r}, needed one of {', '.join(words)}{did_you_mean(word, words)}"
        raise InputError(f"{message.removeprefix('argument ')} (see {self.prog} --help)")


class Version(argparse.Action):
    """Reads the version only when it is asked for: to import what reads package metadata takes longer than parsing."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        from importlib.metadata import version

        print(f"coastwatch {version('coastwatch')}")
        parser.exit()


def completed_by(action: argparse.Action, function: str | None = None) -> None:
    """Says how a shell completes the value of an argument: by a function, or with files."""
    action.complete = FILES if function is None else {"bash": function, "zsh": function}  # type: ignore[attr-defined]


def add_db(parser: Parser) -> None:
    text = f"database: SQLAlchemy URL, or path of an SQLite file (default: {DEFAULT_DB}, in the working directory)"
    completed_by(parser.add_argument("--db", metavar="URL", type=database, default=DEFAULT_DB, help=text))


def add_run(parser: Parser) -> None:
    """Adds the database and the run in it."""
    add_db(parser)
    parser.add_argument(
        "--run",
        metavar="ID",
        type=whole,
        help="number of the run (default: the latest, or that of the same server which holds the time)",
    )


def add_moment(parser: Parser) -> None:
    text = "instant, ISO 8601, e.g. 2026-07-01T12:00:00Z (default: the last cycle)"
    parser.add_argument("--at", metavar="UTC", type=utc, help=text)
    add_box(parser, "only vessels in this box, degrees; W > E crosses the antimeridian")


def add_box(parser: Parser, text: str, required: bool = False) -> None:
    parser.add_argument("--bbox", metavar="S,W,N,E", type=box, required=required, help=text)


def add_span(parser: Parser) -> None:
    """Adds what a question about the past needs: database, run, box and two instants."""
    add_run(parser)
    add_box(parser, "the box, degrees; W > E crosses the antimeridian", required=True)
    parser.add_argument("--from", metavar="UTC", type=utc, dest="from_s", required=True, help="first instant, ISO 8601")
    parser.add_argument("--to", metavar="UTC", type=utc, dest="to_s", required=True, help="last instant, ISO 8601")


FORMATS = ("table", "csv", "json", "geojson", "gpx", "parquet")


def add_format(parser: Parser, formats: Sequence[str] = FORMATS) -> None:
    text = "default: table; gpx: waypoints for a chart plotter" if "gpx" in formats else "default: table"
    parser.add_argument("--format", choices=formats, default="table", help=text)
    text = "the same as --format json: one JSON list, an object per row"
    parser.add_argument("--json", action="store_const", const="json", dest="format", help=text)
    add_output(parser, parquet="parquet" in formats)


def add_rows(parser: Parser, formats: Sequence[str] = FORMATS) -> None:
    """Adds the format of rows, and which rows and columns."""
    add_format(parser, formats)
    text = "sort by columns, the first first; -NAME: descending, e.g. --sort=-sog_kn"
    parser.add_argument("--sort", metavar="NAME,...", type=names, default=(), help=text)
    parser.add_argument("--limit", metavar="N", type=whole, help="at most so many rows")
    parser.add_argument("--columns", metavar="NAME,...", type=names, default=(), help="only these columns, in this order")


def add_output(parser: Parser, *, parquet: bool = True) -> None:
    text = "write to this file instead of the terminal" + ("; Parquet needs it" if parquet else "")
    completed_by(parser.add_argument("--output", metavar="FILE", help=text))


def add_set(parser: Parser, text: str) -> None:
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], type=pair, dest="settings", help=text)


def add_running(parser: Parser) -> None:
    """Adds the options of every command that makes a run."""
    text = "processors that share the work (default: the scenario's, in its [workers])"
    parser.add_argument("--workers", metavar="N", type=workers, help=text)
    add_db(parser)
    resume = "continue the newest unfinished run of this scenario and seed from its last checkpoint"
    restart = "delete earlier runs of this scenario and seed, then start"
    one: dict[str, Any] = {"action": "store_true"}
    parser.add_one_of({"--resume": {**one, "help": resume}, "--restart": {**one, "help": restart}})
    parser.add_argument("--json", action="store_true", help="print one JSON object: scores, timings_s, database and more")


def database(text: str) -> str:
    """A URL or path, as it is: an empty one is that of a shell variable without a value."""
    if not text.strip():
        raise argparse.ArgumentTypeError("got an empty text, needed a URL or the path of an SQLite file")
    return text


def png_file(text: str) -> str:
    """The name of a PNG file."""
    if (suffix := Path(text).suffix) and suffix.lower() != ".png":
        raise argparse.ArgumentTypeError(f"got {text!r}, needed a name that ends with .png: only PNG is drawn")
    return text


def pair(text: str) -> tuple[str, str]:
    """Key and value of KEY=VALUE."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise argparse.ArgumentTypeError(f"got {text!r}, needed KEY=VALUE")
    return key.strip(), value.strip()


def names(text: str) -> tuple[str, ...]:
    """The names in NAME,NAME."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def column_names(text: str) -> dict[str, str]:
    """Our names of columns to those in a file, of OURS=YOURS,OURS=YOURS."""
    return dict(pair(part) for part in text.split(","))


def whole(text: str) -> int:
    """A whole number, 0 or more."""
    if not text.strip().isdigit():
        raise argparse.ArgumentTypeError(f"got {text!r}, needed a whole number, 0 or more")
    return int(text)


AGES = {"h": 3600.0, "d": 86_400.0, "w": 604_800.0}
"""Seconds of a unit of an age."""


def age(text: str) -> float:
    """Seconds of an age such as 12h, 30d or 8w."""
    number, unit = text.strip()[:-1], text.strip()[-1:]
    if unit not in AGES or not number.isdecimal() or len(number) > 6 or int(number) == 0:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed a whole number with h, d or w, such as 12h, 30d or 8w")
    return int(number) * AGES[unit]


def count(text: str) -> int:
    """A whole number, 1 or more."""
    number = whole(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed 1 or more")
    return number


def speed(text: str) -> float:
    """How many times as fast as the clock."""
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0.1 <= number <= 100.0:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed 0.1 to 100")
    return number


def workers(text: str) -> int:
    """A number of processors."""
    number = count(text)
    if number > MOST_WORKERS:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed 1 to {MOST_WORKERS}")
    return number


def seed(text: str) -> int:
    """A whole number that a database can hold."""
    number = whole(text)
    if number >= 2**63:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed 0 to {2**63 - 1}")
    return number


def position(text: str) -> tuple[float, float]:
    """Latitude, longitude in degrees."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed LAT,LON") from None
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
        raise argparse.ArgumentTypeError(f"got {text!r}, needed a latitude within -90..90 and a longitude within -180..180")
    return latitude, longitude


def sensor(names: tuple[str, ...]) -> Callable[[str], dict[str, str | float]]:
    """A function from text such as "north,50.7,-1.2,12" to the settings of a sensor. Args: names: RADAR, STATION or SONAR."""

    def read(text: str) -> dict[str, str | float]:
        parts = [part.strip() for part in text.split(",")]
        if not NEEDED[names] <= len(parts) <= len(names):
            raise argparse.ArgumentTypeError(f"got {text!r}, {len(parts)} values, needed {_form(names)}")
        try:
            return {names[0]: parts[0], **{n: float(p) for n, p in zip(names[1:], parts[1:], strict=False) if p}}
        except ValueError as error:
            raise argparse.ArgumentTypeError(f"got {text!r}: {error}; needed {_form(names)}") from None

    return read


def written_as(names: tuple[str, ...]) -> str:
    """How the value of a sensor's option is written, for its help."""
    optional = "" if len(names) == NEEDED[names] else "; values in brackets are optional"
    return f'"{_form(names)}"{optional}'


def _form(names: tuple[str, ...]) -> str:
    """name,...,rpm[,range_noise_m[,azimuth_noise_deg]]."""
    needed, optional = names[: NEEDED[names]], names[NEEDED[names] :]
    return ",".join(needed) + "".join(f"[,{name}" for name in optional) + "]" * len(optional)
