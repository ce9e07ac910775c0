"""The live part of `make demo`: a server, fed over sockets with the simulation of the scenario guanabara.

python ops/demo.py start [--port N]    # begin in the background, wait for the first picture, say the address
python ops/demo.py stop                # end it; without one it does nothing
python ops/demo.py run --ports A,B,C,D # both programs in the foreground, until Ctrl-C or the end of the simulation

It ends by itself after an hour. Its files are `out/live.*`.
"""

from __future__ import annotations

import argparse
import fcntl
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import TextIO

OUT = Path("out")
DATABASE, LOG, PROCESS = OUT / "live.db", OUT / "live.log", OUT / "live.pid"
HOST, SCENARIO = "127.0.0.1", "guanabara"
PORTS = (8100, 10110, 8600, 10111)
"""Usual ports: page and API, AIS, ASTERIX of the radars, bearings of the sonar."""

CYCLES = 1200  # an hour
FIRST_PICTURE_S, END_S = 120.0, 20.0
COASTWATCH = [str(Path(sys.executable).with_name("coastwatch"))]


def free(port: int) -> int:
    """This port if nobody listens there, else one that the system chooses."""
    for wanted in (port, 0):
        with suppress(OSError), socket.socket() as stream, socket.socket(type=socket.SOCK_DGRAM) as datagrams:
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            stream.bind((HOST, wanted))
            found = int(stream.getsockname()[1])
            datagrams.bind((HOST, found))
            return found
    raise OSError(f"{HOST}: no port is free")


def run(ports: Sequence[int]) -> int:
    """Serve and feed until Ctrl-C, SIGTERM or the end of the simulation. Returns: the exit code of the server."""

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    OUT.mkdir(exist_ok=True)
    own = PROCESS.open("a", encoding="utf-8")  # locked as long as this process lives: no number of a process is mistaken for it
    if not locked(own):
        print(f"{PROCESS}: another demo of this folder runs", file=sys.stderr)
        return 1
    own.truncate(0)
    own.write(str(os.getpid()))
    own.flush()
    page, ais, asterix, bearings = ports
    addresses = [f"ais+{{}}://{HOST}:{ais}", f"asterix+udp://{HOST}:{asterix}", f"json+{{}}://{HOST}:{bearings}"]
    feeds = [word for address in addresses for word in ("--feed", address.format("listen"))]
    targets = [word for address in addresses for word in ("--to", address.format("tcp"))]
    serve = ["serve", SCENARIO, "--db", f"sqlite:///{DATABASE}", "--new", "--port", str(page), *feeds]
    server = subprocess.Popen([*COASTWATCH, *serve], start_new_session=True)
    sender = subprocess.Popen(
        [*COASTWATCH, "feed", SCENARIO, "--set", f"cycles={CYCLES}", *targets],
        start_new_session=True,
        stdout=subprocess.DEVNULL,
    )
    try:
        while server.poll() is None and sender.poll() is None:
            time.sleep(0.2)
    except KeyboardInterrupt:
        pass
    finally:
        for process in (sender, server):
            process.send_signal(signal.SIGINT)
        for process in (sender, server):
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_S)
            if process.poll() is None:
                process.kill()
    return server.wait()


def start(port: int) -> int:
    """Begin in the background. Returns: the exit code."""
    stop()
    OUT.mkdir(exist_ok=True)
    for path in OUT.glob(f"{DATABASE.name}*"):
        path.unlink()
    ports = [free(port), *map(free, PORTS[1:])]
    words = [sys.executable, __file__, "run", "--ports", ",".join(map(str, ports))]
    with LOG.open("wb") as log:
        process = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
        )
    until_s = time.monotonic() + FIRST_PICTURE_S
    while (vessels := shown(ports[0])) == 0:
        if process.poll() is not None or time.monotonic() > until_s:
            stop()
            print(
                f"The live demo did not begin: {LOG.read_text('utf-8', 'replace').strip() or 'no picture came'}",
                file=sys.stderr,
            )
            return 1
        time.sleep(0.3)
    built = Path("coastwatch/operators/web/index.html").is_file()
    print(f"\nLive: {vessels} vessels, fed over sockets, at http://{HOST}:{ports[0]}")
    if not built:
        print("The map is not built, as npm could not be reached; the address has a plain page and the API.")
    print(f"Stop it: make demo-stop. It ends by itself after an hour. Log: {LOG}")
    return 0


def shown(port: int) -> int:
    """Vessels in the picture of the server; 0: there is none yet."""
    asked = http.client.HTTPConnection(HOST, port, timeout=5.0)
    try:
        asked.request("GET", "/api/v1/status")
        answer = asked.getresponse()
        return int(json.loads(answer.read())["vessels"]) if answer.status == 200 else 0
    except (OSError, http.client.HTTPException):
        return 0
    finally:
        asked.close()


def stop() -> bool:
    """End the demo. Returns: whether there was one."""
    if not PROCESS.is_file():
        return False
    with PROCESS.open("r", encoding="utf-8") as file:
        if locked(file):
            return False
        os.kill(int(file.read()), signal.SIGTERM)
        until_s = time.monotonic() + 3.0 * END_S
        while not locked(file) and time.monotonic() < until_s:
            time.sleep(0.1)
    return True


def locked(file: TextIO) -> bool:
    """Lock the file of the process. Returns: whether it could, which means that no demo runs."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def main() -> int:
    """Carry out the command."""
    parser = argparse.ArgumentParser(prog="python ops/demo.py", description="The live part of make demo.")
    parser.add_argument("command", choices=("start", "stop", "run"))
    parser.add_argument("--port", type=int, default=PORTS[0], help="of page and API (default: 8100)")
    parser.add_argument("--ports", type=lambda text: [int(part) for part in text.split(",")], default=list(PORTS))
    options = parser.parse_args()
    if options.command == "run":
        return run(options.ports)
    if options.command == "start":
        return start(options.port)
    print("The live demo has ended." if stop() else "No live demo runs here.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
