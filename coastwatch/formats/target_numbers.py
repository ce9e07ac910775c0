"""Small numbers for vessels, for formats that have no room for their ids."""

from __future__ import annotations

from collections.abc import Sequence


class TargetNumbers:
    """A number for each vessel, the same one while it is in the picture. Vessels beyond the last number have none."""

    def __init__(self, numbers: range) -> None:
        self._every = numbers
        self._number_of: dict[int, int] = {}

    def keep(self, vessel_id: Sequence[int]) -> None:
        """Free the numbers of vessels that have left. Give numbers to new ones. Args: vessel_id: of the whole picture."""
        self._number_of = {vessel: self._number_of[vessel] for vessel in vessel_id if vessel in self._number_of}
        free = iter(sorted(set(self._every) - set(self._number_of.values())))
        for vessel in vessel_id:
            if vessel not in self._number_of and (number := next(free, None)) is not None:
                self._number_of[vessel] = number

    def get(self, vessel_id: int) -> int | None:
        """The number of a vessel; None: there was none left."""
        return self._number_of.get(vessel_id)
