"""Reads SSML 1.1, the part of it that docs/speech.md lists, into a flat list of what is to be said and done.

Python's own expat does the parsing. It refuses here what makes XML dangerous: a document type, so there are no entities
of the document's own and none from outside. (defusedxml would be a further dependency that does the same.) Depth and
size are bounded. Whatever is wrong is an InputError that names line and column.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import NoReturn
from xml.parsers import expat

from app.align.dictionary import Pronunciation
from app.align.phoneset import phones_of, unknown
from app.errors import InputError, TooLong
from app.speech import PHONES, SILENCE
from app.tts.reading.say_as import KINDS, say_as
from app.tts.xml_complaint import complaint

MOST_CHARACTERS = 200_000
DEEPEST = 32
LONGEST_BREAK = 10.0  # seconds
MOST_SILENCE = 30.0  # seconds of breaks one after the other
LONGEST_SPECIAL = 200  # characters in one say-as, sub or phoneme
RATES = {"x-slow": 0.5, "slow": 0.75, "medium": 1.0, "default": 1.0, "fast": 1.25, "x-fast": 1.5}
VOLUMES = {
    "silent": -math.inf,
    "x-soft": -12.0,
    "soft": -6.0,
    "medium": 0.0,
    "default": 0.0,
    "loud": 4.0,
    "x-loud": 8.0,
}
STRENGTHS = {"none": 0.0, "x-weak": 0.06, "weak": 0.12, "medium": 0.3, "strong": 0.55, "x-strong": 1.0}

_SPACE = "http://www.w3.org/2001/10/synthesis"
_ATTRIBUTES: dict[str, frozenset[str]] = {
    "speak": frozenset(["version", "xml:lang", "xmlns", "xmlns:xsi", "xsi:schemaLocation", "xml:base"]),
    "p": frozenset(["xml:lang"]),
    "s": frozenset(["xml:lang"]),
    "break": frozenset(["time", "strength"]),
    "prosody": frozenset(["rate", "volume"]),
    "say-as": frozenset(["interpret-as", "format"]),
    "phoneme": frozenset(["alphabet", "ph"]),
    "sub": frozenset(["alias"]),
    "mark": frozenset(["name"]),
}
_SPECIAL = frozenset(["say-as", "phoneme", "sub"])
_EMPTY = frozenset(["break", "mark"])
_MAY_HOLD: dict[str, frozenset[str]] = {
    "speak": frozenset(_ATTRIBUTES) - {"speak"},
    "p": frozenset(_ATTRIBUTES) - {"speak", "p"},
    "s": frozenset(_ATTRIBUTES) - {"speak", "p", "s"},
    "prosody": frozenset(_ATTRIBUTES) - {"speak"},
}
_SURROGATE = re.compile("[\ud800-\udfff]")
_TIME = re.compile(r"\+?([0-9]{0,6}(?:\.[0-9]{1,6})?)(ms|s)\Z")
_PERCENT = re.compile(r"([+-]?)([0-9]{1,5}(?:\.[0-9]{1,6})?)%\Z")
_FACTOR = re.compile(r"[0-9]{0,5}(?:\.[0-9]{1,6})?\Z")
_DECIBELS = re.compile(r"([+-]?[0-9]{1,3}(?:\.[0-9]{1,6})?)dB\Z")


@dataclass(frozen=True, slots=True)
class Style:
    """How it is said: `speed` times as fast, `gain` decibels louder (minus infinity: silent)."""

    speed: float = 1.0
    gain: float = 0.0


@dataclass(frozen=True, slots=True)
class Said:
    """Text, in order.

    Attributes:
        text: as it is written.
        style: how.
        spoken: the words to say instead, if the document says so.
        alias: a text to read instead.
        phones: how it is pronounced, if the document says so.
        place: line and column, for messages.
    """

    text: str
    style: Style
    spoken: str = ""
    alias: str = ""
    phones: Pronunciation = ()
    place: str = ""

    @property
    def special(self) -> bool:
        return bool(self.spoken or self.alias or self.phones)


@dataclass(frozen=True, slots=True)
class Break:
    """Silence of so many seconds instead of the pause that the punctuation would make."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Bookmark:
    """A place with a name."""

    name: str


@dataclass(frozen=True, slots=True)
class Edge:
    """A sentence or a paragraph begins or ends."""

    paragraph: bool


Item = Said | Break | Bookmark | Edge


def parse(text: str) -> tuple[Item, ...]:
    """The items of a document, in order.

    Raises:
        InputError: it is not well-formed, or has what is not understood; names line and column.
        TooLong: over `MOST_CHARACTERS`.
    """
    if len(text) > MOST_CHARACTERS:
        raise TooLong(f"SSML may have {MOST_CHARACTERS:,} characters, not {len(text):,}", field="text")
    return _Reader().read(text)


@dataclass(slots=True)
class _Open:
    """An element that has not ended: its attributes, the style of its text, and the text itself where it counts."""

    name: str
    attributes: dict[str, str]
    style: Style
    place: str
    text: str = ""


class _Reader:
    """Expat's handlers."""

    def __init__(self) -> None:
        self._items: list[Item] = []
        self._open: list[_Open] = []
        self._silence = 0.0
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters
        self._parser.StartDoctypeDeclHandler = self._doctype
        self._parser.ProcessingInstructionHandler = self._instruction

    def read(self, text: str) -> tuple[Item, ...]:
        plain = (
            text.lstrip("\ufeff \t\r\n") if text.lstrip("\ufeff \t\r\n").startswith("<?xml") else text.lstrip("\ufeff")
        )
        try:
            self._parser.Parse(_SURROGATE.sub("\N{REPLACEMENT CHARACTER}", plain), True)
        except expat.ExpatError as error:
            what, advice = complaint(error, self._open[-1].name if self._open else "")
            raise _wrong(what, f"line {error.lineno}, column {error.offset + 1}", advice) from None
        return tuple(self._items)

    @property
    def _place(self) -> str:
        return f"line {self._parser.CurrentLineNumber}, column {self._parser.CurrentColumnNumber + 1}"

    def _refuse(self, what: str, advice: str = "") -> NoReturn:
        raise _wrong(what, self._place, advice)

    def _doctype(self, *_: object) -> None:
        self._refuse("a document type is not allowed, nor are entities of the document's own")

    def _instruction(self, target: str, _: str) -> None:
        self._refuse(f"the processing instruction {target[:40]!r} is not understood")

    def _start(self, full: str, attributes: dict[str, str]) -> None:
        name = full.removeprefix("ssml:")
        if not self._open and name != "speak":
            self._refuse(f"the outermost element must be speak, not {full[:40]}")
        if name not in _ATTRIBUTES:
            self._refuse(f"the element {full[:40]} is not understood", f"Known: {', '.join(sorted(_ATTRIBUTES))}.")
        if len(self._open) >= DEEPEST:
            self._refuse(f"elements may be {DEEPEST} deep")
        if self._open and name not in _MAY_HOLD.get(self._open[-1].name, frozenset()):
            self._refuse(f"{name} may not stand in {self._open[-1].name}")
        if name == "p" and any(element.name == "s" for element in self._open):
            self._refuse("p may not stand in s")
        if name in ("p", "s") and any(element.name == name for element in self._open):
            self._refuse(f"{name} may not stand in {name}")
        for attribute, value in attributes.items():
            known = attribute in _ATTRIBUTES[name] or (attribute == "xmlns:ssml" and name == "speak")
            if not known:
                self._refuse(f"the attribute {attribute[:40]} of {name} is not understood", _advice(name))
            if attribute == "xml:lang" and not value.lower().startswith("en"):
                self._refuse(f"the language {value[:20]!r} is not spoken, only English is")
            if attribute in ("xmlns", "xmlns:ssml") and value != _SPACE:
                self._refuse(f"the namespace {value[:60]!r} is not SSML's", f"It is {_SPACE}.")
        style = self._open[-1].style if self._open else Style()
        if name == "prosody":
            style = self._prosody(style, attributes)
        elif name in ("p", "s"):
            self._items.append(Edge(name == "p"))
        elif name == "break":
            self._break(attributes)
        elif name == "mark":
            if not attributes.get("name", "").strip():
                self._refuse("mark needs a name")
            if len(attributes["name"]) > 100:
                self._refuse("the name of a mark may have 100 characters")
            self._items.append(Bookmark(attributes["name"]))
        elif name in _SPECIAL:
            self._check_special(name, attributes)
        self._open.append(_Open(name, attributes, style, self._place))

    def _end(self, _: str) -> None:
        element = self._open.pop()
        if element.name in ("p", "s"):
            self._items.append(Edge(element.name == "p"))
        elif element.name in _SPECIAL:
            self._special(element)

    def _characters(self, text: str) -> None:
        element = self._open[-1]
        if element.name in _EMPTY:
            if text.strip():
                self._refuse(f"{element.name} must be empty")
        elif element.name in _SPECIAL:
            element.text += text
            if len(element.text) > LONGEST_SPECIAL:
                self._refuse(f"{element.name} may have {LONGEST_SPECIAL} characters")
        elif text:
            if text.strip():
                self._silence = 0.0
            self._items.append(Said(text, element.style, place=self._place))

    # --- the elements -------------------------------------------------------------------------------------------------

    def _break(self, attributes: dict[str, str]) -> None:
        strength = attributes.get("strength", "medium")
        if strength not in STRENGTHS:
            self._refuse(f"the strength {strength[:40]!r} of break is not known", f"Known: {', '.join(STRENGTHS)}.")
        seconds = STRENGTHS[strength]
        if "time" in attributes:
            found = _TIME.match(attributes["time"].strip())
            if not found or not found[1]:
                self._refuse(f"the time {attributes['time'][:40]!r} of break is none", "Write 500ms or 1.5s.")
            seconds = float(found[1]) / (1000 if found[2] == "ms" else 1)
            if seconds > LONGEST_BREAK:
                self._refuse(f"a break may last {LONGEST_BREAK:g} s, not {seconds:g} s")
        self._silence += seconds
        if self._silence > MOST_SILENCE:
            self._refuse(f"breaks one after the other may last {MOST_SILENCE:g} s")
        self._items.append(Break(seconds))

    def _prosody(self, outer: Style, attributes: dict[str, str]) -> Style:
        style = outer
        if "rate" in attributes:
            style = replace(style, speed=style.speed * self._rate(attributes["rate"].strip()))
        if "volume" in attributes:
            style = replace(style, gain=style.gain + self._volume(attributes["volume"].strip()))
        return style

    def _rate(self, written: str) -> float:
        if written in RATES:
            return RATES[written]
        factor = 0.0
        if found := _PERCENT.match(written):
            value = float(found[2]) / 100
            factor = {"+": 1 + value, "-": 1 - value, "": value}[found[1]]
        elif _FACTOR.match(written) and written:
            factor = float(written)
        if not factor > 0:
            self._refuse(
                f"the rate {written[:40]!r} of prosody is none", f"Write 80%, +10%, 1.2 or one of {', '.join(RATES)}."
            )
        return factor

    def _volume(self, written: str) -> float:
        if written in VOLUMES:
            return VOLUMES[written]
        found = _DECIBELS.match(written)
        if not found or not -60 <= float(found[1]) <= 20:
            self._refuse(
                f"the volume {written[:40]!r} of prosody is none",
                f"Write -60dB to +20dB or one of {', '.join(VOLUMES)}.",
            )
        return float(found[1])

    def _check_special(self, name: str, attributes: dict[str, str]) -> None:
        if name == "say-as" and attributes.get("interpret-as") not in KINDS:
            given = attributes.get("interpret-as", "")[:40]
            self._refuse(f"say-as cannot interpret as {given!r}", f"Known: {', '.join(KINDS)}.")
        if name == "sub" and not 0 < len(attributes.get("alias", "").strip()) <= LONGEST_SPECIAL:
            self._refuse(f"sub needs an alias of at most {LONGEST_SPECIAL} characters")
        if name == "phoneme":
            self._phones(attributes)

    def _phones(self, attributes: dict[str, str]) -> Pronunciation:
        alphabet, written = attributes.get("alphabet", "ipa"), attributes.get("ph", "")[:LONGEST_SPECIAL]
        if alphabet == "ipa":
            if strange := unknown(written):
                self._refuse(f"{strange!r} is no letter of the phonetic alphabet")
            phones = phones_of(written)
        elif alphabet == "x-arpabet":
            phones = tuple(phone.upper().rstrip("012") for phone in written.split())
            if wrong := [phone for phone in phones if phone not in PHONES or phone == SILENCE]:
                self._refuse(f"{wrong[0][:20]!r} is no phone of ARPAbet")
        else:
            self._refuse(f"the alphabet {alphabet[:40]!r} is not known", "Known: ipa, x-arpabet.")
        if not phones:
            self._refuse("phoneme needs ph, the sounds")
        return phones

    def _special(self, element: _Open) -> None:
        text = " ".join(element.text.split())
        if not text:
            raise _wrong(f"{element.name} has no text", element.place)
        said = Said(text, element.style, place=element.place)
        self._silence = 0.0
        if element.name == "sub":
            said = replace(said, alias=element.attributes["alias"])
        elif element.name == "phoneme":
            said = replace(said, phones=self._phones(element.attributes))
        else:
            kind = element.attributes["interpret-as"]
            spoken = say_as(text, kind, element.attributes.get("format", ""))
            if not spoken:
                raise _wrong(f"{text[:40]!r} cannot be said as {kind}", element.place)
            said = replace(said, spoken=spoken)
        self._items.append(said)


def _wrong(what: str, place: str, advice: str = "") -> InputError:
    return InputError(f"SSML, {place}: {what}", advice=advice, field="text")


def _advice(name: str) -> str:
    return f"Known: {', '.join(sorted(_ATTRIBUTES[name]))}." if _ATTRIBUTES[name] else ""
