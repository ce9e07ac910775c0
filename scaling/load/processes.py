"""Memory and processor time of this process and of all that it started, from /proc. Linux alone."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

KIB = 1024
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def family(pid: int | None = None) -> list[int]:
    """This process, or another, and all that descend from it."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError):
                children.setdefault(int(_stat(int(entry.name))[1]), []).append(int(entry.name))
    return list(_below(os.getpid() if pid is None else pid, children))


def _below(pid: int, children: dict[int, list[int]]) -> Iterator[int]:
    yield pid
    for child in children.get(pid, []):
        yield from _below(child, children)


def _stat(pid: int) -> list[str]:
    """Fields of /proc/PID/stat after the name, which may hold blanks: state, parent, ..., 7 faults, ..., 11 and 12 ticks."""
    return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()


def _kib(path: Path, key: str) -> int:
    return next((int(line.split()[1]) for line in path.read_text("utf-8").splitlines() if line.startswith(f"{key}:")), 0)


def memory_bytes() -> tuple[int, int]:
    """What all processes hold now, and an upper bound of what they held at their peak; pages that they share count once.

    Now: the sum of PSS. Peak: the sum of the highest resident sizes (VmHWM), less what the resident sizes of now count more than once
    (RSS less PSS); as if all peaks had been at one time.
    """
    now = peak = 0
    for pid in family():
        with suppress(OSError):
            rollup, status = Path(f"/proc/{pid}/smaps_rollup"), Path(f"/proc/{pid}/status")
            pss, rss = _kib(rollup, "Pss"), _kib(rollup, "Rss")
            now += pss
            peak += _kib(status, "VmHWM") - (rss - pss)
    return now * KIB, peak * KIB


def faults() -> int:
    """Pages that the system had to lay into the memory of this process and of all below it that live, without reading a disk."""
    count = 0
    for pid in family():
        with suppress(OSError):
            count += int(_stat(pid)[7])
    return count


def processor_s() -> float:
    """Processor seconds, user and system, of this process and, in steps of its clock, of all below it that live."""
    ticks = 0
    for pid in family()[1:]:
        with suppress(OSError):
            ticks += sum(int(field) for field in _stat(pid)[11:13])
    return time.process_time() + ticks / TICKS_A_SECOND
