"""Paths of recorded files, and whether the files have changed."""

from __future__ import annotations

from pathlib import Path

import coastwatch

Fingerprint = tuple[tuple[Path, int, int], ...]


def _checkout() -> Path:
    return Path(coastwatch.__file__).resolve().parents[1]


def found(path: Path) -> Path:
    """The path as given if it exists, else relative to the checkout.

    Raises: FileNotFoundError that names both.
    """
    seen = [path, _checkout() / path]
    for place in seen:
        if place.exists():
            return place
    raise FileNotFoundError(f"recorded input: got {path}, needed a file there or at {seen[1]}")


def data_folder(root: Path | None, name: str) -> Path:
    """The folder of a recorded dataset: the given root, or `shared/data/<name>` next to the checkout or the working directory.

    Raises: FileNotFoundError that names every folder that was tried.
    """
    if root is not None:
        return found(root)
    looked = [parent / "shared" / "data" / name for parent in (_checkout().parent, Path.cwd(), Path.cwd().parent)]
    for folder in looked:
        if folder.is_dir():
            return folder
    where = ", ".join(str(folder) for folder in dict.fromkeys(looked))
    raise FileNotFoundError(f"recorded data {name}: no folder at {where}; set input.root to its folder")


def fingerprint(paths: tuple[Path, ...]) -> Fingerprint:
    """Path, size and modification time of each file: a cache of file content uses it as its key.

    Raises: FileNotFoundError that names the missing file.
    """
    out = []
    for path in map(found, paths):
        stat = path.stat()
        out.append((path, stat.st_size, stat.st_mtime_ns))
    return tuple(out)
