"""What was said in a recording, read from a file beside it, with times if the file has them.

| ending | what it is | times |
|---|---|---|
| ``.txt`` | plain text | none |
| ``.align`` | ``start end word`` a line, in 1/25,000 s, as the GRID corpus has it | words |
| ``.TextGrid`` | tiers ``words`` and ``phones`` of another aligner, or any one tier of text | words, phones |
| ``.vtt``, ``.srt`` | captions | captions |
"""

from __future__ import annotations

import codecs
import html
import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from app.align.aligner import Alignment, assemble
from app.align.phoneset import Sound, phones_of
from app.align.textgrid import Interval, Tier, parse
from app.errors import InputError
from app.speech import PHONES, SILENCE, Phone, Word

MOST_BYTES = 20_000_000
LEAST_ROLLING = 3  # pairs of captions: fewer may just say the same twice
GRID_RATE = 25_000  # ticks a second in .align files
TOUCHING = 0.002  # 2 ms: a phone that sticks out of its word by less, by rounding, is still part of it

_SILENCES = frozenset(["", "sil", "sp", "spn", "silence", "<sil>", "<p:>", "<eps>", "<unk>", "_", "#", "pau", "h#"])
_STRESS = re.compile(r"[012]$")
# How the Montreal Forced Aligner writes diphthongs; the rest of its letters are those of everybody.
_MFA: dict[str, tuple[str, ...]] = {
    "aj": ("AY",), "aw": ("AW",), "ej": ("EY",), "ow": ("OW",), "əw": ("OW",), "ɔj": ("OY",), "t̪": ("TH",),
    "d̪": ("DH",),
}  # fmt: skip
_CAPTION_TIME = re.compile(r"(?:(\d+):)?(\d{1,2}):(\d{2})[.,](\d{3})\s+-->\s+(?:(\d+):)?(\d{1,2}):(\d{2})[.,](\d{3})")
_BLANK = re.compile(r"\n[ \t]+\n(?=(?:[^\n]*\n)?[^\n]*-->)")  # an empty line with spaces; else a caption's first line
_TAG = re.compile(r"<[^<>]*>")


@dataclass(frozen=True, slots=True)
class Transcript:
    """What was said.

    Attributes:
        text: all of it, in order.
        words: with their times in seconds, if the file has them.
        phones: ARPAbet, gapless over the times that the file covers, silences included, if the file has them.
        captions: pieces of the text and when they are shown, if the file is one of captions. People speak about then,
            not exactly then.
    """

    text: str
    words: tuple[Word, ...] | None = None
    phones: tuple[Phone, ...] | None = None
    captions: tuple[Word, ...] | None = None

    def alignment(self, duration: float) -> Alignment:
        """The phones and words of the file as an alignment of a sound of this length (seconds), taken at its word.

        Raises:
            InputError: the file has no phones, or not one of them within the sound.
        """
        if self.phones is None:
            raise InputError("the transcript has no phone times", advice="Let an aligner find them.")
        words = self.words or ()
        sounds = [Sound(phone.symbol, phone.start, phone.end, _owner(phone, words)) for phone in self.phones]
        result = assemble(sounds, [word.text for word in words], duration)
        if all(phone.symbol == SILENCE for phone in result.phones):
            raise InputError(f"the transcript has no phone within the {duration:.2f} s of the sound")
        return result


def read_transcript(path: Path) -> Transcript:
    """Read a transcript; the kind is told by the ending of the name.

    Raises:
        InputError: the file is missing, too large, not text, of an unknown or broken format, or has no words; the
            message begins with its name.
    """
    parser = _PARSERS.get(path.suffix.lower())
    if parser is None:
        raise InputError(f"{path.name}: no kind of transcript", advice=f"Known: {', '.join(_PARSERS)}.")
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"more than {MOST_BYTES // 1_000_000} MB are no transcript")
        transcript = parser(decoded(path.read_bytes()))
        if not any(letter.isalnum() for letter in transcript.text):
            raise InputError("the transcript has no words")
    except OSError as error:
        raise InputError(f"{path.name}: {error.strerror or error}") from error
    except InputError as error:
        raise InputError(f"{path.name}: {error.message}", advice=error.advice) from error
    return transcript


def decoded(data: bytes) -> str:
    """Text in UTF-8 or, with a byte order mark, UTF-16; lines end with newline. Raises InputError if it is neither."""
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 at byte {error.start}", advice="Save it as UTF-8.") from error
    if "\0" in text:
        raise InputError("it has zero bytes: no text file")
    return text.replace("\r\n", "\n").replace("\r", "\n")


# --- the formats ------------------------------------------------------------------------------------------------------


def _plain(text: str) -> Transcript:
    return Transcript(text.strip())


def _align(text: str) -> Transcript:
    words: list[Word] = []
    at = 0.0
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            first, last, word = line.split(maxsplit=2)
            start, end = int(first) / GRID_RATE, int(last) / GRID_RATE
        except ValueError:
            raise InputError(f"line {number}: expected “start end word”, found “{line.strip()[:40]}”") from None
        if start < at or end < start:
            raise InputError(f"line {number}: times go backwards")
        at = end
        if word.strip().lower() not in _SILENCES:
            words.append(Word(word.strip(), start, end))
    return Transcript(" ".join(word.text for word in words), tuple(words))


def _textgrid(text: str) -> Transcript:
    tiers = parse(text)
    phones = _tier(tiers, ("phones", "phone", "phonemes", "phoneme"))
    words = _tier(tiers, ("words", "word", "orthography"))
    if words is None:  # one tier of what is said, whatever its name
        others = [tier for tier in tiers if tier is not phones]
        if len(others) != 1:
            named = ", ".join(repr(tier.name) for tier in tiers) or "none"
            raise InputError("no tier is called “words”", advice=f"Its tiers: {named}.")
        said = " ".join(interval.label for interval in others[0].intervals if interval.label)
        return Transcript(said, None, _phones(phones) if phones else None)
    timed = tuple(
        Word(interval.label, interval.start, interval.end)
        for interval in words.intervals
        if interval.label.lower() not in _SILENCES
    )
    return Transcript(" ".join(word.text for word in timed), timed, _phones(phones) if phones else None)


def _captions(text: str) -> Transcript:
    shown: list[tuple[float, float, list[str]]] = []
    for block in re.split(r"\n\n+", _BLANK.sub("\n\n", text)):
        lines = block.strip().splitlines()
        timing = next((at for at, line in enumerate(lines[:2]) if "-->" in line), None)
        if timing is None:  # the header, a note, a style
            continue
        found = _CAPTION_TIME.match(lines[timing].strip())
        if found is None:
            raise InputError(f"“{lines[timing].strip()[:60]}” is no time of a caption")
        said = html.unescape(_TAG.sub("", "\n".join(lines[timing + 1 :])))
        written = [" ".join(line.split()) for line in said.splitlines() if line.strip()]
        if written:
            shown.append((_seconds(found.groups()[:4]), _seconds(found.groups()[4:]), written))
    captions = tuple(Word(" ".join(lines), start, end) for start, end, lines in _unrolled(shown) if lines)
    return Transcript(" ".join(caption.text for caption in captions), captions=captions)


def _unrolled(shown: Sequence[tuple[float, float, list[str]]]) -> list[tuple[float, float, list[str]]]:
    """Captions without the lines that stay from the one before, if they roll: automatic ones show each line twice."""
    stay = [_staying(before[2], after[2]) for before, after in pairwise(shown)]
    if len(stay) < LEAST_ROLLING or sum(map(bool, stay)) <= len(stay) / 2:
        return list(shown)
    return [(start, end, lines[count:]) for count, (start, end, lines) in zip([0, *stay], shown, strict=True)]


def _staying(before: Sequence[str], after: Sequence[str]) -> int:
    """How many lines at the end of one caption begin the next."""
    sizes = range(min(len(before), len(after)), 0, -1)
    return next((size for size in sizes if list(before[-size:]) == list(after[:size])), 0)


_PARSERS: dict[str, Callable[[str], Transcript]] = {
    ".txt": _plain,
    ".align": _align,
    ".textgrid": _textgrid,
    ".vtt": _captions,
    ".srt": _captions,
}


def _seconds(parts: Sequence[str | None]) -> float:
    hours, minutes, seconds, thousandths = (int(part or 0) for part in parts)
    return hours * 3600 + minutes * 60 + seconds + thousandths / 1000


# --- tiers ------------------------------------------------------------------------------------------------------------


def _tier(tiers: Sequence[Tier], names: Sequence[str]) -> Tier | None:
    """The tier of one of these names, also behind a speaker's (``anna - words``)."""
    for tier in tiers:
        if tier.name.lower().rpartition(" - ")[2].strip() in names:
            return tier
    return None


def _phones(tier: Tier) -> tuple[Phone, ...]:
    """The phones of a tier in ARPAbet; its labels are all ARPAbet (any case, with stress or without) or all IPA."""
    labels = {interval.label for interval in tier.intervals if interval.label.lower() not in _SILENCES}
    arpabet = all(_arpabet(label) in PHONES for label in labels)
    phones: list[Phone] = []
    at = 0.0
    for interval in tier.intervals:
        if interval.start > at:
            _append(phones, SILENCE, at, interval.start)
        at = max(at, interval.start)
        symbols = _symbols(interval, arpabet)
        edges = [at + (interval.end - at) * n / len(symbols) for n in range(len(symbols))] + [interval.end]
        for number, symbol in enumerate(symbols):
            _append(phones, symbol, edges[number], edges[number + 1])
        at = max(at, interval.end)
    return tuple(phones)


def _symbols(interval: Interval, arpabet: bool) -> tuple[str, ...]:
    label = interval.label
    if label.lower() in _SILENCES:
        return (SILENCE,)
    if arpabet:
        return (_arpabet(label),)
    return _MFA.get(label.replace("ː", "")) or phones_of(label) or (SILENCE,)


def _append(phones: list[Phone], symbol: str, start: float, end: float) -> None:
    if end <= start:
        return
    if symbol == SILENCE and phones and phones[-1].symbol == SILENCE:
        start = phones.pop().start
    phones.append(Phone(symbol, start, end))


def _arpabet(label: str) -> str:
    return _STRESS.sub("", label.upper())


def _owner(phone: Phone, words: Sequence[Word]) -> int:
    """The number of the word that a phone belongs to; -1: none."""
    number = bisect_right(words, phone.start + TOUCHING, key=lambda word: word.start) - 1
    return number if number >= 0 and phone.end <= words[number].end + TOUCHING else -1
