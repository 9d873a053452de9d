"""An avatar driven by hand: sound in, pictures with sound out."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from puppet import BACKGROUND, OPEN, SIZE, TinyAvatar

from app.align.live_sound import LiveSound
from app.align.mock_recogniser import MockRecogniser
from app.errors import RecognitionFailed
from app.stream.clock import FRAME_SAMPLES
from app.stream.runner import AvatarFrame, AvatarRunner

ROOT = Path(__file__).resolve().parents[2]
RATE = 24_000


def tone(seconds: float) -> np.ndarray:
    return (0.3 * np.sin(2 * np.pi * 300 * np.arange(round(seconds * RATE)) / RATE)).astype(np.float32)


def runner(*, paced: bool = False) -> AvatarRunner:
    return AvatarRunner(TinyAvatar(), LiveSound(MockRecogniser(), RATE), paced=paced)


def mouth(frame: AvatarFrame) -> int:
    return int(frame.picture[0, 0])


async def test_all_that_is_pushed_comes_out_with_a_mouth() -> None:
    driven = runner()
    driven.push_audio(tone(1.0))
    driven.push_audio(np.zeros(RATE // 2, np.float32))
    driven.end()
    frames = [frame async for frame in driven]
    assert [frame.number for frame in frames] == list(range(len(frames)))
    assert all(frame.picture.shape == (SIZE * 3 // 2, SIZE) for frame in frames)
    assert all(frame.sound.shape == (FRAME_SAMPLES,) and frame.speaking for frame in frames)
    sound = np.concatenate([frame.sound for frame in frames])
    assert 1.5 * 48_000 <= len(sound) <= 1.9 * 48_000
    assert np.abs(sound[:48_000]).max() == pytest.approx(0.3, abs=0.02)
    assert not sound[round(1.05 * 48_000) :].any()
    assert max(map(mouth, frames[:25])) == OPEN
    assert {mouth(frame) for frame in frames[29:]} == {BACKGROUND}


async def test_paced_it_idles_until_it_has_something_to_say_and_after() -> None:
    driven = runner(paced=True)
    seen: list[AvatarFrame] = []
    async for frame in driven:
        seen.append(frame)
        if len(seen) == 5:
            driven.push_audio(tone(0.8))
            driven.flush()
        if len(seen) > 10 and not frame.speaking:
            driven.end()
    assert not any(frame.speaking for frame in seen[:5])
    assert not any(frame.sound.any() for frame in seen[:5])
    spoken = [frame for frame in seen if frame.speaking]
    assert 20 <= len(spoken) <= 40
    assert {int(frame.picture[SIZE - 1, 0]) for frame in seen[:5]} == {30, 34, 38, 42, 46}  # the loop goes on


async def test_interrupted_it_is_silent_and_closed_within_a_few_frames_and_goes_on() -> None:
    driven = runner(paced=True)
    driven.push_audio(tone(3.0))
    after: list[AvatarFrame] = []
    spoken = 0
    async for frame in driven:
        if spoken < 12:
            spoken += frame.speaking
            if spoken == 12:
                driven.interrupt()
            continue
        after.append(frame)
        if len(after) == 12:
            driven.push_audio(tone(0.5))
            driven.end()
    assert not np.concatenate([frame.sound for frame in after[1:12]]).any()
    assert {mouth(frame) for frame in after[4:12]} == {BACKGROUND}
    later = np.concatenate([frame.sound for frame in after[12:]])
    assert np.count_nonzero(np.abs(later) > 0.01) > 0.4 * 48_000
    assert np.count_nonzero(np.abs(later) > 0.01) < 0.6 * 48_000  # nothing of what was interrupted


async def test_leaving_the_iteration_ends_its_thread_and_the_feed() -> None:
    driven = runner(paced=True)
    frames = aiter(driven)
    await anext(frames)
    await frames.aclose()  # type: ignore[attr-defined]
    with pytest.raises(Exception, match="has ended"):
        driven.push_audio(tone(0.1))


async def test_what_fails_is_told() -> None:
    class Broken(MockRecogniser):
        def hear(self, samples: np.ndarray) -> list:  # noqa: ARG002
            raise RecognitionFailed("recogniser broken: no")

    driven = AvatarRunner(TinyAvatar(), LiveSound(Broken(), RATE), paced=False)
    driven.push_audio(tone(1.0))
    with pytest.raises(RecognitionFailed):
        async for _ in driven:
            pass


async def test_the_example_of_the_documentation_works(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    text = (ROOT / "docs" / "streaming.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?AvatarRunner.*?)^```$", text, re.M | re.S)
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    exec(compile(code, "docs/streaming.md", "exec"), names)
    await names["main"]()  # type: ignore[operator]
    assert re.fullmatch(r"\d+ pictures of 512x512, \d\.\d s of sound\n", capsys.readouterr().out)
