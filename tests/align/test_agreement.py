from pathlib import Path

import pytest

from app.align.agreement import agreement
from app.align.align_clips import SpokenClip
from app.align.clips import Clip
from app.speech import Phone, Word


def clip(ours: dict[str, float], theirs: dict[str, float] | None, aligner: str = "mock") -> SpokenClip:
    """Words and their starts in milliseconds, and those of the corpus."""
    words, given = (
        None if each is None else tuple(Word(text, at / 1000, at / 1000 + 0.05) for text, at in each.items())
        for each in (ours, theirs)
    )
    assert words is not None
    named = Clip("a", Path("a.mp4"), Path("a.align"))
    return SpokenClip(named, (Phone("SIL", 0.0, 9.0),), words, (), 1.0, given, aligner)


def test_first_words_are_counted_apart() -> None:
    found = agreement(
        [
            clip({"lay": 300, "red": 510, "at": 690}, {"lay": 200, "red": 500, "at": 700}),
            clip({"lay": 180, "red": 550, "at": 700}, {"lay": 200, "red": 500, "at": 670}),
        ]
    )
    assert found is not None
    assert found.inner is not None
    assert found.onsets is not None
    assert found.words == 6
    assert found.inner.count == 4  # 10, -10, 50, 30
    assert found.inner.median == pytest.approx(20)
    assert found.inner.bias == pytest.approx(20)
    assert found.inner.p90 == pytest.approx(44)
    assert found.inner.over_40 == 0.25
    assert found.onsets.count == 2  # 100, -20
    assert found.onsets.median == pytest.approx(60)
    assert found.onsets.bias == pytest.approx(40)
    assert found.onsets.over_40 == 0.5


def test_words_of_one_side_are_passed_over() -> None:
    found = agreement([clip({"Red": 500, "x": 600, "now": 700}, {"lay": 200, "red": 490, "😀": 600, "now": 700})])
    assert found is not None
    assert found.inner is not None
    assert found.onsets is None  # the first word is not among ours
    assert found.words == 2
    assert found.inner.median == pytest.approx(5)


def test_nothing_to_compare() -> None:
    assert agreement([]) is None
    assert agreement([clip({"red": 1}, None), clip({"red": 1}, {"blue": 1})]) is None
    assert agreement([clip({"red": 1}, {"red": 1}, aligner="")]) is None


def test_one_word_a_clip() -> None:
    found = agreement([clip({"red": 100}, {"red": 90})])
    assert found is not None
    assert found.inner is None
    assert found.onsets is not None
    assert found.onsets.over_40 == 0
