"""The environment of a peer: its own, made from exact pins under out/peers/, never the project's."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
HOUSE = HERE.parents[1]
ENVIRONMENTS = HOUSE / "out" / "peers"
PIN = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)==([0-9][A-Za-z0-9.+!]*)")
MARK = "made-from.txt"  # in an environment that is complete: what it was made from
NO_WAITING = ("--disable-pip-version-check", "--quiet", "--retries", "1", "--timeout", "15")

Run = Callable[[list[str]], str]
"""Runs a command; returns "" or, in one line, why it failed."""


class Environment(NamedTuple):
    """Where a peer runs, or why it cannot."""

    python: Path | None
    said: str


def peers() -> list[str]:
    """The peers that there are: folders with pins."""
    return sorted(p.parent.name for p in HERE.glob("*/requirements.txt"))


def pins(peer: str) -> dict[str, str]:
    """Package to version. Raises: ValueError: a line is no exact pin."""
    out = {}
    for number, line in enumerate((HERE / peer / "requirements.txt").read_text("utf-8").splitlines(), 1):
        text = line.partition("#")[0].strip()
        match = PIN.fullmatch(text)
        if text and not match:
            raise ValueError(f"{peer}/requirements.txt:{number}: got {text!r}, needed package==version")
        if match:
            out[match[1]] = match[2]
    return out


def prepare(peer: str, folder: Path = ENVIRONMENTS, run: Run | None = None) -> Environment:
    """The environment of a peer: what is there, else a new one, else the project's where it has the same versions."""
    place, wanted = folder / peer, "".join(f"{p}=={v}\n" for p, v in sorted(pins(peer).items()))
    python, mark = place / "bin" / "python", place / MARK
    if mark.is_file() and mark.read_text("utf-8") == wanted and python.exists():
        return Environment(python, f"{peer}: {place}")
    call = run or in_shell
    why = call([sys.executable, "-m", "venv", "--clear", str(place)]) or call(
        [str(python), "-m", "pip", "install", *NO_WAITING, "--no-deps", "-r", str(HERE / peer / "requirements.txt")]
    )
    if not why:
        mark.write_text(wanted, "utf-8")
        return Environment(python, f"{peer}: made {place}")
    if all(installed(p) == v for p, v in pins(peer).items()):
        return Environment(Path(sys.executable), f"{peer}: the project's environment, which has the same versions ({why})")
    return Environment(None, f"{peer}: left out, its environment cannot be made: {why}")


def installed(package: str) -> str:
    """The version of a package here; "" where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def in_shell(command: list[str]) -> str:
    """Runs a command with one thread a library, at the top of the house. Returns: "" or the last line of what it complained of."""
    single = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    done = subprocess.run(command, cwd=HOUSE, env={**os.environ, **single}, capture_output=True, text=True, check=False)
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return "" if done.returncode == 0 else (lines or [f"exit code {done.returncode}"])[-1].strip()
