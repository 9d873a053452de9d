"""Every wrong request gets a problem document that names the field and says what to do; the service goes on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

JSON = "Content-Type: application/json"
SDP = "Content-Type: application/sdp"
OFFER_OF_NOTHING = "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=-\r\nt=0 0\r\n"


@dataclass(frozen=True)
class Case:
    name: str
    path: str
    status: int
    slug: str
    field: str = ""
    method: str = "POST"
    body: str | bytes | None = None
    headers: tuple[str, ...] = (JSON,)
    advice: bool = True
    details: tuple[str, ...] = ()


def order(**fields: object) -> str:
    return json.dumps(fields)


CASES = [
    # text
    *(
        Case(f"{name} on {path}", path, 422, "nothing-to-say", "text", body=order(text=text))
        for path in ("/v1/streams", "/v1/streams/{id}/say", "/v1/render")
        for name, text in [
            ("empty text", ""),
            ("blank text", " \n\t  "),
            ("control characters", "\x00\x07\x1b\x7f"),
            ("emoji", "🙂🎉"),
            ("half a surrogate pair", "\ud83d"),
        ]
    ),
    *(
        Case(f"long text on {path}", path, 413, "too-long", "text", body=order(text="hello wor " * 2000))
        for path in ("/v1/streams", "/v1/streams/{id}/say", "/v1/render")
    ),
    Case("endless body", "/v1/streams", 413, "too-long", body=order(text="x" * 300_000)),
    Case("no text", "/v1/render", 422, "invalid-input", "text", body="{}", advice=False),
    Case("text that is no text", "/v1/render", 422, "invalid-input", "text", body=order(text=5), advice=False),
    # names
    *(
        Case(f"avatar {name}", path, 404, "not-found", "avatar", body=order(text="Hello.", avatar=name))
        for path in ("/v1/streams", "/v1/render")
        for name in ("nobody", "../../etc", "..", ".", "/etc", "mary/../mary", "mary\x00", "a" * 199)
    ),
    Case("empty avatar", "/v1/streams", 422, "invalid-input", "avatar", body=order(avatar=""), advice=False),
    *(
        Case(f"voice on {path}", path, 404, "not-found", "voice", body=order(text="Hello.", voice="nobody"))
        for path in ("/v1/streams", "/v1/streams/{id}/say", "/v1/render")
    ),
    *(
        Case(f"{method} {path}", path, 404, "not-found", method=method, body=body, headers=headers, advice=False)
        for method, path, body, headers in [
            ("GET", "/v1/streams/none", None, ()),
            ("DELETE", "/v1/streams/none", None, ()),
            ("POST", "/v1/streams/none/say", order(text="Hello."), (JSON,)),
            ("POST", "/v1/streams/none/interrupt", None, ()),
            ("GET", "/v1/streams/none/live.flv", None, ()),
            ("GET", "/v1/streams/none/live.mp4", None, ()),
            ("GET", "/v1/streams/none/video.mp4", None, ()),
            ("GET", "/v1/streams/none/events", None, ()),
            ("POST", "/v1/streams/none/whep", OFFER_OF_NOTHING, (SDP,)),
            ("DELETE", "/v1/streams/none/whep/none", None, ()),
            ("DELETE", "/v1/streams/{id}/whep/none", None, ()),
            ("PATCH", "/v1/streams/{id}/whep/none", "", ()),
            ("GET", "/v1/streams/{id}/whep/none", None, ()),
            ("GET", "/v1/streams/none/whep", None, ()),
            ("GET", "/v1/streams/{id}/video.mp4", None, ()),
            ("GET", "/v1/streams/{id}/video.mp4?utterance=none", None, ()),
            ("POST", "/v1/streams/{id}/utterances/none/shown", order(milliseconds=5), (JSON,)),
            ("GET", "/v1/avatars/nobody/idle.mp4", None, ()),
            ("GET", "/v1/avatars/..%2f..%2fapp/idle.mp4", None, ()),
            ("GET", "/v1/avatars/../config.yaml", None, ()),
            ("GET", "/static/../config.yaml", None, ()),
            ("GET", "/static/%2e%2e/config.yaml", None, ()),
            ("GET", "/v1/nothing", None, ()),
            ("GET", "/problems/none", None, ()),
        ]
    ),
    # fields
    Case("unknown field", "/v1/streams", 422, "invalid-input", "txt", body=order(txt="Hello.")),
    Case("unknown field of say", "/v1/streams/{id}/say", 422, "invalid-input", "x", body=order(text="Hello.", x=1)),
    *(
        Case(f"speed {speed}", "/v1/streams", 422, "invalid-input", "speed", body=f'{{"speed": {speed}}}', advice=False)
        for speed in ("0.49", "2.01", '"1"', "NaN", "Infinity", "-1", "true", "null")
    ),
    Case("start", "/v1/streams", 422, "invalid-input", "start", body=order(start="later"), advice=False),
    Case("idle", "/v1/streams", 422, "invalid-input", "idle", body=order(idle="no"), advice=False),
    Case("once", "/v1/streams", 422, "invalid-input", "once", body=order(once="yes"), advice=False),
    Case("phase", "/v1/streams", 422, "invalid-input", "phase.at_ms", body=order(phase={"frame": 1}), advice=False),
    Case("a list", "/v1/streams", 422, "invalid-input", body="[]", advice=False),
    Case("shown", "/v1/streams/{id}/utterances/x/shown", 422, "invalid-input", "milliseconds", body="{}", advice=False),
    # bodies
    Case("broken JSON", "/v1/streams", 400, "invalid-json", body='{"text": "Hello}', details=("character 9",)),
    Case("no JSON", "/v1/render", 400, "invalid-json", body="Hello.", details=("character 0",)),
    Case("no UTF-8", "/v1/render", 400, "bad-request", body=b'{"text": "\xff\xfe"}', advice=False),
    Case("deep JSON", "/v1/render", 400, "bad-request", body='{"text":' + "[" * 50_000, advice=False),
    *(
        Case(
            f"{kind or 'no type'} on {path}",
            path,
            415,
            "unsupported-media-type",
            body=body,
            headers=(header,),
        )
        for path, body in [
            ("/v1/streams", order(text="Hello.")),
            ("/v1/streams/{id}/say", order(text="Hello.")),
            ("/v1/render", order(text="Hello.")),
            ("/v1/streams/{id}/whep", OFFER_OF_NOTHING),
        ]
        for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "")
        for header in [f"Content-Type: {kind}" if kind else "Content-Type:"]
    ),
    Case("JSON as offer", "/v1/streams/{id}/whep", 415, "unsupported-media-type", body="{}"),
    Case("SDP as order", "/v1/streams", 415, "unsupported-media-type", body="v=0", headers=(SDP,)),
    # offers
    *(
        Case(
            f"offer: {name}",
            "/v1/streams/{id}/whep",
            400,
            "negotiation-failed",
            body=body,
            headers=(SDP,),
            advice=False,
        )
        for name, body in [
            ("empty", " "),
            ("words", "hello"),
            ("nothing offered", OFFER_OF_NOTHING),
            ("cut off", "v=0\r\no=- 1 1 IN IP4 127.0.0.1\r\ns=-\r\nt=0 0\r\nm=video 9 UDP/TLS/RTP/SAVPF"),
            ("no UTF-8", b"v=0\r\n\xff\xfe"),
        ]
    ),
    Case("long offer", "/v1/streams/{id}/whep", 413, "too-long", body="v=0\r\n" * 20_000, headers=(SDP,), advice=False),
    # methods
    Case("PUT", "/v1/streams", 405, "method-not-allowed", method="PUT"),
    Case("POST", "/v1/avatars", 405, "method-not-allowed", method="POST", body="{}"),
    Case("OPTIONS", "/v1/streams", 405, "method-not-allowed", method="OPTIONS"),
    Case("PUT of an offer", "/v1/streams/{id}/whep", 405, "method-not-allowed", method="PUT"),
    Case("POST to a viewer", "/v1/streams/{id}/whep/x", 405, "method-not-allowed"),
]


@pytest.fixture(scope="module")
def stream(server: str) -> str:
    import urllib.request

    request = urllib.request.Request(f"{server}/v1/streams", b"{}", {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=60) as answer:
        return str(json.load(answer)["id"])


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_wrong_request_is_explained(case: Case, server: str, stream: str, curl, tmp_path: Path) -> None:
    options = ["--request", case.method]
    if case.body is not None:
        body = tmp_path / "body"
        body.write_bytes(case.body if isinstance(case.body, bytes) else case.body.encode("utf-8"))
        options += ["--data-binary", f"@{body}"]
    for header in case.headers:
        options += ["--header", header]

    answer = curl(server + case.path.replace("{id}", stream), *options)

    assert answer.status == case.status, answer.body
    assert answer.headers["content-type"] == "application/problem+json"
    document = answer.json()
    assert document["type"] == f"/problems/{case.slug}"
    assert document["status"] == case.status
    assert document["title"]
    assert document["detail"]
    assert document.get("field", "") == case.field or (case.field == "" and "field" in document)
    if case.advice:
        assert document["advice"]
    for words in case.details:
        assert words in document["detail"]
    explained = curl(server + document["type"])
    assert explained.status == 200


def test_the_service_is_unharmed(server: str, stream: str, curl) -> None:
    """Runs after all of the above."""
    assert curl(f"{server}/readyz").status == 200
    said = curl(f"{server}/v1/streams/{stream}/say", "--json", '{"text": "Still here."}')
    assert said.status == 202
    assert curl(f"{server}/v1/streams/{stream}", "--request", "DELETE").status == 204


def test_the_header_allow_names_the_methods(server: str, curl) -> None:
    assert "POST" in curl(f"{server}/v1/streams", "--request", "PUT").headers["allow"]


def test_no_other_site_is_let_in(server: str, curl) -> None:
    asked = ("--header", "Origin: https://elsewhere.example", "--header", "Access-Control-Request-Method: POST")
    for answer in (
        curl(f"{server}/v1/avatars", *asked),
        curl(f"{server}/v1/streams", "--request", "OPTIONS", *asked),
    ):
        assert not [name for name in answer.headers if name.startswith("access-control")]
