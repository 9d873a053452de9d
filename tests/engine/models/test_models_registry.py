from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_phone_mean import FPS, REST, said

from app.engine.models.model import Kind, Spoken
from app.engine.models.phone_mean import PhoneMeanKind
from app.engine.models.registry import DEFAULT, KINDS, check_kinds, check_spoken, fit, kind, seconds_of_speech
from app.engine.models.sound import Sound
from app.errors import NotFound, TrainingFailed
from app.speech import Phone


class Listener(PhoneMeanKind):
    """A kind that needs sound and ten seconds."""

    name = "listener"
    hears = True
    least = 10.0


@pytest.mark.parametrize("name", KINDS.names())
def test_every_kind_is_one(name: str) -> None:
    made = kind(name)
    assert isinstance(made, Kind)
    assert made.name == name
    assert made.version >= 1


def test_the_usual_kind_is_known() -> None:
    assert DEFAULT in KINDS.names()


def test_an_unknown_kind_is_named_with_those_there_are() -> None:
    with pytest.raises(NotFound, match="'oil'") as caught:
        check_kinds(["phone-mean", "oil"])
    assert "phone-mean" in caught.value.advice


def heard(spoken: Spoken) -> Spoken:
    return replace(spoken, sound=Sound(np.zeros(100, np.float32), 16_000))


def test_too_little_speech_is_refused_with_what_is_needed() -> None:
    with pytest.raises(TrainingFailed, match=r"1 s of speech are too little for listener, which needs 10 s"):
        check_spoken(Listener(), [heard(said("SIL", "AA", "B", "AA", "B", "AA", "SIL"))], REST, FPS)


def test_missing_sound_is_refused() -> None:
    with pytest.raises(TrainingFailed, match="sentence 0 has no sound"):
        check_spoken(Listener(), [said("AA")], REST, FPS)


def test_numbers_that_are_none_are_refused_where_they_count() -> None:
    broken = said("AA", "B", "AA", "B", "AA")
    broken.coefficients[3, 1] = np.nan
    with pytest.raises(TrainingFailed, match="not finite"):
        fit("phone-mean", [broken], REST, fps=FPS)
    broken.counted[3] = False
    assert np.isfinite(fit("phone-mean", [broken, broken], REST, fps=FPS).predict([Phone("AA", 0, 1)], 3)).all()


def test_unknown_phones_are_refused() -> None:
    with pytest.raises(TrainingFailed, match="'QQ'"):
        fit("phone-mean", [said("AA", "QQ")], REST, fps=FPS)


def test_rows_of_another_size_are_refused() -> None:
    with pytest.raises(TrainingFailed, match="one row a frame"):
        fit("phone-mean", [said("AA", "B")], np.zeros(3, np.float32), fps=FPS)


def test_seconds_of_speech_count_neither_silence_nor_lost_frames() -> None:
    spoken = said("SIL", "AA", "B", "SIL")
    spoken.counted[6:8] = False
    assert seconds_of_speech(spoken, FPS) == pytest.approx(8 / FPS)
