"""The kind as a whole, on a talker that was made up."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from app.engine.models.hmm import HmmKind
from app.engine.models.hmm_trajectory import HmmTrajectory
from app.engine.models.mfcc import RATE
from app.engine.models.model import Spoken, TrajectoryModel
from app.engine.models.registry import fit
from app.engine.models.sound import Sound
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack, TrainingFailed
from app.speech import SILENCE, Phone

FPS = 25
REST = np.array([2.0, -1.0], np.float32)
MOUTHS = {"AA": (6, 1), "IY": (3, -4), "B": (-2, -1), "S": (3, 3), "UW": (0, 5), SILENCE: (2, -1)}
TONES = {"AA": (700, 1200), "IY": (300, 2300), "B": (150, 400), "S": (5000, 6500), "UW": (320, 800)}
"""Hz: what each phone sounds like."""


def sentence(seed: int) -> Spoken:
    """Silence, eight phones, and silence; mouths go smoothly to what the phone and the next one ask for."""
    random = np.random.default_rng(seed)
    spoken = [str(random.choice(list(TONES))) for _ in range(8)]
    spoken = [symbol for at, symbol in enumerate(spoken) if at == 0 or spoken[at - 1] != symbol]
    ends = 0.4 + np.cumsum(random.uniform(0.08, 0.2, len(spoken)))
    edges = [0.0, 0.4, *np.round(ends, 3), round(float(ends[-1]) + 0.4, 3)]
    symbols = [SILENCE, *spoken, SILENCE]
    phones = tuple(Phone(symbol, a, b) for symbol, a, b in zip(symbols, edges[:-1], edges[1:], strict=True))
    fine = np.arange(0, edges[-1], 0.001)
    place = np.searchsorted(edges[1:], fine, side="right")
    target = np.array([MOUTHS[symbol] for symbol in symbols], float)
    target[1:-2, 1] += 0.3 * (target[2:-1, 0] - 2)  # the next phone pulls
    kernel = np.hanning(120) / np.hanning(120).sum()
    smooth = np.stack(
        [np.convolve(np.pad(column[place], 60, "edge"), kernel, "same")[60:-60] for column in target.T], 1
    )
    frames = int(edges[-1] * FPS)
    rows = smooth[np.arange(frames) * 40] + 0.05 * random.standard_normal((frames, 2))
    time = np.arange(int(edges[-1] * RATE)) / RATE
    sound = 1e-3 * random.standard_normal(len(time))
    for phone in phones[1:-1]:
        there = (time >= phone.start) & (time < phone.end)
        for hertz in TONES[phone.symbol]:
            sound[there] += 0.1 * np.sin(2 * np.pi * hertz * time[there])
    return Spoken(phones, rows.astype(np.float32), np.ones(frames, bool), Sound(sound.astype(np.float32), RATE))


@pytest.fixture(scope="module")
def spoken() -> list[Spoken]:
    return [sentence(seed) for seed in range(36)]


@pytest.fixture(scope="module")
def model(spoken: list[Spoken]) -> HmmTrajectory:
    found = fit("hmm", spoken, REST, fps=FPS)
    assert isinstance(found, HmmTrajectory)
    return found


UNHEARD = [sentence(seed) for seed in range(100, 108)]


def error(model: TrajectoryModel, *, sound: bool = False) -> float:
    """Mean squared, on sentences that no model has learnt from."""
    said = [
        model.predict(() if sound else each.phones, len(each.counted), sound=each.sound if sound else None)
        for each in UNHEARD
    ]
    return float(np.mean([((rows - each.coefficients) ** 2).mean() for rows, each in zip(said, UNHEARD, strict=True)]))


def test_it_knows_a_talker_far_better_than_the_mean_of_each_phone(spoken: list[Spoken], model: HmmTrajectory) -> None:
    assert error(model) < 0.4 * error(fit("phone-mean", spoken, REST, fps=FPS))


def test_from_the_sound_alone_it_is_nearly_as_good(spoken: list[Spoken], model: HmmTrajectory) -> None:
    assert model.inputs == {"phones", "sound"}
    assert error(model, sound=True) < 0.6 * error(fit("phone-mean", spoken, REST, fps=FPS))


@pytest.mark.parametrize("decibel", [-10, 10])
def test_how_loud_it_is_hardly_matters(model: HmmTrajectory, decibel: float) -> None:
    each = UNHEARD[0]
    assert each.sound is not None
    louder = Sound((each.sound.samples * 10 ** (decibel / 20)).astype(np.float32), RATE)
    rows, usual = (model.predict((), len(each.counted), sound=sound) for sound in (louder, each.sound))
    assert ((rows - usual) ** 2).mean() < 0.1 * (each.coefficients - REST).var()


def test_sound_does_not_matter_where_phones_are_known(model: HmmTrajectory) -> None:
    first, other = UNHEARD[:2]
    rows = model.predict(first.phones, 30, sound=other.sound)
    assert np.array_equal(rows, model.predict(first.phones, 30))


def test_the_clock_of_the_sound_is_that_of_the_frames(model: HmmTrajectory) -> None:
    each = UNHEARD[0]
    assert each.sound is not None
    whole = model.predict((), len(each.counted), sound=each.sound)
    later = model.predict((), len(each.counted) - 10, sound=each.sound.moved(10 / FPS))
    np.testing.assert_allclose(later[3:], whole[13:], atol=0.1)


def test_without_sound_it_is_trained_on_phones_alone(spoken: list[Spoken], model: HmmTrajectory) -> None:
    mute = [Spoken(each.phones, each.coefficients, each.counted) for each in spoken]
    found = fit("hmm", mute, REST, fps=FPS)
    assert found.inputs == {"phones"}
    assert "grammar" not in found.to_arrays()
    assert error(found) < 1.3 * error(model)


@pytest.mark.parametrize("sound", [None, Sound(np.zeros(0, np.float32), RATE), Sound(np.zeros(RATE, np.float32), RATE)])
def test_nothing_said_is_rest(model: HmmTrajectory, sound: Sound | None) -> None:
    np.testing.assert_allclose(model.predict((), 25, sound=sound), np.tile(REST, (25, 1)), atol=1e-5)


def test_long_silence_comes_to_rest_and_leaves_it_again(model: HmmTrajectory) -> None:
    phones = [Phone("AA", 0, 0.2), Phone(SILENCE, 0.2, 3.0), Phone(SILENCE, 3.0, 6.2), Phone("AA", 6.2, 6.4)]
    rows = model.predict(phones, 160)
    np.testing.assert_allclose(rows[40:120], np.tile(REST, (80, 1)), atol=0.02)
    assert min(abs(rows[2, 0] - REST[0]), abs(rows[157, 0] - REST[0])) > 1


@pytest.mark.parametrize("length", [1, 2, 3, 8])
def test_a_piece_goes_on_from_the_one_before(model: HmmTrajectory, length: int) -> None:
    """What is made in two pieces is nearly what is made in one, and without a jump even from a strange mouth."""
    phones, cut = UNHEARD[0].phones, 20
    whole = model.predict(phones, 40)
    moved = [Phone(phone.symbol, phone.start - cut / FPS, phone.end - cut / FPS) for phone in phones]
    later = model.predict(moved, 20, before=whole[cut - length : cut])
    np.testing.assert_allclose(later, whole[cut:], atol={1: 0.8, 2: 0.2}.get(length, 0.03))
    strange = np.tile(whole[cut] + 8, (length, 1)).astype(np.float32)
    joined = np.concatenate([strange[-1:], model.predict(moved, 20, before=strange)])
    free = model.predict(moved, 20)
    assert np.abs(joined[1] - joined[0]).max() < np.abs(free[0] - strange[-1]).max() - 0.5
    np.testing.assert_allclose(joined[10:], free[9:], atol=0.1)


def test_untrained_phones_look_like_trained_ones(model: HmmTrajectory) -> None:
    def shown(symbol: str) -> np.ndarray:
        return model.predict([Phone(SILENCE, 0, 0.2), Phone(symbol, 0.2, 0.4), Phone("AA", 0.4, 0.6)], 15)

    assert np.array_equal(shown("M"), shown("B"))
    assert not np.allclose(shown("M"), shown(SILENCE))


def test_no_frames_and_phones_without_length(model: HmmTrajectory) -> None:
    assert model.predict(UNHEARD[0].phones, 0).shape == (0, 2)
    rows = model.predict([Phone("AA", 0.1, 0.1), Phone("B", 0.1, 0.1), Phone("S", 0.1, 0.101)], 4)
    assert rows.shape == (4, 2)
    assert np.isfinite(rows).all()


def test_threads_get_the_same(model: HmmTrajectory) -> None:
    again = HmmKind().load(StoredArrays("a file", model.to_arrays()))
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda each: again.predict((), 30, sound=each.sound), UNHEARD))
    assert all(
        np.array_equal(rows, model.predict((), 30, sound=each.sound)) for rows, each in zip(found, UNHEARD, strict=True)
    )


def test_it_is_read_as_it_was_stored(model: HmmTrajectory) -> None:
    again = HmmKind().load(StoredArrays("a file", model.to_arrays()))
    for each in UNHEARD[:2]:
        assert np.array_equal(again.predict(each.phones, 30), model.predict(each.phones, 30))
        assert np.array_equal(again.predict((), 30, sound=each.sound), model.predict((), 30, sound=each.sound))
    assert np.array_equal(again.rest, REST)


def test_the_same_material_gives_the_same_arrays(spoken: list[Spoken], model: HmmTrajectory) -> None:
    first, second = model.to_arrays(), fit("hmm", spoken, REST, fps=FPS, seed=9).to_arrays()
    assert first.keys() == second.keys()
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_frames_that_do_not_count_are_not_learnt_from(spoken: list[Spoken]) -> None:
    def broken(value: float) -> TrajectoryModel:
        found = []
        for each in spoken:
            rows, counted = each.coefficients.copy(), each.counted.copy()
            rows[12:18], counted[12:18] = value, False
            found.append(Spoken(each.phones, rows, counted, each.sound))
        return fit("hmm", found, REST, fps=FPS)

    phones = UNHEARD[0].phones
    assert np.array_equal(broken(np.nan).predict(phones, 30), broken(1e6).predict(phones, 30))


def test_too_little_is_refused(spoken: list[Spoken]) -> None:
    with pytest.raises(TrainingFailed, match="which needs 10 s"):
        fit("hmm", spoken[:4], REST, fps=FPS)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("phones", lambda _: np.array(["AA", "B"])),
        ("phones", lambda a: a[::-1]),
        ("questions", lambda a: 1 - a),
        ("settings", lambda a: a * [0, 1, 1]),
        ("settings", lambda a: a + np.array([0, 0.5, 0])),
        ("scale", lambda a: -a),
        ("duration_variance", lambda a: 0 * a),
        ("rest", lambda a: a[:1]),
        ("grammar", lambda a: a[1:]),
        ("grammar", lambda a: a * np.nan),
    ],
)
def test_arrays_that_are_none_are_refused(model: HmmTrajectory, name: str, change) -> None:  # type: ignore[no-untyped-def]
    arrays = model.to_arrays()
    with pytest.raises(BadPack):
        HmmKind().load(StoredArrays("a file", arrays | {name: change(arrays[name])}))
