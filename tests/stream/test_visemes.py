from __future__ import annotations

from app.speech import PHONES
from app.stream.visemes import viseme

OCULUS = {"sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou"}


def test_every_phone_has_a_shape_and_every_shape_a_phone() -> None:
    assert {viseme(phone).azure for phone in PHONES} == set(range(22))
    assert {viseme(phone).oculus for phone in PHONES} == OCULUS


def test_only_silence_is_silent_and_only_bilabials_close_the_lips() -> None:
    assert [phone for phone in PHONES if viseme(phone).azure == 0] == ["SIL"]
    assert [phone for phone in PHONES if viseme(phone).oculus == "sil"] == ["SIL"]
    for closed in (lambda phone: viseme(phone).azure == 21, lambda phone: viseme(phone).oculus == "PP"):
        assert [phone for phone in PHONES if closed(phone)] == ["B", "M", "P"]
