"""The file of a server: what its service runs, listens on and receives, in place of a long command line."""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from pydantic import Field, ValidationError, model_validator

from coastwatch.alarms import Zone
from coastwatch.errors import InputError
from coastwatch.operators.api.webhook_settings import WebHook, checked, secret_of
from coastwatch.scenario import Scenario
from coastwatch.scenario.refusing import refusals
from coastwatch.stage import Settings

Port = Annotated[int, Field(strict=True, ge=0, le=65_535)]
TABLES = ("server", "feeds", "regions", "webhooks")

DEFAULTS: dict[str, Any] = {
    "host": "127.0.0.1",
    "port": 8100,
    "speed": 1.0,
    "clock": "wall",
    "role": "all",
    "feed": [],
    "region": [],
    "out": [],
    "webhook": [],
    "zones": (),
}
"""Options that are neither in the file nor on the command line."""

LATENESS_S = {"all": 2.0, "region": 2.0, "centre": 5.0}
"""A centre waits for its regions, which wait for their radars."""

PATHS = ("tokens", "tls_cert", "tls_key")
FILES = ("token-file", "ca-file", "password-file")
"""Options of addresses that are paths."""


class Server(Settings):
    """How a server runs. A path is relative to the folder of the file."""

    scenario: str | None = None  # name, folder or .toml file; none: follow the database
    settings: dict[str, Any] = Field(default_factory=dict)  # of the scenario, by dotted key, as --set
    db: str | None = None  # SQLAlchemy URL, or path of an SQLite file
    workers: Annotated[int, Field(strict=True, ge=1, le=4096)] | None = None
    role: Literal["all", "region", "centre"] | None = None
    clock: Literal["wall", "feeds"] | None = None
    lateness_s: Annotated[float, Field(strict=True, ge=0.0, le=3600.0)] | None = None
    speed: Annotated[float, Field(strict=True, ge=0.1, le=100.0)] | None = None
    host: str | None = None
    port: Port | None = None
    tokens: str | None = None  # file of tokens
    tls_cert: str | None = None
    tls_key: str | None = None
    trusted_proxy: tuple[str, ...] = ()  # networks, as --trusted-proxy
    out: tuple[str, ...] = ()  # feeds that are sent, as --out


class NamedFeed(Settings):
    """A feed or a region."""

    name: Annotated[str, Field(min_length=1, max_length=32)] | None = None  # in lists; of a region, its track source
    url: str


class Hook(Settings):
    """A web hook: a POST for each alarm that begins or ends."""

    url: str
    kinds: tuple[str, ...] = ()  # of alarms; none: all
    secret: str | None = None  # signs each message
    secret_file: str | None = None  # or the file whose first line it is


class ServerFile(Settings):
    """The tables of the file."""

    server: Server = Server()
    feeds: tuple[NamedFeed, ...] = ()
    regions: tuple[NamedFeed, ...] = ()
    webhooks: tuple[Hook, ...] = ()
    zones: tuple[Zone, ...] = ()  # beside those of the scenario

    @model_validator(mode="after")
    def _zones_have_a_run(self) -> ServerFile:
        if self.zones and self.server.scenario is None:
            raise ValueError(
                "zones: got them without server.scenario, needed both: the process that writes the database watches zones"
            )
        return self


def with_file(options: argparse.Namespace) -> argparse.Namespace:
    """The options, with those of the server file that its first argument names, if it names one; the command line goes first.

    Raises: InputError that names the file and the key.
    """
    found = _read(options.scenario)
    given = {} if found is None else _options(found, Path(options.scenario))
    out = argparse.Namespace(**vars(options))
    if found is not None:
        out.scenario = given.pop("scenario", None)
        out.settings = [*given.pop("settings", ()), *options.settings]
        out.db = given.pop("db", options.db) if options.db == options.default_db else options.db
    for name, value in {**DEFAULTS, **given}.items():
        if getattr(out, name, None) in (None, []):
            setattr(out, name, value)
    if out.lateness is None:
        out.lateness = LATENESS_S[out.role]
    return out


def with_zones(scenario: Scenario, zones: tuple[Zone, ...]) -> Scenario:
    """The scenario with more zones; their numbers follow those of its own. Raises: InputError where a name is there twice."""
    names = [zone.name for zone in (*scenario.zones, *zones)]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(
            f"zones: got the name {twice!r} {names.count(twice)} times in the scenario and the server file, needed each once"
        )
    return scenario.model_copy(update={"zones": (*scenario.zones, *zones)})


def _read(name: str | None) -> ServerFile | None:
    """The file of a server; None: it is a scenario, or the name of one."""
    path = None if name is None else Path(name)
    if path is None or path.suffix != ".toml" or not path.is_file():
        return None
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return None  # the reader of scenarios says what is wrong
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if not any(table in data for table in TABLES):
        return None
    try:
        return ServerFile.model_validate(data)
    except ValidationError as error:
        raise InputError("\n".join(f"{path}: {said}" for said in refusals(error, ServerFile))) from error


def _options(file: ServerFile, path: Path) -> dict[str, Any]:
    """What a file says, by the names of the options."""
    here, server = path.parent, file.server
    out = {
        name: value
        for name, value in server.model_dump(exclude_none=True).items()
        if name not in ("settings", "lateness_s", "scenario", "db", "out", "trusted_proxy", *PATHS)
    }
    out |= {name: str(here / value) for name in PATHS if (value := getattr(server, name)) is not None}
    if server.scenario is not None:
        beside = here / server.scenario
        out["scenario"] = str(beside) if beside.exists() else server.scenario
    if server.db is not None:
        out["db"] = server.db if "://" in server.db else str(here / server.db)
    out["settings"] = [(key, value if isinstance(value, str) else _toml(value)) for key, value in server.settings.items()]
    out |= {"out": list(server.out), "trusted_proxy": list(server.trusted_proxy)}
    if server.lateness_s is not None:
        out["lateness"] = server.lateness_s
    for name, many in (("feed", file.feeds), ("region", file.regions)):
        out[name] = [_url(one, here) for one in many]
    out["zones"] = file.zones
    out["webhook"] = [_hook(one, here) for one in file.webhooks]
    return out


def _hook(hook: Hook, here: Path) -> WebHook:
    secret = hook.secret or secret_of(None if hook.secret_file is None else str(here / hook.secret_file))
    return checked(WebHook(hook.url, hook.kinds, secret))


def _toml(value: Any) -> str:
    """A value as --set takes it."""
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _url(feed: NamedFeed, here: Path) -> str:
    """The address with its name, and with files relative to a folder."""
    parts = urlsplit(feed.url)
    options = parse_qsl(parts.query)
    if any(key in FILES for key, _ in options):
        options = [(key, str(here / value) if key in FILES else value) for key, value in options]
        parts = parts._replace(query=urlencode(options, safe="/:,"))
    url = urlunsplit(parts)
    return url if feed.name is None else f"{url}{'&' if parts.query else '?'}name={feed.name}"
