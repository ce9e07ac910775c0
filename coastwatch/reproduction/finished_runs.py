"""Records of finished runs, one file per run in the output folder. A run with a record is not run again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coastwatch.errors import InputError
from coastwatch.server.run import version
from coastwatch.shipped import PACKAGE

MEASURING = (
    "measuring.py",
    "region_inputs.py",
    "side_by_side.py",
    "systems.py",
    "targets.py",
    "track_loss.py",
    "trackers.py",
    "two_filters.py",
)  # of this folder; the others only present the records, or hold settings, which are in the key of a record


def code() -> str:
    """The version, and a digest of every module that can change a record."""
    here = Path(__file__).parent
    below = (p for p in PACKAGE.rglob("*.py") if p.relative_to(PACKAGE).parts[0] not in ("operators", "reproduction"))
    digest = hashlib.sha256()
    for path in sorted([*below, *(here / name for name in MEASURING)]):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return f"{version()}+{digest.hexdigest()[:12]}"


class FinishedRuns:
    """The runs in an output folder."""

    def __init__(self, output: str) -> None:
        """Makes the folder. Raises: InputError if it cannot be written."""
        self.folder = Path(output)
        self._runs = self.folder / "runs"
        try:
            self._runs.mkdir(parents=True, exist_ok=True)
            probe = self._runs / f".{os.getpid()}"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise InputError(f"--output: got {output!r}, needed a folder that can be written: {error.strerror}") from error

    def record(self, key: str) -> dict[str, Any] | None:
        """The record of a run; None if it is absent or incomplete."""
        try:
            found: dict[str, Any] = json.loads((self._runs / f"{key}.json").read_text("utf-8"))
        except (FileNotFoundError, ValueError):
            return None
        return found

    def keep(self, key: str, record: Mapping[str, object]) -> None:
        """Writes the record of a run."""
        self.write(f"runs/{key}.json", json.dumps(record, allow_nan=False))

    def write(self, name: str, text: str) -> Path:
        """Writes a file of the folder, completely or not at all."""
        path = self.folder / name
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        beside.write_text(text, "utf-8")
        os.replace(beside, path)
        return path
