"""Where recorded files are, and whether they changed."""

from __future__ import annotations

from pathlib import Path

import coastwatch

Fingerprint = tuple[tuple[Path, int, int], ...]


def _checkout() -> Path:
    return Path(coastwatch.__file__).resolve().parents[1]


def found(path: Path) -> Path:
    """The path as it stands, or seen from the checkout where nothing stands there.

    Raises: FileNotFoundError that names both places.
    """
    seen = [path, _checkout() / path]
    for place in seen:
        if place.exists():
            return place
    raise FileNotFoundError(f"recorded input: got {path}, needed a file there or at {seen[1]}")


def data_folder(root: Path | None, name: str) -> Path:
    """The folder of a recorded dataset: the given root, or `shared/data/<name>` next to the checkout or the working directory.

    Raises: FileNotFoundError that names every folder looked at.
    """
    if root is not None:
        return found(root)
    looked = [parent / "shared" / "data" / name for parent in (_checkout().parent, Path.cwd(), Path.cwd().parent)]
    for folder in looked:
        if folder.is_dir():
            return folder
    where = ", ".join(str(folder) for folder in dict.fromkeys(looked))
    raise FileNotFoundError(f"recorded data {name}: no folder at {where}; set input.root to where it is")


def fingerprint(paths: tuple[Path, ...]) -> Fingerprint:
    """Path, size and change time of each file: equal fingerprints need not be read twice.

    Raises: FileNotFoundError that names the missing file.
    """
    out = []
    for path in map(found, paths):
        stat = path.stat()
        out.append((path, stat.st_size, stat.st_mtime_ns))
    return tuple(out)
