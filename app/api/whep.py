"""Watching over WebRTC by WHEP, draft-ietf-wish-whep-03. Its "session" is one viewer of a stream.

Of what the draft leaves open: candidates may be trickled, ICE is not restarted (422), and there are no counter-offers
(406): an offer that cannot be answered is refused with a problem document.
"""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException

from app.api.service import LoadedService
from app.config import IceServer
from app.errors import Gone, NegotiationFailed, TooLong
from app.stream import trickle

SDP = "application/sdp"
FRAGMENT = "application/trickle-ice-sdpfrag"

_NO_STORE = {"Cache-Control": "no-store"}
_ENDPOINT_METHODS = "GET, HEAD, OPTIONS, POST"
_SESSION_METHODS = "DELETE, GET, HEAD, OPTIONS, PATCH"

router = APIRouter(prefix="/v1/streams/{stream_id}/whep", tags=["watch"])


@router.post("", status_code=201, response_class=Response)
async def watch(stream_id: str, request: Request, service: LoadedService) -> Response:
    """Watch over WebRTC (WHEP, draft-ietf-wish-whep-03): an SDP offer in, the answer out.

    All candidates of the server are in the answer; those of the viewer may follow by `PATCH` of the `Location`.
    `DELETE` it to leave.
    """
    stream = service.streams.get(stream_id)
    if stream.state == "ended":
        raise Gone("the stream has ended")
    offer = await _body(request, SDP, "offer", service.settings.limits.sdp)
    if not offer.strip():
        raise NegotiationFailed("the offer is empty", advice="Send the SDP of RTCPeerConnection.createOffer().")
    viewer = await stream.whep(offer)
    headers = {"Location": f"/v1/streams/{stream_id}/whep/{viewer.id}", "ETag": viewer.etag, "Accept-Patch": FRAGMENT}
    response = Response(viewer.answer, 201, _NO_STORE | headers)
    response.headers["Content-Type"] = SDP
    for server in service.settings.webrtc.ice_servers:
        for link in _ice_links(server):
            response.headers.append("Link", link)
    return response


@router.head("", status_code=204, response_class=Response, include_in_schema=False)
@router.get("", status_code=204, response_class=Response, include_in_schema=False)
async def endpoint(stream_id: str, service: LoadedService) -> Response:
    """Nothing to be got here, but that the draft wants it said with success."""
    if service.streams.get(stream_id).state == "ended":
        raise Gone("the stream has ended")
    return Response(status_code=204, headers=_NO_STORE)


@router.options("", response_class=Response, include_in_schema=False)
async def endpoint_options() -> Response:
    """What can be done here."""
    return Response(headers={"Allow": _ENDPOINT_METHODS, "Accept-Post": SDP})


@router.put("", include_in_schema=False)
@router.patch("", include_in_schema=False)
@router.delete("", include_in_schema=False)
async def not_on_endpoint() -> None:
    """Starlette's own answer would not name all methods that work."""
    raise HTTPException(405, headers={"Allow": _ENDPOINT_METHODS})


@router.patch("/{viewer}", status_code=204, response_class=Response)
async def add_candidates(stream_id: str, viewer: str, request: Request, service: LoadedService) -> Response:
    """Send candidates found after the offer, as an SDP fragment (RFC 8840), with `If-Match`: the `ETag` of the answer.

    A fragment with other ICE credentials would restart ICE: 422.
    """
    peer = service.streams.get(stream_id).peer(viewer)
    fragment = await _body(request, FRAGMENT, "SDP fragment", service.settings.limits.sdp)
    wanted = request.headers.getlist("if-match")
    if not wanted:
        raise HTTPException(428, "If-Match must name the ICE session, or be *")
    # "*" in quotes is how the draft's example writes it.
    if not {"*", '"*"', peer.etag} & {tag.strip() for line in wanted for tag in line.split(",")}:
        raise HTTPException(412, "If-Match names another ICE session than the present one")
    await peer.trickle(trickle.parse(fragment))
    return Response(status_code=204)


@router.delete("/{viewer}", response_class=Response)
async def leave(stream_id: str, viewer: str, service: LoadedService) -> Response:
    """Stop watching over WebRTC."""
    await service.streams.get(stream_id).peer(viewer).close()
    return Response(status_code=200)


@router.head("/{viewer}", status_code=204, response_class=Response, include_in_schema=False)
@router.get("/{viewer}", status_code=204, response_class=Response, include_in_schema=False)
async def session(stream_id: str, viewer: str, service: LoadedService) -> Response:
    """As `endpoint`, as long as the viewer is there."""
    service.streams.get(stream_id).peer(viewer)
    return Response(status_code=204, headers=_NO_STORE)


@router.options("/{viewer}", response_class=Response, include_in_schema=False)
async def session_options() -> Response:
    """What can be done here."""
    return Response(headers={"Allow": _SESSION_METHODS, "Accept-Patch": FRAGMENT})


@router.post("/{viewer}", include_in_schema=False)
@router.put("/{viewer}", include_in_schema=False)
async def not_on_session() -> None:
    """As `not_on_endpoint`."""
    raise HTTPException(405, headers={"Allow": _SESSION_METHODS})


async def _body(request: Request, media_type: str, what: str, limit: int) -> str:
    content_type = Headers(scope=request.scope).get("content-type", "")
    if content_type.partition(";")[0].strip().lower() != media_type:
        takes = {"Accept-Post": SDP} if media_type == SDP else {"Accept-Patch": FRAGMENT}
        raise HTTPException(415, f"{what}s have the content type {media_type}", takes)
    body = await request.body()
    if len(body) > limit:
        raise TooLong(f"the {what} has {len(body):,} bytes, at most {limit:,} are taken")
    try:
        return body.decode("utf-8")
    except UnicodeDecodeError as error:
        raise NegotiationFailed(f"the {what} is not UTF-8: byte {error.start}") from error


def _ice_links(server: IceServer) -> list[str]:
    """One `Link` an address, as RFC 9725 section 4.6 writes it for WHIP and WHEP."""
    parameters = ['rel="ice-server"']
    if server.username is not None:
        parameters.append(f"username={_quoted(server.username)}")
    if server.credential is not None:
        parameters += [f"credential={_quoted(server.credential)}", 'credential-type="password"']
    return ["; ".join([f"<{url}>", *parameters]) for url in server.urls]


def _quoted(text: str) -> str:
    """As a quoted-string of HTTP (RFC 9110 section 5.6.4)."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
