"""How large a request may be. What is larger is refused before anything reads it."""

from __future__ import annotations

from typing import NamedTuple

from starlette.types import Scope

LARGEST_HEAD = 65_536
"""Bytes of a request line with its headers; also of the trailers of a body."""

LARGEST_TARGET = 8192
"""Bytes of a path with its query."""

MOST_PARAMETERS = 64
"""Parameters of a query."""

LARGEST_BODY = 262_144
"""Bytes of a body. A zone with the most corners takes 50,000, with indentation 100,000."""

MOST_VALUES = 8192
"""Values of a body of JSON, about: its commas and brackets. A zone with the most corners has 4,000."""

LARGEST_MESSAGE = 65_536
"""Bytes of a message from a viewer."""

MOST_FRAGMENTS = 1024
"""Frames of a message from a viewer."""

LARGEST_EXTRA = LARGEST_BODY + 2 * LARGEST_HEAD
"""Bytes of a connection between two answers: a body with its head, chunk sizes and trailers. More end the connection."""


class TooLarge(NamedTuple):
    """Why a request is refused."""

    status: int
    detail: str


def too_large(scope: Scope) -> TooLarge | None:
    """Why the head of a request is refused; None: it is not."""
    query: bytes = scope.get("query_string", b"")
    target = len(scope.get("raw_path") or b"") + len(query)
    if target > LARGEST_TARGET:
        return TooLarge(414, f"got a path and query of {target} bytes, needed at most {LARGEST_TARGET}")
    parameters = query.count(b"&") + 1
    if parameters > MOST_PARAMETERS:
        return TooLarge(400, f"query: got {parameters} parameters, needed at most {MOST_PARAMETERS}")
    size = sum(len(name) + len(value) for name, value in scope["headers"])
    if size > LARGEST_HEAD:
        return TooLarge(431, f"got headers of {size} bytes, needed at most {LARGEST_HEAD}")
    length = next((value for name, value in scope["headers"] if name == b"content-length"), b"0")
    if not length.isdigit() or len(length) > 18 or int(length) > LARGEST_BODY:
        return TooLarge(413, f"got a body of {length[:20].decode('ascii', 'replace')} bytes, needed at most {LARGEST_BODY}")
    return None


def has_too_many_values(body: bytes) -> bool:
    """Whether a body of JSON has more values than any that is meant; commas in texts count too."""
    return body.count(b",") + body.count(b"[") + body.count(b"{") > MOST_VALUES
