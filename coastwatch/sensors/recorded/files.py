"""Recorded files: where they are, whether they have changed, and what their first bytes say of them."""

from __future__ import annotations

import gzip
import re
import zlib
from collections import Counter
from pathlib import Path
from typing import IO, cast

import coastwatch
from coastwatch.errors import InputError

Fingerprint = tuple[tuple[Path, int, int], ...]

LOOK_BYTES = 65_536
SCAN_BYTES = 1 << 26  # of a file that does not begin with what is wanted
SENTENCE = re.compile(rb"[!$][A-Z]{2}([A-Z]{3}),")
SENTENCES = {"ais": ("VDM", "VDO"), "tracks": ("TTM", "TLL")}
"""Sentences of NMEA 0183 that hold AIS, and finished tracks."""
SETTING_OF_SENTENCES = {"ais": "nmea", "tracks": "track_sentences"}

CUT_FILE = "file cut short"
GZIP_MAGIC, PARQUET_MAGIC = b"\x1f\x8b", b"PAR1"
OTHER_FORMATS = {
    b"\xfd7zXZ\x00": "a file compressed by xz",
    b"\x28\xb5\x2f\xfd": "a file compressed by zstd",
    b"BZh": "a file compressed by bzip2",
    b"PK\x03\x04": "a file compressed by zip",
    b"7z\xbc\xaf": "a file compressed by 7-Zip",
}
MARKUP = {b"{": "JSON", b"[": "JSON", b"<": "HTML or XML"}
UTF_16_MARKS = b"\xff\xfe", b"\xfe\xff"
NEVER_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")
UNDECODABLE = "\ufffd".encode()
UNDECODABLE_SHARE = 0.005  # of the characters; random bytes have 3 % in UTF-16
BINARY_SHARE = 0.02  # random bytes have 11 %; one bad cell does not make a table binary


def _checkout() -> Path:
    return Path(coastwatch.__file__).resolve().parents[1]


def existing_path(path: Path) -> Path:
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
        return existing_path(root)
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
    stats = []
    for path in map(existing_path, paths):
        stat = path.stat()
        stats.append((path, stat.st_size, stat.st_mtime_ns))
    return tuple(stats)


def opened(path: Path) -> IO[bytes]:
    """The file, decompressed as it is read if it is gzip. Raises: OSError."""
    with path.open("rb") as plain:
        packed = plain.read(2) == GZIP_MAGIC
    return cast(IO[bytes], gzip.open(path, "rb")) if packed else path.open("rb")


def head(path: Path, size: int | None = None) -> bytes:
    """The first bytes of a file, LOOK_BYTES unless told otherwise, decompressed if needed.

    Raises: InputError that names the file: it is not there, is compressed in another way, or is gzip that cannot be decompressed.
    """
    size = LOOK_BYTES if size is None else size
    with path.open("rb") as file:
        content = file.read(max(size, LOOK_BYTES))  # a few bytes of gzip are none of the file
    for magic, kind in OTHER_FORMATS.items():
        if content.startswith(magic):
            workbook = path.suffix.lower() in (".xlsx", ".ods")
            got, mend = ("a workbook", "save it as CSV") if workbook else (kind, "unpack it first")
            raise InputError(f"{path}: got {got}, needed text, gzip or Parquet: {mend}")
    if not content.startswith(GZIP_MAGIC):
        return content[:size]
    try:
        return zlib.decompressobj(wbits=31).decompress(content, size)
    except zlib.error as error:
        raise InputError(f"{path}: got gzip that cannot be decompressed ({error}), needed text, gzip or Parquet") from error


def is_parquet(path: Path) -> bool:
    """Whether a file is Parquet, by its first bytes: its name may end in .geoparquet, .pq or anything else. Raises: OSError."""
    with path.open("rb") as file:
        return file.read(len(PARQUET_MAGIC)) == PARQUET_MAGIC


def as_utf8(content: bytes) -> bytes:
    """The same text in UTF-8 without a byte order mark, of text in UTF-8 or in UTF-16 with its mark."""
    wide = content[:2] in UTF_16_MARKS
    return content.decode("utf-16", "replace").encode() if wide else content.removeprefix(b"\xef\xbb\xbf")


def check_table(path: Path) -> None:
    """Refuses a file that cannot be a table. The reader of tables refuses what is wrong inside one.

    Raises: InputError that names the file, what it holds and what to do.
    """
    content = as_utf8(head(path))
    begin = content.lstrip()
    if content.startswith(PARQUET_MAGIC):
        return
    if path.suffix == ".parquet":
        got = "bytes that are not Parquet"
    elif not begin:
        got = "an empty file"
    elif (markup := MARKUP.get(begin[:1])) and not SENTENCE.search(begin.split(b"\n", 1)[0]):
        got = markup
    elif content.count(UNDECODABLE) > UNDECODABLE_SHARE * len(content.decode(errors="replace")):
        got = "bytes that begin as UTF-16 and are no text"
    else:
        got = "bytes that are not text" if len(NEVER_TEXT.findall(content)) > BINARY_SHARE * len(content) else ""
    if got:
        raise InputError(f"{path}: got {got}, needed a table in CSV or Parquet; AIS and tracks may be NMEA 0183")
    if counts := sentences_in(path):
        part = next((part for part, kinds in SENTENCES.items() if any(counts[kind] for kind in kinds)), None)
        mend = (
            f"use --{part} (in a scenario: input.{SETTING_OF_SENTENCES[part]})" if part else "needed a table in CSV or Parquet"
        )
        raise InputError(f"{path}: it holds {_counts(counts)} sentences of NMEA 0183 and no table: {mend}")


def has_sentences(path: Path, part: str) -> bool:
    """Whether a file holds the sentences of a part, "ais" or "tracks"; False if it is no file of NMEA 0183.

    Raises: InputError that names the file, and its sentences if they are others.
    """
    begin = head(path)
    counts = Counter(m[1].decode() for m in SENTENCE.finditer(begin))
    if any(counts[kind] for kind in SENTENCES[part]):
        return True
    if begin[:2] in UTF_16_MARKS and SENTENCE.search(as_utf8(begin)):
        raise InputError(f"{path}: got NMEA 0183 in UTF-16, needed ASCII or UTF-8: save it again as UTF-8")
    counts = sentences_in(path)
    if any(counts[kind] for kind in SENTENCES[part]):
        return True
    if not counts:
        return False
    wanted = " or ".join(SENTENCES[part])
    other = next((o for o, kinds in SENTENCES.items() if any(counts[kind] for kind in kinds)), None)
    shown = counts if other is None else Counter({kind: counts[kind] for kind in SENTENCES[other] if counts[kind]})
    mend = f"use --{other} (in a scenario: input.{SETTING_OF_SENTENCES[other]})" if other else f"needed {wanted}"
    raise InputError(f"{path}: it holds {_counts(shown)} sentences and no {wanted}: {mend}")


def sentences_in(path: Path) -> Counter[str]:
    """How many sentences of each kind a file of NMEA 0183 has in its first 64 MB; nothing for another file."""
    lines = head(path).splitlines()[:200]
    if 2 * sum(SENTENCE.search(line) is not None for line in lines) <= len(lines):
        return Counter()
    return Counter(m[1].decode() for m in SENTENCE.finditer(head(path, SCAN_BYTES)))


def _counts(counts: Counter[str]) -> str:
    return ", ".join(f"{count:,} {kind}" for kind, count in counts.most_common(5))
