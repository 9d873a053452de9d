from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from test_network_features import voice

from app.engine.models.model import SeeingKind, Spoken
from app.engine.models.network import NetworkKind, NetworkTrajectory, awake, continued
from app.engine.models.network_training import Options
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack, TrainingFailed
from app.speech import SILENCE, Phone

FPS = 25.0
REST = np.array([0.5, -1.0, 0.0], np.float32)
MOUTHS = {SILENCE: REST, "AA": np.array([4, 0, 1]), "B": np.array([-2, 1, 0]), "S": np.array([1, 3, -2])}
SMALL = Options(hidden=24, members=2, least_steps=150, epochs=1, batch=4)


def said(seed: int) -> Spoken:
    """Phones of a random order, each with its own mouth, blurred over three frames; loud when the mouth is open."""
    random = np.random.default_rng(seed)
    symbols = [SILENCE, *random.choice(["AA", "B", "S"], 8), SILENCE]
    ends = np.cumsum([0.4, *random.uniform(0.08, 0.2, 8), 0.4])
    phones = tuple(Phone(str(s), float(a), float(b)) for s, a, b in zip(symbols, [0, *ends[:-1]], ends, strict=True))
    times = np.arange(int(ends[-1] * FPS)) / FPS
    shown = np.array([MOUTHS[next(p for p in phones if t < p.end).symbol] for t in times], np.float64)
    blurred = np.stack([np.convolve(np.pad(c, 1, "edge"), [0.25, 0.5, 0.25], "valid") for c in shown.T], 1)
    sound = voice(110 + seed % 16, seed, seconds=float(ends[-1]))
    gain = np.interp(np.arange(len(sound.samples)) / 16_000, times, 0.2 + np.maximum(blurred[:, 0], 0))
    return Spoken(
        phones, blurred.astype(np.float32), np.ones(len(times), bool),
        replace(sound, samples=(sound.samples * gain).astype(np.float32)),
    )  # fmt: skip


@pytest.fixture(scope="module")
def spoken() -> list[Spoken]:
    return [said(seed) for seed in range(16)]


def trained(spoken: list[Spoken], options: Options = SMALL, seed: int = 0) -> NetworkTrajectory:
    return NetworkKind(options).fit(spoken, REST, fps=FPS, seed=seed, progress=lambda _: None)


@pytest.fixture(scope="module")
def model(spoken: list[Spoken]) -> NetworkTrajectory:
    return trained(spoken)


def error(rows: np.ndarray, true: Spoken) -> float:
    return float(((rows - true.coefficients) ** 2).mean() / true.coefficients.var(0).mean())


@pytest.mark.parametrize(("reads", "most"), [("phones", 0.1), ("sound", 0.75), ("both", 0.1)])
def test_it_says_what_it_has_not_heard(model: NetworkTrajectory, reads: str, most: float) -> None:
    errors = []
    for seed in range(20, 24):
        new = said(seed)
        phones, sound = new.phones if reads != "sound" else (), new.sound if reads != "phones" else None
        errors.append(error(model.predict(phones, len(new.counted), sound=sound), new))
    assert np.mean(errors) < most


def test_the_own_voice_is_listened_to_and_others_are_not(model: NetworkTrajectory) -> None:
    new = said(30)
    frames = len(new.counted)
    mute = model.predict(new.phones, frames)
    stranger = voice(260, 5, seconds=frames / FPS, tilt=0.2)
    assert np.array_equal(model.predict(new.phones, frames, sound=stranger), mute)
    assert not np.array_equal(model.predict(new.phones, frames, sound=new.sound), mute)


def test_without_sound_it_speaks_from_phones(spoken: list[Spoken]) -> None:
    mute = trained([replace(each, sound=None) for each in spoken[:4]], replace(SMALL, members=1, least_steps=2))
    assert mute.inputs == {"phones"}
    assert set(mute.networks) == {"phones"}
    assert mute.predict((), 3, sound=spoken[0].sound).tolist() == [REST.tolist()] * 3


def test_the_same_seed_gives_the_same_model(spoken: list[Spoken]) -> None:
    few = replace(SMALL, least_steps=3)
    once, again, other = (trained(spoken[:4], few, seed).to_arrays() for seed in (1, 1, 2))
    assert once.keys() == again.keys()
    assert all(np.array_equal(once[name], again[name]) for name in once)
    assert not np.array_equal(once["network_phones"], other["network_phones"])


def test_pieces_are_near_the_whole(model: NetworkTrajectory) -> None:
    new = said(31)
    whole = model.predict(new.phones, len(new.counted))
    at = 17
    later = [Phone(each.symbol, each.start - at / FPS, each.end - at / FPS) for each in new.phones]
    rest_of_it = model.predict(later, len(whole) - at, before=whole[at - 8 : at])
    np.testing.assert_allclose(rest_of_it, whole[at:], atol=1e-3)


@pytest.mark.parametrize("count", [1, 2, 8])
def test_it_goes_on_from_where_the_mouth_is(model: NetworkTrajectory, count: int) -> None:
    before = np.tile(np.array([6.0, 6.0, 6.0], np.float32), (count, 1))
    phones = [Phone(SILENCE, 0, 1), Phone("AA", 1, 2)]
    joined, alone = model.predict(phones, 30, before=before), model.predict(phones, 30)
    steps = np.abs(np.diff(np.concatenate([before[-1:], joined]), axis=0)).max(1)
    assert steps[0] < 0.25 * np.abs(alone[0] - before[-1]).max()
    np.testing.assert_allclose(joined[4:], alone[4:], atol=1e-5)


def test_what_goes_on_overshoots_neither() -> None:
    joined = continued(np.zeros((10, 3), np.float32), np.array([[5, -9, 1], [1, 1, 1]], np.float32))
    assert joined.min() >= 0
    assert joined.max() <= 1


def test_long_silence_is_exactly_at_rest(model: NetworkTrajectory) -> None:
    rows = model.predict([Phone(SILENCE, 0, 2), Phone("AA", 2, 3)], 75)
    assert np.array_equal(rows[:20], np.tile(REST, (20, 1)))
    assert np.array_equal(model.predict([], 4), np.tile(REST, (4, 1)))
    assert awake([Phone("AA", 0, 1)], 60, 5, FPS).tolist() == [1] * 5  # it goes on


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_few_frames(model: NetworkTrajectory, frames: int) -> None:
    for phones in ((), (Phone("AA", 0, 0.01),), (Phone("ZH", 0, 1),)):
        rows = model.predict(phones, frames, before=REST[None], sound=voice(110, 1))
        assert rows.shape == (frames, 3)
        assert rows.dtype == np.float32
        assert np.isfinite(rows).all()


def test_threads_may_share_it(model: NetworkTrajectory) -> None:
    new = said(32)
    expected = model.predict(new.phones, 40, sound=new.sound)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: model.predict(new.phones, 40, sound=new.sound), range(20)))
    assert all(np.array_equal(each, expected) for each in found)


def test_it_is_read_as_it_was_stored(model: NetworkTrajectory) -> None:
    assert isinstance(NetworkKind(), SeeingKind)
    again = NetworkKind().load(StoredArrays("a file", model.to_arrays()))
    new = said(33)
    for phones, sound in ((new.phones, None), (new.phones, new.sound), ((), new.sound)):
        expected = model.predict(phones, 30, sound=sound)
        np.testing.assert_allclose(again.predict(phones, 30, sound=sound), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"phones": np.array(["AA", "B"])}, "ARPAbet"),
        ({"fps": np.array([0.0])}, "frames a second"),
        ({"rest": np.zeros(4)}, "do not go with"),
        ({"network_phones": np.zeros(9)}, "row of bytes"),
        ({"network_phones": np.zeros(9, np.uint8)}, "cannot be used"),
        ({"hearing": np.zeros((5, 20))}, "deviations"),
        ({"hearing": np.zeros((4, 20))}, "shape"),
        ({"share": np.array([1.5])}, "do not go with"),
        ({"gaussian_state_mean": np.zeros((1, 3))}, "shape"),
        ({"hearing_limit": np.array([np.nan])}, "finite"),
    ],
)
def test_what_is_not_what_it_should_be_is_refused(
    model: NetworkTrajectory, changed: dict[str, np.ndarray], told: str
) -> None:
    with pytest.raises(BadPack, match=told):
        NetworkKind().load(StoredArrays("a file", model.to_arrays() | changed))


def test_the_network_of_another_input_is_refused(model: NetworkTrajectory) -> None:
    arrays = model.to_arrays()
    with pytest.raises(BadPack, match="reads sound cannot be used"):
        NetworkKind().load(StoredArrays("a file", arrays | {"network_sound": arrays["network_phones"]}))


def test_silence_alone_teaches_nothing() -> None:
    quiet = Spoken((Phone(SILENCE, 0, 1),), np.zeros((25, 3), np.float32), np.ones(25, bool))
    with pytest.raises(TrainingFailed, match="nothing is said"):
        trained([quiet])
