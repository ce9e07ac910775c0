"""A web hook as it is set: who is told of which alarms, and how a message is signed."""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from urllib.parse import urlsplit

from coastwatch.batches import ALARM_KINDS
from coastwatch.errors import InputError
from coastwatch.server.link import first_line


@dataclass(frozen=True)
class WebHook:
    """Who is told of which alarms."""

    url: str
    kinds: tuple[str, ...] = ()  # of alarms; none: all
    secret: str = ""  # signs each message; empty: no signature

    @property
    def name(self) -> str:
        """Host and port: a path or a query may hold a secret."""
        return urlsplit(self.url).netloc.rpartition("@")[2]


def checked(hook: WebHook) -> WebHook:
    """The hook, if it can work. Raises: InputError."""
    if urlsplit(hook.url).scheme not in ("http", "https") or not hook.name:
        raise InputError(f"webhook: got {hook.name or hook.url[:40]!r}, needed an address such as https://host/path")
    if "#" in hook.url:  # HTTP sends nothing of what is behind it
        raise InputError(f"webhook {hook.name}: got '#' in its address, needed %23 for one that is meant")
    unknown = [kind for kind in hook.kinds if kind not in ALARM_KINDS]
    if unknown:
        raise InputError(f"webhook {hook.name}: kinds: got {unknown[0]!r}, needed some of {', '.join(ALARM_KINDS)}")
    return hook


def signature(secret: str, timestamp: str, body: bytes) -> str:
    """The value of X-Coastwatch-Signature: "sha256=" and HMAC-SHA256 of timestamp, point and body."""
    return "sha256=" + hmac.new(secret.encode(), timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()


def secret_of(path: str | None) -> str:
    """The secret in the first line of a file; empty: no file. Raises: InputError that names the file."""
    if path is None:
        return ""
    try:
        secret = first_line(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if not secret:
        raise InputError(f"{path}: got an empty first line, needed the secret that signs messages to web hooks")
    return secret
