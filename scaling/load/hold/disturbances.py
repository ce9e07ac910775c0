"""What is done to the server. Each function returns when the disturbance is over, and says what it did."""

from __future__ import annotations

import shutil
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import httpx2 as httpx

from scaling.load.fuzz import Messages
from scaling.load.hold.senders import FIRST_SPOOFED, OtherMachine, spoofed
from scaling.load.hold.server import Server
from scaling.load.hostile import HOST

LOCK_S, FULL_S, CUT_S, CLOCK_S, TOKENS_S = 14.0, 60.0, 20.0, 90.0, 20.0
NEW, NEW_S = 5_000, 10.0
DENSE, DENSE_NM, DENSE_S, DENSE_EVERY_S = 5_000, 2.0, 90.0, 10.0
FUZZ_A_SECOND = 20_000


@dataclass
class World:
    """What disturbances act on."""

    server: Server
    machine: OtherMachine | None
    has_small_disk: bool
    read_s: float  # how long the endless reader reads
    fuzz: int  # datagrams
    seed: int
    token: str
    count: int = 0  # disturbances so far
    said: list[str] = field(default_factory=list)


def killed(world: World) -> str:
    """SIGKILL."""
    world.server.kill()
    return "SIGKILL; begun again after 0.5 s"


def locked(world: World) -> str:
    """Another program holds the write lock."""
    with closing(sqlite3.connect(world.server.database, isolation_level=None, timeout=30.0)) as raw:
        raw.execute("BEGIN IMMEDIATE")
        time.sleep(LOCK_S)
        raw.execute("ROLLBACK")
    return f"write lock held for {LOCK_S:g} s"


def disk_full(world: World) -> str:
    """The disk of the database is full for a minute."""
    if not world.has_small_disk:
        return "NOT DONE: a small file system needs root"
    path = world.server.folder / "filler"
    try:
        with path.open("wb") as out:
            until_s = time.monotonic() + FULL_S
            while time.monotonic() < until_s:  # also what is freed in between
                try:
                    out.write(b"\0" * (1 << 20))
                    out.flush()
                except OSError:
                    time.sleep(0.2)
            free = shutil.disk_usage(world.server.folder).free
    finally:
        path.unlink()
    return f"disk full for {FULL_S:g} s ({free} bytes free)"


def power_cut(world: World) -> str:
    """The machine of the radar that sends TTM loses power, and comes back."""
    if world.machine is None:
        return "NOT DONE: a network namespace needs root and ip"
    world.machine.power_cut()
    time.sleep(CUT_S)
    world.machine.power_on(world.server.ports["ttm"])
    return f"link down and sender killed; back after {CUT_S:g} s"


def clock_back(world: World) -> str:
    """The clock of the machine is an hour back for a while."""
    return _clock(world, -3600.0)


def clock_ahead(world: World) -> str:
    """The clock of the machine is an hour ahead for a while."""
    return _clock(world, 3600.0)


def _clock(world: World, seconds: float) -> str:
    world.server.clock.write_text(str(seconds), "utf-8")
    time.sleep(CLOCK_S)
    world.server.clock.write_text("0", "utf-8")
    return f"clock set by {seconds:+g} s for {CLOCK_S:g} s"


def fuzzed(world: World) -> str:
    """Damaged datagrams of every format on all sockets that take datagrams."""
    command = [sys.executable, "-m", "scaling.load.hold.disturbances", str(world.fuzz), str(world.seed + world.count)]
    command += [str(world.server.ports[name]) for name in ("ais_others", "asterix", "json_others", "ttm_others")]
    begun_s = time.monotonic()
    subprocess.run(command, check=True)
    return f"{world.fuzz:,} damaged datagrams in {time.monotonic() - begun_s:.0f} s"


def send_fuzz(number: int, seed: int, ports: dict[str, int]) -> None:
    """Send so many damaged messages, a datagram each. Args: ports: by format."""
    messages, names = Messages(seed), list(ports)
    begun_s = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for k in range(number):
            name = names[k % len(names)]
            out.sendto(messages.of(name, time.time())[:60_000], (HOST, ports[name]))
            if k % 100 == 0 and (early_s := begun_s + k / FUZZ_A_SECOND - time.monotonic()) > 0.0:
                time.sleep(early_s)


def new_vessels(world: World) -> str:
    """A sender reports thousands of MMSI that nobody has heard before, once each."""
    given = NEW, 12.0, NEW_S, NEW_S, FIRST_SPOOFED + 10_000 * (world.count % 9), world.seed
    return f"{spoofed(world.server.ports['ais_others'], *given):,} reports of {NEW:,} new MMSI in {NEW_S:g} s"


def dense(world: World) -> str:
    """Thousands of vessels within 2 NM, with a report every 10 s."""
    given = DENSE, DENSE_NM, DENSE_S, DENSE_EVERY_S, FIRST_SPOOFED + 5_000 + 10_000 * (world.count % 9), world.seed
    sent = spoofed(world.server.ports["ais_others"], *given)
    return f"{DENSE:,} vessels within {DENSE_NM:g} NM for {DENSE_S:g} s ({sent:,} reports)"


def endless_reader(world: World) -> str:
    """A reader of the database keeps its transaction open."""
    with closing(sqlite3.connect(world.server.database, isolation_level=None)) as raw:
        raw.execute("BEGIN")
        raw.execute("SELECT count(*) FROM cycle").fetchone()
        time.sleep(world.read_s)
        log = Path(f"{world.server.database}-wal").stat().st_size
        raw.execute("ROLLBACK")
    return f"transaction of a reader open for {world.read_s:g} s; log {log / 1e6:.0f} MB"


def half_tokens(world: World) -> str:
    """The file of tokens is half written for a while."""
    path = world.server.tokens
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    refused, until_s = 0, time.monotonic() + TOKENS_S
    while time.monotonic() < until_s:
        answer = httpx.get(
            f"{world.server.address}/api/v1/status", headers={"Authorization": f"Bearer {world.token}"}, timeout=5.0
        )
        refused += answer.status_code != 200
        time.sleep(0.5)
    path.write_bytes(whole)
    return f"half a file of tokens for {TOKENS_S:g} s: {refused} requests refused"


DISTURBANCES: tuple[Callable[[World], str], ...] = (
    killed, locked, disk_full, power_cut, clock_back, clock_ahead, fuzzed, new_vessels, dense, endless_reader, half_tokens,
)  # fmt: skip


def in_turn() -> Iterator[Callable[[World], str]]:
    """The disturbances, again and again."""
    while True:
        yield from DISTURBANCES


if __name__ == "__main__":
    send_fuzz(
        int(sys.argv[1]), int(sys.argv[2]), dict(zip(("ais", "asterix", "json", "ttm"), map(int, sys.argv[3:]), strict=True))
    )
