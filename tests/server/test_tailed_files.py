"""A file that is followed: every line that is written to it comes once and in order, whatever rotates the file."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import pytest
from hypothesis import given, settings, strategies as st

from coastwatch.server.feeds import transport
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.transport import Inbox, _tailed

pytestmark = pytest.mark.whole

READ = 8
LOOK_S = 0.001


async def follow(folder: Path, write: Callable[[Path, int], bool]) -> list[bytes]:
    """The lines that come while a file is written. Args: write: called with the file and a number, between looks; False: no more."""
    path = folder / "ais.nmea"
    path.write_bytes(b"")
    inbox = Inbox(parsed(f"ais+file://{path}"))
    with mock.patch.multiple(transport, READ_BYTES=READ // 16 or 1, TAIL_WAIT_S=LOOK_S, FORMER_S=0.02):
        task = asyncio.create_task(_tailed(inbox))
        await quiet(inbox)
        number, files, out = 0, 1, []
        while write(path, number):
            number += 1
            if number % 3 == 0 or len(list(folder.iterdir())) != files or inbox.connections < 1:
                await quiet(inbox)  # a file that is replaced twice between two looks was never seen
            files = len(list(folder.iterdir()))
            out += inbox.pop_first(1000)
        await quiet(inbox)
        await asyncio.sleep(0.05)
        await quiet(inbox)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    return [line for _, line, _ in [*out, *inbox.pop_first(1000)]]


async def quiet(inbox: Inbox) -> None:
    """Wait until nothing has come for some looks."""
    before, looks = (-1, -1), 0
    while looks < 4:
        await asyncio.sleep(3 * LOOK_S)
        now = inbox.size, inbox.connections
        before, looks = now, looks + 1 if now == before else 0


def said(number: int, length: int) -> bytes:
    return b"%06d" % number + b"x" * length + b"\n"


@settings(max_examples=25)
@given(
    steps=st.lists(st.tuples(st.sampled_from(["write", "write", "write", "rename", "delete"]), st.integers(0, 3 * READ)), max_size=12),
    end=st.booleans(),
)  # fmt: skip
def test_every_line_comes_once_whatever_renames_the_file(steps: list[tuple[str, int]], end: bool) -> None:
    """Lines are written just before and, by a program that still has it open, just after the file is renamed or deleted."""
    lines = []

    def write(path: Path, number: int) -> bool:
        if number >= len(steps):
            return False
        what, length = steps[number]
        with path.open("ab") as stream:
            lines.append(said(2 * number, length))
            stream.write(lines[-1])
            stream.flush()
            if what == "rename":
                path.rename(path.with_name(f"old-{number}"))
            elif what == "delete":
                path.unlink()
                path.with_name(f"gone-{number}").touch()
            if what != "write":
                lines.append(said(2 * number + 1, length))
                stream.write(lines[-1])
                stream.flush()
                path.write_bytes(b"")
        return True

    with TemporaryDirectory() as folder:
        found = asyncio.run(follow(Path(folder), write))
    assert found == [line[:-1] for line in lines]


@settings(max_examples=25)
@given(past=st.lists(st.integers(-READ, 3 * READ), min_size=1, max_size=6), begin=st.integers(0, 40))
def test_a_file_that_is_emptied_and_has_grown_again_is_read_from_its_beginning(past: list[int], begin: int) -> None:
    """`copytruncate`: at the next look the file is shorter, as long as before, or longer. The last one lost its first lines."""
    lines, size = [], [0]

    def write(path: Path, number: int) -> bool:
        if number > 3 * len(past):
            return False
        if number % 3:
            return True  # time to look
        if number == 0:
            lines.append(said(0, begin))
            path.write_bytes(lines[-1])
        else:
            length = max(size[0] + past[number // 3 - 1], 8)
            kept = []
            while sum(map(len, kept)) < length:
                kept.append(said(1000 * number + len(kept), 3))
            path.write_bytes(b"".join(kept))  # the same file, emptied and written anew
            os.utime(path, ns=(number * 10**9, number * 10**9))
            lines.extend(kept)
        size[0] = path.stat().st_size
        return True

    with TemporaryDirectory() as folder:
        found = asyncio.run(follow(Path(folder), write))
    assert found == [line[:-1] for line in lines]


def test_a_last_line_without_its_end_comes_when_the_file_is_gone(tmp_path: Path) -> None:
    def write(path: Path, number: int) -> bool:
        if number == 0:
            path.write_bytes(b"one\ntwo")
        elif number == 3:
            path.rename(path.with_name("old"))
            path.write_bytes(b"three\nfour")
        elif number == 6:
            path.write_bytes(b"five\n")
        return number < 9

    found = asyncio.run(follow(tmp_path, write))
    assert sorted(found) == [b"five", b"four", b"one", b"three", b"two"]
