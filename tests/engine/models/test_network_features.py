from __future__ import annotations

import numpy as np
import pytest
import soxr

from app.engine.models.network_features import (
    AFTER,
    BEFORE,
    HEARD_LOOK,
    LOOK,
    PHONE_FEATURES,
    SOUND_FEATURES,
    Hearing,
    learn_hearing,
    phone_features,
)
from app.engine.models.sound import Sound
from app.speech import PHONES, SILENCE, Phone

FPS = 25.0
SAID = [Phone(SILENCE, 0, 0.4), Phone("B", 0.4, 0.5), Phone("AA", 0.5, 0.7), Phone("S", 0.7, 0.8), Phone("M", 0.8, 1.2)]


def voice(pitch: float, seed: int, *, seconds: float = 2.0, tilt: float = 1.0) -> Sound:
    """A buzz with a little noise, between pauses."""
    t = np.arange(int(seconds * 16_000)) / 16_000
    buzz = sum(np.sin(2 * np.pi * pitch * k * t) / k**tilt for k in range(1, 30))
    loud = (t > 0.4) & (t < seconds - 0.4)
    noise = np.random.default_rng(seed).standard_normal(len(t))
    return Sound((0.1 * buzz * loud + 0.002 * noise).astype(np.float32), 16_000)


@pytest.fixture(scope="module")
def hearing() -> Hearing:
    return learn_hearing([voice(110 + seed, seed) for seed in range(4)], [2.0] * 4)


def test_shares_of_the_frame_and_of_those_around_add_up() -> None:
    rows = phone_features(SAID, -5, 40, FPS, PHONES)
    assert rows.shape == (40, PHONE_FEATURES)
    assert rows.dtype == np.float32
    shares = rows[:, : (BEFORE + 1 + AFTER) * len(PHONES)].reshape(40, -1, len(PHONES))
    np.testing.assert_allclose(shares.sum(2), 1, atol=1e-5)
    at_12 = shares[17, BEFORE]  # 0.48 s, read from 0.48 to 0.52: half B, half AA
    assert at_12[PHONES.index("B")] == pytest.approx(0.5, abs=1e-5)
    assert at_12[PHONES.index("AA")] == pytest.approx(0.5, abs=1e-5)


def test_pieces_read_what_the_whole_reads(hearing: Hearing) -> None:
    whole = phone_features(SAID, 0, 30, FPS, PHONES)
    later = [Phone(each.symbol, each.start - 0.4, each.end - 0.4) for each in SAID]
    np.testing.assert_allclose(phone_features(later, 0, 20, FPS, PHONES), whole[10:], atol=1e-5)
    sound = voice(110, 9)
    heard = hearing.features(sound, 0, 30, FPS)
    assert heard.shape == (30, SOUND_FEATURES)
    np.testing.assert_allclose(hearing.features(sound.moved(0.4), 0, 20, FPS), heard[10:], atol=1e-4)


@pytest.mark.parametrize("frame", [3, 10, 17])
def test_nothing_later_than_the_look_ahead_is_read(hearing: Hearing, frame: int) -> None:
    known = frame / FPS + LOOK
    cut = [each for each in SAID if each.start <= known] + [Phone("F", 9.0, 9.1)]  # what comes later is another thing
    cut[-2] = Phone(cut[-2].symbol, cut[-2].start, max(cut[-2].end, known))
    whole = phone_features(SAID, frame, 1, FPS, PHONES)
    np.testing.assert_allclose(phone_features(cut, frame, 1, FPS, PHONES), whole, atol=1e-5)
    sound, known = voice(110, 9), frame / FPS + HEARD_LOOK
    expected = hearing.features(sound, frame, 1, FPS)
    until = Sound(sound.samples[: round(known * 16_000)], 16_000)
    np.testing.assert_allclose(hearing.features(until, frame, 1, FPS), expected, atol=1e-4)


def test_phones_that_were_never_seen_are_read_as_others() -> None:
    seen = [SILENCE, "B", "AA", "S"]
    unseen = [Phone(each.symbol.replace("M", "P"), each.start, each.end) for each in SAID]
    as_b = [Phone(each.symbol.replace("M", "B"), each.start, each.end) for each in SAID]
    assert np.array_equal(phone_features(unseen, 0, 30, FPS, seen), phone_features(as_b, 0, 30, FPS, seen))


def test_nothing_said_is_silence() -> None:
    silence = phone_features([Phone(SILENCE, 0, 5)], 0, 4, FPS, PHONES)
    assert np.array_equal(phone_features([], 0, 4, FPS, PHONES), silence)


def test_what_is_quieter_than_the_recording_sounds_like_its_pauses(hearing: Hearing) -> None:
    nothing = hearing.features(Sound(np.zeros(0, np.float32), 16_000), 0, 3, FPS)
    hum = hearing.features(Sound(np.full(8000, 1e-6, np.float32), 16_000), 0, 3, FPS)
    assert np.array_equal(nothing, hum)
    pause = np.tile((hearing.quiet - hearing.mean) / hearing.deviation, SOUND_FEATURES // 20)
    np.testing.assert_allclose(nothing[1], np.clip(pause, -4, 4), atol=1e-4)


def test_the_talker_is_told_from_others(hearing: Hearing) -> None:
    assert hearing.knows(voice(112, 20), 2.0)
    assert not hearing.knows(voice(260, 21, tilt=0.2), 2.0)
    assert not hearing.knows(Sound(np.zeros(32_000, np.float32), 16_000), 2.0)
    assert not hearing.knows(Sound(np.zeros(0, np.float32), 16_000), 2.0)


def test_only_the_part_that_is_spoken_tells_the_voice() -> None:
    """A sentence of a long take has the sound of the whole take."""
    other, own = voice(260, 21, tilt=0.2), [voice(110 + seed, seed) for seed in range(4)]
    around = [Sound(np.concatenate([other.samples, each.samples, other.samples]), 16_000, -2.0) for each in own]
    found, expected = learn_hearing(around, [2.0] * 4), learn_hearing(own, [2.0] * 4)
    assert found.distance(expected.voice) < found.limit < found.distance(learn_hearing([other], [2.0]).voice)
    assert found.knows(own[0], 2.0)


@pytest.mark.parametrize("rate", [8_000, 22_050, 48_000])
def test_any_rate_is_heard_alike(hearing: Hearing, rate: int) -> None:
    sound = voice(110, 9)
    again = Sound(soxr.resample(sound.samples, 16_000, rate), rate)
    a, b = hearing.features(again, 5, 30, FPS), hearing.features(sound, 5, 30, FPS)
    low = np.arange(SOUND_FEATURES) % 20 < 2  # what lies above 4 kHz is lost at the least rate
    assert np.abs(a[:, low] - b[:, low]).mean() < (1.0 if rate == 8_000 else 0.1)
