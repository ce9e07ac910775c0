"""A server with a coast of vessels live at the speed of the clock, over sockets: cycles on time, lag, memory, drops:

    python -m scaling.load.live --vessels 10000 --minutes 10 [--workers N] [--json]

AIS sentences go over one TCP connection, plots and bearings as JSON lines over another. They are made before the clock starts, so that
the sender costs little. Exit code 1: a cycle was more than a period late, or a report was dropped or late.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx2 as httpx
import numpy as np
import tomli_w

from coastwatch.operators.cli.arguments import count
from coastwatch.server.feeds.address import Address, parsed
from coastwatch.server.feeds.sending import STEP_S, Batch, encoded, send
from coastwatch.server.timing import date_utc, machine
from scaling.load.chain.reports import State, initial_state, next_cycle
from scaling.load.chain.world import Size, World, build_world, conditions, scenario_document
from scaling.load.hostile import HOST, free_ports, wait_for_cycles
from scaling.load.kills import COASTWATCH
from scaling.load.processes import memory_bytes

PERIOD_S, MINUTE_S, WARM_UP_S = 3.0, 60.0, 60.0
"""What is before the warm-up is over does not count: windows and pictures fill."""

LEAD = 1.5
"""The input is begun so much later than its making should take."""

TRIAL_CYCLES = 3
Lines = dict[float, dict[str, list[bytes]]]
"""By instant, the lines of each format that are sent up to it."""


def made(world: World, cycles: int) -> Lines:
    """The lines of so many cycles of a coast, by the time at which they are received."""
    state, out = initial_state(world), Lines()
    for number in range(cycles):
        state, lines = _of_cycle(world, state)
        out |= lines
        print(f"\rmaking the input: {number + 1} of {cycles} cycles", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return out


def _of_cycle(world: World, state: State) -> tuple[State, Lines]:
    """The state after a cycle, and its lines."""
    until_s = world.plan.instant_s(state.cycle)
    after_s = until_s - world.plan.period_s
    state, reports = next_cycle(world, state)
    steps = after_s + STEP_S * np.arange(1, round(world.plan.period_s / STEP_S) + 1)
    out: Lines = {}
    for step_s in steps.tolist():
        part = reports.between(step_s - STEP_S, step_s)
        out[step_s] = {one: encoded(part, parsed(f"{one}+tcp://{HOST}:1"), world.sensors) for one in ("ais", "json")}
    return state, out


def batches(lines: Lines) -> Iterator[Batch]:
    """What `send` takes."""
    for instant_s, by_format in lines.items():

        def encode(address: Address, by_format: dict[str, list[bytes]] = by_format) -> list[bytes]:
            return by_format[address.format]

        yield instant_s, encode


@dataclass
class Seen:
    """What was seen of the server, once a second after the warm-up."""

    address: str
    pid: int
    rows: list[dict[str, Any]] = field(default_factory=list)
    faults: dict[str, int] = field(default_factory=dict)  # by feed and kind, since the start
    unanswered: int = 0

    def look(self) -> None:
        """Ask it once."""
        try:
            status = httpx.get(f"{self.address}/api/v1/status", timeout=5.0).json()
            feeds = httpx.get(f"{self.address}/api/v1/feeds", timeout=5.0).json()["feeds"]
        except (httpx.HTTPError, json.JSONDecodeError):
            self.unanswered += 1
            return
        kept = {name: status[name] for name in ("cycles", "cycles_late", "late_s", "cycle_ms", "vessels")}
        counted = {name: sum(one[name] for one in feeds) for name in ("late", "dropped", "refused", "records")}
        self.faults = {f"{one['name']}: {kind}": count for one in feeds for kind, count in one["faults"].items()}
        self.rows.append(kept | counted | {"clock_s": time.time(), "memory": memory_bytes(self.pid)[0]})

    def figures(self) -> dict[str, Any]:
        """What the looks come to. Memory is in MB."""
        first, last, newest = self.rows[0], self.rows[-1], {row["cycles"]: row for row in self.rows}
        late_s, cycle_ms = (np.array([row[name] for row in newest.values()]) for name in ("late_s", "cycle_ms"))
        minutes = [
            [row["memory"] for row in self.rows if k * MINUTE_S <= row["clock_s"] - first["clock_s"] < (k + 1) * MINUTE_S]
            for k in range(math.ceil((last["clock_s"] - first["clock_s"]) / MINUTE_S))
        ]
        return {
            "cycles": last["cycles"] - first["cycles"],
            "expected": round((last["clock_s"] - first["clock_s"]) / PERIOD_S, 1),
            "cycles_late": last["cycles_late"] - first["cycles_late"],
            "ready_after_due_s": _spread(late_s),
            "compute_s": _spread(cycle_ms / 1e3),
            "vessels": [min(row["vessels"] for row in self.rows), max(row["vessels"] for row in self.rows)],
            "reports": last["records"] - first["records"],
            **{name: last[name] - first[name] for name in ("late", "dropped", "refused")},
            "faults": self.faults,
            "memory_mb_by_minute": [round(float(np.median(part)) / 1e6) for part in minutes if part],
            "unanswered": self.unanswered,
        }


def _spread(seconds: Any) -> dict[str, float]:
    return {name: round(float(np.quantile(seconds, q)), 3) for name, q in (("median", 0.5), ("p99", 0.99), ("most", 1.0))}


def is_on_time(found: dict[str, Any]) -> bool:
    """Whether every cycle came, none a period late, and no report was dropped, refused or late."""
    came = abs(found["cycles"] - found["expected"]) <= 1.5
    return came and not any(found[name] for name in ("cycles_late", "late", "dropped", "refused", "unanswered"))


def run(vessels: int, minutes: float, workers: int, seed: int) -> dict[str, Any]:
    """Serve a coast, feed it and look. Returns: figures."""
    size = Size(vessels, math.ceil((WARM_UP_S + minutes * MINUTE_S) / PERIOD_S) + 2)
    page, ais, lines = free_ports(3)
    listen = [f"{one}+listen://{HOST}:{port}" for one, port in (("ais", ais), ("json", lines))]
    to = [parsed(text.replace("listen", "tcp")) for text in listen]
    address = f"http://{HOST}:{page}"
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "coast.toml"
        scenario.write_text(tomli_w.dumps(_of_server(scenario_document(size, seed))), "utf-8")
        serve = [COASTWATCH, "serve", str(scenario), "--db", f"{folder}/live.db", "--port", str(page), "--new"]
        serve += ["--workers", str(workers), *(word for one in listen for word in ("--feed", one))]
        server, stop = subprocess.Popen(serve, stdout=subprocess.DEVNULL), threading.Event()
        seen = Seen(address, server.pid)
        try:
            wait_for_cycles(address, server)
            input_lines = _input(size, seed)
            begin_s = next(iter(input_lines))
            if begin_s < time.time():
                raise RuntimeError("making the input took longer than expected: it should have begun already")
            threading.Thread(target=send, args=(batches(input_lines), to, 1.0, stop), kwargs={"now": True}, daemon=True).start()
            time.sleep(begin_s + WARM_UP_S - time.time())
            while time.time() < begin_s + WARM_UP_S + minutes * MINUTE_S and server.poll() is None:
                seen.look()
                time.sleep(1.0)
        finally:
            stop.set()
            server.send_signal(signal.SIGINT)
            ended = server.wait(120.0)
        if ended:
            raise RuntimeError(f"the server ended with {ended}")
    return seen.figures()


def _of_server(document: dict[str, Any]) -> dict[str, Any]:
    """The scenario without a beginning and an end."""
    return {name: value for name, value in document.items() if name not in ("start_utc", "cycles")}


def _input(size: Size, seed: int) -> Lines:
    """The lines of the coast from an instant on that lies far enough ahead for them to be made."""
    began = time.monotonic()
    trial = build_world(Size(size.vessels, TRIAL_CYCLES), {}, seed)
    made(trial, TRIAL_CYCLES)
    each_s = (time.monotonic() - began) / TRIAL_CYCLES
    start = datetime.fromtimestamp(math.ceil(time.time() + LEAD * each_s * size.cycles), UTC)
    return made(build_world(size, {"start_utc": start.isoformat()}, seed), size.cycles)


def main() -> int:
    """Run, and print the figures. Returns: 1 where something was late or lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vessels", type=count, default=10_000)
    parser.add_argument("--minutes", type=float, default=10.0, help="after a minute of warm-up (default: 10)")
    parser.add_argument("--workers", type=count, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = {"date": date_utc(), "machine": machine(), "vessels_simulated": options.vessels, "workers": options.workers}
    found["conditions"] = conditions(Size(options.vessels, 1), {})
    found |= run(options.vessels, options.minutes, options.workers, options.seed)
    found["on_time"] = is_on_time(found)
    if options.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:20} {value}")
    return 0 if found["on_time"] else 1


if __name__ == "__main__":
    sys.exit(main())
