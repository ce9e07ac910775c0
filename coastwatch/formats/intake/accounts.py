"""What became of every record that was read: each is in a report, beside the reports, refused or set aside, and nowhere else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from coastwatch.batches import Fault, FileContent
from coastwatch.formats.intake.faults import SET_ASIDE

UNACCOUNTED = "records unaccounted for: the reader has lost or doubled them"
UNUSED = "reports after the end of the run, which should have been of the whole files"
LOSSES = (UNACCOUNTED, UNUSED)
"""Kinds of faults that no input may cause: a run that has one has not done what it was asked for."""


class Accounts(NamedTuple):
    """Counts of records."""

    read: int
    in_reports: int
    beside: tuple[tuple[str, int], ...]  # names and sizes, times, further sentences, truth: what and how many
    refused: int
    set_aside: int

    @property
    def unaccounted(self) -> int:
        """Records that were read and are nowhere; negative: that are somewhere and were not read."""
        return self.read - self.in_reports - sum(count for _, count in self.beside) - self.refused - self.set_aside


def accounts(contents: Sequence[FileContent], faults: Sequence[Fault]) -> Accounts:
    """The accounts of all files together. Args: faults: of the recording, not of what later stages drop."""
    beside: Counter[str] = Counter()
    for content in contents:
        beside.update(dict(content.beside))
    final = [fault for fault in faults if not fault.used]
    aside = sum(fault.count for fault in final if fault.kind.startswith(SET_ASIDE))
    return Accounts(
        sum(content.read for content in contents),
        sum(content.records for content in contents),
        tuple(sorted((what, count) for what, count in beside.items() if count)),
        sum(fault.count for fault in final) - aside,
        aside,
    )


def losses(contents: Sequence[FileContent], faults: Sequence[Fault], unused: int) -> tuple[Fault, ...]:
    """A fault for records that are unaccounted for, and one for those that the run has not used though it should have.

    Args: as of `accounts`; unused: reports after the end of a run of whole files.
    """
    account = accounts(contents, faults)
    names = ", ".join(content.name for content in contents[:3]) + (", ..." if len(contents) > 3 else "")
    lost = []
    if contents and account.unaccounted:
        lost.append(Fault(UNACCOUNTED, abs(account.unaccounted), names, str(account)))
    if unused:
        lost.append(Fault(UNUSED, unused, names, ""))
    return tuple(lost)
