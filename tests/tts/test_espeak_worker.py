from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from app.worker import Worker, WorkerFailed

pytest.importorskip("espeakng_loader", reason="espeak-ng is not installed: pip install 'mary[espeak]'")


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    worker = Worker("app.tts.espeak_worker")
    yield worker
    worker.close()


def speak(worker: Worker, text: str, voice: str = "en-us", mnemonics: bool = False) -> tuple[dict[str, list], bytes]:
    question = {"task": "speak", "text": text, "voice": voice, "pace": 175, "mnemonics": mnemonics}
    return worker.ask(question, seconds=30)


def test_sound_and_events(worker: Worker) -> None:
    answer, sound = speak(worker, "Hello, é world.")
    samples = np.frombuffer(sound, np.int16)
    assert answer["rate"] == 22_050
    assert [at for kind, at, _ in answer["events"] if kind == "word"] == [0, 7, 9]
    starts = [sample for _, _, sample in answer["events"]]
    assert all(before <= after for before, after in pairwise(starts))
    assert 0 <= starts[0] < starts[-1] <= len(samples)
    assert "ˈɜː" in [ipa for kind, ipa, _ in answer["events"] if kind == "phone"]


def test_mnemonics_only_when_asked(worker: Worker) -> None:
    def heard(mnemonics: bool) -> str:
        events = speak(worker, "[[t'u:]]", mnemonics=mnemonics)[0]["events"]
        return "".join(what for kind, what, _ in events if kind == "phone")

    assert heard(True) == "tˈuː"
    assert len(heard(False)) > 4


def test_ipa(worker: Worker) -> None:
    texts = ["of the world", "the", "Stop. Go!", "", "...", "Weltschmerz"]
    answer, _ = worker.ask({"task": "ipa", "voice": "en-us", "texts": texts}, seconds=30)
    assert answer[:5] == ["ʌvðə wˈɜːld", "ðə", "stˈɑːp ɡˈoʊ", "", ""]
    assert "(" not in answer[5]


def test_voices(worker: Worker) -> None:
    answer, _ = worker.ask({"task": "voices"}, seconds=30)
    assert ["gmw/en-US", "English (America)", "en-us", "male"] in answer
    assert ["!v/f2", "female2", "variant", "female"] in answer


def test_what_it_cannot_do(worker: Worker) -> None:
    speak(worker, "Hello.")
    with pytest.raises(WorkerFailed, match="no voice 'nobody'"):
        speak(worker, "Hello.", voice="nobody")
    with pytest.raises(WorkerFailed, match="no task 'sing'"):
        worker.ask({"task": "sing"}, seconds=30)
    assert speak(worker, "Hello.")[1]
