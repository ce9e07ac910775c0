"""A file that another program writes: what is added to it, also after it was renamed, and from its beginning after it was emptied."""

from __future__ import annotations

import os
from pathlib import Path

MARK_BYTES = 256
"""Bytes before the place of reading that are compared, to notice that a file was emptied and has grown past that place again."""


class GrowingFile:
    """An open file. It stays open when it is renamed or deleted, so that its end is not lost."""

    def __init__(self, path: Path, sender: int, at_start: bool) -> None:
        """Args: sender: number of who sends its lines; at_start: read it from its beginning, else from its end on. Raises: OSError."""
        self._file = os.open(path, os.O_RDONLY)
        found = os.fstat(self._file)
        self.identity = found.st_dev, found.st_ino
        self.sender = sender
        self.rest = b""  # the beginning of a line whose end has not come
        self.grown_s = 0.0  # when something came last, by any clock
        self._position = 0 if at_start else found.st_size
        self._looked: tuple[int, int] | None = None  # size and time of modification at the last look
        self._mark = self._before()

    def is_emptied(self) -> bool:
        """Whether the file was emptied since the last look. Then it is read from its beginning. Raises: OSError."""
        found = os.fstat(self._file)
        looked = found.st_size, found.st_mtime_ns
        if looked == self._looked:
            return False
        emptied = found.st_size < self._position or self._before() != self._mark
        self._looked = looked
        if emptied:
            self._position, self._mark = 0, b""
        return emptied

    def more(self, most: int) -> bytes:
        """What was added, up to so many bytes. Raises: OSError."""
        data = os.pread(self._file, most, self._position)
        if data:
            self._position += len(data)
            self._mark = (self._mark + data)[-MARK_BYTES:]
        return data

    def close(self) -> None:
        """Give the file back."""
        os.close(self._file)

    def _before(self) -> bytes:
        begin = max(self._position - MARK_BYTES, 0)
        return os.pread(self._file, self._position - begin, begin)
