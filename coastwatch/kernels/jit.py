"""`jit`, the one decorator of compiled functions, and where numba keeps what it has compiled.

numba checks only the module of a function, not the modules that this function calls (numba issue 1833). So the folder of its cache
is named by a digest of all kernels: any change of a kernel begins a new folder.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any


def cache_folder() -> Path:
    """Folder of the compiled kernels: inside NUMBA_CACHE_DIR if that is set, else inside the user's cache folder."""
    digest = hashlib.sha256(f"numba {version('numba')} {platform.machine()}".encode())
    for module in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(module.read_bytes())
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "coastwatch"
    parent, name = Path(os.environ.get("NUMBA_CACHE_DIR") or user), f"kernels-{digest.hexdigest()[:16]}"
    return parent if parent.name == name else parent / name  # a child process inherits the folder itself


os.environ["NUMBA_CACHE_DIR"] = str(cache_folder())

from numba import njit  # noqa: E402 - numba reads its settings when it is imported
from numba.core import event  # noqa: E402


def jit(function: Callable[..., Any]) -> Any:
    """A function compiled by numba at its first call, kept on disk, and free to run beside other threads.

    A division by zero gives infinity or NaN, as in numpy: numba's check of divisors prevents vectorisation.
    """
    return njit(cache=True, nogil=True, error_model="numpy")(function)


class _Compilations(event.Listener):
    """Calls a function before each compilation."""

    def __init__(self, begun: Callable[[], None]) -> None:
        self._begun = begun

    def on_start(self, event: Any) -> None:
        self._begun()

    def on_end(self, event: Any) -> None:
        pass


@contextmanager
def compilations(begun: Callable[[], None]) -> Iterator[None]:
    """Inside the block, a function is called before each compilation in this process; not where a kernel is loaded from disk.

    Args: begun: it may be called in any thread that calls a kernel.
    """
    with event.install_listener("numba:compile", _Compilations(begun)):
        yield
