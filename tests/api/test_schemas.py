from __future__ import annotations

import pytest
from pydantic import ValidationError

from app.api.schemas import RenderRequest, SayRequest, StreamRequest


def test_everything_about_a_stream_may_be_left_out() -> None:
    order = StreamRequest.model_validate_json("{}")
    assert (order.text, order.speed, order.start, order.idle, order.once) == (None, 1.0, "viewer", "stream", False)


def test_surrogates_are_joined_or_replaced() -> None:
    assert SayRequest.model_validate_json(r'{"text": "a \ud83d\ude42 b"}').text == "a 🙂 b"
    assert RenderRequest.model_validate({"text": "a \ud83d b"}).text == "a � b"


@pytest.mark.parametrize(
    "fields",
    [
        {"text": "Hello.", "more": 1},
        {"text": b"Hello."},
        {"text": "Hello.", "speed": float("nan")},
        {"text": "Hello.", "speed": "1"},
        {"text": "Hello.", "interrupt": 1},
        {"text": "Hello.", "phase": {"frame": -1, "at_ms": 0}},
        {"text": "Hello.", "phase": {"frame": 1, "at_ms": float("inf")}},
        {},
    ],
)
def test_nothing_is_guessed(fields: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SayRequest.model_validate(fields)


@pytest.mark.parametrize("lexicon", [{"word": ""}, {"": "W ER D"}])
def test_an_empty_pronunciation_is_told_in_characters(lexicon: dict[str, str]) -> None:
    with pytest.raises(ValidationError, match="at least 1 character"):
        RenderRequest(text="word", lexicon=lexicon)
