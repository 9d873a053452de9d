"""Reads English text: for every written word the plain words that are said for it.

"On Jan. 5th it cost $3 million." is said as "On January fifth it cost three million dollars." Engines get only such
plain words, so all of them read alike, and every spoken word is known to belong to a written one. Rules look at the
words around; nothing looks further than a few words, and no word is longer than a piece, so time is linear in the text.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass

from app.tts.reading import amounts, dates, letters, names
from app.tts.reading.numbers import PLAIN, cardinal, digits, number, one, ordinal, with_commas
from app.tts.reading.single_words import BETWEEN_NUMBERS, SingleWords, english
from app.tts.reading.word_list import these

_OPENERS = "\"'([{<«*_"
_CLOSERS = "\"')]}>»*"
_STOPS = ".,;:!?…—"
_SAID_STOPS = re.compile(r"[.,;:!?…—)]+")
_ELIDED = these("tis twas em cause til n bout round kay")

_NUMBER = re.compile(rf"([-+±~]?)({PLAIN})\Z")
_TELEPHONE = re.compile(
    r"(?:\+?[0-9]{1,3}[-.])?(?:\([0-9]{3}\)|[0-9]{3}[-.])[0-9]{3}[-.][0-9]{4}\Z|[0-9]{3}-[0-9]{4}\Z|\+[0-9]{7,15}\Z"
)
_GROUP = re.compile(r"\(?[0-9]{2,5}\)?(?:-[0-9]{2,5}){0,3}\Z")
_DIALLED = frozenset(["call", "dial", "phone", "ring"])
_DOTTED = re.compile(r"(?:[^\W\d_²³¹½¼¾]\.)+[^\W\d_²³¹½¼¾]\Z")
_WORD = re.compile(r"[^\W\d_²³¹½¼¾]+(?:['-][^\W\d_²³¹½¼¾]+)*'?\Z")


@dataclass(frozen=True, slots=True)
class Reading:
    """A written word and what is said for it.

    Attributes:
        text: as it is written, punctuation included; several words if SSML makes them one.
        spoken: plain words with their punctuation; perhaps only punctuation, or nothing.
        as_written: the word itself is said, so a dictionary or letter-to-sound must know how.
    """

    text: str
    spoken: str
    as_written: bool = False


def verbalise(
    text: str, *, own: Container[str] = frozenset(), known: Callable[[str], bool] | None = None
) -> tuple[Reading, ...]:
    """How a cleaned text is read, in order; the readings' texts are its words.

    Args:
        text: a clause or more.
        own: words in small letters that are said as they are, since somebody says how (a lexicon).
        known: whether a word in small letters is an English word; the CMU dictionary by default.
    """
    parts = [_divided(word) for word in text.split()]
    return _Line(parts, own, known or english).read()


@dataclass(frozen=True, slots=True)
class _Part:
    """A written word divided: punctuation before it, the word, punctuation after it."""

    before: str
    core: str
    after: str

    @property
    def text(self) -> str:
        return self.before + self.core + self.after

    @property
    def joined(self) -> bool:
        """No stop keeps it from the next word."""
        return not self.after

    @property
    def ordinary(self) -> bool:
        """A word in small letters that cannot be short for anything: most words of most texts."""
        core = self.core
        return len(core) > 2 and core.islower() and core.isalpha() and self.after[:1] != "." and core not in names.SHORT

    def said(self, spoken: str, *, dot: bool = True) -> str:
        """Spoken words with the punctuation that engines make pauses of."""
        if not self.before and not self.after:
            return spoken
        after = "".join(_SAID_STOPS.findall(self.after))
        if not dot and after.startswith("."):
            after = after[1:]
        before = "(" if "(" in self.before and spoken else ""
        return (before + spoken + after) if spoken else after.replace(")", "")


def _divided(word: str) -> _Part:
    if word in BETWEEN_NUMBERS:
        return _Part("", word, "")
    start, end = 0, len(word)
    while start < end and word[start] in _OPENERS:
        start += 1
    while end > start and (word[end - 1] in _CLOSERS or word[end - 1] in _STOPS):
        end -= 1
    core = word[start:end]
    if start and word[start - 1] == "'" and (core.lower() in _ELIDED or dates.decade(core)):
        start -= 1
    if word.startswith("(") and word[end : end + 1] == ")" and core.isdigit():
        return _Part("", word[: end + 1], word[end + 1 :])  # (555): the area code of a telephone number
    if word[end : end + 1] == "'" and core[-1:] in ("s", "n"):  # the dogs', goin'
        end += 1
    return _Part(word[:start], word[start:end], word[end:])


class _Line:
    """The words of a text, read from left to right."""

    def __init__(self, parts: Sequence[_Part], own: Container[str], known: Callable[[str], bool]) -> None:
        self._parts = parts
        self._own = own
        lettered = [part.core for part in parts if len(part.core) > 1 and part.core.isalpha()]
        shouted = len(lettered) > 2 and sum(map(str.isupper, lettered)) * 5 > len(lettered) * 3
        self._words = SingleWords(known, shouted=shouted)

    def read(self) -> tuple[Reading, ...]:
        readings: list[Reading] = []
        at = 0
        while at < len(self._parts):
            part = self._parts[at]
            if part.ordinary:
                readings.append(Reading(part.text, part.said(part.core), as_written=True))
                at += 1
                continue
            spoken = self._together(at)
            if spoken:
                readings += [
                    Reading(part.text, part.said(said)) for part, said in zip(self._parts[at:], spoken, strict=False)
                ]
                at += len(spoken)
            else:
                readings.append(self._alone(at))
                at += 1
        return tuple(readings)

    def _core(self, at: int) -> str:
        """The word there, a number with commas between its thousands; empty beyond the ends."""
        core = self._parts[at].core if 0 <= at < len(self._parts) else ""
        commas = with_commas(core)
        return core if commas != core and core.lower() in self._own else commas

    def _next(self, at: int) -> str:
        """The word after, if no stop lies between."""
        return self._core(at + 1) if self._parts[at].joined else ""

    # --- several words together ---------------------------------------------------------------------------------------

    def _together(self, at: int) -> list[str]:
        """What is said for each of the words from `at` on that belong together; nothing if this one stands alone."""
        core = self._core(at)
        if core.lower() in self._own:
            return []
        after = self._next(at)
        telephone = self._telephone(at)
        if telephone:
            return telephone
        if not after or after.lower() in self._own:
            return self._month_and_day(at)
        if dates.half_of_day(after):
            hour = cardinal(int(core)) if dates.day(core) and core.isdecimal() else ""
            if said := dates.time(core, half=True) or hour:
                return [said]
        if core in amounts.CODES and (found := _NUMBER.match(after)):  # USD 5, as $5
            single, many, *_ = amounts.CURRENCIES[amounts.CODES[core]]
            said, size = amounts.sign(found[1]) + number(found[2]), amounts.magnitude(self._next(at + 1))
            return [said, size, many] if size else [said, single if one(found[2]) else many]
        if amounts.magnitude(after):
            said, then = amounts.money(core, after)
            if said:
                return [said, then]
        if found := _NUMBER.match(core):
            return self._counted(at, found[1], found[2], after)
        part, unit = amounts.vulgar(core), amounts.unit(after, single=core in "½¼¾", apart=True)
        if part and unit:
            return [f"{part} of", f"a {unit}"] if core in "½¼¾" else [part, unit]
        if core.endswith(("th", "st", "nd", "rd")) and dates.day(core) and self._month(at + 1):
            return [f"{self._the(at)}{ordinal(dates.day(core))} of", self._month(at + 1)]
        return self._month_and_day(at)

    def _counted(self, at: int, sign: str, amount: str, after: str) -> list[str]:
        """A number and the word that says of what."""
        said = amounts.sign(sign) + number(amount)
        if not sign and dates.day(amount) and self._month(at + 1):
            self._drop_dot(at + 1)
            return [f"{self._the(at)}{ordinal(dates.day(amount))} of", self._month(at + 1)]
        if after in amounts.CODES:
            single, many, *_ = amounts.CURRENCIES[amounts.CODES[after]]
            return [said, single if one(amount) else many]
        if len(after) == 1 and after in amounts.CURRENCIES:
            return [said, amounts.CURRENCIES[after][not one(amount)]]
        if amounts.magnitude(after) and (unit := amounts.unit(self._next(at + 1), single=False, apart=True)):
            return [said, after, unit]
        if unit := amounts.unit(after, single=one(amount), apart=True):
            return [said, unit]
        part = amounts.vulgar(after) if after in "½¼¾" else amounts.slashed(after)
        if part and not sign and amount.isdecimal() and "over" not in part and part[0] != "m":
            return [said, f"and {part.replace('one ', 'a ', 1)}"]
        return []

    def _the(self, at: int) -> str:
        return "" if self._core(at - 1).lower() == "the" else "the "

    def _month(self, at: int) -> str:
        """The month whose name or short form stands there with a capital; empty if none does."""
        core = self._core(at)
        return dates.MONTHS.get(core.lower(), "") if names.capitalised(core) else ""

    def _month_and_day(self, at: int) -> list[str]:
        """``Jan. 5th``, ``Mon. 5 Jan.``, ``Jan.``"""
        part = self._parts[at]
        if part.after not in ("", "."):
            return []
        following = self._core(at + 1)
        if month := self._month(at):
            if on := dates.day(following):
                self._drop_dot(at)
                return [month, ordinal(on)]
            if part.core != month and ((part.after == "." and part.core in _ALWAYS_MONTHS) or dates.is_year(following)):
                self._drop_dot(at)
                return [month]
        weekday = dates.WEEKDAYS.get(part.core.lower(), "") if names.capitalised(part.core) else ""
        if weekday and (self._month(at + 1) or dates.day(following)):
            self._drop_dot(at)
            return [weekday]
        return []

    def _drop_dot(self, at: int) -> None:
        """The stop of an abbreviation is none of the sentence, unless it is its last word."""
        part = self._parts[at]
        if part.after.startswith(".") and at + 1 < len(self._parts):
            changed = list(self._parts)
            changed[at] = _Dotless(part.before, part.core, part.after)
            self._parts = changed

    def _telephone(self, at: int) -> list[str]:
        """A telephone number in one word or in several: ``+1 555 123 4567``, ``(555) 123-4567``."""
        core = self._core(at)
        if not core or core[0] not in "+(0123456789":
            return []
        if _TELEPHONE.match(core):
            return [dates.telephone(core)]
        if core in ("911", "999", "112", "411") and self._core(at - 1).lower() in _DIALLED:
            return [digits(core)]
        groups = [core]
        while len(groups) < 7 and self._parts[at + len(groups) - 1].joined:
            following = self._core(at + len(groups))
            if not _GROUP.match(following):
                break
            groups.append(following)
        figures = sum(map(str.isdecimal, "".join(groups)))
        international = re.match(r"\+[0-9]{1,4}\Z", core) and 8 <= figures <= 15
        area = core[0] == "(" and len(groups) > 1 and 7 <= figures <= 11
        american = [len(group) for group in groups[:3]] == [3, 3, 4] and "".join(groups[:3]).isdecimal()
        if american and not international:
            groups = groups[:3]
        if not (international or area or american):
            return []
        said = [dates.telephone(group) for group in groups]
        return [*(f"{group}," for group in said[:-1]), said[-1]]

    # --- one word alone -----------------------------------------------------------------------------------------------

    def _alone(self, at: int) -> Reading:
        part, core = self._parts[at], self._core(at)
        if not core:
            return Reading(part.text, part.said(""))
        if core.lower() in self._own:
            return Reading(part.text, part.said(core), as_written=True)
        before, following = self._core(at - 1), self._core(at + 1)
        dotted = part.after.startswith(".")
        last = at + 1 == len(self._parts)
        if at == 0 and not last and part.after in (".", ")") and (said := names.roman_enumerator(core)):
            return Reading(part.text, part.said(said))
        if said := names.abbreviation(core, dotted and not part.after.startswith(".."), before, following):
            return Reading(part.text, part.said(said, dot=last))
        if said := self._initials(core, dotted, last):
            return Reading(part.text, part.said(said, dot=last or not (_DOTTED.match(core) or len(core) == 1)))
        if said := names.roman_numeral(core, before if at and self._parts[at - 1].joined else "", following):
            return Reading(part.text, part.said(said))
        if dates.half_of_day(core) and (before[:1].isdigit() or core[0] == "P"):
            return Reading(part.text, part.said(dates.half_of_day(core), dot=last or "." not in core))
        if len(core) == 1 and (not core.isalnum() or core in BETWEEN_NUMBERS):
            return Reading(part.text, part.said(self._words.sign(core, before, following)))
        if core.isalpha() or _WORD.match(core):
            said = self._words.word(core)
            return Reading(part.text, part.said(said), as_written=said.lower() == core.lower())
        return Reading(part.text, part.said(self._words.figures(core, before, following)))

    def _initials(self, core: str, dotted: bool, last: bool) -> str:
        if _DOTTED.match(core):  # U.S., J.R.R.
            plain = core.replace(".", "")
            if dates.half_of_day(core):
                return dates.half_of_day(core)
            return letters.spelled(plain) if plain.isascii() else " ".join(plain)
        return core if dotted and not last and len(core) == 1 and core.isalpha() and core.isupper() else ""


class _Dotless(_Part):
    """A part whose first full stop is not said."""

    @property
    def ordinary(self) -> bool:
        """A word in small letters that cannot be short for anything: most words of most texts."""
        core = self.core
        return len(core) > 2 and core.islower() and core.isalpha() and self.after[:1] != "." and core not in names.SHORT

    def said(self, spoken: str, *, dot: bool = True) -> str:  # noqa: ARG002
        return _Part.said(self, spoken, dot=False)


_ALWAYS_MONTHS = these("Jan Feb Aug Sept Sep Oct Nov Dec")
