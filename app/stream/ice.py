"""Which addresses a WebRTC answer offers, and which of the offer's are used.

aiortc leaves no choice: aioice offers the addresses of all network interfaces but never 127.0.0.1, and waits about a
second for each `.local` name a browser hides its addresses behind. Here and nowhere else this is changed, on single
connections, through aioice's `Connection.get_component_candidates`.
"""

from __future__ import annotations

import copy
import ipaddress
from collections.abc import Sequence
from typing import Any

from aioice.candidate import candidate_foundation

from app.errors import ConfigError

LOOPBACK = "127.0.0.1"
MAX_CANDIDATES = 16  # of an offer; for each, connectivity checks are sent to wherever it points


def check_addresses(addresses: Sequence[str]) -> None:
    """Raises ConfigError if one of `addresses` is not an IP address."""
    for address in addresses:
        try:
            ipaddress.ip_address(address)
        except ValueError as error:
            raise ConfigError(
                f"{address!r} is not an IP address",
                field="webrtc.addresses",
                advice="Give the public IPv4 or IPv6 addresses of this server, not host names.",
            ) from error


def usable_candidates(offer: str) -> str:
    """The offer without `.local` candidates, without more than 16 others, and without `end-of-candidates`.

    A viewer whose candidates are dropped still connects: its own checks arrive and reveal its address
    (peer-reflexive candidates, RFC 8445 section 7.3.1.3). For that the list must not be said to be complete.
    """
    kept: list[str] = []
    candidates = 0
    for line in offer.splitlines():
        if line.startswith("a=end-of-candidates"):
            continue
        if line.startswith("a=candidate:"):
            parts = line.split()
            if len(parts) < 8 or parts[4].endswith(".local") or candidates == MAX_CANDIDATES:
                continue
            candidates += 1
        kept.append(line)
    return "\r\n".join(kept) + "\r\n"


def offer_addresses(connection: Any, addresses: Sequence[str], *, loopback: bool) -> None:
    """Make an ICE connection that has not gathered its candidates offer other addresses.

    Args:
        connection: an `aioice.Connection`.
        addresses: offered instead of those of the network interfaces, e.g. the public address of a server behind
            one-to-one NAT or in a container; the ports are those bound on the interfaces. Empty: the interfaces' own.
        loopback: offer 127.0.0.1 as well, for browsers on the same machine.
    """
    gather = connection.get_component_candidates

    async def get_component_candidates(component: int, addresses: list[str], timeout: int = 5) -> list[Any]:
        # Last, since the first candidate is also the default address of the answer.
        bound = [*addresses, LOOPBACK] if loopback else addresses
        return advertised(await gather(component=component, addresses=bound, timeout=timeout), wanted)

    wanted = list(addresses)
    connection.get_component_candidates = get_component_candidates


def advertised(candidates: Sequence[Any], addresses: Sequence[str]) -> list[Any]:
    """The candidates to put into the answer when `addresses` are wanted instead of the interfaces' own.

    An address that is one of an interface goes with that interface's port; any other with the ports of all interfaces
    of its IP version, as it is not known which one the network translates it to. Loopback candidates stay.
    """
    if not addresses:
        return list(candidates)
    bound = [candidate for candidate in candidates if candidate.host != LOOPBACK]
    chosen: list[Any] = []
    for address in addresses:
        version = ipaddress.ip_address(address).version
        own = [candidate for candidate in bound if candidate.host == address]
        for candidate in own or [each for each in bound if ipaddress.ip_address(each.host).version == version]:
            changed = copy.copy(candidate)
            changed.host = address
            changed.foundation = candidate_foundation(candidate.type, candidate.transport, address)
            chosen.append(changed)
    return chosen + [candidate for candidate in candidates if candidate.host == LOOPBACK]
