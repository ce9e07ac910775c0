"""What a server says, once a second: cycles, troubles, names of vessels, alarms, memory."""

from __future__ import annotations

import itertools
import json
import sqlite3
import threading
import time
from collections import Counter
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx2 as httpx
import numpy as np

from coastwatch.operators.api.answers import MOST_ROWS
from scaling.load.hold.senders import FIRST_SPOOFED
from scaling.load.hold.server import Server
from scaling.load.processes import KIB

PERIOD_S, ON_TIME_LOOKS = 3.0, 5
SPOOFED = range(FIRST_SPOOFED, FIRST_SPOOFED + 100_000)


@dataclass(frozen=True)
class Look:
    """One answer of the server."""

    at_s: float  # monotonic
    ready: bool
    late_s: float
    cycle: int
    memory: int  # bytes
    counts: dict[str, float]
    troubles: tuple[str, ...]

    @property
    def on_time(self) -> bool:
        return self.ready and self.late_s < PERIOD_S


@dataclass
class Watching:
    """Looks once a second, and reads the stream of alarms. Use it in a `with` block."""

    server: Server
    token: str
    looks: list[Look] = field(default_factory=list)
    unanswered: int = 0
    alarms: dict[str, str] = field(default_factory=dict)  # by id: the kind of each that the stream told
    _stop: threading.Event = field(default_factory=threading.Event)

    @property
    def headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"}

    def __enter__(self) -> Watching:
        for target in (self._look, self._listen):
            threading.Thread(target=target, daemon=True).start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._stop.set()

    def wait_until_on_time(self, after_s: float, longest_s: float) -> float:
        """Seconds from an instant until the server is on time for some looks in a row; inf: it never is."""
        while time.monotonic() < after_s + longest_s:
            found = [look for look in self.looks if look.at_s >= after_s]
            for k in range(len(found) - ON_TIME_LOOKS + 1):
                part = found[k : k + ON_TIME_LOOKS]
                if all(look.on_time for look in part) and part[-1].cycle > part[0].cycle:
                    return part[0].at_s - after_s
            time.sleep(0.5)
        return float("inf")

    def names(self) -> dict[int, int]:
        """The vessel that has each MMSI of an honest sender, of those that one vessel alone has."""
        answer = httpx.get(
            f"{self.server.address}/api/v1/picture",
            params={"columns": "vessel_id,mmsi", "limit": MOST_ROWS, "format": "json"}, headers=self.headers, timeout=20.0,
        )  # fmt: skip
        answer.raise_for_status()
        rows = [(int(row["mmsi"]), row["vessel_id"]) for row in answer.json()["vessels"] if row["mmsi"] is not None]
        count = Counter(mmsi for mmsi, _ in rows)
        return {mmsi: vessel for mmsi, vessel in rows if count[mmsi] == 1 and mmsi not in SPOOFED}

    def memory(self, from_s: float, to_s: float) -> float:
        """Median memory in a span of monotonic time, bytes."""
        found = [look.memory for look in self.looks if from_s <= look.at_s <= to_s and look.memory]
        return float(np.median(found)) if found else float("nan")

    def difference(self, name: str, from_s: float, to_s: float) -> float:
        """How much a counter of the server grew in a span. A server that was begun again counts from zero."""
        values = [look.counts.get(name, 0.0) for look in self.looks if from_s <= look.at_s <= to_s]
        return sum(max(b - a, 0.0) if b >= a else b for a, b in itertools.pairwise(values))

    def troubles(self, from_s: float, to_s: float) -> list[str]:
        """The kinds of troubles that the server said in a span."""
        return sorted({one for look in self.looks if from_s <= look.at_s <= to_s for one in look.troubles})

    def _look(self) -> None:
        with httpx.Client(headers=self.headers, timeout=5.0) as client:
            while not self._stop.wait(1.0):
                try:
                    ready = client.get(f"{self.server.address}/readyz")
                    status = client.get(f"{self.server.address}/api/v1/status")
                    if status.status_code != 200:
                        raise ValueError(status.status_code)
                    said = status.json()
                except (httpx.HTTPError, ValueError):
                    self.unanswered += 1
                    continue
                counts = {name: value for name, value in said.items() if isinstance(value, int | float)}
                troubles = tuple(f"{one['kind']} {one['name']}".strip() for one in said["troubles"])
                memory = _resident(self.server.pid)
                self.looks.append(
                    Look(time.monotonic(), ready.status_code == 200, said["late_s"], said["cycle"], memory, counts, troubles)
                )

    def _listen(self) -> None:
        """Note every alarm that the stream tells. It is opened again when it ends."""
        while not self._stop.is_set():
            with suppress(httpx.HTTPError, ValueError, KeyError):
                address, limits = f"{self.server.address}/api/v1/alarms/stream", httpx.Timeout(5.0, read=60.0)
                with httpx.stream("GET", address, headers=self.headers, timeout=limits) as stream:
                    for line in stream.iter_lines():
                        if line.startswith("data: ") and "alarm_id" in (row := json.loads(line[6:])):
                            self.alarms[row["alarm_id"]] = row["kind"]
                        if self._stop.is_set():
                            return
            time.sleep(0.5)


def _resident(pid: int) -> int:
    """Resident memory of a process, bytes; 0: it is gone."""
    with suppress(OSError, IndexError):
        return int(Path(f"/proc/{pid}/status").read_text("utf-8").partition("VmRSS:")[2].split()[0]) * KIB
    return 0


def alarms_of(database: Path) -> tuple[set[str], int]:
    """The alarms of the newest run by id, as the stream writes it, and how many overlap another one of their vessel and kind."""
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as raw:
        rows = raw.execute(
            "SELECT vessel_id, kind, subject, start_s, end_s FROM event WHERE run_id = (SELECT max(id) FROM run) "
            "AND kind NOT IN ('coasting', 'stationary') ORDER BY vessel_id, kind, subject, start_s"
        ).fetchall()
    ids = {f"{v}-{kind}-{round(start_s * 1000)}" + (f"-{subject}" if subject else "") for v, kind, subject, start_s, _ in rows}
    twice = 0
    for before, after in itertools.pairwise(rows):
        same = before[:3] == after[:3]
        twice += same and (before[4] is None or after[3] < before[4])
    return ids, twice


def runs_of(database: Path) -> int:
    """How many runs a database has."""
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as raw:
        return int(raw.execute("SELECT count(*) FROM run").fetchone()[0])
