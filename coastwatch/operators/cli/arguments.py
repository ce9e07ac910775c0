"""Arguments that several commands share, and how text becomes a time, a box or a setting."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

DEFAULT_DB = "sqlite:///coastwatch.db"

Box = tuple[float, float, float, float]


def add_db(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--db",
        metavar="URL",
        default=DEFAULT_DB,
        help=f"database: SQLAlchemy URL, or a path of an SQLite file (default: {DEFAULT_DB}, in this folder)",
    )


def add_run(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--run", metavar="ID", type=int, help="number of the run (default: the latest)")


def add_moment(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--at", metavar="UTC", type=utc, help="instant, ISO 8601, e.g. 2026-07-01T12:00:00Z (default: the last cycle)"
    )
    parser.add_argument(
        "--bbox",
        metavar="S,W,N,E",
        type=box,
        help="only what lies in this box, degrees; W > E crosses the antimeridian",
    )


def add_format(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--format", choices=("table", "csv", "geojson", "parquet"), default="table", help="default: table")
    parser.add_argument("--output", metavar="FILE", help="write here, not to the terminal; Parquet needs it")


def add_set(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], type=pair, dest="settings", help=what)


def pair(text: str) -> tuple[str, str]:
    """Key and value of KEY=VALUE."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise argparse.ArgumentTypeError(f"got {text!r}, needed KEY=VALUE")
    return key.strip(), value.strip()


def utc(text: str) -> float:
    """Seconds since the Unix epoch of an ISO 8601 instant; without a zone it is UTC."""
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed an instant such as 2026-07-01T12:00:00Z") from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def box(text: str) -> Box:
    """South, west, north, east in degrees."""
    try:
        south, west, north, east = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed four numbers S,W,N,E") from None
    if not (-90.0 <= south < north <= 90.0 and -180.0 <= west <= 180.0 and -180.0 <= east <= 180.0):
        raise argparse.ArgumentTypeError(f"got {text!r}, needed -90 <= S < N <= 90 and W, E within -180..180")
    return south, west, north, east


def whole(text: str) -> int:
    """A whole number, 0 or more."""
    if not text.strip().isdigit():
        raise argparse.ArgumentTypeError(f"got {text!r}, needed a whole number, 0 or more")
    return int(text)


def count(text: str) -> int:
    """A whole number, 1 or more."""
    number = whole(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed 1 or more")
    return number


def place(text: str) -> tuple[float, float]:
    """Latitude, longitude in degrees."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed LAT,LON") from None
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
        raise argparse.ArgumentTypeError(f"got {text!r}, needed a latitude within -90..90 and a longitude within -180..180")
    return latitude, longitude
