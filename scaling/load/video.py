"""Radar video (ASTERIX CAT 240) over the wire: what a spoke costs, what damage does, and radars live over loopback multicast:

    python -m scaling.load.video decode
    python -m scaling.load.video damaged [--messages 100000]
    python -m scaling.load.video live [--radars 4] [--minutes 3] [--spokes 4096] [--cells 2048] [--hostile] [--viewer]

Live, a turn of noise with ships is made first and sent again and again, with new times and numbers, at 25 turns a minute. With
`--hostile` somebody else sends to the feed of the first radar: its video at ten times the rate, random and cut datagrams, and bombs.
With `--viewer` a program takes the picture of every radar, as the map does, and notes how far it is behind the beam.
Exit code 1: a spoke was lost, a cycle came late or not at all, an exception left the decoder, or memory grew by more than a tenth.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import httpx2 as httpx
import numpy as np
import tomli_w
from websockets.sync.client import connect

from coastwatch.batches import Array
from coastwatch.formats.asterix.video import VideoMessage, decode, encode
from coastwatch.formats.asterix.video_feed import NUMBER_AT, VIDEO, VideoDecoder
from coastwatch.formats.decoding import FeedSettings, Item
from coastwatch.operators.api.video_stream import HEADER, SECTOR
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import make_scenario
from coastwatch.server.timing import date_utc, machine
from scaling.load.hostile import HOST, free_ports, wait_for_cycles
from scaling.load.kills import COASTWATCH
from scaling.load.processes import TICKS_PER_S, memory_bytes, process_tree

PERIOD_S, CYCLE_S, RANGE_NM = 2.4, 3.0, 12.0
GROUP, INTERFACE = "239.192.77.{}", "127.0.0.1"
WARM_UP_S = 45.0
SITES = ((54.3, 12.0), (54.4, 12.3), (54.2, 12.4), (54.5, 11.9))
SHIPS = 40
TIME_OCTETS = 3  # the time of day is the last item of what `encode` makes
MOST_GROWTH = 1.1
SPOKES_TOGETHER = 16  # sent at a time: 10 ms of a turn
FASTER = 10  # than a radar, somebody else


def turn(spokes: int, cells: int, sic: int, seed: int, *, compressed: bool = False) -> list[bytes]:
    """The messages of a turn."""
    return [encode(message) for message in spoken(noise_and_ships(spokes, cells, seed), sic, compressed)]


def noise_and_ships(spokes: int, cells: int, seed: int) -> Array:
    """The levels of a turn, half a decibel each. (S, C) uint8"""
    rng = np.random.default_rng(seed)
    power = rng.standard_exponential((spokes, cells), np.float32)
    row, column = np.arange(spokes), np.arange(cells)
    for at, range_ in zip(rng.integers(0, spokes, SHIPS), rng.integers(cells // 8, cells, SHIPS), strict=True):
        off = (row - at + spokes // 2) % spokes - spokes // 2
        near = np.flatnonzero(np.abs(off) < 30), np.flatnonzero(np.abs(column - range_) < 10)
        power[np.ix_(*near)] += 1e3 * np.exp(-((off[near[0], None] / 6.0) ** 2) - ((column[near[1]] - range_) / 3.0) ** 2)
    return np.clip(20.0 + 20.0 * np.log10(np.maximum(power, 1e-3)), 0, 255).astype(np.uint8)


def spoken(level: Array, sic: int, compressed: bool) -> list[VideoMessage]:
    """Spokes as messages. Args: level: (S, C)."""
    spokes, cells = level.shape
    duration_fs = round(RANGE_NM * 1852.0 / cells / 0.5 / 299_792_458.0e-15)
    step = 65_536 / spokes
    return [
        VideoMessage(
            25, sic, k, round(k * step), round((k + 1) * step) % 65_536, 0, duration_fs, row, 0.0, compressed=compressed
        )
        for k, row in enumerate(level)
    ]


def items(datagrams: list[bytes], begun_s: float) -> list[Item]:
    """Datagrams as they arrive."""
    step_s = PERIOD_S / len(datagrams)
    return [(begun_s + k * step_s, _stamped(data, k, begun_s + k * step_s), 0) for k, data in enumerate(datagrams)]


def _stamped(data: bytes, number: int, time_s: float) -> bytes:
    """A message with another number and time of day."""
    clock = (round(time_s % 86_400.0 * 128.0) % (86_400 * 128)).to_bytes(TIME_OCTETS, "big")
    return data[:NUMBER_AT] + (number % (1 << 32)).to_bytes(4, "big") + data[NUMBER_AT + 4 : -TIME_OCTETS] + clock


def sensors(radars: int) -> Any:
    """The sensors of the scenario."""
    return make_scenario(document(radars), "video", {}).sensors()


def document(radars: int) -> dict[str, Any]:
    """A scenario of radars of one region each."""
    return {
        "name": "video-load",
        "title": "radars that send video",
        "period_s": CYCLE_S,
        "area": {"latitude_deg": 54.3, "longitude_deg": 12.1},
        "radars": [
            {"name": f"r{k + 1}", "region": f"region{k + 1}", "latitude_deg": SITES[k % 4][0], "longitude_deg": SITES[k % 4][1]}
            | {"range_nm": RANGE_NM, "rpm": 60.0 / PERIOD_S}
            for k in range(radars)
        ],
        "input": {"method": "simulated_video"},
    }


def a_decoder(radars: int) -> VideoDecoder:
    """A decoder of a feed."""
    assert VIDEO.decoder is not None
    made = VIDEO.decoder(FeedSettings("feed", "video+udp://x"), sensors(radars))
    assert isinstance(made, VideoDecoder)
    return made


def cost(cells: int = 2048, spokes: int = 4096, repeats: int = 5) -> dict[str, Any]:
    """Processor time of a spoke in us, the best of some repeats: decoded alone, and through the feed to batches."""
    found: dict[str, Any] = {"spokes": spokes, "cells": cells}
    for name, compressed in (("plain", False), ("zlib", True)):
        datagrams = turn(spokes, cells, 1, 1, compressed=compressed)
        found[f"{name}_octets"] = round(sum(map(len, datagrams)) / spokes)
        alone, through = [], []
        for repeat in range(repeats):
            begun = time.process_time()
            for data in datagrams:
                decode(data)
            alone.append(time.process_time() - begun)
            made, arrived = a_decoder(1), items(datagrams, 1.75e9 + repeat)
            begun = time.process_time()
            for first in range(0, spokes, 128):
                made.decode(arrived[first : first + 128], None)
            reports = made.reports_between(-math.inf, math.inf)
            through.append(time.process_time() - begun)
            assert len(reports.video) == spokes
        found[f"{name}_us"] = round(min(alone) / spokes * 1e6, 1)
        found[f"{name}_feed_us"] = round(min(through) / spokes * 1e6, 1)
    return found


def damaged(messages: int, seed: int) -> dict[str, Any]:
    """Damaged messages through a feed: what was counted, exceptions, and memory after each tenth in MB."""
    rng, made = np.random.default_rng(seed), a_decoder(2)
    good = [
        data
        for sic in (1, 2)
        for bits in (1, 2, 4, 8, 16, 32)
        for packed in (False, True)
        for data in map(encode, (m._replace(bits=bits, compressed=packed) for m in spoken(_noise(rng), sic, packed)))
    ]
    memory, exceptions, used, now_s = [], 0, 0, 1.75e9
    for tenth in range(10):
        for _ in range(messages // 10 // 500):
            batch = []
            for _ in range(500):
                now_s += 1e-3
                raw = bytearray(good[rng.integers(len(good))] if rng.random() > 0.02 else rng.bytes(int(rng.integers(1, 300))))
                for at in rng.integers(0, len(raw), rng.integers(1, 6)):
                    raw[at if rng.random() < 0.3 else at % 40 % len(raw)] = rng.integers(0, 256)
                if rng.random() < 0.3:
                    raw = raw[: rng.integers(1, len(raw) + 1)]
                batch.append((now_s, bytes(raw), int(rng.integers(0, 3))))
            try:
                made.decode(batch, None)
                used += len(made.reports_between(now_s - 3.0, now_s + 1e6))
            except Exception as error:
                exceptions += 1
                print(f"tenth {tenth}: {type(error).__name__}: {error}", file=sys.stderr)
        memory.append(round(memory_bytes()[0] / 1e6, 1))
    faults = {fault.kind: fault.count for fault in made.tally.faults()}
    return {"messages": messages, "exceptions": exceptions, "spokes_used": used, "memory_mb": memory, "faults": faults}


def _noise(rng: np.random.Generator) -> Array:
    return rng.integers(0, 256, (64, 256)).astype(np.uint8)


def send_radar(sic: int, port: int, spokes: int, cells: int, begin_s: float, until_s: float) -> None:
    """Send the video of a radar at its pace: what a process does."""
    datagrams = turn(spokes, cells, sic, sic)
    step_s, number, to = PERIOD_S / spokes, 0, (GROUP.format(sic), port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(INTERFACE))
        while (at_s := begin_s + number * step_s) < until_s:
            time.sleep(max(at_s - time.time(), 0.0))
            for k in range(number, number + SPOKES_TOGETHER):
                sender.sendto(_stamped(datagrams[k % spokes], k, begin_s + k * step_s), to)
            number += SPOKES_TOGETHER


def attack(port: int, spokes: int, cells: int, begin_s: float, until_s: float) -> None:
    """Send what a feed should not get: what a process does."""
    rng, datagrams = np.random.default_rng(9), turn(spokes, cells, 1, 99)
    packed = zlib.compress(bytes(64 << 20), 9)[:60_000]
    bomb = bytearray(encode(VideoMessage(25, 1, 0, 0, 16, 0, 50_000_000, np.frombuffer(packed, np.uint8), 0.0)))
    at = bomb.index(bytes([0, 4]) + len(packed).to_bytes(2, "big"))
    bomb[at], bomb[at + 4 : at + 7] = 0x80, (65_536).to_bytes(3, "big")
    step_s, number, to = PERIOD_S / spokes / FASTER, 0, (GROUP.format(1), port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(INTERFACE))
        while (at_s := begin_s + number * step_s) < until_s:
            time.sleep(max(at_s - time.time(), 0.0))
            for k in range(number, number + FASTER * SPOKES_TOGETHER):
                sender.sendto(_stamped(datagrams[k % spokes], k, begin_s + k * step_s), to)
            number += FASTER * SPOKES_TOGETHER
            sender.sendto(rng.bytes(int(rng.integers(1, 1400))), to)
            sender.sendto(datagrams[0][: rng.integers(1, len(datagrams[0]))], to)
            sender.sendto(bytes(bomb), to)


def live(o: argparse.Namespace) -> dict[str, Any]:
    """Serve radars that send video over loopback multicast. Returns: figures after the warm-up."""
    radars, minutes, spokes, cells, workers = o.radars, o.minutes, o.spokes, o.cells, o.workers
    page, *ports = free_ports(1 + radars)
    address, until_s = f"http://{HOST}:{page}", math.inf
    feeds = [
        f"video+udp://{GROUP.format(k + 1)}:{port}?interface={INTERFACE}&25/{k + 1}=r{k + 1}" for k, port in enumerate(ports)
    ]
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "video.toml"
        scenario.write_text(tomli_w.dumps(document(radars)), "utf-8")
        serve = [COASTWATCH, "serve", str(scenario), "--db", f"sqlite:///{folder}/live.db", "--port", str(page), "--new"]
        serve += ["--workers", str(workers), *(word for one in feeds for word in ("--feed", one))]
        server = subprocess.Popen(serve, stdout=subprocess.DEVNULL)
        senders = []
        try:
            wait_for_cycles(address, server)
            begin_s = math.ceil(time.time()) + 10.0
            until_s = begin_s + WARM_UP_S + 60.0 * minutes
            for k, port in enumerate(ports):
                given = (k + 1, port, spokes, cells, begin_s + 0.6 * k, until_s)
                senders.append(get_context("spawn").Process(target=send_radar, args=given, daemon=True))
                senders[-1].start()
            if o.hostile:
                given_too = (ports[0], spokes, cells, begin_s + 5.0, until_s)
                senders.append(get_context("spawn").Process(target=attack, args=given_too, daemon=True))
                senders[-1].start()
            time.sleep(begin_s + WARM_UP_S - time.time())
            looks, seen = [], list[tuple[int, int, float]]()
            if o.viewer:
                threading.Thread(target=view, args=(page, until_s, seen), daemon=True).start()
            while time.time() < until_s - 1.0 and server.poll() is None:
                looks.append(_look(address, server.pid))
                time.sleep(2.0)
        finally:
            for sender in senders:
                sender.join(10.0 if until_s < math.inf else 0.0)
                sender.terminate()
            server.send_signal(signal.SIGINT)
            ended = server.wait(120.0)
        if ended:
            raise RuntimeError(f"the server ended with {ended}")
    found = _figures(looks, radars, spokes)
    if seen:
        behind_s = np.array([one[2] for one in seen])
        a_turn = len(seen) / (radars * (until_s - begin_s - WARM_UP_S) / PERIOD_S)
        found["viewer"] = {
            "sectors_a_turn": round(a_turn, 2),
            "kB_a_turn": round(float(np.mean([one[1] for one in seen])) * 16e-3, 1),
            "behind_beam_s": {f"{q} %": round(float(np.percentile(behind_s, q)), 3) for q in (50, 95, 99, 100)},
        }
    return found


def view(port: int, until_s: float, seen: list[tuple[int, int, float]]) -> None:
    """Take the picture of every radar, as the map does. Args: seen: radar, octets, and seconds behind the newest spoke; written."""
    with connect(f"ws://{HOST}:{port}/api/v1/video/stream", compression=None) as socket_:
        socket_.send(json.dumps({"radars": json.loads(socket_.recv())["radars"]}))
        while time.time() < until_s - 1.0:
            message = socket_.recv()
            assert isinstance(message, bytes)
            _, _, kind, radar, *_, time_s, _, _, _ = HEADER.unpack_from(message)
            if kind == SECTOR:
                seen.append((radar, len(message), time.time() - time_s))


def _look(address: str, pid: int) -> dict[str, Any]:
    """What a server says now, and what it uses."""
    status, feeds = (httpx.get(f"{address}/api/v1/{path}", timeout=10.0).json() for path in ("status", "feeds"))
    radars = [radar for feed in feeds["feeds"] for radar in feed["radars"]]
    ticks = 0
    for one in process_tree(pid):
        fields = Path(f"/proc/{one}/stat").read_text("utf-8").rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    counted = {name: sum(feed[name] for feed in feeds["feeds"]) for name in ("late", "dropped", "refused", "records")}
    return {
        "clock_s": time.time(),
        "processor_s": ticks / TICKS_PER_S,
        "memory_mb": memory_bytes(pid)[0] / 1e6,
        "radars": {radar["name"]: radar for radar in radars},
        **{name: status[name] for name in ("cycles", "cycles_late", "cycles_merged", "late_s", "cycle_ms", "vessels")},
        **counted,
    }


def _figures(looks: list[dict[str, Any]], radars: int, spokes: int) -> dict[str, Any]:
    first, last = looks[0], looks[-1]
    span_s = last["clock_s"] - first["clock_s"]
    lost = {
        name: sum(last["radars"][radar][name] - first["radars"][radar][name] for radar in last["radars"])
        for name in ("spokes", "spokes_lost", "parts_lost")
    }
    late_s = np.array([look["late_s"] for look in looks])
    return {
        "minutes": round(span_s / 60.0, 2),
        "cycles": last["cycles"] - first["cycles"],
        "expected": round(span_s / CYCLE_S, 1),
        **{name: last[name] - first[name] for name in ("cycles_late", "cycles_merged", "late", "dropped", "refused")},
        "ready_after_due_s": {"median": round(float(np.median(late_s)), 3), "most": round(float(late_s.max()), 3)},
        "cycle_ms": round(float(np.median([look["cycle_ms"] for look in looks]))),
        **lost,
        "spokes_expected": round(radars * spokes * span_s / PERIOD_S),
        "processors": round((last["processor_s"] - first["processor_s"]) / span_s, 2),
        "memory_mb": [round(looks[k]["memory_mb"]) for k in np.linspace(0, len(looks) - 1, 5).astype(int)],
        "vessels": last["vessels"],
        "radars": {
            name: {key: one[key] for key in ("turn_s", "spokes_a_turn", "plots_a_turn", "threshold_db", "second_sender")}
            for name, one in last["radars"].items()
        },
    }


def is_good(found: dict[str, Any]) -> bool:
    """Whether nothing was lost, late or thrown, and memory was flat."""
    nothing = ("exceptions", "cycles_late", "cycles_merged", "late", "dropped", "spokes_lost", "parts_lost")
    memory = found.get("memory_mb", [1.0])
    came = abs(found.get("cycles", 0) - found.get("expected", 0)) <= 1.5
    return (
        came
        and not any(found.get(name, 0) for name in nothing)
        and memory[-1] <= MOST_GROWTH * memory[1 if len(memory) > 1 else 0]
    )


def main() -> int:
    """Run, and print the figures. Returns: 1 where something was lost, late or thrown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("decode", "damaged", "live"))
    parser.add_argument("--messages", type=count, default=100_000)
    parser.add_argument("--seed", type=int, default=2001)
    parser.add_argument("--radars", type=count, default=4)
    parser.add_argument("--minutes", type=float, default=3.0, help="after the warm-up (default: 3)")
    parser.add_argument("--spokes", type=count, default=4096)
    parser.add_argument("--cells", type=count, default=2048)
    parser.add_argument("--hostile", action="store_true", help="somebody else sends to the feed of the first radar")
    parser.add_argument("--viewer", action="store_true", help="a program takes the picture of every radar")
    parser.add_argument("--workers", type=count, default=2)
    o = parser.parse_args()
    if o.what == "decode":
        found = cost(o.cells, o.spokes)
    elif o.what == "damaged":
        found = damaged(o.messages, o.seed)
    else:
        found = live(o)
    print(json.dumps({"date": date_utc(), "machine": machine(), **found}, indent=1))
    return 0 if is_good(found) else 1


if __name__ == "__main__":
    sys.exit(main())
