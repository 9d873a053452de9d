"""The speech engine of a service as the settings describe it: limited, timed, remembered, with another behind it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from app.align.aligners import Aligners
from app.align.registry import names as aligner_names
from app.config import AlignSettings, SpeechSettings
from app.errors import ConfigError, NotFound
from app.tts.engine import SpeechEngine
from app.tts.fallback import FallbackEngine
from app.tts.limit import Limit, LimitedEngine
from app.tts.registry import create, names
from app.tts.speech_cache import CachedEngine
from app.tts.timed import AUTO, NATIVE, TimedEngine, TimesCount


@dataclass(frozen=True, slots=True)
class EngineCounts:
    """Sentences of one engine.

    Attributes:
        engine: its name.
        times: where their phone times came from.
        remembered: those that had been spoken before.
        fallback: those that it spoke since another engine had failed.
    """

    engine: str
    times: TimesCount
    remembered: int
    fallback: int


@dataclass(frozen=True)
class Voicebox:
    """What `voicebox` makes.

    Attributes:
        engine: to speak with.
        timed: of each engine in it: the one of the settings, then its fallback if there is one.
        caches: likewise; none if nothing is remembered.
        fallback: what changes from one to the other, None if there is no other.
    """

    engine: SpeechEngine
    timed: tuple[TimedEngine, ...]
    caches: tuple[CachedEngine, ...]
    fallback: FallbackEngine | None

    def counts(self) -> tuple[EngineCounts, ...]:
        """Of each engine, in the order of `timed`."""
        hits = [cache.hits for cache in self.caches] or [0] * len(self.timed)
        spoken = (0, self.fallback.count if self.fallback else 0)
        return tuple(
            EngineCounts(each.name, each.count, remembered, instead)
            for each, remembered, instead in zip(self.timed, hits, spoken, strict=False)
        )


def voicebox(speech: SpeechSettings, align: AlignSettings, aligners: Aligners) -> Voicebox:
    """Make the engine of the settings.

    Args:
        speech, align: the settings.
        aligners: make the aligner, when it is first needed; to be closed by the caller, like the engine.

    Raises:
        ConfigError: an engine or aligner is unknown, or an option is wrong.
        MissingExtra: a library is not installed.
    """
    timed: list[TimedEngine] = []
    caches: list[CachedEngine] = []
    choice = align.engine if speech.aligner in (AUTO, NATIVE) else speech.aligner

    def one(name: str, field: str) -> SpeechEngine:
        limit = Limit(speech.seconds)
        try:
            made = create(name, speech.engines.get(name, {}))
        except NotFound as error:
            raise ConfigError(f"{field}: {error.message}", field=field, advice=error.advice) from error
        timed.append(TimedEngine(LimitedEngine(made, limit), speech.aligner, lambda: aligners.get(choice), limit))
        if not speech.cache_mb:
            return timed[-1]
        caches.append(CachedEngine(timed[-1], round(speech.cache_mb * 1e6)))
        return caches[-1]

    _refuse_unknown("speech.engines", speech.engines, names(), "engine")
    _refuse_unknown("align.aligners", align.aligners, aligner_names(), "aligner")
    if speech.aligner not in (AUTO, NATIVE, *aligner_names()):
        raise ConfigError(
            f"speech.aligner: there is no aligner {speech.aligner!r}",
            field="speech.aligner",
            advice=f"Known: {', '.join((AUTO, NATIVE, *aligner_names()))}.",
        )
    if speech.aligner != NATIVE and choice in aligner_names():
        aligners.get(choice)  # whose options may be wrong: better now than with the first sentence
    engine = one(speech.engine, "speech.engine")
    fallback = None
    if speech.fallback:
        engine = fallback = FallbackEngine(engine, one(speech.fallback, "speech.fallback"))
    return Voicebox(engine, tuple(timed), tuple(caches), fallback)


def _refuse_unknown(section: str, given: Iterable[str], known: Sequence[str], kind: str) -> None:
    for name in given:
        if name not in known:
            field = f"{section}.{name}"
            raise ConfigError(f"{field}: there is no such {kind}", field=field, advice=f"Known: {', '.join(known)}.")
