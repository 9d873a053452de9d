from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from talking import FPS, REST, talk, talked
from threadpoolctl import threadpool_limits

from app.engine.models.gpdm import SwitchingGpdm
from app.engine.models.gpdm_kinds import PhoneGpdmKind, VlmmGpdmKind
from app.engine.models.model import Spoken
from app.engine.models.registry import fit
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack, TrainingFailed
from app.speech import Phone

KINDS = {"vlmm-gpdm": VlmmGpdmKind(), "phone-gpdm": PhoneGpdmKind()}
NEW = talk("SIL", "B", "AA", "S", "S", "AA", "B", "SIL", seed=99)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """As the service has it: threads inside such small products cost far more than they save."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="module")
def spoken() -> list[Spoken]:
    return talked(6)


@pytest.fixture(scope="module")
def models(spoken: list[Spoken]) -> dict[str, SwitchingGpdm]:
    found = {}
    for name in KINDS:
        model = fit(name, spoken, REST, fps=FPS)
        assert isinstance(model, SwitchingGpdm)
        found[name] = model
    return found


@pytest.fixture(params=sorted(KINDS))
def model(models: dict[str, SwitchingGpdm], request: pytest.FixtureRequest) -> SwitchingGpdm:
    return models[request.param]


def error(model: SwitchingGpdm, said: Spoken = NEW) -> float:
    rows = model.predict(said.phones, len(said.counted), sound=said.sound)
    return float(((rows - said.coefficients) ** 2).mean())


def test_new_sentences_are_said_better_than_by_the_mean_of_each_phone(
    model: SwitchingGpdm, spoken: list[Spoken]
) -> None:
    mean = fit("phone-mean", spoken, REST, fps=FPS).predict(NEW.phones, len(NEW.counted))
    assert error(model) < 0.8 * ((mean - NEW.coefficients) ** 2).mean()


def test_states_remember(models: dict[str, SwitchingGpdm]) -> None:
    vlmm = models["vlmm-gpdm"].vlmm
    assert vlmm is not None
    assert max(len(each) for each in vlmm.contexts) > 2
    assert models["phone-gpdm"].vlmm is None


def test_sound_tells_more_than_phones_alone(model: SwitchingGpdm) -> None:
    mute = model.predict(NEW.phones, len(NEW.counted))
    assert np.isfinite(mute).all()
    assert error(model) < ((mute - NEW.coefficients) ** 2).mean()


def test_prediction_by_the_dynamics_is_another_way_to_say_it(model: SwitchingGpdm) -> None:
    other = replace(model, algorithm="prediction")
    assert error(other) < ((NEW.coefficients - NEW.coefficients.mean(0)) ** 2).mean()
    assert error(other) != error(model)


def test_it_is_read_as_it_was_stored(model: SwitchingGpdm) -> None:
    again = KINDS[model.name].load(StoredArrays("a file", model.to_arrays()))
    said = [each.predict(NEW.phones, 40, sound=NEW.sound) for each in (model, again)]
    assert said[0].dtype == np.float32
    assert np.array_equal(*said)


def test_the_same_seed_gives_the_same_model(spoken: list[Spoken]) -> None:
    one, other = (fit("phone-gpdm", spoken, REST, fps=FPS, seed=3).to_arrays() for _ in range(2))
    assert one.keys() == other.keys()
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_threads_say_the_same(model: SwitchingGpdm) -> None:
    cold = KINDS[model.name].load(StoredArrays("a file", model.to_arrays()))
    expected = model.predict(NEW.phones, 40, sound=NEW.sound)
    with ThreadPoolExecutor(4) as threads:
        said = list(threads.map(lambda _: cold.predict(NEW.phones, 40, sound=NEW.sound), range(4)))
    assert all(np.array_equal(each, expected) for each in said)


def test_what_was_before_goes_on_without_a_jump(model: SwitchingGpdm) -> None:
    whole = model.predict(NEW.phones, 40, sound=NEW.sound)
    before = np.tile(np.float32([6, 6, 6]), (8, 1))
    rows = model.predict(NEW.phones, 40, sound=NEW.sound, before=before)
    assert np.linalg.norm(rows[0] - before[-1]) < 0.35 * np.linalg.norm(whole[0] - before[-1])
    np.testing.assert_allclose(rows[-5:], whole[-5:], atol=0.5)


@pytest.mark.parametrize(("asked", "known"), [("P", "B"), ("Z", "S"), ("AE", "AA")])
def test_phones_that_were_never_seen_look_like_others(model: SwitchingGpdm, asked: str, known: str) -> None:
    unseen, seen = (model.predict([Phone("SIL", 0, 0.2), Phone(each, 0.2, 1)], 20) for each in (asked, known))
    assert np.array_equal(unseen, seen)


def test_any_length_is_said(model: SwitchingGpdm) -> None:
    assert model.predict(NEW.phones, 0).shape == (0, 3)
    assert model.predict(NEW.phones, 1, sound=NEW.sound).shape == (1, 3)
    assert model.predict((), 30).shape == (30, 3)
    assert np.isfinite(model.predict(NEW.phones, 200, sound=NEW.sound)).all()


def test_too_little_speech_is_refused(spoken: list[Spoken]) -> None:
    with pytest.raises(TrainingFailed, match="too little"):
        fit("vlmm-gpdm", spoken[:3], REST, fps=FPS)


@pytest.mark.parametrize(
    "change",
    [
        {"tokens": np.array(["AA", "B", "S"])},
        {"state_frames": np.array([1, 2])},
        {"kernels": -1},
        {"rows": 10**6},
        {"begins": 0},
        {"gain": np.zeros((2, 9))},
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(model: SwitchingGpdm, change: dict[str, object]) -> None:
    arrays = model.to_arrays()
    for name, value in change.items():
        arrays[name] = value if isinstance(value, np.ndarray) else np.full_like(arrays[name], value)
    with pytest.raises(BadPack):
        KINDS[model.name].load(StoredArrays("a file", arrays))


def test_an_automaton_that_is_none_is_refused(models: dict[str, SwitchingGpdm]) -> None:
    arrays = models["vlmm-gpdm"].to_arrays()
    contexts = arrays["contexts"].copy()
    contexts[-1] = "AA AA AA AA AA AA AA AA AA"
    with pytest.raises(BadPack, match="automaton"):
        KINDS["vlmm-gpdm"].load(StoredArrays("a file", arrays | {"contexts": contexts}))
