import json
from pathlib import Path

import hibari
import pytest

from app.align.phoneset import Sound, Unit, merge, phones_of, unknown
from app.speech import PHONES, SILENCE


@pytest.mark.parametrize(
    ("ipa", "phones"),
    [
        ("həlˈO wˈɜɹld", "HH AH L OW W ER L D"),  # misaki
        ("həlˈəʊ", "HH AH L OW"),  # espeak, British
        ("tʃˈɜːtʃ", "CH ER CH"),
        ("ʤˈʌʤ", "JH AH JH"),
        ("fˈIəɹ", "F AY ER"),
        ("ðə kwˈɪk bɹˈaʊn fˈɑks", "DH AH K W IH K B R AW N F AA K S"),
        ("bˈɑːɹ", "B AA R"),
        ("fˈoːɹ", "F AO R"),
        ("kˈAk, nˈWn", "K EY K N AW N"),
        ("ˌʌndɚstˈænd", "AH N D ER S T AE N D"),
        ("bˈʌʔn̩", "B AH T N"),
        ("", ""),
        ("… — “”", ""),
    ],
)
def test_known_spellings(ipa: str, phones: str) -> None:
    assert " ".join(phones_of(ipa)) == phones


def test_every_letter_of_the_voice_has_a_phone_of_the_house() -> None:
    vocabulary = json.loads((Path(hibari.__file__).parent / "assets/vocab.json").read_text("utf-8"))
    marks = set("̃ᵝˈˌːʰʲ↓→↗↘ ") | set(';:,.!?—…"()“”')
    for letter in vocabulary:
        phones = phones_of(letter)
        assert set(phones) <= set(PHONES)
        assert bool(phones) == (letter not in marks), letter


def test_a_diphthong_over_two_units_is_one_phone_with_their_joint_time() -> None:
    assert merge([Unit("a", 0.0, 0.1), Unit("ɪ", 0.1, 0.25)]) == [Sound("AY", 0.0, 0.25)]


def test_one_unit_of_two_sounds_divides_its_time() -> None:
    assert merge([Unit("ʦ", 1.0, 1.5, 3)]) == [Sound("T", 1.0, 1.25, 3), Sound("S", 1.25, 1.5, 3)]
    assert merge([Unit("ˈkæ", 0.0, 0.2)]) == [Sound("K", 0.0, 0.1), Sound("AE", 0.1, 0.2)]


def test_marks_give_their_time_to_their_phone() -> None:
    units = [Unit("ˈ", 0.0, 0.1), Unit("i", 0.1, 0.2), Unit("ː", 0.2, 0.3), Unit("z", 0.3, 0.4)]
    assert merge(units) == [Sound("IY", 0.0, 0.3), Sound("Z", 0.3, 0.4)]


def test_letters_of_two_words_stay_apart() -> None:
    assert [s.symbol for s in merge([Unit("t", 0.0, 0.1, 0), Unit("ʃ", 0.1, 0.2, 1)])] == ["T", "SH"]
    assert [s.symbol for s in merge([Unit("t", 0.0, 0.1, 0), Unit("ʃ", 0.1, 0.2, 0)])] == ["CH"]


def test_pauses_become_one_silence_and_leave_no_gap() -> None:
    units = [
        Unit("", 0.0, 0.1),
        Unit("a", 0.1, 0.2, 0),
        Unit(",", 0.2, 0.3),
        Unit(" ", 0.3, 0.4),
        Unit("b", 0.4, 0.5, 1),
    ]
    assert merge(units) == [
        Sound(SILENCE, 0.0, 0.1),
        Sound("AA", 0.1, 0.2, 0),
        Sound(SILENCE, 0.2, 0.4),
        Sound("B", 0.4, 0.5, 1),
    ]
    assert merge([Unit("ˈ", 0.0, 0.1), Unit(".", 0.1, 0.2)]) == [Sound(SILENCE, 0.0, 0.2)]


def test_unknown_letters_of_a_phonetic_text() -> None:
    assert [unknown(ipa) for ipa in ("təˈmeɪtoʊ", "d͡ʒʌd͡ʒ", "naːˑ.ʰt", "")] == ["", "", "", ""]
    assert [unknown(ipa) for ipa in ("t5", "ta%", "tя")] == ["5", "%", "я"]
