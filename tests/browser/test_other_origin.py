"""A page of another origin creates a stream, hears of it and plays it by WHEP, if the service lets its origin in."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from page_steps import STEP_MS
from playwright.sync_api import Browser

PLAY = """async (base) => {
  const order = { method: "POST", headers: { "Content-Type": "application/json" }, body: '{"text": "Hello."}' };
  const created = await fetch(`${base}/v1/streams`, order);
  const { urls } = await created.json();
  const told = new Promise((resolve) => {
    const events = new EventSource(base + urls.events);
    events.addEventListener("speak_started", () => { events.close(); resolve(true); });
  });
  const peer = new RTCPeerConnection({ bundlePolicy: "max-bundle" });
  const video = document.querySelector("video");
  video.srcObject = new MediaStream();
  for (const kind of ["video", "audio"]) {
    video.srcObject.addTrack(peer.addTransceiver(kind, { direction: "recvonly" }).receiver.track);
  }
  const candidates = [];
  const gathered = new Promise((resolve) => {
    peer.onicecandidate = ({ candidate }) => (candidate?.candidate ? candidates.push(candidate) : resolve());
  });
  await peer.setLocalDescription();
  const offer = { method: "POST", headers: { "Content-Type": "application/sdp" }, body: peer.localDescription.sdp };
  const answer = await fetch(base + urls.whep, offer);
  const seen = ["Location", "ETag", "Accept-Patch", "Link"].map((name) => answer.headers.get(name));
  const session = base + seen[0];
  await peer.setRemoteDescription({ type: "answer", sdp: await answer.text() });
  await gathered;
  const line = (name) => peer.localDescription.sdp.match(new RegExp(`a=${name}:.*`))[0];
  const fragment = [
    line("ice-ufrag"), line("ice-pwd"), "m=video 9 UDP/TLS/RTP/SAVPF 96", "a=mid:0",
    ...candidates.filter(({ sdpMLineIndex }) => sdpMLineIndex === 0).map(({ candidate }) => `a=${candidate}`),
    "a=end-of-candidates", "",
  ].join("\\r\\n");
  const headers = { "Content-Type": "application/trickle-ice-sdpfrag", "If-Match": seen[1] };
  const trickled = await fetch(session, { method: "PATCH", headers, body: fragment });
  video.muted = true;
  await video.play();
  while (video.currentTime < 0.4) await new Promise((resolve) => video.requestVideoFrameCallback(resolve));
  const heard = await told;
  const left = await fetch(session, { method: "DELETE" });
  const gone = await fetch(session, { method: "DELETE" });
  peer.close();
  await fetch(base + urls.self, { method: "DELETE" });
  const problem = await gone.json();
  return { seen, size: video.videoWidth, trickled: trickled.status, heard, left: left.status, problem: problem.type };
}"""


@pytest.fixture
def foreign_port() -> Iterator[int]:
    """A web server of somebody else's, with a page that holds a video."""

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><link rel=icon href=data:,><title>Elsewhere</title><video></video>")

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Page) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


def test_a_page_of_another_origin(own_server: Any, foreign_port: int, browsers: Callable[..., Browser]) -> None:
    friend, stranger = f"http://127.0.0.1:{foreign_port}", f"http://localhost:{foreign_port}"
    with own_server(SERVER__CORS_ORIGINS=f'["{friend}"]') as server:
        page = browsers().new_page()
        page.set_default_timeout(STEP_MS)
        page.goto(friend)
        played = page.evaluate(PLAY, server.url)
        location, etag, patch, link = played.pop("seen")
        assert location.startswith("/v1/streams/")
        assert etag.startswith('"')
        assert (patch, link) == ("application/trickle-ice-sdpfrag", None)
        assert played == {"size": 512, "trickled": 204, "heard": True, "left": 200, "problem": "/problems/not-found"}

        page.goto(stranger)
        refused = page.evaluate("base => fetch(base + '/v1/avatars').catch(error => error.name)", server.url)
        assert refused == "TypeError"
        page.close()
