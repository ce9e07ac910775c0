"""The server in a process of its own on a small disk. It is begun again when it ends, as a service manager would."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Self

from scaling.load.hostile import HOST, free_ports

SCENARIO, SOURCE, SITE = "guanabara", "vts", "-22.949,-43.156"
DISK_MB = 2_000
AGAIN_S = 0.5
FEEDS = ("ais", "ais_others", "asterix", "json", "json_others", "ttm", "ttm_others")


def small_disk(folder: Path, stack: ExitStack) -> bool:
    """Put a file system of `DISK_MB` at a folder until the stack is closed. Returns: False: this user cannot."""
    if os.geteuid() != 0:
        return False
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", str(folder)], check=False)
    if done.returncode:
        return False
    stack.callback(subprocess.run, ["umount", "-l", str(folder)], check=False)
    return True


@dataclass
class Server:
    """The server. Use it in a `with` block."""

    folder: Path  # of the database
    vessels: int
    ttm_host: str  # on which the radar on another machine reaches it
    others: Path  # folder of its log, tokens and clock
    begun: int = 0  # times
    pid: int = 0
    ports: dict[str, int] = field(default_factory=dict)
    _stop: threading.Event = field(default_factory=threading.Event)
    _process: subprocess.Popen[bytes] | None = None
    _thread: threading.Thread | None = None
    _log: IO[bytes] | None = None

    @property
    def database(self) -> Path:
        return self.folder / "live.db"

    @property
    def tokens(self) -> Path:
        return self.others / "tokens.toml"

    @property
    def clock(self) -> Path:
        """Holds the seconds by which its clock is off."""
        return self.others / "clock"

    @property
    def log(self) -> Path:
        return self.others / "server.log"

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.ports['page']}"

    def __enter__(self) -> Self:
        self.ports = dict(zip(("page", *FEEDS), free_ports(1 + len(FEEDS)), strict=True))
        self.clock.write_text("0", "utf-8")
        self._log = self.log.open("ab")
        self._start()
        self._thread = threading.Thread(target=self._keep, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._stop.set()
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(60.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
        if self._thread is not None:
            self._thread.join(10.0)
        if self._log is not None:
            self._log.close()

    @property
    def process(self) -> subprocess.Popen[bytes]:
        """The one that runs now."""
        assert self._process is not None
        return self._process

    def kill(self) -> None:
        """End it as a lost machine would. It is begun again."""
        self.process.kill()

    def _start(self) -> None:
        p = self.ports
        feeds = [
            f"ais+listen://{HOST}:{p['ais']}", f"ais+udp://{HOST}:{p['ais_others']}?name=others",
            f"asterix+udp://{HOST}:{p['asterix']}", f"json+listen://{HOST}:{p['json']}",
            f"json+udp://{HOST}:{p['json_others']}?name=json-others",
            f"ttm+listen://{self.ttm_host}:{p['ttm']}?source={SOURCE}&site={SITE}",
            f"ttm+udp://{HOST}:{p['ttm_others']}?source=fuzz&site={SITE}",
        ]  # fmt: skip
        words = ["serve", SCENARIO, "--db", str(self.database), "--port", str(p["page"]), "--tokens", str(self.tokens)]
        words += [word for one in feeds for word in ("--feed", one)] + ["--log-format", "json"]
        command = [sys.executable, "-m", "scaling.load.hold.shifted_clock", str(self.clock), *words]
        self._process = subprocess.Popen(command, stdout=self._log, stderr=self._log)
        self.begun, self.pid = self.begun + 1, self._process.pid

    def _keep(self) -> None:
        """Begin it again whenever it has ended."""
        while not self._stop.is_set():
            self.process.wait()
            if not self._stop.wait(AGAIN_S):
                self._start()
