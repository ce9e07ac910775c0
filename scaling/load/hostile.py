"""A server under hostile input on every socket while a good feed goes on: does anything stop, come late, or grow?

    python -m scaling.load.hostile [--minutes 10] [--seed 1]

The feeds, the API and its WebSocket get random bytes, damaged ASTERIX and lines of 1 MB, all on loopback. Some senders give a byte
a second, and some viewers read nothing. Exit code 1: a cycle was more than a period late, a feed ended, the API did not answer, or
memory grew.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import httpx2 as httpx

from coastwatch.formats.asterix.decoder import datagrams
from coastwatch.scenario import load_scenario
from scaling.load.processes import KIB

HOST, SCENARIO = "127.0.0.1", "guanabara"
PERIOD_S, WARM_UP_S, START_UP_S, MINUTE_S = 3.0, 30.0, 900.0, 60.0
SLOW_SENDERS = 40
"""Senders of a byte a second on each socket, and viewers that read nothing."""

MOST_GROWTH = 1.10
"""Memory at the end over that after the warm-up."""

LONG_LINE = 1 << 20
COASTWATCH = str(Path(sys.executable).with_name("coastwatch"))


@dataclass
class Attack:
    """What all attackers share."""

    ports: dict[str, int]  # page, ais, asterix, json
    stop: threading.Event = field(default_factory=threading.Event)
    sent: Counter[str] = field(default_factory=Counter)

    def connected(self, name: str) -> socket.socket:
        """A stream to a socket of the server."""
        return socket.create_connection((HOST, self.ports[name]), timeout=5.0)


def random_streams(attack: Attack, name: str, random: Random) -> None:
    """Connect, send up to 64 KiB of anything, go; three times a second."""
    while not attack.stop.wait(0.3):
        with suppress(OSError), attack.connected(name) as out:
            out.sendall(random.randbytes(random.randrange(1, 65_536)))
            attack.sent["random streams"] += 1


def long_lines(attack: Attack, name: str, random: Random) -> None:
    """Lines of 1 MB, one a second, some of them not ended."""
    while not attack.stop.wait(1.0):
        with suppress(OSError), attack.connected(name) as out:
            out.sendall(b"A" * LONG_LINE + random.choice((b"", b"\r\n")))
            attack.sent["lines of 1 MB"] += 1


def slow_senders(attack: Attack, name: str, random: Random) -> None:
    """Many connections that give a byte a second, opened again when they are closed."""
    begun = b"GET /api/v1/status HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: " if name == "page" else b"!AIVDM,1,1,,A,"
    held: list[socket.socket] = []
    with ExitStack() as stack:
        while not attack.stop.wait(1.0):
            for one in list(held):
                try:
                    one.sendall(b"a")
                except OSError:
                    held.remove(one)
                    one.close()
            while len(held) < SLOW_SENDERS:
                try:
                    made = stack.enter_context(attack.connected(name))
                    made.sendall(begun)
                except OSError:
                    break
                held.append(made)
                attack.sent["slow senders"] += 1


def random_datagrams(attack: Attack, name: str, random: Random) -> None:
    """Two hundred datagrams of anything a second."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        while not attack.stop.wait(0.05):
            for _ in range(10):
                out.sendto(random.randbytes(random.randrange(1, 1400)), (HOST, attack.ports[name]))
            attack.sent["random datagrams"] += 10


def cut_asterix(attack: Attack, name: str, random: Random) -> None:
    """Datagrams of a radar, cut anywhere, two hundred a second."""
    scenario = load_scenario(SCENARIO, {"cycles": "3", "warmup_s": "0"})
    plan = scenario.plan()
    reports = scenario.input.load(scenario.sensors(), 1, plan).reports.between(plan.start_s, plan.instant_s(2))
    whole = list(datagrams(reports.radar))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        while not attack.stop.wait(0.05):
            for _ in range(10):
                one = random.choice(whole)
                out.sendto(one[: random.randrange(1, len(one))], (HOST, attack.ports[name]))
            attack.sent["cut ASTERIX datagrams"] += 10


def deaf_viewers(attack: Attack, name: str, random: Random) -> None:
    """WebSockets that read nothing, or send what is no request."""
    asked = (
        b"GET /api/v1/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
    )
    with ExitStack() as stack:
        for _ in range(SLOW_SENDERS):
            with suppress(OSError):
                stack.enter_context(attack.connected(name)).sendall(asked)
        attack.sent["viewers that do not read"] += SLOW_SENDERS
        while not attack.stop.wait(0.5):
            with suppress(OSError), attack.connected(name) as out:
                out.sendall(asked)
                out.recv(4096)
                out.sendall(random.randbytes(20_000))
                attack.sent["sockets with garbage"] += 1


ATTACKS: dict[str, tuple[Callable[[Attack, str, Random], None], ...]] = {
    "page": (random_streams, long_lines, slow_senders, deaf_viewers),
    "ais": (random_streams, long_lines, slow_senders),
    "json": (random_streams, long_lines, slow_senders),
    "asterix": (random_datagrams, cut_asterix),
}


@dataclass
class Seen:
    """What was seen of the server, once a second."""

    cycles: list[tuple[float, float]] = field(default_factory=list)  # when, cycles so far
    late_s: list[float] = field(default_factory=list)
    answer_s: list[float] = field(default_factory=list)
    memory: list[int] = field(default_factory=list)  # bytes
    files: list[int] = field(default_factory=list)  # open ones
    records: list[int] = field(default_factory=list)  # of the feed of AIS
    vessels: list[int] = field(default_factory=list)
    unanswered: int = 0
    feeds: list[dict[str, Any]] = field(default_factory=list)  # at the end
    cycles_late: float = 0.0  # since the first look
    late_before: float | None = None  # while kernels were compiled

    def look(self, address: str, pid: int) -> None:
        """Ask the server once."""
        began = time.monotonic()
        try:
            status = httpx.get(f"{address}/api/v1/status", timeout=5.0).json()
            self.feeds = httpx.get(f"{address}/api/v1/feeds", timeout=5.0).json()["feeds"]
        except (httpx.HTTPError, json.JSONDecodeError, KeyError):
            self.unanswered += 1
            return
        self.answer_s.append(time.monotonic() - began)
        self.cycles.append((time.monotonic(), status["cycles"]))
        self.late_s.append(status["late_s"])
        self.vessels.append(status["vessels"])
        if self.late_before is None:
            self.late_before = status["cycles_late"]
        self.cycles_late = status["cycles_late"] - self.late_before
        self.records.append(next(feed["records"] for feed in self.feeds if feed["name"].startswith("ais")))
        with suppress(OSError):
            status_text = Path(f"/proc/{pid}/status").read_text("utf-8")
            self.memory.append(int(status_text.partition("VmRSS:")[2].split()[0]) * KIB)
            self.files.append(len(os.listdir(f"/proc/{pid}/fd")))

    def faults(self) -> list[str]:
        """What went wrong, one sentence each."""
        (first_s, first), (last_s, last) = self.cycles[0], self.cycles[-1]
        missing = (last_s - first_s) / PERIOD_S - (last - first)
        tenth = max(len(self.memory) // 10, 1)
        growth = sorted(self.memory[-tenth:])[tenth // 2] / sorted(self.memory[:tenth])[tenth // 2]
        steps = [b - a for a, b in zip(self.records, self.records[10:], strict=False)]
        found = [
            (missing > 1.5, f"{missing:.1f} cycles did not come"),
            (self.cycles_late > 0, f"{self.cycles_late:.0f} cycles were more than a period late"),
            (growth > MOST_GROWTH, f"memory grew to {growth:.2f} times"),
            (min(steps, default=1) <= 0, "nothing came of the good feed of AIS for 10 s"),
            (self.unanswered > 0, f"{self.unanswered} questions had no answer in 5 s"),
        ]
        return [said for wrong, said in found if wrong]


def free_ports(count: int) -> list[int]:
    """Ports that nobody uses now."""
    with ExitStack() as stack:
        made = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in made:
            one.bind((HOST, 0))
        return [int(one.getsockname()[1]) for one in made]


def main() -> int:
    """Attack, look, and print what was seen. Returns: 1 where something went wrong."""
    parser = argparse.ArgumentParser(prog="python -m scaling.load.hostile", description=__doc__.split(":")[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    attack = Attack(dict(zip(("page", "ais", "asterix", "json"), free_ports(4), strict=True)))
    page, ais, asterix, lines = attack.ports.values()
    address = f"http://{HOST}:{page}"
    seen = Seen()
    with tempfile.TemporaryDirectory() as folder:
        feeds = (f"ais+{{}}://{HOST}:{ais}", f"asterix+udp://{HOST}:{asterix}", f"json+{{}}://{HOST}:{lines}")
        serve = [COASTWATCH, "serve", SCENARIO, "--db", f"{folder}/live.db", "--port", str(page), "--new"]
        server = subprocess.Popen([*serve, *(word for one in feeds for word in ("--feed", one.format("listen")))])
        send = [
            COASTWATCH,
            "feed",
            SCENARIO,
            "--set",
            "cycles=2000",
            *(w for one in feeds for w in ("--to", one.format("tcp"))),
        ]
        sender = subprocess.Popen(send, stdout=subprocess.DEVNULL)
        threads: list[threading.Thread] = []
        try:
            wait_for_cycles(address, server)
            time.sleep(WARM_UP_S)
            for name, kinds in ATTACKS.items():
                for kind in kinds:
                    given = attack, name, Random(f"{options.seed} {name} {kind.__name__}")
                    threads.append(threading.Thread(target=kind, args=given, daemon=True))
            for thread in threads:
                thread.start()
            time.sleep(WARM_UP_S)  # buffers have been filled by then
            end = time.monotonic() + options.minutes * MINUTE_S
            while time.monotonic() < end and server.poll() is None:
                seen.look(address, server.pid)
                time.sleep(1.0)
            faults = seen.faults()
            faults += [] if server.poll() is None else [f"the server ended with {server.returncode}"]
            faults += [] if sender.poll() is None else [f"the good feed ended with {sender.returncode}"]
        finally:
            attack.stop.set()
            for thread in threads:
                thread.join(10.0)
            for process in (sender, server):
                process.send_signal(signal.SIGINT)
            ended = [process.wait(60.0) for process in (sender, server)]
    tell(attack, seen, options.minutes)
    faults += [] if ended[1] == 0 else [f"the server ended with {ended[1]} when it was asked to"]
    print("\n".join(faults) or "Nothing stopped, came late or grew.")
    return 1 if faults else 0


def wait_for_cycles(address: str, server: subprocess.Popen[bytes]) -> None:
    """Wait until pictures come. Raises: TimeoutError, RuntimeError."""
    until_s = time.monotonic() + START_UP_S
    while time.monotonic() < until_s:
        if server.poll() is not None:
            raise RuntimeError(f"the server ended with {server.returncode}")
        with suppress(httpx.HTTPError):
            if httpx.get(f"{address}/readyz", timeout=5.0).status_code == 200:
                return
        time.sleep(0.5)
    raise TimeoutError("no picture came")


def tell(attack: Attack, seen: Seen, minutes: float) -> None:
    """Print what was sent and what was seen."""
    print(f"{minutes:g} minutes of {', '.join(f'{count} {name}' for name, count in sorted(attack.sent.items()))}")
    answers = sorted(seen.answer_s)
    rows = {
        "cycles": f"{seen.cycles[-1][1] - seen.cycles[0][1]:.0f}, {seen.cycles_late:.0f} late, latest {max(seen.late_s):.2f} s after due",
        "vessels": f"{min(seen.vessels)} to {max(seen.vessels)}",
        "two answers of the API": f"median {answers[len(answers) // 2] * 1e3:.0f} ms, longest {answers[-1] * 1e3:.0f} ms",
        "memory": "{:.0f} MB at first, {:.0f} at last, {:.0f} at most".format(
            *(n / 1e6 for n in (seen.memory[0], seen.memory[-1], max(seen.memory)))
        ),
        "open files": f"{max(seen.files)} at most",
    }
    for feed in seen.feeds:
        rows[f"feed {feed['name']}"] = ", ".join(
            f"{name} {feed[name]}" for name in ("records", "refused", "dropped", "late", "connections")
        )
    for name, value in rows.items():
        print(f"{name:28} {value}")


if __name__ == "__main__":
    sys.exit(main())
