from __future__ import annotations

import asyncio

import aioice
import pytest
from aioice import Candidate
from aioice.ice import get_host_addresses
from hypothesis import given
from hypothesis import strategies as st

from app.errors import ConfigError
from app.stream.ice import LOOPBACK, MAX_CANDIDATES, advertised, check_addresses, offer_addresses, usable_candidates

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


@given(st.text(max_size=200))
def test_any_text_is_survived(offer: str) -> None:
    usable_candidates(offer)


def test_addresses_must_be_addresses() -> None:
    check_addresses(["203.0.113.5", "2001:db8::1"])
    with pytest.raises(ConfigError, match="example"):
        check_addresses(["203.0.113.5", "www.example.org"])


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
    offer_addresses(connection, [], loopback=loopback)
    await connection.gather_candidates()
    hosts = [each.host for each in connection.local_candidates]
    await connection.close()
    assert (LOOPBACK in hosts) == loopback
    assert set(hosts) - {LOOPBACK} == set(get_host_addresses(use_ipv4=True, use_ipv6=True))
    assert hosts.index(LOOPBACK) == len(hosts) - 1 if loopback else True


async def test_two_connections_meet_on_loopback() -> None:
    one, two = aioice.Connection(ice_controlling=True), aioice.Connection(ice_controlling=False)
    for connection in (one, two):
        offer_addresses(connection, [], loopback=True)
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
