"""Texts that people type or read: suggestions for a misspelt name, instants, lines without control characters, values for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

ONE_LINE = r"^[^\x00-\x1f\x7f-\x9f]*$"
"""A pattern of text without control characters: a database may refuse them, and they move the cursor of a terminal."""


def did_you_mean(got: str, names: Iterable[str]) -> str:
    """`; did you mean 'guanabara'?`, or nothing if no known name is similar."""
    import difflib  # only a refusal needs it

    listed = {name.lower(): name for name in names}
    similar = difflib.get_close_matches(got.lower(), listed, n=1, cutoff=0.6)
    return f"; did you mean {listed[similar[0]]!r}?" if similar else ""


def utc_text(time_s: float, timespec: str = "milliseconds") -> str:
    """Seconds since the Unix epoch as ISO 8601 text, UTC. Args: timespec: as of `datetime.isoformat`; "auto": no fraction where it is 0."""
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec=timespec).replace("+00:00", "Z")


def printable(text: str) -> str:
    r"""The text with every character that is not printable, such as control and direction marks, as its escape: \x1b, \u202e."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """The same for a text of several lines, which stay lines."""
    return "\n".join(map(printable, text.split("\n")))


def json_value(value: Any) -> Any:
    """The value with numpy numbers and tuples converted to JSON types, and null for a number that is not finite."""
    if isinstance(value, Mapping):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(item) for item in value]
    if hasattr(value, "tolist"):
        return json_value(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
