"""What hears recordings and live sound: the aligner and the recogniser of the settings, made when first needed."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import BinaryIO

from app.align import recognisers, registry
from app.align.aligners import Aligners
from app.align.dictionary import read_lexicon
from app.align.listen import Listened, align_recording, recognise_recording
from app.align.live_sound import LiveSound
from app.align.recogniser import Recogniser
from app.align.sound_file import read_sound
from app.api.threads import in_thread
from app.api.turns import Turns
from app.config import Settings
from app.errors import ConfigError
from app.stream.seats import Seats

LISTENED_WAITING = 8
"""Recordings that may wait to be listened to; one more is told to come back later."""


class Listening:
    """Recordings are listened to one at a time. Nothing is loaded before it is needed.

    Args:
        settings: of the whole service.
        aligners: to be closed by whoever made them.

    Attributes:
        live_seats: for sounds that are listened to while they are made; each takes a quarter of a core.
    """

    def __init__(self, settings: Settings, aligners: Aligners) -> None:
        self._settings = settings
        self._aligners = aligners
        self._turns = Turns(1, LISTENED_WAITING)
        self.live_seats = Seats(settings.limits.live_sounds, "live sounds")
        self._lock = threading.Lock()
        self._recogniser: Recogniser | None = None

    def check(self) -> None:
        """Refuse settings that name an aligner or a recogniser that is not there.

        Raises:
            ConfigError: names the setting and what is known.
        """
        chosen = self._settings.align
        for field, name, names in (
            ("align.engine", chosen.engine, registry.names),
            ("align.recogniser", chosen.recogniser, recognisers.names),
        ):
            known = names()
            if name not in known:
                raise ConfigError(f"{field}: there is no {name!r}", field=field, advice=f"Known: {', '.join(known)}.")

    async def recording(self, file: BinaryIO, text: str, *, strict: bool, lexicon: Mapping[str, str]) -> Listened:
        """A recording as speech.

        Args:
            file: any sound file.
            text: what is said in it, all of it; empty if that is not known.
            strict: refuse a text that is probably not what is said.
            lexicon: word to ARPAbet, before the service's own.

        Raises:
            InputError, TooLong: see `app.align.sound_file.read_sound` and `app.align.listen.align_recording`.
            NothingToSay: the text has no word that sounds.
            AlignmentFailed, RecognitionFailed: what listens failed.
            MissingExtra: its library is not installed.
            OverCapacity: too many are waiting.
        """

        own = read_lexicon({**self._settings.speech.lexicon, **lexicon})

        def listen() -> Listened:
            samples, rate = read_sound(file, longest=self._settings.limits.audio_seconds, name="the recording")
            if text.strip():
                aligner = self._aligners.get(self._settings.align.engine)
                return align_recording(samples, rate, text, aligner, strict=strict, lexicon=own)
            return recognise_recording(samples, rate, self._made_recogniser())

        async with self._turns:
            return await in_thread(listen)

    async def live(self, rate: int, transcript: str = "") -> LiveSound:
        """Live sound to push to; its `speeches` are those of a `Script`.

        Args:
            rate: samples a second.
            transcript: what will be said, whole, if it is known.

        Raises:
            InputError: no such rate.
            NothingToSay: a transcript without a word that sounds.
            RecognitionFailed, MissingExtra: what hears cannot be loaded.
        """

        def make() -> LiveSound:
            recogniser = self._made_recogniser()
            recogniser.warm_up()
            limit = self._settings.limits.live_audio_seconds
            return LiveSound(recogniser, rate, transcript=transcript, limit=limit)

        return await in_thread(make)

    def _made_recogniser(self) -> Recogniser:
        with self._lock:
            if self._recogniser is None:
                self._recogniser = recognisers.create(self._settings.align.recogniser)
            return self._recogniser
