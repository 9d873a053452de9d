from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import NegotiationFailed
from app.stream.trickle import Section, parse

UDP = "1387637174 1 udp 2122260223 192.0.2.1 61764 typ host generation 0 ufrag EsAw network-id 1"
TCP = "473322822 1 tcp 1518280447 192.0.2.1 9 typ host tcptype active generation 0 ufrag EsAw network-id 1"
CREDENTIALS = ["a=ice-ufrag:EsAw", "a=ice-pwd:P2uYro0UCOQ4zxjKXaWCBui1"]


def lines(*parts: str) -> str:
    return "\r\n".join([*parts, ""])


def test_the_example_of_the_draft() -> None:
    fragment = lines(
        "a=group:BUNDLE 0 1",
        "m=audio 9 UDP/TLS/RTP/SAVPF 111",
        "a=mid:0",
        *CREDENTIALS,
        f"a=candidate:{UDP}",
        f"a=candidate:{TCP}",
        "a=end-of-candidates",
    )
    assert parse(fragment) == (Section("0", "EsAw", "P2uYro0UCOQ4zxjKXaWCBui1", [UDP, TCP]),)


def test_credentials_of_the_session_hold_for_sections_without() -> None:
    fragment = lines(
        *CREDENTIALS,
        "m=audio 9 RTP/AVP 0",
        "a=mid:sound",
        f"a=candidate:{UDP}",
        "m=video 9 RTP/AVP 0",
        "a=mid:picture",
        "a=ice-ufrag:other",
        "a=ice-pwd:another",
    )
    sound, picture = parse(fragment)
    assert (sound.mid, sound.ufrag, sound.candidates) == ("sound", "EsAw", [UDP])
    assert (picture.mid, picture.ufrag, picture.password, picture.candidates) == ("picture", "other", "another", [])


@pytest.mark.parametrize(
    ("fragment", "words"),
    [
        ("", "section"),
        ("hello", "no SDP"),
        (lines(*CREDENTIALS), "section"),
        (lines(*CREDENTIALS, f"a=candidate:{UDP}"), "section"),
        (lines(*CREDENTIALS, "m=audio 9 RTP/AVP 0", f"a=candidate:{UDP}"), "name"),
        (lines("m=audio 9 RTP/AVP 0", "a=mid:0", f"a=candidate:{UDP}"), "credentials"),
        (lines(CREDENTIALS[0], "m=audio 9 RTP/AVP 0", "a=mid:0", f"a=candidate:{UDP}"), "credentials"),
        *(
            (lines(*CREDENTIALS, "m=audio 9 RTP/AVP 0", "a=mid:0", f"a=candidate:{damaged}"), "candidate")
            for damaged in ("", "1 1 udp", UDP.replace("61764", "port"), UDP.replace("typ", "type"), f"1 {UDP}")
        ),
    ],
)
def test_malformed_fragments_are_refused(fragment: str, words: str) -> None:
    with pytest.raises(NegotiationFailed, match=words) as caught:
        parse(fragment)
    assert "RFC 8840" in caught.value.advice


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(fragment: str) -> None:
    with contextlib.suppress(NegotiationFailed):
        parse(fragment)
    with contextlib.suppress(NegotiationFailed):
        parse(lines(*CREDENTIALS, "m=audio 9 RTP/AVP 0", "a=mid:0", f"a=candidate:{fragment}"))
