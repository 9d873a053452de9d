from __future__ import annotations

import pytest

from app.errors import InputError
from app.stream.push.target import MAX_URL, push_target, without_credentials


@pytest.mark.parametrize(
    ("url", "kind", "shown"),
    [
        ("rtmp://localhost/live/key", "rtmp", "rtmp://localhost/live/…"),
        ("rtmp://user:pass@host:1936/live/deep/key?token=x", "rtmp", "rtmp://host:1936/live/…"),
        ("rtmp://localhost/live/key/", "rtmp", "rtmp://localhost/live/…"),
        ("https://sfu.example.org/SECRET/webRTC/publish", "whip", "https://sfu.example.org/…"),
        ("rtmps://[2001:db8::1]:443/app/key", "rtmp", "rtmps://[2001:db8::1]:443/app/…"),
        ("RTMP://HOST/app/key", "rtmp", "rtmp://HOST/app/…"),
        ("https://sfu.example.org/whip/room?key=x", "whip", "https://sfu.example.org/…"),
        ("http://127.0.0.1:8889/whip", "whip", "http://127.0.0.1:8889/…"),
    ],
)
def test_servers_are_taken_and_shown_without_what_lets_one_in(url: str, kind: str, shown: str) -> None:
    target = push_target(url)
    assert (target.kind, target.url, target.shown) == (kind, url, shown)
    assert url not in repr(target)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "hello",
        "file:///etc/passwd",
        "/etc/passwd",
        "tcp://host:80",
        "udp://host:80/a/b",
        "pipe:1",
        "concat:rtmp://host/app/key",
        "rtmpt://host/app/key",
        "fifo://host/app/key",
        "tee:rtmp://host/app/key|file.flv",
        "rtmp://host/app/key live=1 swfUrl=x",
        "rtmp://host/app/key\nfile:x",
        "rtmp://host/app/key\t",
        "rtmp://host/app/ключ",
        "rtmp://host/app/key#part",
        "rtmp://host/app",
        "rtmp://host/",
        "rtmp://host",
        "rtmp:///app/key",
        "rtmp:host/app/key",
        "rtmp://:1935/app/key",
        "rtmp://host:0/app/key",
        "rtmp://host:99999/app/key",
        "rtmp://[::1/app/key",
        "http://",
        "ftp://host/whip",
        "rtmp://host/app/" + MAX_URL * "k",
    ],
)
def test_everything_else_is_refused(url: str) -> None:
    with pytest.raises(InputError) as refused:
        push_target(url, field="rtmp_url")
    assert refused.value.field == "rtmp_url"
    assert refused.value.advice


def test_a_refusal_does_not_repeat_the_password() -> None:
    for url in ("rtmp://user:hunter2@host/app", "rtsp://user:hunter2@host/app/key", "rtmp://user:hunter2@host:0/a/b"):
        with pytest.raises(InputError) as refused:
            push_target(url)
        assert "hunter2" not in refused.value.message + refused.value.advice


@pytest.mark.parametrize(("kind", "url"), [("rtmp", "https://host/whip"), ("whip", "rtmp://host/app/key")])
def test_a_field_takes_its_own_kind_only(kind: str, url: str) -> None:
    with pytest.raises(InputError, match="scheme"):
        push_target(url, kind=kind)  # type: ignore[arg-type]


def test_the_operator_may_name_the_servers() -> None:
    assert push_target("rtmp://Live.example.org/app/key", hosts=["live.example.org"]).kind == "rtmp"
    with pytest.raises(InputError, match="not allowed"):
        push_target("rtmp://127.0.0.1/app/key", hosts=["live.example.org"])
    with pytest.raises(InputError, match="not allowed"):
        push_target("rtmp://live.example.org@127.0.0.1/app/key", hosts=["live.example.org"])


@pytest.mark.parametrize(
    ("url", "token"), [("rtmp://host/app/key", "abc"), ("https://host/whip", "a b"), ("https://host/whip", "a\r\nb: c")]
)
def test_tokens_are_for_whip_and_one_word(url: str, token: str) -> None:
    with pytest.raises(InputError, match="token"):
        push_target(url, token=token)
    assert push_target("https://host/whip", token="eyJ.abc").token == "eyJ.abc"


def test_what_a_server_says_is_shown_without_what_it_repeats() -> None:
    target = push_target("rtmp://user:p%40ss@host/app/secret?token=abc123")
    said = "no stream secret?token=abc123 for user with p@ss (p%40ss), secret"
    assert target.hide(said) == "no stream … for … with … (…), …"
    target = push_target("https://host/SECRET/webRTC/publish")
    assert "SECRET" not in target.hide("nothing at /SECRET/webRTC, SECRET, publish")
    assert "secret" not in push_target("rtmp://host/app/secret/").hide("no stream secret")


def test_where_something_plays_has_no_credentials() -> None:
    assert without_credentials("rtmp://user:pass@host:1935/live/?token=x") == "rtmp://host:1935/live/"
