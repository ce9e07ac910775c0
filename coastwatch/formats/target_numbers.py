"""Small numbers for vessels, for formats that have no room for their ids."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence


class TargetNumbers:
    """A number for each vessel, the same one while it is in the picture. Vessels beyond the last number have none.

    It is the next free one from the id of the vessel on, counted round. So vessels that come have the numbers that were free longest,
    and a server that is started again gives the same numbers, but for few.
    """

    def __init__(self, numbers: range) -> None:
        self._every = numbers
        self._number_of: dict[int, int] = {}

    def keep(self, vessel_id: Sequence[int]) -> None:
        """Free the numbers of vessels that have left. Give numbers to new ones. Args: vessel_id: of the whole picture."""
        self._number_of = {vessel: self._number_of[vessel] for vessel in vessel_id if vessel in self._number_of}
        taken, count = set(self._number_of.values()), len(self._every)
        fresh = [vessel for vessel in vessel_id if vessel not in self._number_of]
        crowded = []
        for vessel in fresh:
            number = self._every[vessel % count]
            if number in taken:
                crowded.append(vessel)
            else:
                self._number_of[vessel] = number
                taken.add(number)
        free = sorted(set(self._every) - taken) if crowded else []
        for vessel in crowded[: len(free)]:
            at = bisect_left(free, self._every[vessel % count])
            self._number_of[vessel] = free.pop(at if at < len(free) else 0)

    def get(self, vessel_id: int) -> int | None:
        """The number of a vessel; None: there was none left."""
        return self._number_of.get(vessel_id)
