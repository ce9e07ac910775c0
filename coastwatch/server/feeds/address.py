"""The address of a live feed: what it carries, how it is reached, and which sensor it is of."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from ipaddress import AddressValueError, IPv4Address
from urllib.parse import parse_qsl, unquote, urlsplit

from coastwatch.errors import AddressError
from coastwatch.formats.decoding import LONGEST_NAME, FeedSettings
from coastwatch.formats.registry import DECODED, FORMATS, check_options
from coastwatch.spelling import ONE_LINE

TRANSPORTS = ("tcp", "listen", "udp", "file", "mqtt", "mqtts")
MQTT_PORTS = {"mqtt": 1883, "mqtts": 8883}
OPTIONS = {
    "file": ("from",),
    "udp": ("interface",),
    "mqtt": ("user", "password-file"),
    "mqtts": ("user", "password-file", "ca-file"),
}
"""What a transport takes behind '?'."""

EXAMPLES = "ais+tcp://host:10110, ais+listen://127.0.0.1:10110, asterix+udp://127.0.0.1:8600, video+udp://239.192.0.1:8600"


@dataclass(frozen=True)
class Address:
    """One feed. `text` is how it was given."""

    text: str
    format: str  # of DECODED
    transport: str  # of TRANSPORTS
    host: str = ""
    port: int = 0
    path: str = ""
    options: dict[str, str] = field(default_factory=dict)
    interface: str = ""  # address of this machine by which datagrams of a group come and go; empty: the system chooses

    @property
    def is_group(self) -> bool:
        """Whether it is a group of UDP multicast."""
        return self.transport == "udp" and (of_ip := _ipv4(self.host)) is not None and of_ip.is_multicast

    @property
    def name(self) -> str:
        """Its name in lists."""
        where = f"{self.host}:{self.port}" if self.port else ""
        topic = "/" if self.port and self.path else ""
        return self.options.get("name", f"{self.format}+{self.transport}://{where}{topic}{self.path}")

    @property
    def source(self) -> str:
        """The track source that its tracks are of."""
        return self.options.get("source", self.name)[:LONGEST_NAME]

    def settings(self, checked: bool) -> FeedSettings:
        """What its format is told of it. Args: as of `FeedSettings`."""
        return FeedSettings(self.name, self.text, self.options, self.source, checked=checked)


def parsed(text: str) -> Address:
    """The feed of an address such as ais+tcp://127.0.0.1:10110?name=north. Raises: AddressError."""
    parts = urlsplit(text, allow_fragments=False)  # '#' is of a topic or of the name of a file
    format_, _, transport = parts.scheme.partition("+")
    if format_ not in DECODED or transport not in TRANSPORTS:
        raise AddressError(
            f"feed: got {text!r}, needed FORMAT+TRANSPORT://ADDRESS with FORMAT one of {', '.join(DECODED)} and TRANSPORT one of "
            f"{', '.join(TRANSPORTS)}, e.g. {EXAMPLES}"
        )
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    check_options(format_, text, options, OPTIONS.get(transport, ()))
    if options.get("from", "start") != "start":
        raise AddressError(f"feed: got from={options['from']} in {text!r}, needed from=start: else only what is added is read")
    if transport == "file":
        path = unquote(parts.netloc + parts.path)
        if not path or FORMATS[format_].in_datagrams:
            raise AddressError(f"feed: got {text!r}, needed the path of a file of lines, e.g. ais+file:///var/log/ais.nmea")
        return Address(text, format_, transport, path=path, options=options)
    try:
        port = parts.port or MQTT_PORTS.get(transport) if parts.port != 0 else 0
    except ValueError:
        port = None
    if transport in MQTT_PORTS and not (parts.hostname and unquote(parts.path).strip("/")):
        raise AddressError(f"feed: got {text!r}, needed host and topic, e.g. ais+mqtt://broker:1883/coast/ais")
    if port is None or (not parts.hostname and transport == "tcp"):
        raise AddressError(f"feed: got {text!r}, needed host and port, e.g. {EXAMPLES}")
    if FORMATS[format_].in_datagrams and transport != "udp":
        raise AddressError(f"feed: got {text!r}, needed {format_}+udp: {format_.upper()} comes in datagrams")
    path = _topic(text, parts.path) if transport in MQTT_PORTS else ""
    if transport not in MQTT_PORTS and parts.path not in ("", "/"):
        raise AddressError(f"feed: got {parts.path} behind the host in {text!r}, needed nothing there but options behind '?'")
    interface = options.pop("interface", "")
    address = Address(text, format_, transport, parts.hostname or "127.0.0.1", port, path, options, interface)
    if interface and (not address.is_group or _ipv4(interface) is None):
        raise AddressError(
            f"feed: got interface={interface} in {text!r}, needed an IPv4 address of this machine, with a multicast group such as "
            f"{format_}+udp://239.192.0.1:8600?interface=192.168.1.10"
        )
    return address


def _topic(text: str, path: str) -> str:
    """The topic filter of MQTT in the path of an address. Raises: AddressError where a broker would refuse it."""
    topic = unquote(path).removeprefix("/").rstrip("/")
    *before, last = topic.split("/")
    if (
        "#" in "".join(before)
        or ("#" in last and last != "#")
        or any("+" in level and level != "+" for level in (*before, last))
    ):
        raise AddressError(
            f"feed: got the topic {topic!r} in {text!r}, needed '+' alone between slashes and '#' alone at the end, e.g. coast/+/ais/#"
        )
    if not re.match(ONE_LINE, topic):
        raise AddressError(f"feed: got the topic {topic!r} in {text!r}, needed text without control characters")
    return topic


def _ipv4(text: str) -> IPv4Address | None:
    """The address; none: it is a name, or of another kind."""
    try:
        return IPv4Address(text)
    except AddressValueError:
        return None
