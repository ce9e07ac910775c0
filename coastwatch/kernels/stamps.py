"""Whether code that numba kept on disk is still that of the source: of the module, and of all of this house that it imports.

numba looks at the module alone. A kernel whose parts come from a module that was changed by `git pull` would go on with parts as they
were, and read arrays as they were laid out before.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching

HOUSE = Path(__file__).parents[2]
"""The folder that holds the package."""

IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(coastwatch[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+(coastwatch[\w.]*))", re.M
)


def digest(path: Path, house: Path = HOUSE) -> bytes:
    """Of a module and of those that it imports, they again, and so on; in functions too."""
    found = hashlib.sha256()
    for module in sorted(_reached(path, house)):
        found.update(_content(module))
    return found.digest()


def _reached(path: Path, house: Path) -> set[Path]:
    reached, new = {path}, [path]
    while new:
        for module in _imports(new.pop(), house):
            if module not in reached:
                reached.add(module)
                new.append(module)
    return reached


@cache
def _imports(path: Path, house: Path) -> tuple[Path, ...]:
    """Modules of the house that a module names."""
    return tuple(_named(path.read_text("utf-8"), house))


def _named(text: str, house: Path) -> Iterator[Path]:
    for package, names, module in IMPORT.findall(text):
        inside = [f"{package}.{name}" for name in re.findall(r"\w+", names)]
        for dotted in [package or module, *inside]:
            place = house / dotted.replace(".", "/")
            for file in (place.with_suffix(".py"), place / "__init__.py"):
                if file.is_file():
                    yield file


@cache
def _content(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


class _Whole:
    """The stamp of a function of this house; others keep numba's own."""

    _py_file: str

    def get_source_stamp(self) -> Any:
        own, path = super().get_source_stamp(), Path(self._py_file)  # type: ignore[misc]
        return (own, digest(path)) if HOUSE / "coastwatch" in path.parents else own


class Given(_Whole, caching.UserProvidedCacheLocator):
    """In NUMBA_CACHE_DIR."""


class Beside(_Whole, caching.InTreeCacheLocator):
    """Beside the module."""


class OfTheUser(_Whole, caching.UserWideCacheLocator):
    """In the user's cache."""


def take_over() -> None:
    """From now on numba keeps functions of this house by these stamps, unless its setting CACHE_LOCATOR_CLASSES names others."""
    ours = {kind.__mro__[2]: kind for kind in (Given, Beside, OfTheUser)}
    caching.CacheImpl._locator_classes = [ours.get(kind, kind) for kind in caching.CacheImpl._locator_classes]
