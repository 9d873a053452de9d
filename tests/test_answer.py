from __future__ import annotations

import pytest

from app.answer import Answer, complaint_of


@pytest.mark.parametrize(
    ("body", "kind", "said"),
    [
        (b'{"error": {"message": "no such model"}}', "application/json", "no such model"),
        (b'{"error": "no such model"}', "", "no such model"),
        (b'{"detail": "Not Found"}', "application/json", "Not Found"),
        (b'{"other": 1}', "application/json", ""),
        (b"{broken", "application/json", "{broken"),
        (b"[" * 60_000, "application/json", "[" * 199 + "…"),
        (b"<html><head><title>502 Bad\nGateway</title></head><body>nginx", "text/html", "502 Bad Gateway"),
        (b"<p>sorry</p> <b>gone</b>", "text/html", "sorry gone"),
        (b"\x1b[31mred\x00", "text/plain", "[31mred"),
        (b"\xff\xfe\x00", "audio/wav", ""),
        (b"", "", ""),
    ],
)
def test_complaints(body: bytes, kind: str, said: str) -> None:
    assert complaint_of(Answer(body, kind)) == said
