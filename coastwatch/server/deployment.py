"""How a server runs: one struct that the server file, the environment and the command line fill.

A field of `Server` or `Deployment` with its docstring is the whole of an option: its name, type, default and help.
"""

from __future__ import annotations

import os
import shlex
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_origin
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

from pydantic import ConfigDict, Field, ValidationError, model_validator

from coastwatch.alarms import Zone
from coastwatch.errors import InputError
from coastwatch.scenario import Scenario, ScenarioError, TrackSource, refuse_shared_names
from coastwatch.scenario.refusing import refusals
from coastwatch.shipped import DEFAULT_DB
from coastwatch.stage import Settings

LATENESS_S = {"all": 2.0, "region": 2.0, "centre": 5.0}
"""A centre waits for its regions, which wait for their radars."""

PATIENCE_S = 10.0
"""A track that its region has not sent for so long is dropped: a region sends all its tracks in every cycle."""

TABLES = ("server", "feeds", "regions", "webhooks")
FILES = ("token-file", "ca-file", "password-file")
"""Options of addresses that are paths."""


@dataclass(frozen=True)
class Option:
    """How the command line writes a field."""

    metavar: str | None = None
    flag: str = ""  # without dashes; empty: the name of the field
    is_file: bool = False  # completed with files; in the server file relative to its folder


class Server(Settings):
    """The fields that the table [server] of a server file may have. A path there is relative to the folder of the file."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    scenario: Annotated[str | None, Option("SCENARIO|FILE")] = None
    """name, folder or .toml file of a scenario, or the .toml file of a server (default: follow the database)"""

    settings: Annotated[dict[str, Any], Option("KEY=VALUE", "set")] = Field(default_factory=dict)
    """override a setting of the scenario; repeatable"""

    db: Annotated[str, Option("URL", is_file=True)] = DEFAULT_DB
    """database: SQLAlchemy URL, or path of an SQLite file (default: sqlite:///coastwatch.db, in the working directory)"""

    workers: Annotated[int | None, Field(strict=True, ge=1, le=4096), Option("N")] = None
    """processors that share the work (default: the scenario's, in its [workers])"""

    role: Literal["all", "region", "centre"] = "all"
    """region: also send the tracks of its radars to centres; centre: take the tracks of regions in place of radars; all: both in one \
process (default: all)"""

    out: Annotated[tuple[str, ...], Option("URL")] = ()
    """send the picture of each cycle: cot+udp://239.2.3.1:6969, cot+tcp://HOST:PORT (Cursor on Target), \
ttm+udp://HOST:PORT?site=LAT,LON, tll+udp://HOST:PORT (NMEA targets), asterix+udp://HOST:PORT (CAT 062); ?rate=N messages a second (500). \
Over UDP nobody \
says whether it arrives: the state of the feed is `sending`. Of a region: tracks+nats://HOST:PORT/NAME, its tracks to a stream; \
repeatable"""

    lateness_s: Annotated[float | None, Field(strict=True, ge=0.0, le=3600.0), Option("S", "lateness")] = None
    """seconds that a cycle waits for late reports; later ones are counted and left out (default: 2; of a centre 5)"""

    clock: Literal["wall", "feeds"] = "wall"
    """what time is: the clock of this machine, or the time stamps of the feeds, for replays (default: wall)"""

    speed: Annotated[float, Field(strict=True, ge=0.1, le=100.0), Option("N")] = 1.0
    """times as fast as the clock, 0.1 to 100 (default: 1)"""

    host: Annotated[str, Option("ADDRESS")] = "127.0.0.1"
    """address to listen on (default: 127.0.0.1)"""

    port: Annotated[int, Field(strict=True, ge=0, le=65_535), Option("N")] = 8100
    """port (default: 8100; 0: any free one)"""

    tokens: Annotated[str | None, Option("FILE", is_file=True)] = None
    """file of tokens, made by `coastwatch token add NAME`: then each request needs one; other addresses than loopback need it"""

    trusted_proxy: Annotated[tuple[str, ...], Option("CIDR")] = ()
    """address or network of a proxy that asks people who they are, such as oauth2-proxy: its X-Forwarded-User and \
X-Forwarded-Groups are believed (groups coastwatch-viewer, coastwatch-operator, coastwatch-admin); repeatable"""

    tls_cert: Annotated[str | None, Option("FILE", is_file=True)] = None
    """certificate chain, PEM, for https"""

    tls_key: Annotated[str | None, Option("FILE", is_file=True)] = None
    """its private key, PEM"""


class NamedFeed(Settings):
    """A feed or a region of a server file."""

    name: Annotated[str, Field(min_length=1, max_length=32)] | None = None  # in lists; of a region, its track source
    url: str

    def address(self, folder: Path) -> str:
        """The URL with its name, and with files relative to a folder."""
        parts = urlsplit(self.url, allow_fragments=False)  # as feeds read it
        options = parse_qsl(parts.query)
        if any(key in FILES for key, _ in options):
            options = [(key, str(folder / value) if key in FILES else value) for key, value in options]
            parts = parts._replace(query=urlencode(options, safe="/:,"))
        url = urlunsplit(parts)
        return url if self.name is None else f"{url}{'&' if parts.query else '?'}name={self.name}"


class Hook(Settings):
    """A web hook: a POST for each alarm that begins, ends or returns."""

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

    def options(self, folder: Path) -> dict[str, Any]:
        """What it says, by the names of the fields of `Deployment`. Args: folder: where the file lies."""
        options = self.server.model_dump(exclude_unset=True)
        for name, value in options.items():
            is_file = any(isinstance(mark, Option) and mark.is_file for mark in Server.model_fields[name].metadata)
            if (is_file and "://" not in value) or (name == "scenario" and (folder / value).exists()):
                options[name] = str(folder / value)
            elif name == "settings":  # as --set takes them
                texts = {
                    key: str(setting).lower() if isinstance(setting, bool) else repr(setting) for key, setting in value.items()
                }
                options[name] = texts | {key: setting for key, setting in value.items() if isinstance(setting, str)}
        hooks = tuple(
            hook if hook.secret_file is None else hook.model_copy(update={"secret_file": str(folder / hook.secret_file)})
            for hook in self.webhooks
        )
        feed, region = (tuple(one.address(folder) for one in many) for many in (self.feeds, self.regions))
        return {**options, "feed": feed, "region": region, "hooks": hooks, "zones": self.zones}


class Deployment(Server):
    """How a server runs, whatever said so."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    run: Annotated[int | None, Option("ID")] = None
    """number of the run (default: the latest)"""

    feed: Annotated[tuple[str, ...], Option("URL")] = ()
    """a live feed in place of the scenario's input, FORMAT+TRANSPORT://ADDRESS; formats ais, ttm, asterix, video, heading, json; \
transports tcp (connect), listen, udp, file, mqtt: ais+tcp://host:10110, ais+listen://0.0.0.0:10110, \
asterix+udp://0.0.0.0:8600?25/1=north, ais+file:///var/log/ais.nmea; repeatable. The run goes on with the last one, if that ended less \
than 10 minutes ago. A database into which another server of this machine writes is refused"""

    region: Annotated[tuple[str, ...], Option("URL")] = ()
    """a region of this centre: wss://HOST:PORT?name=NAME&token-file=FILE&ca-file=FILE; its tracks are the track source NAME; \
or nats://HOST:PORT/NAME, the stream of NATS JetStream that has them; repeatable"""

    webhook: Annotated[tuple[str, ...], Option("URL")] = ()
    """POST each alarm that begins, ends or returns as JSON to this address, again for minutes while nobody takes it; repeatable"""

    webhook_secret_file: Annotated[str | None, Option("FILE", is_file=True)] = None
    """file whose first line signs these messages (HMAC-SHA256 in X-Coastwatch-Signature)"""

    new: bool = False
    """begin a new run"""

    log_format: Literal["text", "json"] = "text"
    """what is printed while it runs: text, or one JSON object a line, for collectors of logs (default: text)"""

    hooks: tuple[Hook, ...] = ()  # of the server file, where `webhook` names none
    zones: tuple[Zone, ...] = ()  # of the server file

    @property
    def lateness(self) -> float:
        """Seconds that a cycle waits for late reports."""
        return LATENESS_S[self.role] if self.lateness_s is None else self.lateness_s

    @property
    def webhooks(self) -> tuple[Hook, ...]:
        """The web hooks of the command line, or else of the server file."""
        return tuple(Hook(url=url, secret_file=self.webhook_secret_file) for url in self.webhook) or self.hooks


FROM_FILE_ALONE = ("hooks", "zones")


def flag(name: str) -> str:
    """The option of the command line that a field of `Deployment` has, such as --lateness of lateness_s."""
    named = next((mark.flag for mark in Deployment.model_fields[name].metadata if isinstance(mark, Option)), "")
    return f"--{named or name.replace('_', '-')}"


def variable(name: str) -> str:
    """The environment variable of a field of `Deployment`, such as COASTWATCH_LATENESS_S."""
    return f"COASTWATCH_{name.upper()}"


def deployment(given: Mapping[str, Any], variables: Mapping[str, str] = os.environ) -> Deployment:
    """How a server runs: by its command line, else by the environment, else by the server file that `scenario` names, if it names one.

    Args:
        given: values of the command line by the names of the fields; None: not given.
        variables: the environment.
    Raises: InputError that names the option, the variable, or the file and the key.
    """
    sources = [
        {name: value for name, value in given.items() if value is not None and name in Deployment.model_fields},
        of_environment(variables),
    ]
    path = Path(str(next((source["scenario"] for source in sources if "scenario" in source), "")))
    if (file := of_file(path)) is not None:
        sources = [{"scenario": file.get("scenario")}, *sources, file]
    typed: dict[str, Any] = {}
    for source in reversed(sources):
        typed |= {**source, "settings": {**typed.get("settings", {}), **dict(source.get("settings", {}))}}
    try:
        return Deployment.model_validate(typed)
    except ValidationError as error:
        raise _refused(error, flag) from error


def of_environment(variables: Mapping[str, str]) -> dict[str, Any]:
    """What the environment says, by the names of the fields. An empty variable says nothing. Raises: InputError."""
    texts = {name: variables.get(variable(name), "").strip() for name in Deployment.model_fields if name not in FROM_FILE_ALONE}
    several: dict[str, Any] = {}
    for name, text in texts.items():
        if text and (kind := get_origin(Deployment.model_fields[name].annotation)) in (tuple, dict):
            try:
                words = shlex.split(text)
                several[name] = tuple(words) if kind is tuple else dict(word.split("=", 1) for word in words)
            except ValueError as error:
                needed = "URLs" if kind is tuple else "KEY=VALUE"
                raise InputError(
                    f"{variable(name)}: got {text!r}, needed {needed}, quoted as in a shell, with blanks between"
                ) from error
    try:
        one = Deployment.model_validate_strings({name: text for name, text in texts.items() if text and name not in several})
    except ValidationError as error:
        raise _refused(error, variable) from error
    return one.model_dump(exclude_unset=True) | several


def _refused(error: ValidationError, written: Callable[[str], str]) -> InputError:
    """The first error of a deployment. Args: written: how the name of a field was written."""
    name, sentence = str(error.errors()[0]["loc"][0]), refusals(error, Deployment)[0]
    return InputError(written(name) + sentence.removeprefix(name))


def with_zones(scenario: Scenario, zones: tuple[Zone, ...]) -> Scenario:
    """The scenario with more zones; their numbers follow those of its own. Raises: InputError where a name is there twice."""
    names = [zone.name for zone in (*scenario.zones, *zones)]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(
            f"zones: got the name {twice!r} {names.count(twice)} times in the scenario and the server file, needed each once"
        )
    return scenario.model_copy(update={"zones": (*scenario.zones, *zones)})


def of_centre(scenario: Scenario, regions: Sequence[str]) -> Scenario:
    """The scenario with a track source for each region and without radars. A source that it has already keeps its settings.

    Raises: ScenarioError: two regions of one name.
    """
    return with_track_sources(scenario, regions, PATIENCE_S).model_copy(update={"radars": ()})


def with_track_sources(scenario: Scenario, names: Sequence[str], patience_s: float = 30.0) -> Scenario:
    """The scenario with a track source of each of these names. One that it has already keeps its settings.

    Args: patience_s: of the new ones.
    Raises: ScenarioError: a name is there twice; InputError, as of `refuse_shared_names`.
    """
    twice = sorted({name for name in names if list(names).count(name) > 1})
    if twice:
        count = list(names).count(twice[0])
        raise ScenarioError(f"track source: got the name {twice[0]!r} {count} times, needed each once: name=NAME")
    present = {source.name for source in scenario.track_sources}
    added = tuple(TrackSource(name=name, patience_s=patience_s) for name in names if name not in present)
    refuse_shared_names(scenario.radars, added, scenario.sonars)
    return scenario.model_copy(update={"track_sources": (*scenario.track_sources, *added)})


def of_file(path: Path) -> dict[str, Any] | None:
    """What the file of a server says, by the names of the fields; None: it is a scenario, or the name of one. Raises: InputError."""
    if path.suffix != ".toml" or not path.is_file():
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
        return ServerFile.model_validate(data).options(path.parent)
    except ValidationError as error:
        raise InputError("\n".join(f"{path}: {refusal}" for refusal in refusals(error, ServerFile))) from error
