"""Why a database cannot grow: its disk is full, its files have reached the limit of this process, or neither is known."""

from __future__ import annotations

import shutil
from pathlib import Path

FULL = ("is full", "no space left", "could not extend file")
FAILED = "disk i/o error"
"""What SQLite says of any other failure to write, a limit of the process among them."""

LEAST_BYTES = 1_000_000
"""Free on a disk, under which a failure is taken to be for want of room."""


def cannot_grow(where: str, said: str, page_bytes: int, *, here: bool) -> str | None:
    """A sentence where what a driver said is that it could not write; None where it is something else.

    Args: where: the path of an SQLite file, or for messages; here: whether it is a path; page_bytes: of its pages.
    """
    low, line = said.lower(), said.split("\n")[0]
    full = any(sign in low for sign in FULL)
    if not full and FAILED not in low:
        return None
    folder = Path(where).absolute().parent
    free = shutil.disk_usage(folder).free if here and folder.is_dir() else None
    most = _most_bytes() if here else None
    if not full and most is not None and any(_size(Path(where + end)) + page_bytes > most for end in ("", "-wal")):
        head, why = "file cannot grow", f"this process may write files of {most / 1e6:.1f} MB at most (ulimit -f): "
    else:
        head = "disk full" if full or (free is not None and free < LEAST_BYTES) else "cannot be written"
        why = "" if free is None else f"{free / 1e6:.1f} MB free in {folder}: "
    return f"{head}: {where}: {why}{line}; every whole cycle stored so far is kept"


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _most_bytes() -> int | None:
    """The largest file that this process may write; None: no limit, or a system that has none."""
    try:
        import resource
    except ImportError:
        return None
    soft = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if soft == resource.RLIM_INFINITY else soft
