"""The process that writes a run: its number, the machine where that number is meant, and whether it is still there."""

from __future__ import annotations

import os
import platform
from pathlib import Path

BOOT, NAMESPACE = Path("/proc/sys/kernel/random/boot_id"), Path("/proc/self/ns/pid")
"""Of Linux: since one boot, in one namespace, a number means one process at a time. Containers of a host have namespaces apart."""


def this_process() -> tuple[str, int]:
    """The machine on which this process runs, and its number there."""
    return _machine(), os.getpid()


def is_gone(machine: str | None, process: int | None) -> bool:
    """Whether a process of this machine has certainly ended. A process of another machine, or one whose number was given again, has not."""
    if machine is None or process is None or os.name != "posix" or machine != _machine():
        return False
    try:
        os.kill(process, 0)  # sends nothing
    except ProcessLookupError:
        return True
    except OSError:  # there, but another user's
        return False
    return False


def _machine() -> str:
    parts = [platform.node()]
    if BOOT.is_file():
        parts.append(BOOT.read_text("ascii").strip())
    if NAMESPACE.exists():
        parts.append(str(NAMESPACE.stat().st_ino))
    return " ".join(parts)
