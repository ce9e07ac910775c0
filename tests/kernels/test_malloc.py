"""A process that works in cycles asks the system for its memory once."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.contract

CYCLES = """
import resource
import threading
import numpy as np
from coastwatch.workers import open_workers

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.empty(12_000_000)[::512] = 1.0  # every page of 96 MB
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

def faults_of_a_thread():
    said = []
    thread = threading.Thread(target=lambda: said.append(faults()))
    thread.start()
    thread.join()
    return said[0]

print(*[faults() for _ in range(5)])
with open_workers("threads", 2):
    print(*[faults() for _ in range(5)])
    print(*[faults_of_a_thread() for _ in range(5)])
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs glibc, whose allocator can be told to keep memory")
def test_memory_of_one_cycle_serves_the_next() -> None:
    done = subprocess.run([sys.executable, "-c", CYCLES], capture_output=True, text=True, check=True)
    plain, kept, of_threads = ([int(n) for n in line.split()] for line in done.stdout.splitlines())
    assert min(plain) >= 40  # of 4 kB, or of 2 MB where the system has such pages
    assert max(kept[1:]) < 0.1 * min(plain)
    assert max(of_threads) < 0.1 * min(plain)  # what the main thread left
