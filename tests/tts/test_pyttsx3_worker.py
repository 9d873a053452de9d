from pathlib import Path

import pytest

from app.align.sound_file import read_sound
from app.worker import Worker, WorkerFailed

pytest.importorskip("espeakng_loader", reason="espeak-ng is not installed: pip install 'mary[espeak]'")


def test_voices_and_files(tmp_path: Path) -> None:
    worker = Worker("app.tts.pyttsx3_worker")
    answer, _ = worker.ask({"task": "voices"}, seconds=30)
    assert answer["driver"] == "espeak"
    assert ["gmw/en-us", "English (America)", ["en-us"], "male"] in answer["voices"]
    path = tmp_path / "speech.wav"
    question = {"task": "speak", "text": "Hello.", "voice": "gmw/en-us", "speed": 1.0, "path": str(path)}
    for _ in range(2):
        assert worker.ask(question, seconds=30) == (True, b"")
        samples, rate = read_sound(path)
        assert 0.2 < len(samples) / rate < 2
        path.unlink()
    with pytest.raises(WorkerFailed, match="no task 'sing'"):
        worker.ask({"task": "sing"}, seconds=30)
    worker.close()
