"""Text from files and ships made safe to print: it cannot move the cursor of a terminal or start a formula."""

from __future__ import annotations

FORMULA = ("=", "+", "-", "@")
"""A spreadsheet computes a cell that begins so."""


def printable(text: str) -> str:
    r"""The text with every character that is not printable, such as control and direction marks, as its escape: \x1b, \u202e."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """The same for a text of several lines, which stay lines."""
    return "\n".join(map(printable, text.split("\n")))


def csv_cell(text: str) -> str:
    """The text as a cell of CSV: printable, and behind an apostrophe where a spreadsheet would take it for a formula."""
    text = printable(text)
    return f"'{text}" if text.startswith(FORMULA) else text
