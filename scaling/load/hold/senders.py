"""Who sends to the server: the honest feeds, a radar on another machine, and vessels that are not there."""

from __future__ import annotations

import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyais.encode import encode_dict

from scaling.load.hold.server import SCENARIO, Server
from scaling.load.hostile import HOST
from scaling.load.kills import COASTWATCH

NAMESPACE, HERE, THERE = "cw-hold", "cwhold0", "cwhold1"
HERE_ADDRESS, THERE_ADDRESS = "10.251.7.1", "10.251.7.2"
CENTRE_DEG = -23.02, -43.12
FIRST_SPOOFED = 431_000_000
METRES_A_DEGREE = 111_194.9
KNOT_M_S = 1852.0 / 3600.0


@dataclass
class OtherMachine:
    """A network namespace with a link to this one: a radar that sends TTM, whose power can be cut."""

    process: subprocess.Popen[bytes] | None = None

    @staticmethod
    def made(stack: ExitStack) -> OtherMachine | None:
        """One until the stack is closed; None: this user cannot make it."""
        if os.geteuid() != 0 or shutil.which("ip") is None:
            return None
        for words in (
            f"netns add {NAMESPACE}", f"link add {HERE} type veth peer name {THERE}", f"link set {THERE} netns {NAMESPACE}",
            f"addr add {HERE_ADDRESS}/30 dev {HERE}", f"link set {HERE} up",
            f"-n {NAMESPACE} addr add {THERE_ADDRESS}/30 dev {THERE}", f"-n {NAMESPACE} link set {THERE} up",
        ):  # fmt: skip
            if _ip(words):
                _ip(f"netns del {NAMESPACE}")
                return None
        stack.callback(_ip, f"netns del {NAMESPACE}")
        return OtherMachine()

    def power_on(self, port: int) -> None:
        """Have it send."""
        _ip(f"link set {HERE} up")
        _ip(f"-n {NAMESPACE} link set {THERE} up")
        command = ["ip", "netns", "exec", NAMESPACE, sys.executable, "-m", "scaling.load.hold.targets", HERE_ADDRESS, str(port)]
        self.process = subprocess.Popen(command)

    def power_cut(self) -> None:
        """End it without a word on the line."""
        _ip(f"link set {HERE} down")
        self.end()

    def end(self) -> None:
        """End its program."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()


def _ip(words: str) -> int:
    return subprocess.run(["ip", *words.split()], check=False, stderr=subprocess.DEVNULL).returncode


def honest(server: Server, seconds: float, seed: int) -> subprocess.Popen[bytes]:
    """What sends AIS, plots and bearings of a simulation for so long."""
    p = server.ports
    to = [f"ais+tcp://{HOST}:{p['ais']}", f"asterix+udp://{HOST}:{p['asterix']}", f"json+tcp://{HOST}:{p['json']}"]
    # The simulation begins when it is asked for and is sent from when it is ready, so it is made for longer.
    settings = {"cycles": math.ceil(seconds * 1.15 / 3.0) + 200, "input.count": server.vessels, "seed": seed}
    command = [COASTWATCH, "feed", SCENARIO, *(word for one in to for word in ("--to", one))]
    command += [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def end(process: subprocess.Popen[bytes]) -> None:
    """End a sender."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(20.0)
    except subprocess.TimeoutExpired:
        process.kill()


def position_lines(mmsi: Any, position_deg: Any, sog_kn: float, cog_deg: Any) -> Iterator[bytes]:
    """AIS sentences of vessels now. Args: mmsi: (N,); position_deg: (N, 2); cog_deg: (N,)."""
    second = int(time.time()) % 60
    for number, (latitude, longitude), course in zip(mmsi.tolist(), position_deg.tolist(), cog_deg.tolist(), strict=True):
        said = {"msg_type": 1, "mmsi": number, "lat": latitude, "lon": longitude, "second": second}
        yield from (line.encode() for line in encode_dict(said | {"speed": sog_kn, "course": course}, radio_channel="A"))


def spoofed(port: int, count: int, width_nm: float, seconds: float, every_s: float, first: int, seed: int) -> int:
    """Send vessels that are not there, each every so often, from one address over UDP. Returns: sentences sent."""
    rng, sent = np.random.default_rng([seed, 7]), 0
    mmsi, course = first + np.arange(count), rng.uniform(0.0, 360.0, count)
    east, north = rng.uniform(-0.5, 0.5, (2, count)) * width_nm * 1852.0
    begun_s = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        turn = 0
        while (since_s := time.monotonic() - begun_s) < seconds:
            away_m, radians = 8.0 * KNOT_M_S * since_s, np.radians(course)
            latitude = CENTRE_DEG[0] + (north + away_m * np.cos(radians)) / METRES_A_DEGREE
            scale = METRES_A_DEGREE * math.cos(math.radians(CENTRE_DEG[0]))
            longitude = CENTRE_DEG[1] + (east + away_m * np.sin(radians)) / scale
            for k, line in enumerate(position_lines(mmsi, np.stack([latitude, longitude], 1), 8.0, course)):
                out.sendto(line, (HOST, port))
                sent += 1
                behind_s = begun_s + turn * every_s + (k + 1) * every_s / count - time.monotonic()
                if behind_s > 0.005:
                    time.sleep(behind_s)
            turn += 1
            time.sleep(max(begun_s + turn * every_s - time.monotonic(), 0.0))
    return sent
