"""All kernels of a run compiled before it, over processes: what is compiled is known from runs (`signatures.txt`), not kept by hand.

numba keeps what it has compiled on disk, beside the modules or, where that cannot be written to, in NUMBA_CACHE_DIR or the user's cache.
Two processes that need the same part of two kernels do not both compile it: who compiles a function has its lock.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from coastwatch.server.many import over_processes
from coastwatch.store.native import library

SIGNATURES = Path(__file__).with_name("signatures.txt")
CALLED_BACK = "coastwatch.store.collect_loop"
"""The module of functions that SQLite calls, which are compiled when it is imported, where SQLite can be asked for more than SQL."""


@dataclass(frozen=True)
class Compiled:
    """What it took."""

    kernels: int
    compiled: int  # functions, with those that kernels are made of; the others were there
    processes: int
    elapsed_s: float
    processor_s: float
    folders: tuple[str, ...]  # where they are kept


@dataclass(frozen=True)
class One:
    """What one kernel took."""

    compiled: int
    processor_s: float
    folder: str


def known() -> list[str]:
    """Kernels with the types of their arguments."""
    return [line for line in SIGNATURES.read_text("utf-8").splitlines() if line and not line.startswith("#")]


def compile_known(processes: int, say: Callable[[int, int, str], None]) -> Compiled:
    """Compile every kernel of `known` that is not there yet.

    Args: say: called with kernels done, kernels in all and which was the last.
    """
    begun, kernels, made = time.perf_counter(), known(), []
    if library() is not None:
        kernels.append(CALLED_BACK)
    say(0, len(kernels), "")
    with tempfile.TemporaryDirectory(prefix="coastwatch-compile-") as locks:
        for kernel, one in over_processes(partial(compile_one, locks), kernels, processes):
            made.append(one)
            say(len(made), len(kernels), kernel.partition(" ")[0])
    return Compiled(
        len(kernels),
        sum(one.compiled for one in made),
        processes,
        time.perf_counter() - begun,
        sum(one.processor_s for one in made),
        tuple(sorted({one.folder for one in made})),
    )


def compile_one(locks: str, kernel: str) -> One:
    """Compile a line of `known` in this process, or find that it is there."""
    from numba.core import event

    begun = time.process_time()
    name, _, given = kernel.partition(" ")
    if not given:
        module = importlib.import_module(name)
        made = [module.take_row, module.finish]
        compiled, folder = sum(one.cache_hits == 0 for one in made), str(made[0]._cache.cache_path)
        return One(compiled, time.process_time() - begun, folder)
    dispatcher, types = function(name), argument_types(given)
    with locked(Path(locks)), event.install_recorder("numba:compile") as seen:
        dispatcher.compile(types)
    compiled = sum(what.is_start and is_ours(what.data["dispatcher"]) for _, what in seen.buffer)
    return One(compiled, time.process_time() - begun, str(dispatcher.stats.cache_path))


def is_ours(dispatcher: Any) -> bool:
    """Whether a compiled function is of this house and so is kept on disk; each process compiles what it needs of numba's own."""
    return str(dispatcher.py_func.__module__).startswith("coastwatch.")


def function(name: str) -> Any:
    """A compiled function by its dotted name."""
    module, _, attribute = name.rpartition(".")
    return getattr(importlib.import_module(module), attribute)


def argument_types(text: str) -> tuple[Any, ...]:
    """Types of numba, as `as_line` writes them."""
    return tuple(eval(f"({text},)", _names()))


def as_line(dispatcher: Any, types: Iterable[Any]) -> str:
    """A line of `known`."""
    return f"{_dotted(dispatcher.py_func)} {', '.join(map(_written, types))}"


def _written(kind: Any) -> str:
    """A type as an expression of the names of `_names`. That of a named tuple is not what numba prints of it."""
    members = getattr(kind, "types", None)
    if members is None:
        return repr(kind)
    written = ", ".join(map(_written, members))
    named = getattr(kind, "instance_class", None)
    return f"tuple_of({written})" if named is None else f"named({_dotted(named)!r}, {written})"


@cache
def _names() -> dict[str, Any]:
    from numba import types

    def tuple_of(*members: Any) -> Any:
        return types.BaseTuple.from_types(members)

    def named(name: str, *members: Any) -> Any:
        return types.BaseTuple.from_types(members, function(name))

    return {**vars(types), "tuple_of": tuple_of, "named": named, "__builtins__": {}}


def _dotted(what: Any) -> str:
    return f"{what.__module__}.{what.__qualname__}"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Inside the block a function is compiled by one process at a time, of all that have this folder for their locks."""
    from numba.core.caching import Cache

    held: dict[tuple[str, str], Any] = {}
    load, save = Cache.load_overload, Cache.save_overload

    def found_or_locked(self: Any, sig: Any, context: Any) -> Any:
        index = self._cache_file._index_path
        lock = (folder / hashlib.sha1(index.encode()).hexdigest()).open("w")
        fcntl.flock(lock, fcntl.LOCK_EX)
        found = load(self, sig, context)
        if found is None:
            held[index, str(sig)] = lock  # until it is saved
        else:
            lock.close()
        return found

    def saved(self: Any, sig: Any, made: Any) -> None:
        try:
            save(self, sig, made)
        finally:
            held.pop((self._cache_file._index_path, str(sig))).close()

    Cache.load_overload, Cache.save_overload = found_or_locked, saved  # type: ignore[method-assign]
    try:
        yield
    finally:
        Cache.load_overload, Cache.save_overload = load, save  # type: ignore[method-assign]
        for lock in held.values():
            lock.close()
