"""A file of the command line that is whole, or as it was before."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO


@contextmanager
def written(output: str) -> Iterator[IO[bytes]]:
    """A file that takes its name, and the place of an old one, when the block has ended without an error.

    What is no ordinary file, such as /dev/stdout, is written as it is. Raises: OSError that names the output.
    """
    is_there = Path(output).exists()
    if is_there and not Path(output).is_file():
        with open(output, "wb") as file:
            yield file
        return
    path = Path(os.path.realpath(output))  # a link stays one
    if is_there and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), output)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with beside.open("wb") as file:
            yield file
        if is_there:
            shutil.copymode(path, beside)
        beside.replace(path)
    except OSError as error:
        _remove(beside)
        if error.errno == errno.ENOSPC:
            kept = "the old file is kept" if is_there else "no file is left"
            raise OSError(f"{output}: got a full disk, needed room for the file: {kept}") from error
        raise OSError(error.errno, error.strerror or str(error), output) from error
    except BaseException:
        _remove(beside)
        raise


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink(missing_ok=True)
