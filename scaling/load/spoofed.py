"""Two servers on one honest feed, one of them with a second sender that invents vessels: is the honest picture the same?

    python -m scaling.load.spoofed [--mmsi 300000] [--rate 3000] [--seed 1] [--json]

The second sender reports so many MMSI that do not exist, at so many a second, each once. Beside them go 500 that jump about, and a clock
sentence a second, years off. Exit code 1: a cycle was late, memory passed 1 GB, or an honest vessel is missing, moved, renamed,
or has other alarms.
"""

from __future__ import annotations

import argparse
import json
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, closing
from datetime import datetime
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import httpx2 as httpx
import numpy as np

from coastwatch.operators.api.answers import MOST_ROWS
from coastwatch.operators.cli.arguments import count
from coastwatch.server.timing import date_utc, machine
from scaling.load.hold.senders import CENTRE_DEG, FIRST_SPOOFED, position_lines
from scaling.load.hostile import HOST, SCENARIO, Seen, free_ports, wait_for_cycles
from scaling.load.kills import COASTWATCH

WARM_UP_S, AFTER_S, JUMPING, MOST_MEMORY = 120.0, 30.0, 500, 1e9
AREA_DEG = 0.3
PERIOD_S = 3.0
SAME_M, METRES_A_DEGREE = 1.0, 111_194.9


def attack(port: int, vessels: int, rate: int, seed: int, stop: threading.Event, sent: dict[str, int]) -> None:
    """Send vessels that do not exist, others that jump about, and clock sentences years off, from one address."""
    rng = np.random.default_rng([seed, 3])
    begun_s = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for second in range(vessels // rate):
            if stop.is_set():
                return
            jumping = np.arange(JUMPING) + FIRST_SPOOFED + vessels
            mmsi = np.concatenate([FIRST_SPOOFED + second * rate + np.arange(rate), jumping])
            where = np.array(CENTRE_DEG) + rng.uniform(-0.5, 0.5, (len(mmsi), 2)) * AREA_DEG
            lines = list(position_lines(mmsi, where, 12.0, rng.uniform(0.0, 359.0, len(mmsi))))
            year = (2001, 2020, 2031, 2099)[second % 4]
            body = b"GPZDA,%s.00,01,01,%d,00,00" % (time.strftime("%H%M%S", time.gmtime()).encode(), year)
            out.sendto(b"$%s*%02X" % (body, reduce(xor, body, 0)), (HOST, port))
            for k in range(0, len(lines), 10):
                out.sendto(b"\r\n".join(lines[k : k + 10]), (HOST, port))
                behind_s = begun_s + second + (k + 10) / len(lines) - time.monotonic()
                if behind_s > 0.002:
                    time.sleep(behind_s)
            sent["spoofed"] = (second + 1) * rate
            sent["seconds"] = round(time.monotonic() - begun_s)


def honest(rows: list[dict[str, Any]]) -> dict[int, dict[str, Any]]:
    """The vessels with the MMSI of an honest sender."""
    named = {int(row["mmsi"]): row for row in rows if row["mmsi"] is not None}
    return {mmsi: row for mmsi, row in named.items() if not _is_spoofed(mmsi)}


def _is_spoofed(mmsi: int) -> bool:
    return FIRST_SPOOFED <= mmsi < FIRST_SPOOFED + 1_000_000


def differences(alone: dict[int, dict[str, Any]], attacked: dict[int, dict[str, Any]]) -> dict[str, int]:
    """How two pictures of one instant differ in honest vessels."""
    both = alone.keys() & attacked.keys()
    moved = 0
    for mmsi in both:
        north, east = (float(attacked[mmsi][name]) - float(alone[mmsi][name]) for name in ("latitude_deg", "longitude_deg"))
        moved += np.hypot(north, east * np.cos(np.radians(CENTRE_DEG[0]))) * METRES_A_DEGREE > SAME_M
    return {
        "honest vessels": len(alone),
        "missing": len(alone.keys() - attacked.keys()),
        "more": len(attacked.keys() - alone.keys()),
        "moved by more than a metre": int(moved),
        "other flags": sum(alone[mmsi]["flags"] != attacked[mmsi]["flags"] for mmsi in both),
        "other names": sum(alone[mmsi]["name"] != attacked[mmsi]["name"] for mmsi in both),
    }


def alarms(database: Path, until_s: float) -> set[tuple[str, int, float]]:
    """Kind, MMSI and beginning of the alarms of honest vessels."""
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as raw:
        rows = raw.execute(
            "SELECT kind, mmsi, start_s FROM event WHERE mmsi IS NOT NULL AND start_s <= ? "
            "AND kind NOT IN ('coasting', 'stationary')",
            (until_s,),
        ).fetchall()
    return {(kind, mmsi, start_s) for kind, mmsi, start_s in rows if not _is_spoofed(mmsi)}


def _picture(address: str, time_utc: str | None = None) -> dict[str, Any]:
    asked: dict[str, str | int] = {"limit": MOST_ROWS, "format": "json"}
    if time_utc is not None:
        asked["at"] = time_utc
    answer = httpx.get(f"{address}/api/v1/picture", params=asked, timeout=60.0)
    answer.raise_for_status()
    return dict(answer.json())


def run(vessels: int, rate: int, seed: int) -> dict[str, Any]:
    """Serve, attack one server, and compare. Returns: figures."""
    page_a, page_b, *ports = free_ports(7)
    feeds_a, feeds_b = ports[:2], ports[2:4]
    seconds = WARM_UP_S + vessels / rate + AFTER_S
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        servers = []
        for name, page, own in (("alone", page_a, feeds_a), ("attacked", page_b, feeds_b)):
            words = [COASTWATCH, "serve", SCENARIO, "--db", f"{folder}/{name}.db", "--port", str(page), "--new"]
            words += ["--feed", f"ais+listen://{HOST}:{own[0]}", "--feed", f"asterix+udp://{HOST}:{own[1]}"]
            words += ["--feed", f"ais+udp://{HOST}:{ports[4]}?name=second"] if name == "attacked" else []
            servers.append(_started(words, page))
            while name == "attacked" and (_instant_s(page_b) - _instant_s(page_a)) % PERIOD_S != 0.0:
                _end(servers.pop())  # its cycles end at other instants, at which vessels are elsewhere
                servers.append(_started(words, page))
            stack.callback(_end, servers[-1])
        to = [f"{kind}://{HOST}:{own[k]}" for own in (feeds_a, feeds_b) for k, kind in enumerate(("ais+tcp", "asterix+udp"))]
        cycles = round(seconds * 1.2 / 3.0) + 60
        words = [COASTWATCH, "feed", SCENARIO, "--set", f"cycles={cycles}", "--set", f"seed={seed}"]
        feed = subprocess.Popen([*words, *(word for one in to for word in ("--to", one))], stdout=subprocess.DEVNULL)
        stack.callback(_end, feed)
        time.sleep(WARM_UP_S)
        stop, sent = threading.Event(), dict[str, int]()
        stack.callback(stop.set)
        thread = threading.Thread(target=attack, args=(ports[4], vessels, rate, seed, stop, sent), daemon=True)
        thread.start()
        seen, address = Seen(), f"http://{HOST}:{page_b}"
        until_s = None
        while until_s is None or time.monotonic() < until_s:
            seen.look(address, servers[1].pid)
            time.sleep(1.0)
            if until_s is None and not thread.is_alive():
                until_s = time.monotonic() + AFTER_S
        last = _picture(address)
        time.sleep(10.0)
        at = last["time_utc"]
        pictures = [honest(_picture(f"http://{HOST}:{page}", at)["vessels"]) for page in (page_a, page_b)]
        until = max(float(servers_s) for servers_s in (_time_s(folder, name) for name in ("alone", "attacked"))) - 15.0
        known = [alarms(Path(folder) / f"{name}.db", until) for name in ("alone", "attacked")]
    return {
        **sent,
        "vessels in the attacked picture": len(last["vessels"]),
        "cycles late": seen.cycles_late,
        "latest s after due": max(seen.late_s),
        "memory MB at most": round(max(seen.memory) / 1e6),
        **differences(*pictures),
        "honest alarms": len(known[0]),
        "honest alarms only alone": len(known[0] - known[1]),
        "honest alarms only attacked": len(known[1] - known[0]),
        "which": ", ".join(f"{kind} {mmsi} {start_s:.0f}" for kind, mmsi, start_s in sorted(known[0] ^ known[1])) or "-",
        "which flags": ", ".join(_other_flags(*pictures)) or "-",
    }


def _other_flags(alone: dict[int, dict[str, Any]], attacked: dict[int, dict[str, Any]]) -> list[str]:
    """MMSI, flags without the attack and flags with it, of honest vessels where they differ."""
    both = sorted(alone.keys() & attacked.keys())
    flags = [(mmsi, alone[mmsi]["flags"], attacked[mmsi]["flags"]) for mmsi in both]
    return [f"{mmsi} {one} -> {other}" for mmsi, one, other in flags if one != other]


def _started(words: list[str], page: int) -> subprocess.Popen[bytes]:
    """A server that has made its first picture."""
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    wait_for_cycles(f"http://{HOST}:{page}", process)
    return process


def _instant_s(page: int) -> float:
    """The time of the newest picture of a server, s."""
    return datetime.fromisoformat(_picture(f"http://{HOST}:{page}")["time_utc"]).timestamp()


def _time_s(folder: str, name: str) -> float:
    with closing(sqlite3.connect(f"file:{folder}/{name}.db?mode=ro", uri=True)) as raw:
        return float(raw.execute("SELECT max(time_s) FROM cycle").fetchone()[0])


def _end(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGINT)
    try:
        process.wait(60.0)
    except subprocess.TimeoutExpired:
        process.kill()


def is_right(found: dict[str, Any]) -> bool:
    """Whether the honest picture is as without the attack, on time, and memory is bounded."""
    same: tuple[str, ...] = ("missing", "more", "moved by more than a metre", "other flags", "other names")
    same += ("honest alarms only alone", "honest alarms only attacked")
    return (
        not found["cycles late"] and found["memory MB at most"] <= MOST_MEMORY / 1e6 and not any(found[name] for name in same)
    )


def main() -> int:
    """Run, and print the figures. Returns: 1 where the attack changed something."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mmsi", type=count, default=300_000)
    parser.add_argument("--rate", type=count, default=3_000, help="a second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = {"date": date_utc(), "machine": machine()} | run(options.mmsi, options.rate, options.seed)
    found["right"] = is_right(found)
    if options.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:34} {value}")
    return int(not found["right"])


if __name__ == "__main__":
    sys.exit(main())
