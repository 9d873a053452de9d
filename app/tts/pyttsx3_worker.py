"""The process in which pyttsx3 runs: several threads hang it, and so may the system's speech behind it.

`app.tts.pyttsx3_voice` is the other end. The questions are ``{"task": name, ...}``:

- ``voices`` answers ``{"driver": module, "voices": [[id, name, [language, ...], sex], ...], "voice": the one set}``.
- ``speak`` with ``text``, ``voice``, ``speed`` and ``path`` writes a sound file there and answers true.

Without a speech system to drive every answer is null.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from typing import Any

from app.worker import serve


class _System:
    """pyttsx3's engine, made once."""

    def __init__(self) -> None:
        import pyttsx3

        self._engine = pyttsx3.init()
        self._driver = type(self._engine.proxy._driver).__module__.rpartition(".")[2]
        self._finished = threading.Event()
        self._engine.connect("finished-utterance", lambda **_: self._finished.set())
        self._pace = self._engine.getProperty("rate")  # words a minute

    def voices(self) -> dict[str, Any]:
        voices = [
            [voice.id, voice.name or voice.id, [_text(each) for each in voice.languages or []], _sex(voice.gender)]
            for voice in self._engine.getProperty("voices")
        ]
        return {"driver": self._driver, "voices": voices, "voice": self._engine.getProperty("voice") or ""}

    def speak(self, text: str, voice: str, speed: float, path: str) -> bool:
        self._finished.clear()
        self._engine.setProperty("voice", voice)
        self._engine.setProperty("rate", round(self._pace * speed))
        self._rest()
        self._engine.save_to_file(text, path)
        self._engine.runAndWait()
        if self._driver == "espeak":  # it returns while a thread of the library still speaks
            self._finished.wait()
        self._rest()
        return True

    def _rest(self) -> None:
        """Wait until espeak is idle: the driver cancels what goes on when it begins, and with it what it begins."""
        if self._driver == "espeak":
            from pyttsx3.drivers import _espeak

            while _espeak.IsPlaying():
                time.sleep(0.001)


def _text(language: Any) -> str:
    """Drivers give languages as text or as bytes with a priority in front."""
    text = language.decode("utf-8", "ignore") if isinstance(language, bytes) else str(language)
    return "".join(letter for letter in text if letter.isprintable())


def _sex(gender: Any) -> str:
    text = str(gender or "").lower()
    return next((sex for sex in ("female", "male") if sex in text), "")


def _prepare() -> bool:
    """Make espeak-ng loadable where pyttsx3 needs it; False if there is none."""
    if sys.platform in ("darwin", "win32"):  # they have speech of their own
        return True
    for name in ("libespeak-ng.so.1", "libespeak.so.1"):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    try:
        import espeakng_loader
    except ImportError:
        return False
    os.environ.setdefault("ESPEAK_DATA_PATH", espeakng_loader.get_data_path())
    ctypes.CDLL(espeakng_loader.get_library_path(), ctypes.RTLD_GLOBAL)  # pyttsx3 then finds it by its name
    return True


def main() -> None:
    """Answer questions until the input ends."""
    ready: list[_System | None] = []  # with the first question, so that a failure is its answer

    def answer(question: dict[str, Any], _: bytes) -> tuple[Any, bytes]:
        if not ready:
            ready.append(_System() if _prepare() else None)
        system = ready[0]
        if system is None:
            return None, b""
        match question["task"]:
            case "voices":
                return system.voices(), b""
            case "speak":
                return system.speak(question["text"], question["voice"], question["speed"], question["path"]), b""
            case task:
                raise ValueError(f"no task {task!r}")

    serve(answer)


if __name__ == "__main__":
    main()
