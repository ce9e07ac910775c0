"""What counts that only grow did in the last minute."""

from __future__ import annotations

from collections import Counter, deque

WITHIN_S = 60.0


class LastMinute:
    """Counts by name, as they were at the instants of the last minute. Another thread may ask while one notes."""

    def __init__(self, fewest: int = 1) -> None:
        """Args: fewest: notes that are kept in any case, however old."""
        self._fewest = fewest
        self._notes: deque[tuple[float, Counter[str]]] = deque()

    def note(self, at_s: float, **counts: int) -> None:
        """Note the counts. Where one is less than before, its source began anew, and so does the minute. Args: at_s: now."""
        now = Counter(counts)
        if self._notes and not self._notes[-1][1] <= now:
            self._notes = deque()
        self._notes.append((at_s, now))
        while len(self._notes) > self._fewest and self._notes[0][0] < at_s - WITHIN_S:
            self._notes.popleft()

    def change(self, newest: int | None = None) -> Counter[str]:
        """By how much each count grew; nothing where none is noted. Args: newest: notes that are compared; None: all."""
        notes = list(self._notes)
        if newest is not None:
            notes = notes[-newest:]
        return notes[-1][1] - notes[0][1] if notes else Counter()
