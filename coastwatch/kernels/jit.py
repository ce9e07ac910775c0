"""`jit`, the one decorator of compiled functions, and where numba keeps what it has compiled.

numba checks only the module of a function, not the modules that this function calls (numba issue 1833). So the folder of its cache
is named by a digest of all kernels: any change of a kernel begins a new folder. Inside it a module has its place by its name, not by
the path of the checkout, as numba has it: checkouts and installations with equal kernels share what one of them has compiled.
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

KERNELS = Path(__file__).parent


def cache_folder() -> Path:
    """Folder of the compiled kernels: inside NUMBA_CACHE_DIR if that is set, else inside the user's cache folder."""
    digest = hashlib.sha256(f"numba {version('numba')} {platform.machine()}".encode())
    for module in sorted(KERNELS.rglob("*.py")):
        digest.update(str(module.relative_to(KERNELS)).encode() + module.read_bytes())
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "coastwatch"
    parent, name = Path(os.environ.get("NUMBA_CACHE_DIR") or user), f"kernels-{digest.hexdigest()[:16]}"
    return parent if parent.name == name else parent / name  # a child process inherits the folder itself


os.environ["NUMBA_CACHE_DIR"] = str(cache_folder())

from numba import config, njit  # noqa: E402 - numba reads its settings when it is imported
from numba.core import event  # noqa: E402
from numba.core.caching import UserProvidedCacheLocator  # noqa: E402


class KernelCache(UserProvidedCacheLocator):
    """Where numba keeps a compiled kernel: a folder by the place of its module in `coastwatch/kernels`. None for other functions."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """The folder, relative to that of the cache. Args: py_file: path of the module."""
        return "_".join(Path(py_file).relative_to(KERNELS).with_suffix("").parts)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> KernelCache | None:
        """The place of a kernel; None: not a kernel, numba goes on to its next class. Args: py_file: path of the module."""
        return super().from_function(py_func, py_file) if Path(py_file).is_relative_to(KERNELS) else None  # type: ignore[no-untyped-call]


config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]  # type: ignore[attr-defined]  # another program may have imported it before
# Not in the environment: a program that a hook starts may have numba, but not this class.
if not config.CACHE_LOCATOR_CLASSES:  # type: ignore[attr-defined]
    config.CACHE_LOCATOR_CLASSES = f"{__name__}.KernelCache,UserProvidedCacheLocator"  # type: ignore[attr-defined]


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
