"""A trusted proxy that has asked people who they are, such as oauth2-proxy: their names and groups come in headers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network

from starlette.datastructures import Headers

from coastwatch.errors import InputError
from coastwatch.operators.api.tokens import ROLES, Person

USER, GROUPS = "x-forwarded-user", "x-forwarded-groups"
GROUP = "coastwatch-"
"""The group of a role is this text and the role: coastwatch-viewer, coastwatch-operator, coastwatch-admin."""

LONGEST_NAME = 64


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
