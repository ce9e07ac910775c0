"""Texts that people type: suggestions for a misspelt name, and lines without control characters."""

from __future__ import annotations

from collections.abc import Iterable

ONE_LINE = r"^[^\x00-\x1f\x7f-\x9f]*$"
"""A pattern of text without control characters: a database may refuse them, and they move the cursor of a terminal."""


def did_you_mean(got: str, known: Iterable[str]) -> str:
    """`; did you mean 'guanabara'?`, or nothing if no known name is similar."""
    import difflib  # only a refusal needs it

    listed = {name.lower(): name for name in known}
    found = difflib.get_close_matches(got.lower(), listed, n=1, cutoff=0.6)
    return f"; did you mean {listed[found[0]]!r}?" if found else ""
