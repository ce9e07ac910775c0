"""Values that people type on the command line and in addresses of the API."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

Box = tuple[float, float, float, float]


def utc(text: str) -> float:
    """Seconds since the Unix epoch of an ISO 8601 instant; without a time zone it is UTC."""
    try:
        moment = datetime.fromisoformat(text.strip())
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC).timestamp()
    except (ValueError, OverflowError):  # the second: of no year from 1 to 9999 in UTC
        raise argparse.ArgumentTypeError(f"got {text!r}, needed an instant such as 2026-07-01T12:00:00Z") from None


def box(text: str) -> Box:
    """South, west, north, east in degrees."""
    try:
        south, west, north, east = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed four numbers S,W,N,E") from None
    if not (-90.0 <= south < north <= 90.0 and -180.0 <= west <= 180.0 and -180.0 <= east <= 180.0):
        raise argparse.ArgumentTypeError(f"got {text!r}, needed -90 <= S < N <= 90 and W, E within -180..180")
    return south, west, north, east
