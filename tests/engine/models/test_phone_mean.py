from __future__ import annotations

import numpy as np
import pytest

from app.engine.models.model import Spoken
from app.engine.models.phone_mean import PhoneMean, PhoneMeanKind
from app.engine.models.registry import fit
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack
from app.speech import SILENCE, Phone

FPS = 25
REST = np.array([7.0, -7.0], np.float32)


def said(*symbols: str, seed: int = 0) -> Spoken:
    """Five frames a phone."""
    phones = tuple(Phone(symbol, round(0.2 * at, 3), round(0.2 * (at + 1), 3)) for at, symbol in enumerate(symbols))
    rows = np.random.default_rng(seed).standard_normal((5 * len(symbols), 2)).astype(np.float32)
    return Spoken(phones, rows, np.ones(len(rows), bool))


@pytest.fixture
def spoken() -> list[Spoken]:
    return [said("SIL", "B", "AA", "SIL", seed=1), said("AA", "S", "AA", seed=2)]


@pytest.fixture
def model(spoken: list[Spoken]) -> PhoneMean:
    found = fit("phone-mean", spoken, REST, fps=FPS)
    assert isinstance(found, PhoneMean)
    return found


def test_every_frame_shows_the_mean_of_its_phone(spoken: list[Spoken], model: PhoneMean) -> None:
    first, second = (each.coefficients for each in spoken)
    expected = np.concatenate([first[10:15], second[:5], second[10:]]).mean(0)
    rows = model.predict([Phone("B", 0, 0.2), Phone("AA", 0.2, 0.28)], 8)
    np.testing.assert_allclose(rows[5:], np.tile(expected, (3, 1)), atol=1e-6)
    np.testing.assert_allclose(rows[0], first[5:10].mean(0), atol=1e-6)


def test_frames_that_do_not_count_are_not_learnt_from(spoken: list[Spoken]) -> None:
    spoken[0].counted[5:8] = False
    spoken[0].coefficients[5:8] = np.nan
    rows = fit("phone-mean", spoken, REST, fps=FPS).predict([Phone("B", 0, 1)], 1)
    np.testing.assert_allclose(rows[0], spoken[0].coefficients[8:10].mean(0), atol=1e-6)


@pytest.mark.parametrize(("asked", "shown"), [("P", "B"), ("Z", "S"), ("AE", "AA")])
def test_phones_that_were_never_seen_look_like_others(model: PhoneMean, asked: str, shown: str) -> None:
    unseen, seen = (model.predict([Phone(each, 0, 1)], 1) for each in (asked, shown))
    assert np.array_equal(unseen, seen)


def test_silence_that_was_never_seen_is_rest() -> None:
    model = fit("phone-mean", [said("AA", "B", "S", "AA", "B")], REST, fps=FPS)
    assert np.array_equal(model.predict([], 2), [REST, REST])


def test_no_frames(model: PhoneMean) -> None:
    assert model.predict([Phone("AA", 0, 1)], 0).shape == (0, 2)


def test_it_is_read_as_it_was_stored(model: PhoneMean) -> None:
    again = PhoneMeanKind().load(StoredArrays("a file", model.to_arrays()))
    phones = [Phone("B", 0, 0.2), Phone(SILENCE, 0.2, 0.3), Phone("AA", 0.3, 0.4)]
    assert np.array_equal(again.predict(phones, 10), model.predict(phones, 10))
    assert np.array_equal(again.rest, REST)


@pytest.mark.parametrize("phones", [["AA"], ["SIL", "XX"]])
def test_phones_that_are_none_are_refused(model: PhoneMean, phones: list[str]) -> None:
    arrays = model.to_arrays() | {"phones": np.array(phones), "mean": np.zeros((len(phones), 2))}
    with pytest.raises(BadPack, match="ARPAbet"):
        PhoneMeanKind().load(StoredArrays("a file", arrays))
