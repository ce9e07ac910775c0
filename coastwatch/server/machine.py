"""Date and machine of a computation, for reports."""

from __future__ import annotations

import os
import platform
from datetime import UTC, datetime
from pathlib import Path


def date_utc() -> str:
    """The date and time now, ISO 8601, whole minutes."""
    return datetime.now(UTC).isoformat(timespec="minutes").replace("+00:00", "Z")


def machine() -> dict[str, str | int | float]:
    """Processor, number of processors, operating system, Python, and the load of the last minute."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return {
        "processor": next(names, platform.machine()),
        "processors": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else 0.0,
    }
