from __future__ import annotations

from app.engine.models.labels import frame_phones
from app.speech import SILENCE, Phone


def test_one_label_a_frame() -> None:
    phones = [Phone("M", 0.0, 0.05), Phone("AA", 0.05, 0.2)]
    assert frame_phones(phones, 7, 25) == ["M", "M", "AA", "AA", "AA", "AA", "AA"]


def test_a_frame_on_a_border_shows_what_begins_there() -> None:
    assert frame_phones([Phone("M", 0.0, 0.04), Phone("AA", 0.04, 0.08)], 2, 25) == ["M", "AA"]


def test_no_phones_are_silence() -> None:
    assert frame_phones([], 2, 25) == [SILENCE, SILENCE]
    assert frame_phones([], 0, 25) == []
