"""Which addresses and ports a WebRTC answer offers, and which of the viewer's candidates are used.

aiortc leaves no choice: aioice offers the addresses of all network interfaces but never 127.0.0.1, binds any free port,
and waits about a second for each `.local` name a browser hides its addresses behind and five for a STUN server that
cannot be reached from one of the interfaces. Here and nowhere else this is changed, on single connections, through
aioice's `Connection.get_component_candidates`.
"""

from __future__ import annotations

import asyncio
import copy
import errno
import ipaddress
import logging
import random
import socket
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

from aioice.candidate import Candidate, candidate_foundation, candidate_priority
from aioice.ice import StunProtocol, server_reflexive_candidate
from aioice.turn import UDP_SOCKET_BUFFER_SIZE
from aiortc import RTCIceServer

from app.config import WebrtcSettings
from app.errors import OverCapacity

LOOPBACK = "127.0.0.1"
MAX_CANDIDATES = 16  # of a viewer; for each, connectivity checks are sent to wherever it points
SERVER_SECONDS = 2.0  # how long a viewer waits for our STUN and TURN servers
MORE_SECONDS = 0.05  # once one interface knows its public address, how long for the others

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class IceOptions:
    """How a connection gathers its candidates.

    Attributes:
        addresses: offered instead of those of the network interfaces, e.g. the public address of a server behind
            one-to-one NAT or in a container; the ports are those bound on the interfaces. Empty: the interfaces' own.
        ports: UDP ports to bind; None: any that is free.
        loopback: offer 127.0.0.1 as well, for browsers on the same machine.
        servers: a STUN server that tells the public address, a TURN server that relays, for the server itself.
    """

    addresses: tuple[str, ...] = ()
    ports: range | None = None
    loopback: bool = False
    servers: tuple[RTCIceServer, ...] = ()

    @classmethod
    def of(cls, settings: WebrtcSettings) -> Self:
        """The options that the service is set to."""
        servers = [RTCIceServer(settings.stun)] if settings.stun else []
        if turn := settings.turn:
            servers.append(RTCIceServer(turn.url, turn.username, turn.credential))
        return cls(tuple(settings.addresses), settings.port_range, settings.loopback, tuple(servers))


def usable(candidate: Sequence[str]) -> bool:
    """Whether a remote candidate, as the words of its line, can be of use: an IP address to send RTP to by UDP."""
    if len(candidate) < 8 or candidate[1] != "1" or candidate[2].lower() != "udp":
        return False
    try:
        ipaddress.ip_address(candidate[4])
    except ValueError:
        return False  # a `.local` name among others
    return True


def usable_candidates(offer: str) -> str:
    """The offer without `.local` and other useless candidates, more than 16 others, and `end-of-candidates`.

    A viewer whose candidates are dropped still connects: its own checks arrive and reveal its address
    (peer-reflexive candidates, RFC 8445 section 7.3.1.3). For that the list must not be said to be complete.
    """
    kept: list[str] = []
    candidates = 0
    for line in offer.splitlines():
        if line.startswith("a=end-of-candidates"):
            continue
        if line.startswith("a=candidate:"):
            if candidates == MAX_CANDIDATES or not usable(line.split()):
                continue
            candidates += 1
        kept.append(line)
    return "\r\n".join(kept) + "\r\n"


def gather_as(connection: Any, options: IceOptions) -> None:
    """Make an `aioice.Connection` that has not gathered its candidates do so as `options` say.

    Gathering raises OverCapacity when all of `options.ports` are taken.
    """
    relay = connection.get_component_candidates

    async def get_component_candidates(component: int, addresses: list[str], timeout: int = 5) -> list[Any]:  # noqa: ARG001
        # Loopback comes last, since the first candidate is also the default address of the answer.
        for address in [*addresses, LOOPBACK] if options.loopback else addresses:
            await _bind(connection, component, address, options.ports)
        protocols = list(connection._protocols)
        candidates = advertised([protocol.local_candidate for protocol in protocols], options.addresses)
        if connection.stun_server is None and connection.turn_server is None:
            return candidates
        found, relayed = await asyncio.gather(
            _public_addresses(protocols, connection.stun_server),
            # Without addresses aioice asks the TURN server only; its sockets go out and need no port of ours.
            relay(component=component, addresses=[], timeout=SERVER_SECONDS),
        )
        if connection.turn_server is not None and not relayed:
            _log.warning("the TURN server %s:%s gave no relay address", *connection.turn_server)
        known = {(candidate.host, candidate.port) for candidate in candidates}
        return [*candidates, *(each for each in found if (each.host, each.port) not in known), *relayed]

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


async def _bind(connection: Any, component: int, address: str, ports: range | None) -> None:
    """Add a socket at `address` to a connection, as aioice does. An address that cannot be bound is left out."""
    try:
        protocol = await _endpoint(connection, _socket(address, ports))
    except OSError as error:
        _log.info("cannot bind to %s: %s", address, error)
        return
    host, port = protocol.transport.get_extra_info("sockname")[:2]
    protocol.local_candidate = Candidate(
        foundation=candidate_foundation("host", "udp", host),
        component=component,
        transport="udp",
        priority=candidate_priority(component, "host"),
        host=host,
        port=port,
        type="host",
    )
    connection._protocols.append(protocol)


async def _endpoint(connection: Any, bound: socket.socket) -> Any:
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UDP_SOCKET_BUFFER_SIZE)
        loop = asyncio.get_running_loop()
        _, protocol = await loop.create_datagram_endpoint(lambda: StunProtocol(connection), sock=bound)
    except BaseException:
        bound.close()
        raise
    return protocol


def _socket(address: str, ports: range | None) -> socket.socket:
    """A UDP socket bound to `address`.

    Raises:
        OverCapacity: all of `ports` are taken there.
        OSError: there can be none.
    """
    made = socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        for port in _in_turn(ports):
            try:
                made.bind((address, port))
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
            else:
                return made
    except BaseException:
        made.close()
        raise
    made.close()
    assert ports is not None
    raise OverCapacity(
        f"all UDP ports for WebRTC are taken ({ports[0]} to {ports[-1]})",
        advice="Try again when viewers have gone, watch over HTTP, or widen webrtc.ports.",
    )


def _in_turn(ports: range | None) -> Iterator[int]:
    """From a random one on, so that a port is not soon used again while packets for its last viewer are under way."""
    if ports is None:
        yield 0
        return
    first = random.randrange(len(ports))
    for offset in range(len(ports)):
        yield ports[(first + offset) % len(ports)]


async def _public_addresses(protocols: Sequence[Any], server: tuple[str, int] | None) -> list[Any]:
    """What the STUN server sees as the addresses of our sockets.

    Not every interface need reach it (a container bridge does not), so when one does the others get little time.
    """
    asking = [
        each for each in protocols if each.local_candidate.host != LOOPBACK and ":" not in each.local_candidate.host
    ]
    if server is None or not asking:
        return []
    pending = {asyncio.create_task(server_reflexive_candidate(protocol, server)) for protocol in asking}
    found: list[Any] = []
    loop = asyncio.get_running_loop()
    give_up = loop.time() + SERVER_SECONDS
    try:
        while pending and (left := give_up - loop.time()) > 0:
            done, pending = await asyncio.wait(pending, timeout=left, return_when=asyncio.FIRST_COMPLETED)
            answers = [task.result()[0] for task in done if task.exception() is None]
            if answers and not found:
                give_up = loop.time() + MORE_SECONDS
            found += answers
    finally:
        for task in pending:
            task.cancel()
    if not found:
        _log.warning("the STUN server %s:%s does not answer", *server)
    return found
