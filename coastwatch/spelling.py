"""Suggestions for a misspelt name."""

from __future__ import annotations

from collections.abc import Iterable


def did_you_mean(got: str, known: Iterable[str]) -> str:
    """`; did you mean 'guanabara'?`, or nothing if no known name is similar."""
    import difflib  # only a refusal needs it

    listed = {name.lower(): name for name in known}
    found = difflib.get_close_matches(got.lower(), listed, n=1, cutoff=0.6)
    return f"; did you mean {listed[found[0]]!r}?" if found else ""
