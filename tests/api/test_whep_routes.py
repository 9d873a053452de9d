"""WHEP with curl for the letter of the draft, and with aiortc as a viewer that knows nothing of ours."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

from app.stream.ice import IceOptions, gather_as

SDP = {"Content-Type": "application/sdp"}
FRAGMENT = {"Content-Type": "application/trickle-ice-sdpfrag"}
WAIT_SECONDS = 30
RESTART = "a=ice-ufrag:anew\r\na=ice-pwd:P2uYro0UCOQ4zxjKXaWCBui1\r\nm=video 9 UDP/TLS/RTP/SAVPF 0\r\na=mid:0\r\n"


class Viewer:
    """aiortc's receiver and decoders; of ours it only has the address 127.0.0.1."""

    def __init__(self, http: httpx.AsyncClient) -> None:
        self.http = http
        self.peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.session = ""
        self.etag = ""

    async def offer(self, kinds: tuple[str, ...] = ("video", "audio")) -> str:
        for kind in kinds:
            transceiver = self.peer.addTransceiver(kind, direction="recvonly")
            gather_as(transceiver.receiver.transport.transport.iceGatherer._connection, IceOptions(loopback=True))
        await self.peer.setLocalDescription(await self.peer.createOffer())
        sdp: str = self.peer.localDescription.sdp
        return sdp

    async def send(self, whep: str, offer: str) -> httpx.Response:
        answer = await self.http.post(whep, content=offer, headers=SDP)
        if answer.status_code == 201:
            self.session, self.etag = answer.headers["location"], answer.headers["etag"]
        return answer

    async def accept(self, answer: str) -> None:
        await self.peer.setRemoteDescription(RTCSessionDescription(answer, "answer"))

    async def watch(self, whep: str, kinds: tuple[str, ...] = ("video", "audio")) -> None:
        answer = await self.send(whep, await self.offer(kinds))
        assert answer.status_code == 201, answer.text
        await self.accept(answer.text)

    async def frames(self, kind: str, count: int) -> list[Any]:
        (track,) = (each.receiver.track for each in self.peer.getTransceivers() if each.kind == kind)
        return [await asyncio.wait_for(track.recv(), WAIT_SECONDS) for _ in range(count)]

    async def ended(self, kind: str) -> None:
        with pytest.raises(MediaStreamError):
            await self.frames(kind, 100_000)


@pytest.fixture
async def http() -> AsyncIterator[httpx.AsyncClient]:
    async with httpx.AsyncClient(timeout=WAIT_SECONDS) as client:
        yield client


@pytest.fixture
async def viewers(http: httpx.AsyncClient) -> AsyncIterator[Callable[[], Viewer]]:
    made: list[Viewer] = []

    def make() -> Viewer:
        made.append(Viewer(http))
        return made[-1]

    yield make
    for viewer in made:
        await viewer.peer.close()


async def create(http: httpx.AsyncClient, server: str, **order: object) -> dict[str, str]:
    """The addresses of a new stream."""
    urls: dict[str, str] = (await http.post(f"{server}/v1/streams", json=order)).raise_for_status().json()["urls"]
    return {name: server + url for name, url in urls.items()}


def without(sdp: str, *starts: str) -> str:
    return "\r\n".join(line for line in sdp.splitlines() if not line.startswith(starts)) + "\r\n"


def fragment_of(offer: str) -> str:
    """The credentials and candidates of an offer as an SDP fragment."""
    section = offer.split("m=")[1].splitlines()
    kept = [line for line in section if line.startswith(("a=mid", "a=ice-ufrag", "a=ice-pwd", "a=candidate"))]
    return "\r\n".join([f"m={section[0]}", *kept, "a=end-of-candidates", ""])


async def test_pictures_and_sound_arrive_until_the_viewer_leaves(
    server: str, http: httpx.AsyncClient, viewers: Any
) -> None:
    urls = await create(http, server, text="One two three four five six.")
    viewer = viewers()
    await viewer.watch(urls["whep"])
    pictures, sound = await asyncio.gather(viewer.frames("video", 30), viewer.frames("audio", 60))
    assert {(frame.width, frame.height) for frame in pictures} == {(512, 512)}
    assert len({frame.pts for frame in pictures}) == 30
    assert any(abs(frame.to_ndarray()).max() > 500 for frame in sound)
    assert (await http.get(urls["self"])).json()["viewers"]["whep"] == 1

    left = await http.delete(server + viewer.session, headers={"If-Match": '"another"'})  # needs no match
    assert left.status_code == 200
    await viewer.ended("video")
    assert (await http.delete(server + viewer.session)).status_code == 404
    assert (await http.get(urls["self"])).json()["viewers"]["whep"] == 0
    await http.delete(urls["self"])


@pytest.mark.parametrize("kind", ["video", "audio"])
async def test_one_kind_alone(server: str, http: httpx.AsyncClient, viewers: Any, kind: str) -> None:
    urls = await create(http, server)
    viewer = viewers()
    await viewer.watch(urls["whep"], (kind,))
    assert len(await viewer.frames(kind, 10)) == 10
    await http.delete(urls["self"])


async def test_the_end_of_the_stream_ends_the_viewer(server: str, http: httpx.AsyncClient, viewers: Any) -> None:
    urls = await create(http, server)
    viewer = viewers()
    await viewer.watch(urls["whep"])
    await viewer.frames("video", 3)
    await http.delete(urls["self"])
    await viewer.ended("video")
    assert (await http.get(server + viewer.session)).status_code == 404
    late = await http.post(urls["whep"], content=await viewers().offer(), headers=SDP)
    assert late.status_code == 410
    assert late.json()["type"] == "/problems/gone"


async def test_candidates_may_follow_the_offer(server: str, http: httpx.AsyncClient, viewers: Any) -> None:
    """The viewer does not know where the server is, so it takes what is trickled to bring them together."""
    urls = await create(http, server)
    viewer = viewers()
    offer = await viewer.offer()
    answer = await viewer.send(urls["whep"], without(offer, "a=candidate", "a=end-of-candidates"))
    assert answer.status_code == 201
    assert "a=candidate" in answer.text
    await viewer.accept(without(answer.text, "a=candidate", "a=end-of-candidates"))
    trickled = await http.patch(
        server + viewer.session, content=fragment_of(offer), headers=FRAGMENT | {"If-Match": viewer.etag}
    )
    assert (trickled.status_code, trickled.content) == (204, b"")
    assert "etag" not in trickled.headers
    assert len(await viewer.frames("video", 5)) == 5
    await http.delete(urls["self"])


async def test_patches_that_do_not_fit_are_refused(server: str, http: httpx.AsyncClient, viewers: Any) -> None:
    urls = await create(http, server)
    viewer = viewers()
    offer = await viewer.offer()
    await viewer.send(urls["whep"], offer)
    good, etag = fragment_of(offer), viewer.etag
    long = good + "a=x:y\r\n" * 20_000
    restart = RESTART + "a=candidate:1 1 udp 1 192.0.2.1 9 typ host\r\n"
    for content, headers, status, problem in [
        (good, FRAGMENT, 428, "precondition-required"),
        (good, FRAGMENT | {"If-Match": '"another"'}, 412, "precondition-failed"),
        (good, FRAGMENT | {"If-Match": f"W/{etag}"}, 412, "precondition-failed"),
        (good, {"Content-Type": "application/sdp", "If-Match": etag}, 415, "unsupported-media-type"),
        (good, {"If-Match": etag}, 415, "unsupported-media-type"),
        ("hello", FRAGMENT | {"If-Match": etag}, 400, "negotiation-failed"),
        ("", FRAGMENT | {"If-Match": etag}, 400, "negotiation-failed"),
        (b"a=\xff", FRAGMENT | {"If-Match": etag}, 400, "negotiation-failed"),
        (good.replace("a=mid:0", "a=mid:7"), FRAGMENT | {"If-Match": etag}, 400, "negotiation-failed"),
        (long, FRAGMENT | {"If-Match": etag}, 413, "too-long"),
        (restart, FRAGMENT | {"If-Match": "*"}, 422, "ice-restart-refused"),
        (restart, FRAGMENT | {"If-Match": etag}, 422, "ice-restart-refused"),
    ]:
        answer = await http.patch(server + viewer.session, content=content, headers=headers)
        assert (answer.status_code, answer.json()["type"]) == (status, f"/problems/{problem}"), answer.text
        assert status != 415 or answer.headers["accept-patch"] == "application/trickle-ice-sdpfrag"
    for match in ("*", '"*"', f'"another", {etag}'):
        answer = await http.patch(server + viewer.session, content=good, headers=FRAGMENT | {"If-Match": match})
        assert answer.status_code == 204
    assert (await http.get(server + viewer.session)).status_code == 204  # none of it did harm
    await http.delete(urls["self"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("VP8 only", "H.264"),
        ("G.711 only", "Opus"),
        ("another H.264", "cannot be answered"),
        ("sendonly", "does not ask to receive"),
        ("inactive", "does not ask to receive"),
        ("data channel only", "does not ask to receive"),
        ("data channel too", "more than a video and an audio section"),
        ("two pictures", "more than a video and an audio section"),
        ("no fingerprint", "DTLS"),
        ("no credentials", "ICE"),
    ],
)
async def test_offers_that_cannot_be_answered(
    server: str, http: httpx.AsyncClient, viewers: Any, change: str, words: str
) -> None:
    viewer = viewers()
    if change.startswith("data channel"):
        viewer.peer.createDataChannel("talk")
    kinds = {"data channel only": (), "two pictures": ("video", "audio", "video"), "G.711 only": ("audio",)}
    offer = await viewer.offer(kinds.get(change, ("video", "audio")))
    offer = {
        "VP8 only": lambda: offer.replace("H264/90000", "VP8/90000"),
        "G.711 only": lambda: without(offer, "a=rtpmap:96"),  # aiortc's number for Opus
        "another H.264": lambda: offer.replace("42e01f", "640c1f").replace("42001f", "4d001f"),
        "sendonly": lambda: offer.replace("a=recvonly", "a=sendonly"),
        "inactive": lambda: offer.replace("a=recvonly", "a=inactive"),
        "no fingerprint": lambda: without(offer, "a=fingerprint"),
        "no credentials": lambda: without(offer, "a=ice-ufrag"),
    }.get(change, lambda: offer)()
    urls = await create(http, server)
    answer = await viewer.send(urls["whep"], offer)
    assert answer.status_code == 400
    document = answer.json()
    assert document["type"] == "/problems/negotiation-failed"
    assert words in document["detail"]
    assert document["advice"]
    assert (await http.get(urls["self"])).json()["viewers"]["whep"] == 0
    await http.delete(urls["self"])


async def test_offers_may_be_as_long_as_the_limit(server: str, http: httpx.AsyncClient, viewers: Any) -> None:
    urls = await create(http, server)
    viewer = viewers()
    offer = await viewer.offer()
    room = 65_536 - len(offer)
    offer += f"a=x-room:{'x' * (room - 11)}\r\n"
    assert len(offer) == 65_536
    assert (await viewer.send(urls["whep"], offer)).status_code == 201
    longer = await viewer.send(urls["whep"], offer + "\n")
    assert (longer.status_code, longer.json()["type"]) == (413, "/problems/too-long")
    await http.delete(urls["self"])


async def test_the_letter_of_the_draft(
    server: str, curl: Any, tmp_path: Path, http: httpx.AsyncClient, viewers: Any
) -> None:
    urls = await create(http, server)
    offer = tmp_path / "offer.sdp"
    offer.write_text(await viewers().offer())
    post = ("--header", "Content-Type: application/sdp", "--data-binary", f"@{offer}")
    answer = curl(urls["whep"], *post)
    assert answer.status == 201, answer.body
    assert answer.headers["content-type"] == "application/sdp"
    assert answer.headers["cache-control"] == "no-store"
    assert answer.headers["accept-patch"] == "application/trickle-ice-sdpfrag"
    assert re.fullmatch(r'"[!#-~]+"', answer.headers["etag"])
    assert "link" not in answer.headers
    assert answer.body.startswith(b"v=0\r\n")
    session = server + answer.headers["location"]
    assert re.fullmatch(re.escape(urls["whep"]) + r"/[\w-]{22}", session)
    assert curl(urls["whep"], *post).headers["etag"] != answer.headers["etag"]

    for url, allowed, accepts in [
        (urls["whep"], "GET, HEAD, OPTIONS, POST", ("accept-post", "application/sdp")),
        (session, "DELETE, GET, HEAD, OPTIONS, PATCH", ("accept-patch", "application/trickle-ice-sdpfrag")),
    ]:
        got = curl(url)
        assert (got.status, got.body) == (204, b"")
        assert curl(url, "--head").status == 204
        options = curl(url, "--request", "OPTIONS")
        assert (options.status, options.headers["allow"]) == (200, allowed)
        assert options.headers[accepts[0]] == accepts[1]
        for method in {"DELETE", "PATCH", "POST", "PUT"} - set(allowed.split(", ")):
            refused = curl(url, "--request", method)
            assert (refused.status, refused.headers["allow"]) == (405, allowed)
            assert refused.json()["type"] == "/problems/method-not-allowed"
    curl(urls["self"], "--request", "DELETE")
    assert curl(urls["whep"]).status == 410


async def test_behind_a_firewall(own_server: Any, free_ports: Any, http: httpx.AsyncClient, viewers: Any) -> None:
    """Two UDP ports, so two viewers; and the servers that viewers shall use."""
    ports = free_ports(2)
    ice_servers = [
        {"urls": "stun:stun.example.org:3478"},
        {"urls": ["turn:a.example.org?transport=udp", "turns:b.example.org"], "username": "u", "credential": 'c"\\;,'},
    ]
    settings = {
        "WEBRTC__PORTS": f"{ports[0]}-{ports[-1]}",
        "WEBRTC__ICE_SERVERS": json.dumps(ice_servers),
        "WEBRTC__ADDRESSES": '["127.0.0.1"]',
    }
    with own_server(**settings) as server:
        urls = await create(http, server.url)
        one, two, three = viewers(), viewers(), viewers()
        offer = await one.offer()
        answer = await one.send(urls["whep"], offer)
        await one.accept(answer.text)
        await two.watch(urls["whep"])
        assert len(await one.frames("video", 5)) == len(await two.frames("video", 5)) == 5
        offered = [line.split() for line in answer.text.splitlines() if line.startswith("a=candidate:")]
        assert {words[4] for words in offered} == {"127.0.0.1"}
        assert {int(words[5]) for words in offered} <= set(ports)
        login = 'username="u"; credential="c\\"\\\\;,"; credential-type="password"'
        assert answer.headers.get_list("link") == [
            '<stun:stun.example.org:3478>; rel="ice-server"',
            f'<turn:a.example.org?transport=udp>; rel="ice-server"; {login}',
            f'<turns:b.example.org>; rel="ice-server"; {login}',
        ]

        refused = await three.send(urls["whep"], await three.offer())
        assert (refused.status_code, refused.json()["type"]) == (503, "/problems/over-capacity")
        assert str(ports[0]) in refused.json()["detail"]
        assert int(refused.headers["retry-after"]) > 0
        assert (await http.get(urls["self"])).json()["viewers"]["whep"] == 2

        await http.delete(server.url + one.session)
        again = await three.send(urls["whep"], three.peer.localDescription.sdp)
        assert again.status_code == 201
        await three.accept(again.text)
        assert len(await three.frames("video", 5)) == 5
