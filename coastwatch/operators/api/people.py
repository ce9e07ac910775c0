"""People and programs that ask: their roles, the file with the hashes of their tokens, a trusted proxy, and how fast each may ask.

A trusted proxy, such as oauth2-proxy, has asked people who they are: their names and groups come in headers.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError
from starlette.datastructures import Headers

from coastwatch.errors import InputError
from coastwatch.scenario.refusing import refusals, sentence
from coastwatch.server.troubles import Trouble
from coastwatch.spelling import ONE_LINE

ROLES = ("viewer", "operator", "admin")
"""Each may do what those before it may."""

Role = Literal["viewer", "operator", "admin"]
TOKEN_BYTES = 32
A_SECOND, AT_ONCE = 20.0, 60.0
"""Requests of one token or address: on average, and in a burst."""

FILES_A_SECOND, FILES_AT_ONCE = 200.0, 600.0
"""The same of files of the page and tiles of the land: a map that is moved asks for many at once."""

MOST_BUCKETS = 10_000
USER, GROUPS = "x-forwarded-user", "x-forwarded-groups"
GROUP = "coastwatch-"
"""The group of a role is this text and the role: coastwatch-viewer, coastwatch-operator, coastwatch-admin."""

LONGEST_NAME = 64


@dataclass(frozen=True)
class Person:
    """Who asks: the name of a token or of a user of a trusted proxy, and a role."""

    name: str
    role: str

    def may(self, role: str) -> bool:
        """Whether the role of this person may do what another one may."""
        return ROLES.index(self.role) >= ROLES.index(role)


class Token(BaseModel):
    """One row of tokens.toml. The token itself is not kept."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=64)]
    role: Role
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    expires_utc: AwareDatetime | None = None

    def is_valid(self) -> bool:
        """Whether it has not expired."""
        return self.expires_utc is None or self.expires_utc > datetime.now(UTC)


class _NewToken(Token):
    """One that is added. Files of before may hold what is refused here."""

    name: Annotated[str, Field(min_length=1, max_length=64, pattern=ONE_LINE)]


class _File(BaseModel):
    """What a file of tokens holds."""

    tokens: tuple[Token, ...] = ()


class Tokens:
    """The tokens of a file. It is read again when it changes. While it cannot be read those of before hold."""

    def __init__(self, path: Path) -> None:
        """Raises: InputError, OSError that name the file."""
        self._path = path
        self._read_at: tuple[int, ...] | None = stamp(path)
        self._tokens = read(path)
        self._wrong: tuple[float, str] | None = None  # since when, and what
        if not self._tokens:
            raise InputError(f"{path}: got no token, needed at least one; `coastwatch token add NAME` makes one")

    def person(self, text: str) -> Person | None:
        """Who has the token with this text, if it is valid."""
        self._reload()
        digest = _digest(text)
        tokens = [token for token in self._tokens if hmac.compare_digest(token.sha256, digest)]
        return Person(tokens[0].name, tokens[0].role) if tokens and tokens[0].is_valid() else None

    def troubles(self) -> list[Trouble]:
        """What is wrong with the file now."""
        self._reload()
        wrong = self._wrong
        return [] if wrong is None else [Trouble("tokens", self._path.name, *wrong, False)]

    def reread(self) -> None:
        """Read the file again, whether it has changed or not."""
        self._read_at = None
        self._reload()

    def _reload(self) -> None:
        now: tuple[int, ...] | None = None
        try:
            now = stamp(self._path)
            if now == self._read_at:
                return
            self._tokens = read(self._path)
        except (OSError, InputError) as error:
            now = None if isinstance(error, OSError) else now
            reason = error.strerror if isinstance(error, OSError) else str(error).removeprefix(f"{self._path}: ")
            self._note(f"the tokens of before hold: {reason}")
        else:
            self._note("" if self._tokens else "there is no token in it, so nobody may ask")
        self._read_at = now

    def _note(self, trouble: str) -> None:
        since_s = time.time() if self._wrong is None else self._wrong[0]
        self._wrong = (since_s, trouble) if trouble else None


def stamp(path: Path) -> tuple[int, ...]:
    """What changes with a file. Raises: OSError."""
    about = path.stat()
    return about.st_mtime_ns, about.st_size, about.st_ino


def read(path: Path) -> tuple[Token, ...]:
    """The tokens of a file. Raises: InputError, OSError that name it."""
    try:
        return _File.model_validate(tomllib.loads(path.read_text("utf-8"))).tokens
    except (tomllib.TOMLDecodeError, ValidationError, UnicodeDecodeError, RecursionError) as error:
        refusal = str(error)
        if isinstance(error, ValidationError):  # a value is not repeated: it may be a token
            shown = [one if one["loc"][-1] in ("role", "expires_utc") else {**one, "input": "..."} for one in error.errors()]
            refusal = "; ".join(sentence(one, _File) for one in shown)
        raise InputError(
            f"{path}: {refusal}; needed [[tokens]] with name, role and sha256, as `coastwatch token add` writes it"
        ) from error


def add(path: Path, name: str, role: str, expires_s: float | None) -> str:
    """Add a token to a file that only its owner may read. Returns: the token, which is not kept.

    Raises: InputError, OSError; nothing is written then.
    """
    if path.exists() and any(token.name == name for token in read(path)):
        raise InputError(f"{path}: got the name {name!r} again, needed a new one; delete its [[tokens]] to replace it")
    text = secrets.token_urlsafe(TOKEN_BYTES)
    try:
        _NewToken.model_validate({"name": name, "role": role, "sha256": _digest(text)})
    except ValidationError as error:
        raise InputError("; ".join(refusals(error, _NewToken))) from None
    quoted = json.dumps(name, ensure_ascii=False)
    rows = ["", "[[tokens]]", f"name = {quoted}", f'role = "{role}"', f'sha256 = "{_digest(text)}"']
    if expires_s is not None:
        rows.append(f"expires_utc = {datetime.fromtimestamp(expires_s, UTC).isoformat()}")
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600), "a", encoding="utf-8") as file:
        file.write("\n".join([*rows, ""]))
    return text


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()


@dataclass(frozen=True)
class TrustedProxy:
    """The addresses of a proxy. Its headers are taken from these addresses only."""

    networks: tuple[IPv4Network | IPv6Network, ...]

    def person(self, client: str, headers: Headers) -> Person | None:
        """Who asks through the proxy, with the highest role of the groups; None: somebody else asks, or without such a group.

        A header that comes twice is refused: one of the two may be of the browser.

        Args: client: address of the other end of the connection.
        """
        try:
            address = ip_address(client)
        except ValueError:  # a socket of the file system has no address
            return None
        addresses = (address, getattr(address, "ipv4_mapped", None) or address)
        if not any(one in network for network in self.networks for one in addresses):
            return None
        users, groups = headers.getlist(USER), headers.getlist(GROUPS)
        if len(users) != 1 or len(groups) != 1 or not users[0].strip():
            return None
        names = {group.strip() for group in groups[0].split(",")}
        roles = [role for role in ROLES if GROUP + role in names]
        return Person(users[0].strip()[:LONGEST_NAME], roles[-1]) if roles else None


def trusted(texts: Sequence[str]) -> TrustedProxy:
    """The proxy with these addresses or networks, such as 10.0.0.5 or 10.0.0.0/28. Raises: InputError."""
    try:
        networks = tuple(ip_network(text) for text in texts)
    except ValueError as error:
        raise InputError(f"--trusted-proxy: {error}; needed an address or network such as 10.0.0.5 or 10.0.0.0/28") from error
    wide = next((network for network in networks if network.prefixlen == 0), None)
    if wide is not None:
        raise InputError(f"--trusted-proxy: got {wide}, which is everybody, needed the addresses of the proxy")
    return TrustedProxy(networks)


@dataclass
class _Bucket:
    left: float
    at_s: float


class Limits:
    """A bucket of requests for each token or address."""

    def __init__(self, a_second: float = A_SECOND, at_once: float = AT_ONCE) -> None:
        self._a_second, self._at_once = a_second, at_once
        self._buckets: dict[str, _Bucket] = {}  # the one that asked last is last

    def wait_s(self, who: str) -> float:
        """Take one request. Returns: seconds until the next one is allowed, 0: it is allowed now."""
        now_s = time.monotonic()
        bucket = self._buckets.pop(who, None) or _Bucket(self._at_once, now_s)
        self._buckets[who] = bucket
        bucket.left = min(bucket.left + (now_s - bucket.at_s) * self._a_second, self._at_once)
        bucket.at_s = now_s
        if len(self._buckets) > MOST_BUCKETS:
            del self._buckets[next(iter(self._buckets))]
        if bucket.left < 1.0:
            return (1.0 - bucket.left) / self._a_second
        bucket.left -= 1.0
        return 0.0
