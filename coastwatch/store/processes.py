"""The process that writes a run: its number, the machine where that number is meant, and whether it is still there."""

from __future__ import annotations

import os
import platform
from enum import Enum
from pathlib import Path

PROC = Path("/proc")
BOOT, NAMESPACE = PROC / "sys/kernel/random/boot_id", PROC / "self/ns/pid"
"""Of Linux: since one boot, in one namespace, a number means one process at a time. Containers of a host have namespaces apart."""

STARTED = "start="
"""Before the time at which the process began, in clock ticks since the boot: a number that was given again has another one."""

ENDED = ("Z", "X")
"""States of a process that does nothing any more."""


class Presence(Enum):
    """Whether a process is still there."""

    HERE = "here"
    GONE = "gone"
    UNKNOWN = "unknown"  # it is of another machine, or of a system that does not say


def this_process() -> tuple[str, int]:
    """The machine on which this process runs, with when the process began, and its number there."""
    began = _began(os.getpid())
    return " ".join([_machine(), *([] if began is None else [STARTED + began])]), os.getpid()


def presence(machine: str | None, process: int | None) -> Presence:
    """Whether a process is still there. Args: machine, process: as of `this_process`."""
    name, _, began = (machine or "").partition(" " + STARTED)
    if machine is None or process is None or os.name != "posix" or name != _machine():
        return Presence.UNKNOWN
    try:
        os.kill(process, 0)  # sends nothing
    except ProcessLookupError:
        return Presence.GONE
    except OSError:  # there, but another user's
        pass
    now, fields = _began(process), _fields(process)
    if fields and fields[0] in ENDED:
        return Presence.GONE  # it has ended, and its parent has not asked how
    if not began or now is None:
        return Presence.UNKNOWN  # the number may have been given again
    return Presence.HERE if began == now else Presence.GONE


def _began(process: int) -> str | None:
    """When a process began, in clock ticks since the boot; None: the system does not say."""
    fields = _fields(process)
    return fields[19] if fields else None


def _fields(process: int) -> list[str]:
    """What Linux says of a process, from field 3, its state, on; field 2 may have blanks. Empty: the system does not say."""
    try:
        text = (PROC / str(process) / "stat").read_text("ascii", "replace")
    except OSError:
        return []
    return text.rpartition(")")[2].split()


def _machine() -> str:
    parts = [platform.node()]
    if BOOT.is_file():
        parts.append(BOOT.read_text("ascii").strip())
    if NAMESPACE.exists():
        parts.append(str(NAMESPACE.stat().st_ino))
    return " ".join(parts)
