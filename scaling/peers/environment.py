"""The Python environment of a peer, made from exact pins under out/peers/."""

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
CHECKOUT = HERE.parents[1]
ENVIRONMENTS = CHECKOUT / "out" / "peers"
PIN = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)==([0-9][A-Za-z0-9.+!]*)")
MARK = "made-from.txt"  # in a complete environment: the pins that it was made from
PIP_OPTIONS = ("--disable-pip-version-check", "--quiet", "--retries", "1", "--timeout", "15")

Run = Callable[[list[str]], str]
"""Runs a command; returns "" or, in one line, why it failed."""


class Environment(NamedTuple):
    """The Python of a peer, None if it cannot be made, and a message."""

    python: Path | None
    message: str


def peers() -> list[str]:
    """Names of the peers: folders with a requirements.txt."""
    return sorted(p.parent.name for p in HERE.glob("*/requirements.txt"))


def pins(peer: str) -> dict[str, str]:
    """Version of each package. Raises: ValueError: a line is no exact pin."""
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
    """The environment of a peer: the existing one, else a new one, else the project's own if its versions are the same."""
    path, wanted = folder / peer, "".join(f"{p}=={v}\n" for p, v in sorted(pins(peer).items()))
    python, mark = path / "bin" / "python", path / MARK
    if mark.is_file() and mark.read_text("utf-8") == wanted and python.exists():
        return Environment(python, f"{peer}: {path}")
    call = run or run_command
    why = call([sys.executable, "-m", "venv", "--clear", str(path)]) or call(
        [str(python), "-m", "pip", "install", *PIP_OPTIONS, "--no-deps", "-r", str(HERE / peer / "requirements.txt")]
    )
    if not why:
        mark.write_text(wanted, "utf-8")
        return Environment(python, f"{peer}: made {path}")
    if all(installed(p) == v for p, v in pins(peer).items()):
        return Environment(Path(sys.executable), f"{peer}: the project's environment, which has the same versions ({why})")
    return Environment(None, f"{peer}: left out, its environment cannot be made: {why}")


def installed(package: str) -> str:
    """The version of an installed package, "" if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def run_command(command: list[str]) -> str:
    """Run a command at the top of the checkout, one thread per library. Returns: "" or the last line of its stderr."""
    single = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    done = subprocess.run(command, cwd=CHECKOUT, env={**os.environ, **single}, capture_output=True, text=True, check=False)
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return "" if done.returncode == 0 else (lines or [f"exit code {done.returncode}"])[-1].strip()
