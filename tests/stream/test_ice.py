from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable
from typing import Any

import aioice
import pytest
from aioice import Candidate, stun
from aioice.ice import get_host_addresses
from aiortc.rtcicetransport import connection_kwargs
from hypothesis import given
from hypothesis import strategies as st

from app.config import WebrtcSettings
from app.errors import OverCapacity
from app.stream.ice import LOOPBACK, MAX_CANDIDATES, IceOptions, advertised, gather_as, usable, usable_candidates

OFFER = "\r\n".join(
    [
        "v=0",
        "m=audio 9 UDP/TLS/RTP/SAVPF 111",
        "a=candidate:1 1 udp 2113937151 0d9c3cd5-6b92-4f2a-bc19-4a3f2a1ccf6e.local 51341 typ host generation 0",
        "a=candidate:2 1 udp 2113937150 10.0.0.7 51342 typ host generation 0",
        "a=end-of-candidates",
        "a=ice-ufrag:x",
        "",
    ]
)


def candidate(host: str, port: int) -> Candidate:
    return Candidate("f" + host, 1, "udp", 2130706431, host, port, "host")


def test_local_names_are_dropped_and_the_rest_stays() -> None:
    kept = usable_candidates(OFFER)
    assert ".local" not in kept
    assert "10.0.0.7 51342" in kept
    assert "end-of-candidates" not in kept
    assert "a=ice-ufrag:x" in kept
    assert kept.endswith("\r\n")


def test_the_number_of_candidates_is_limited() -> None:
    offer = "v=0\n" + "".join(f"a=candidate:{n} 1 udp 1 10.0.0.7 {n} typ host\n" for n in range(1000))
    assert usable_candidates(offer).count("a=candidate:") == MAX_CANDIDATES


@pytest.mark.parametrize(
    ("candidate", "useful"),
    [
        ("1 1 udp 2113937151 10.0.0.7 51342 typ host", True),
        ("1 1 UDP 2113937151 fd00::7 51342 typ srflx raddr :: rport 9", True),
        ("1 1 udp 2113937151 0d9c3cd5.local 51342 typ host", False),
        ("1 1 udp 2113937151 www.example.org 51342 typ host", False),
        ("1 1 tcp 1518280447 10.0.0.7 9 typ host tcptype active", False),
        ("1 2 udp 2113937150 10.0.0.7 51343 typ host", False),  # of separate RTCP
        ("1 1 udp", False),
    ],
)
def test_only_addresses_for_rtp_over_udp_are_useful(candidate: str, useful: bool) -> None:
    assert usable(candidate.split()) == useful
    assert ("a=candidate:" in usable_candidates(f"v=0\na=candidate:{candidate}\n")) == useful


@given(st.text(max_size=200))
def test_any_text_is_survived(offer: str) -> None:
    usable_candidates(offer)


def test_without_addresses_nothing_changes() -> None:
    own = [candidate("10.0.0.2", 1000), candidate(LOOPBACK, 1001)]
    assert advertised(own, []) == own


def test_a_public_address_goes_with_the_ports_of_its_version() -> None:
    own = [
        candidate("10.0.0.2", 1000),
        candidate("172.17.0.1", 1001),
        candidate("fd00::2", 1002),
        candidate(LOOPBACK, 1003),
    ]
    found = advertised(own, ["203.0.113.5"])
    assert [(each.host, each.port) for each in found] == [
        ("203.0.113.5", 1000),
        ("203.0.113.5", 1001),
        (LOOPBACK, 1003),
    ]
    assert own[0].host == "10.0.0.2"  # what is bound stays as it is


def test_an_address_of_an_interface_goes_with_its_own_port() -> None:
    own = [candidate("10.0.0.2", 1000), candidate("172.17.0.1", 1001)]
    assert [(each.host, each.port) for each in advertised(own, ["172.17.0.1"])] == [("172.17.0.1", 1001)]


@pytest.mark.parametrize("loopback", [True, False])
async def test_a_connection_offers_loopback_if_asked(loopback: bool) -> None:
    connection = aioice.Connection(ice_controlling=False)
    gather_as(connection, IceOptions(loopback=loopback))
    await connection.gather_candidates()
    hosts = [each.host for each in connection.local_candidates]
    await connection.close()
    assert (LOOPBACK in hosts) == loopback
    assert set(hosts) - {LOOPBACK} == set(get_host_addresses(use_ipv4=True, use_ipv6=True))
    assert hosts.index(LOOPBACK) == len(hosts) - 1 if loopback else True


async def test_two_connections_meet_on_loopback() -> None:
    one, two = aioice.Connection(ice_controlling=True), aioice.Connection(ice_controlling=False)
    for connection in (one, two):
        gather_as(connection, IceOptions(loopback=True))
        await connection.gather_candidates()
    for here, there in ((one, two), (two, one)):
        for each in there.local_candidates:
            if each.host == LOOPBACK:
                await here.add_remote_candidate(each)
        await here.add_remote_candidate(None)
        here.remote_username, here.remote_password = there.local_username, there.local_password
    await asyncio.gather(one.connect(), two.connect())
    await one.send(b"hello")
    assert await two.recv() == b"hello"
    await one.close()
    await two.close()


@pytest.fixture
async def gathered() -> AsyncIterator[Callable[..., Any]]:
    """`await gathered(options, …)`: a connection that has gathered as `options` say; closed in the end."""
    connections: list[aioice.Connection] = []

    async def gather(options: IceOptions, **servers: Any) -> aioice.Connection:
        connection = aioice.Connection(ice_controlling=False, **servers)
        connections.append(connection)
        gather_as(connection, options)
        await connection.gather_candidates()
        return connection

    yield gather
    for connection in connections:
        await connection.close()


async def test_ports_come_from_the_range_until_it_is_used_up(gathered: Any, free_ports: Callable[[int], range]) -> None:
    options = IceOptions(ports=free_ports(3), loopback=True)
    connections = [await gathered(options) for _ in range(3)]
    ports = [{each.port for each in connection.local_candidates if each.host == LOOPBACK} for connection in connections]
    assert set.union(*ports) == set(options.ports)
    with pytest.raises(OverCapacity, match=f"{options.ports[0]} to {options.ports[-1]}"):
        await gathered(options)
    await connections[1].close()
    again = await gathered(options)
    assert {each.port for each in again.local_candidates if each.host == LOOPBACK} == ports[1]


async def test_an_address_that_cannot_be_bound_is_left_out(gathered: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aioice.ice, "get_host_addresses", lambda **_: ["203.0.113.5"])
    connection = await gathered(IceOptions(loopback=True))
    assert [each.host for each in connection.local_candidates] == [LOOPBACK]


class StunServer(asyncio.DatagramProtocol):
    """Answers everybody that his public address is 203.0.113.9:1234."""

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, address: Any) -> None:
        request = stun.parse_message(data)
        answer = stun.Message(request.message_method, stun.Class.RESPONSE, request.transaction_id)
        answer.attributes["XOR-MAPPED-ADDRESS"] = ("203.0.113.9", 1234)
        self.transport.sendto(bytes(answer), address)


async def test_the_stun_server_tells_the_public_address(gathered: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aioice.ice, "get_host_addresses", lambda **_: ["127.0.0.2"])
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(StunServer, local_addr=("127.0.0.3", 0))
    with contextlib.closing(transport):
        server = transport.get_extra_info("sockname")
        connection = await gathered(IceOptions(loopback=True), stun_server=server)
    hosts = {
        each.type: (each.host, each.related_address) for each in connection.local_candidates if each.host != LOOPBACK
    }
    assert hosts == {"host": ("127.0.0.2", None), "srflx": ("203.0.113.9", "127.0.0.2")}


async def test_servers_that_do_not_answer_are_not_waited_for_long(
    gathered: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("app.stream.ice.SERVER_SECONDS", 0.1)
    with socket.socket(type=socket.SOCK_DGRAM) as silent:
        silent.bind((LOOPBACK, 0))
        server = silent.getsockname()
        servers = {"stun_server": server, "turn_server": server, "turn_username": "x", "turn_password": "y"}
        async with asyncio.timeout(5):  # aioice by itself would take as long
            connection = await gathered(IceOptions(loopback=True), **servers)
    assert {each.type for each in connection.local_candidates} == {"host"}
    assert "STUN server 127.0.0.1" in caplog.text
    assert "TURN server 127.0.0.1" in caplog.text


def test_options_come_from_the_settings() -> None:
    settings = WebrtcSettings(
        addresses=["203.0.113.5"],
        ports="50000-50100",
        loopback=False,
        stun="stun:stun.example.org",
        turn={"url": "turn:turn.example.org:3479?transport=tcp", "username": "mary", "credential": "secret"},
    )
    options = IceOptions.of(settings)
    assert (options.addresses, options.loopback) == (("203.0.113.5",), False)
    assert (options.ports[0], options.ports[-1]) == (50000, 50100)
    assert connection_kwargs(list(options.servers)) == {
        "stun_server": ("stun.example.org", 3478),
        "turn_server": ("turn.example.org", 3479),
        "turn_ssl": False,
        "turn_transport": "tcp",
        "turn_username": "mary",
        "turn_password": "secret",
    }
    assert IceOptions.of(WebrtcSettings()) == IceOptions(loopback=True)
