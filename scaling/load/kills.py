"""Whether SIGKILL of a region or of its centre loses or repeats a cycle, with a simulation over real sockets:

    python -m scaling.load.kills --kills 10 [--while-writing 2] [--scenario NAME] [--set KEY=VALUE ...] [--seed N] [--json]

The region runs the scenario's radars, the centre takes its tracks and AIS. They are killed in turn, at random moments; some at the
moment when their database begins to be written. Nearly every cycle of a live run is written with a checkpoint.
"""

from __future__ import annotations

import argparse
import itertools
import json
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np

from coastwatch.operators.cli.arguments import count, whole
from coastwatch.server.timing import date_utc, machine

PERIOD_S = 1.0
PATIENCE_S = 900.0  # a busy machine that compiles the kernels for the first time
CYCLES_BETWEEN = 4
LONG = 3_000  # cycles of the simulation: two and a half hours
COASTWATCH = str(Path(sys.executable).with_name("coastwatch"))


def free_ports(number: int) -> list[int]:
    """Ports on which nobody listens now."""
    held = [socket.create_server(("127.0.0.1", 0)) for _ in range(number)]
    try:
        return [one.getsockname()[1] for one in held]
    finally:
        for one in held:
            one.close()


class Server:
    """A region or a centre in a process of its own."""

    def __init__(self, folder: Path, name: str, *words: str) -> None:
        self.db = folder / f"{name}.db"
        self._log = folder / f"{name}.log"
        self._command = [COASTWATCH, "serve", *words, "--db", str(self.db)]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, or start it again."""
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(self._command, stderr=log, stdout=log)

    def end(self, how: signal.Signals) -> None:
        """End it and wait until it is gone."""
        assert self._process is not None
        self._process.send_signal(how)
        self._process.wait(30.0)

    def rows(self, query: str) -> list[Any]:
        """What its database answers; nothing before it is there."""
        with suppress(sqlite3.OperationalError), closing(sqlite3.connect(f"file:{self.db}?mode=ro", uri=True)) as raw:
            return raw.execute(query).fetchall()
        return []

    def cycles(self) -> int:
        """Cycles stored."""
        found = self.rows("SELECT count(*) FROM cycle")
        return int(found[0][0]) if found else 0

    def wait_for_writing(self) -> None:
        """Wait until a transaction begins to be written: the write-ahead log changes."""
        log, until_s = Path(f"{self.db}-wal"), time.monotonic() + PATIENCE_S
        before = log.stat().st_mtime_ns
        while log.stat().st_mtime_ns == before and time.monotonic() < until_s:
            time.sleep(0.0005)

    def has_checkpoint_of_last_cycle(self) -> bool:
        """Whether the newest cycle was written with a checkpoint."""
        found = self.rows("SELECT (SELECT max(cycle) FROM checkpoint) = (SELECT max(number) FROM cycle)")
        return bool(found and found[0][0])

    def vessels(self) -> set[int]:
        """The vessels that are there now."""
        return {row[0] for row in self.rows("SELECT vessel_id FROM presence WHERE to_cycle IS NULL")}

    def wait(self, more: int) -> None:
        """Wait until it has stored so many further cycles. Raises: TimeoutError with the end of its log."""
        assert self._process is not None
        wanted, until_s = self.cycles() + more, time.monotonic() + PATIENCE_S
        while self.cycles() < wanted:
            if self._process.poll() is not None or time.monotonic() > until_s:
                raise TimeoutError(f"{self.db.stem}: no cycle was stored: {self._log.read_text('utf-8')[-2000:]}")
            time.sleep(0.05)


def started(folder: Path, scenario: str, given: Sequence[str]) -> tuple[Server, Server, subprocess.Popen[bytes]]:
    """The region, the centre and the simulation that feeds them. Args: given: settings of both servers, KEY=VALUE."""
    plots, ais, of_region, of_centre = free_ports(4)
    settings = ["--set", f"period_s={PERIOD_S}", "--set", "warmup_s=0", *(word for pair in given for word in ("--set", pair))]
    region = ["--role", "region", "--port", str(of_region), "--feed", f"json+listen://127.0.0.1:{plots}"]
    centre = ["--role", "centre", "--port", str(of_centre), "--feed", f"ais+listen://127.0.0.1:{ais}"]
    centre += ["--region", f"ws://127.0.0.1:{of_region}?name=north"]
    made = [Server(folder, name, scenario, *settings, *words) for name, words in (("region", region), ("centre", centre))]
    to = ["--to", f"json+tcp://127.0.0.1:{plots}", "--to", f"ais+tcp://127.0.0.1:{ais}"]
    try:
        for server in made:
            server.start()
            server.wait(1)
    except BaseException:
        for server in made:
            with suppress(AssertionError):
                server.end(signal.SIGKILL)
        raise
    command = [COASTWATCH, "feed", scenario, *to, "--set", f"cycles={LONG}"]
    return made[0], made[1], subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


def figures(region: Server, centre: Server) -> dict[str, Any]:
    """What the databases say: runs, cycles that are missing or there twice, cycles of the region that the centre used."""
    out: dict[str, Any] = {}
    for server in (region, centre):
        numbers = [row[0] for row in server.rows("SELECT number FROM cycle ORDER BY run_id, number")]
        times = np.array([row[0] for row in server.rows("SELECT time_s FROM cycle ORDER BY run_id, number")])
        out[server.db.stem] = {
            "runs": server.rows("SELECT count(*) FROM run")[0][0],
            "cycles": len(numbers),
            "gaps": sum(b != a + 1 for a, b in itertools.pairwise(numbers)),
            "gaps_in_time": int((np.abs(np.diff(times) - PERIOD_S) > 1e-6).sum()),
            "largest_vessel_id": server.rows("SELECT max(vessel_id) FROM presence")[0][0],
            "vessels": server.rows("SELECT count(*) FROM presence WHERE to_cycle IS NULL")[0][0],
        }
    used = centre.rows("SELECT region_run, first_seq, last_seq, late FROM region_intake ORDER BY cycle, number")
    pairs = list(itertools.pairwise(used))
    out["intake"] = {
        "region_runs": len({row[0] for row in used}),
        "cycles": sum(last - first + 1 for _, first, last, _ in used),
        "missing": sum(max(after[1] - before[2] - 1, 0) for before, after in pairs),
        "twice": sum(max(before[2] - after[1] + 1, 0) for before, after in pairs),
        "late": sum(row[3] for row in used),
    }
    return out


def is_right(found: dict[str, Any]) -> bool:
    """Whether no cycle is missing or twice, and both went on with one run."""
    servers = all(
        found[name]["runs"] == 1 and not found[name]["gaps"] + found[name]["gaps_in_time"] for name in ("region", "centre")
    )
    intake = found["intake"]
    return servers and intake["region_runs"] == 1 and intake["cycles"] > 0 and not intake["missing"] + intake["twice"]


def kill(kills: int, while_writing: int, scenario: str, given: Sequence[str], seed: int) -> dict[str, Any]:
    """Kill them so many times in all, in turn. Args: while_writing: of these kills; given: settings. Returns: figures."""
    rng, kept, with_checkpoint = np.random.default_rng([seed, 1]), list[float](), 0
    writing = set(rng.permutation(kills)[:while_writing].tolist())
    with tempfile.TemporaryDirectory() as folder:
        region, centre, feed = started(Path(folder), scenario, given)
        try:
            while not (region.vessels() and centre.vessels()):
                for server in (region, centre):
                    server.wait(1)
            known = {server: server.vessels() for server in (region, centre)}
            for number in range(kills):
                for server in (region, centre):
                    server.wait(CYCLES_BETWEEN)
                killed = (region, centre)[number % 2]
                known[killed] = killed.vessels()
                time.sleep(PERIOD_S * rng.random())
                if number in writing:
                    killed.wait_for_writing()
                    with_checkpoint += killed.has_checkpoint_of_last_cycle()
                killed.end(signal.SIGKILL)
                killed.start()
                killed.wait(CYCLES_BETWEEN)
                kept.append(len(known[killed] & killed.vessels()) / max(len(known[killed]), 1))
                said = (
                    f"{number + 1} of {kills} kills, {centre.cycles()} cycles of the centre, {kept[-1]:.0%} of its vessels kept"
                )
                print(said, file=sys.stderr, flush=True)
            for server in (region, centre):
                server.wait(CYCLES_BETWEEN)
        finally:
            feed.kill()
            feed.wait()
            for server in (centre, region):
                with suppress(subprocess.TimeoutExpired, AssertionError):
                    server.end(signal.SIGINT)
        more = {"least_share_of_vessels_kept": min(kept), "cycle_before_had_a_checkpoint": with_checkpoint}
        return figures(region, centre) | more


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=count, default=10, help="in all, in turn region and centre (default: 10)")
    parser.add_argument("--while-writing", type=whole, default=0, metavar="N", help="of these, while a cycle is written")
    parser.add_argument("--scenario", default="guanabara")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of region and centre")
    parser.add_argument("--seed", type=int, default=1, help="of the moments of the kills")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = {"date": date_utc(), "machine": machine(), "kills": options.kills, "while_writing": options.while_writing}
    found["settings"] = options.set
    found |= kill(options.kills, options.while_writing, options.scenario, options.set, options.seed)
    found["right"] = is_right(found)
    if options.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:8} {value}")
    sys.exit(0 if found["right"] else 1)


if __name__ == "__main__":
    main()
