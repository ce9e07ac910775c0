"""Memory and processor time of this process and its descendants, from /proc. Linux only."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

KIB = 1024
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def process_tree(pid: int | None = None) -> list[int]:
    """Process ids of this process, or of another, and of all its descendants."""
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
    """Fields of /proc/PID/stat after the name: 0 state, 1 parent, 7 minor page faults, 11 and 12 user and system ticks."""
    return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()


def _kib(path: Path, key: str) -> int:
    return next((int(line.split()[1]) for line in path.read_text("utf-8").splitlines() if line.startswith(f"{key}:")), 0)


def memory_bytes(pid: int | None = None) -> tuple[int, int]:
    """Memory of all processes now, and an upper bound of their peak, in bytes; shared pages count once.

    Args: pid: of the first process, else this one.

    Now: the sum of PSS. Peak: the sum of the highest resident sizes (VmHWM), less the pages now counted more than once
    (RSS less PSS). The bound assumes that all processes peaked at one time.
    """
    now = peak = 0
    for one in process_tree(pid):
        with suppress(OSError):
            rollup, status = Path(f"/proc/{one}/smaps_rollup"), Path(f"/proc/{one}/status")
            pss, rss = _kib(rollup, "Pss"), _kib(rollup, "Rss")
            now += pss
            peak += _kib(status, "VmHWM") - (rss - pss)
    return now * KIB, peak * KIB


def page_faults() -> int:
    """Minor page faults, without disk access, of this process and its live descendants."""
    count = 0
    for pid in process_tree():
        with suppress(OSError):
            count += int(_stat(pid)[7])
    return count


def processor_s() -> float:
    """Processor seconds, user and system, of this process and its live descendants; theirs in steps of the system clock tick."""
    ticks = 0
    for pid in process_tree()[1:]:
        with suppress(OSError):
            ticks += sum(int(field) for field in _stat(pid)[11:13])
    return time.process_time() + ticks / TICKS_PER_S
