"""Counts of the records that were refused or set aside, by kind, with the location of the first of each kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from coastwatch.batches import Array, Fault, FileContent
from coastwatch.spelling import printable

SET_ASIDE = "set aside: "
"""Prefix of the kinds of valid records that are not used: base stations, duplicates, comments of a gateway."""

EXAMPLE_LENGTH = 80


class Ledger:
    """Records of one file as they are read, and those of them that are neither in a report nor in a fault."""

    def __init__(self) -> None:
        self.read = 0
        self.beside: Counter[str] = Counter()


class Tally:
    """Counts of faults by kind, in order of the first of each kind, and what was taken from each file."""

    def __init__(self) -> None:
        self._faults: dict[str, Fault] = {}
        self._contents: list[FileContent] = []

    def add(self, kind: str, where: str, example: str | bytes = "", count: int = 1, *, used: bool = False) -> None:
        """Count records of a kind. The first call of a kind also stores its location and an example. Args: used: as of Fault.

        Both are stored printable: they come out in logs, lists and answers.
        """
        fault = self._faults.get(kind)
        if fault is not None:
            self._faults[kind] = replace(fault, count=fault.count + count)
            return
        text = example.decode("ascii", "backslashreplace") if isinstance(example, bytes) else example
        shown = printable(text[:EXAMPLE_LENGTH])[:EXAMPLE_LENGTH]
        self._faults[kind] = Fault(kind, count, printable(where), shown, used)

    def add_rows(
        self, kind: str, rows: Array, where: Callable[[int], str], example: Callable[[int], str], *, used: bool = False
    ) -> None:
        """Count the rows under a mask. `where` and `example` are called for the first row only. Args: used: as of Fault."""
        count = int(rows.sum())
        if count:
            first = int(rows.argmax())
            self.add(kind, where(first), example(first), count, used=used)

    def count(self, kind: str) -> int:
        """Number of faults of this kind so far."""
        return self._faults[kind].count if kind in self._faults else 0

    def add_file(self, content: FileContent) -> None:
        """Note what was taken from a file."""
        self._contents.append(content)

    def contents(self) -> tuple[FileContent, ...]:
        """What was taken from each file."""
        return tuple(self._contents)

    def faults(self) -> tuple[Fault, ...]:
        """One Fault per kind."""
        return tuple(self._faults.values())


def refused(faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    """The faults without the kinds that were only set aside."""
    return tuple(f for f in faults if not f.kind.startswith(SET_ASIDE))
