"""The process in which espeak-ng runs: it has one global state, and a crash of its C code must end nothing else.

`app.tts.espeak_process` is the other end. The questions are ``{"task": name, ...}``:

- ``voices`` answers ``[[identifier, name, language, sex], ...]``, all languages, then variants (language "variant").
- ``speak`` with ``text``, ``voice``, ``pace`` (words a minute) and ``mnemonics`` (whether ``[[...]]`` in the text is
  phonemes) answers ``{"rate": samples a second, "events": [...]}`` with the samples (int16) as bytes. An event is
  ``["word", position in the text from 0, sample]`` or ``["phone", IPA or "" for a pause, sample]``.
- ``ipa`` with ``voice`` and ``texts`` answers the IPA of each, words divided by spaces.

Without the library every answer is null.
"""

from __future__ import annotations

import ctypes
import re
import sys
from typing import Any

from app.worker import serve

# Constants of espeak-ng/speak_lib.h.
_OUTPUT_SYNCHRONOUS = 2
_PHONEME_EVENTS, _PHONEME_IPA, _DONT_EXIT = 0x0001, 0x0002, 0x8000
_WORD, _PHONEME = 1, 7
_POSITION_CHARACTER = 1
_CHARACTERS_UTF8, _PHONEMES = 0x0001, 0x0100
_RATE = 1  # parameter: words a minute
_MODE_IPA = 2
_SEXES = ("", "male", "female", "")
_NAMES = {"darwin": "libespeak-ng.1.dylib", "win32": "libespeak-ng.dll"}
_LANGUAGE_SWITCH = re.compile(r"\([^)]*\)")  # "(fr)" before a word that is read as French


class _Name(ctypes.Union):
    _fields_ = (("number", ctypes.c_int), ("name", ctypes.c_char_p), ("string", ctypes.c_char * 8))


class _Event(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("unique_identifier", ctypes.c_uint),
        ("text_position", ctypes.c_int),
        ("length", ctypes.c_int),
        ("audio_position", ctypes.c_int),
        ("sample", ctypes.c_int),
        ("user_data", ctypes.c_void_p),
        ("id", _Name),
    )


class _Voice(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("languages", ctypes.c_char_p),
        ("identifier", ctypes.c_char_p),
        ("gender", ctypes.c_ubyte),
        ("age", ctypes.c_ubyte),
        ("variant", ctypes.c_ubyte),
        ("reserved", ctypes.c_ubyte),
        ("score", ctypes.c_int),
        ("spare", ctypes.c_void_p),
    )


_Callback = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event))


class _Espeak:
    """The library, set up once."""

    def __init__(self, path: str, data: str | None) -> None:
        self._library = library = ctypes.CDLL(path)
        library.espeak_Synth.argtypes = [
            ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint, ctypes.c_int, ctypes.c_uint, ctypes.c_uint,
            ctypes.c_void_p, ctypes.c_void_p,
        ]  # fmt: skip
        library.espeak_ListVoices.restype = ctypes.POINTER(ctypes.POINTER(_Voice))
        library.espeak_TextToPhonemes.restype = ctypes.c_char_p
        library.espeak_TextToPhonemes.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int]
        options = _PHONEME_EVENTS | _PHONEME_IPA | _DONT_EXIT
        self._rate = library.espeak_Initialize(_OUTPUT_SYNCHRONOUS, 0, data.encode() if data else None, options)
        if self._rate <= 0:
            raise RuntimeError(f"espeak-ng cannot read its data (espeak_Initialize: {self._rate})")
        self._sound = bytearray()
        self._events: list[list[Any]] = []
        self._callback = _Callback(self._heard)  # kept: the library calls it as long as it lives
        library.espeak_SetSynthCallback(self._callback)

    def voices(self) -> list[list[str]]:
        variants = _Voice(languages=b"variant")
        return [*self._listed(None), *self._listed(ctypes.byref(variants))]

    def speak(self, text: str, voice: str, pace: int, mnemonics: bool) -> tuple[dict[str, Any], bytes]:
        self._choose(voice)
        self._library.espeak_SetParameter(_RATE, pace, 0)
        self._sound.clear()
        self._events = []
        flags = _CHARACTERS_UTF8 | (_PHONEMES if mnemonics else 0)
        encoded = _encoded(text)
        failed = self._library.espeak_Synth(encoded, len(encoded), 0, _POSITION_CHARACTER, 0, flags, None, None)
        if failed:
            raise RuntimeError(f"espeak_Synth failed: {failed}")
        self._library.espeak_Synchronize()
        return {"rate": self._rate, "events": self._events}, bytes(self._sound)

    def ipa(self, voice: str, texts: list[str]) -> list[str]:
        self._choose(voice)
        return [self._ipa(text) for text in texts]

    def _ipa(self, text: str) -> str:
        text_buffer = ctypes.create_string_buffer(_encoded(text))
        rest = ctypes.c_void_p(ctypes.addressof(text_buffer))
        clauses: list[str] = []
        while rest.value:  # one clause each time
            found = self._library.espeak_TextToPhonemes(ctypes.byref(rest), _CHARACTERS_UTF8, _MODE_IPA)
            clauses.append(_LANGUAGE_SWITCH.sub("", (found or b"").decode("utf-8", "ignore")))
        return " ".join(" ".join(clauses).split())

    def _choose(self, voice: str) -> None:
        if self._library.espeak_SetVoiceByName(voice.encode()):
            raise LookupError(f"espeak-ng has no voice {voice!r}")

    def _listed(self, like: Any) -> list[list[str]]:
        voices = self._library.espeak_ListVoices(like)
        listed: list[list[str]] = []
        while voices[len(listed)]:
            voice = voices[len(listed)].contents
            language = voice.languages[1:]  # after a byte of priority
            texts = [part.decode("utf-8", "replace") for part in (voice.identifier, voice.name, language)]
            listed.append([*texts, _SEXES[voice.gender & 3]])
        return listed

    def _heard(self, wave: Any, count: int, events: Any) -> int:
        if wave and count > 0:
            self._sound += ctypes.string_at(wave, count * ctypes.sizeof(ctypes.c_short))
        at = 0
        while events[at].type:
            event = events[at]
            at += 1
            if event.type == _WORD:
                self._events.append(["word", event.text_position - 1, event.sample])
            elif event.type == _PHONEME:
                self._events.append(["phone", event.id.string.decode("utf-8", "ignore"), event.sample])
        return 0


def _encoded(text: str) -> bytes:
    """UTF-8 with a zero at the end and none inside."""
    return text.replace("\0", " ").encode("utf-8", "replace") + b"\0"


def _load() -> _Espeak | None:
    try:
        import espeakng_loader
    except ImportError:
        name = _NAMES.get(sys.platform, "libespeak-ng.so.1")
        try:
            ctypes.CDLL(name)
        except OSError:
            return None
        return _Espeak(name, None)
    return _Espeak(espeakng_loader.get_library_path(), espeakng_loader.get_data_path())


def main() -> None:
    """Answer questions until the input ends."""
    loaded: list[_Espeak | None] = []  # with the first question, so that a failure is its answer

    def answer(question: dict[str, Any], _: bytes) -> tuple[Any, bytes]:
        if not loaded:
            loaded.append(_load())
        espeak = loaded[0]
        if espeak is None:
            return None, b""
        match question["task"]:
            case "voices":
                return espeak.voices(), b""
            case "speak":
                return espeak.speak(question["text"], question["voice"], question["pace"], question["mnemonics"])
            case "ipa":
                return espeak.ipa(question["voice"], question["texts"]), b""
            case task:
                raise ValueError(f"no task {task!r}")

    serve(answer)


if __name__ == "__main__":
    main()
