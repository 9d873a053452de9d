from __future__ import annotations

import numpy as np

from app.engine.models.hmm_context import CLASSES, COLUMNS, contexts, questions
from app.engine.states import VISEMES, silences_joined
from app.speech import PHONES, SILENCE, Phone


def said(*symbols: str) -> list[Phone]:
    return [Phone(symbol, 0.1 * at, 0.1 * (at + 1)) for at, symbol in enumerate(symbols)]


def test_a_phone_stands_between_its_neighbours_and_silence() -> None:
    found = contexts(said("B", "AA"), ("SIL", "AA", "B"))
    assert [[PHONES[place] for place in row] for row in found] == [[SILENCE, "B", "AA"], ["B", "AA", SILENCE]]


def test_untrained_phones_are_taken_for_what_looks_like_them() -> None:
    found = contexts(said("P", "AE"), ("SIL", "AA", "B"))
    assert np.array_equal(found, contexts(said("B", "AA"), ("SIL", "AA", "B")))


def test_silences_in_a_row_are_one() -> None:
    phones = [Phone("SIL", 0, 1), Phone("SIL", 1, 2), Phone("AA", 2, 3), Phone("AA", 3, 4)]
    assert silences_joined(phones) == [Phone("SIL", 0, 2), *phones[2:]]
    assert silences_joined([]) == []


def test_answers_say_whether_the_phone_at_a_place_is_one_of_the_class() -> None:
    asked = questions()
    found = asked.answers(contexts(said("B", "AA", "M"), PHONES))
    by_name = dict(zip(asked.names, found, strict=True))
    assert by_name["this: vowel"].tolist() == [False, True, False]
    assert by_name["next: nasal"].tolist() == [False, True, False]
    assert by_name["last: looks like P"].tolist() == [False, True, False]
    assert by_name["next: looks like SIL"].tolist() == [False, False, True]


def test_every_phone_viseme_and_class_is_asked_for_once_at_each_place() -> None:
    asked = questions()
    sets = {(int(column), *np.flatnonzero(yes)) for column, yes in zip(asked.column, asked.yes, strict=True)}
    assert len(sets) == len(asked.names) == len(set(asked.names))
    members = [each.split() for each in CLASSES.values()] + [list(each) for each in VISEMES] + [[p] for p in PHONES]
    for group in members:
        places = sorted(PHONES.index(phone) for phone in group)
        assert all((column, *places) in sets for column in range(len(COLUMNS)))
