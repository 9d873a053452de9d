"""Words alone: letters, figures, and whatever else is written between two spaces."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Sequence
from functools import cache

from app.align.dictionary import Dictionary
from app.align.spelling import spell
from app.tts.reading import amounts, dates, letters
from app.tts.reading.addresses import address
from app.tts.reading.numbers import PLAIN, cardinal, digits, number, ordinal, scientific, whole, year
from app.tts.reading.ranges import between
from app.tts.reading.word_list import these

_NUMBER = re.compile(rf"([-+±~]?)({PLAIN})\Z")
_ORDINAL = re.compile(r"([0-9]{1,3}(?:,[0-9]{3})*|[0-9]{1,15})(?:st|nd|rd|th)\Z", re.IGNORECASE)
_RANGE = re.compile(rf"({PLAIN})(?:-|—)({PLAIN})\Z")
_RATIO = re.compile(r"([0-9]{1,4}):([0-9]{1,4})\Z")
_TIMES = re.compile(rf"({PLAIN})[x×]({PLAIN})\Z")
_TIMES_AS_MUCH = re.compile(rf"({PLAIN})[x×]\Z")
_FEET = re.compile(r"([0-9])'([0-9]{1,2})\Z")
_SIGNED = re.compile(r"([-+±~]?)(.+)\Z", re.DOTALL)
_SHORTENED = re.compile(rf"([-+~]?)({PLAIN})(k|K|M|B|bn|mn)\Z")
_VERSION = re.compile(r"([vV]?)([0-9]{1,4}(?:\.[0-9]{1,4}){2,})\Z")
_RUNS = re.compile(r"[^\W\d_²³¹½¼¾]+(?:'[^\W\d_²³¹½¼¾]+)*|[0-9]+(?:,[0-9]{3})*(?:\.[0-9]+)?|.", re.DOTALL)
_CAPITALS_AND_S = re.compile(r"[A-Z]+'?s\Z")
_COUNTABLE = re.compile(r"[a-z]+s\Z")
_NOT_COUNTED = these("was is has as its this us thus does always perhaps across plus unless versus")
_COUNTED = these("people men women children percent feet dollars euros of")

SIGNS: dict[str, str] = {
    "&": "and", "+": "plus", "=": "equals", "<": "less than", ">": "greater than", "%": "percent", "@": "at",
    "#": "hash", "/": "slash", "\\": "backslash", "±": "plus or minus", "×": "times", "÷": "divided by", "°": "degrees",
    "§": "section", "¶": "paragraph", "©": "copyright", "→": "to", "²": "squared", "³": "cubed", "½": "one half",
    "¼": "one quarter", "¾": "three quarters", "µ": "micro", "$": "dollars", "€": "euros", "£": "pounds", "¥": "yen",
    "₹": "rupees", "₩": "won", "¢": "cents", "^": "to the power of", "~": "about",
}  # fmt: skip
"""Signs that have a name. Others make no sound."""
BETWEEN_NUMBERS = {"-": "minus", "*": "times", "x": "by", "/": "divided by", "X": "by"}
_NAMED = {"C++": "C plus plus", "C#": "C sharp", "F#": "F sharp", "G++": "G plus plus", "AC/DC": "A.C D.C",
          "and/or": "and or", "I/O": "I.O", "TCP/IP": "T.C.P I.P", "R&B": "R and B", "n/a": "not applicable",
          "N/A": "not applicable", "km/h": "kilometers per hour", "m/s": "meters per second"}  # fmt: skip


class SingleWords:
    """Reads words without their punctuation.

    Args:
        known: whether a word in small letters is an English word.
        shouted: the text is in capitals.
    """

    def __init__(self, known: Callable[[str], bool], *, shouted: bool) -> None:
        self._known = known
        self._shouted = shouted

    def word(self, core: str) -> str:
        """A word of letters, perhaps with hyphens and apostrophes."""
        if "-" in core:
            parts = [self.word(part) for part in core.split("-") if part]
            return "-".join(parts) if "".join(parts).isalpha() and parts == core.split("-") else " ".join(parts)
        if not core.isascii() or core.islower() or core.istitle():
            return core
        known = self._known(re.sub(r"'?s\Z", "", core).lower() if _CAPITALS_AND_S.match(core) else core.lower())
        if said := letters.initials(core, shouted=self._shouted, known=known):
            return said
        if core.rstrip("s").rstrip("'").isupper() and len(core) > 1:  # engines spell capitals
            return core.lower() if self._shouted else core.capitalize()
        return core

    def sign(self, sign: str, before: str, following: str) -> str:
        numbers = before[-1:].isdigit() and following[:1].isdigit()
        if numbers and sign in BETWEEN_NUMBERS:
            return BETWEEN_NUMBERS[sign]
        if sign.isalpha():
            return sign
        if sign in "-|/":
            return ""
        return SIGNS.get(sign, "")

    def figures(self, core: str, before: str, following: str) -> str:
        """A word with digits or signs in it."""
        if core in _NAMED:
            return _NAMED[core]
        if core in ("x", "X") and before[-1:].isdigit() and following[:1].isdigit():
            return "by"
        if found := _NUMBER.match(core):
            return self._number(found[1], found[2], following)
        if found := _ORDINAL.match(core):
            return ordinal(int(found[1].replace(",", "")))
        for reading in (dates.date, dates.time, dates.decade, amounts.amount, amounts.slashed, amounts.vulgar):
            if said := reading(core):
                return said
        if said := amounts.money(core)[0] or between(core):
            return said
        if (found := _SIGNED.match(core)) and (said := scientific(found[2])):
            return amounts.sign(found[1]) + said
        if found := _RANGE.match(core):
            return f"{self._number('', found[1], '')} to {self._number('', found[2], following)}"
        if found := _RATIO.match(core):
            return f"{whole(found[1])} to {whole(found[2])}"
        if found := _TIMES.match(core):
            return f"{number(found[1])} {'times' if '×' in core else 'by'} {number(found[2])}"
        if found := _TIMES_AS_MUCH.match(core):
            return f"{number(found[1])} times"
        if found := _FEET.match(core):
            return f"{cardinal(int(found[1]))} foot {cardinal(int(found[2]))}"
        if (found := _SHORTENED.match(core)) and not (found[3] == "K" and len(found[2]) < 3):
            return f"{amounts.sign(found[1])}{number(found[2])} {amounts.magnitude(found[3])}"
        if found := _VERSION.match(core):
            parts = found[2].split(".")
            dot = " dot " if len(parts) == 4 else " point "
            return f"{'version ' if found[1] else ''}{dot.join(map(whole, parts))}"
        if core[0] == "#" and core[1:].isdecimal() and core.isascii():
            return f"number {whole(core[1:])}"
        return address(core) or self._runs(core)

    def _number(self, sign: str, amount: str, following: str) -> str:
        """A number; four digits are a year unless something is counted."""
        if not sign and dates.is_year(amount):
            counted = _COUNTABLE.match(following) and following not in _NOT_COUNTED
            if not counted and following not in _COUNTED:
                return year(int(amount))
        return amounts.sign(sign) + number(amount)

    def _runs(self, core: str) -> str:
        """Whatever it is: its words, its numbers and the names of its signs."""
        said: list[str] = []
        runs = _RUNS.findall(core)
        for at, run in enumerate(runs):
            if "0" <= run[0] <= "9":
                said.append(number(run) if "." in run or "," in run else digits(run) if len(run) > 4 else whole(run))
            elif run[0].isalpha():
                said.append(self.word(run) if len(run) > 1 else run)
            elif run == "." and at and runs[at - 1][0].isalpha() and at + 1 < len(runs):
                if runs[at + 1][0].islower():
                    said.append("dot")
                else:  # a space is missing
                    said[-1] += "."
            elif run in "*x" and _between_figures(runs, at):
                said.append("times")
            elif run == "-" and at == 0 and len(runs) > 1 and runs[1][0].isdecimal():
                said.append("minus")
            elif run == "—" or run in ",;:!?":
                if said:
                    said[-1] += "—" if run == "—" else ","
            elif unicodedata.category(run[0])[0] == "M" and said:
                said[-1] += run
            elif run[0].isdigit() and run not in SIGNS:  # of other scripts
                said.append(" ".join(cardinal(unicodedata.digit(letter, 0)) for letter in run))
            else:
                said.append(SIGNS.get(run, ""))
        return " ".join(filter(None, said))


def english(word: str) -> bool:
    """Whether the CMU dictionary has a word, and not as letters: it has ``fbi``, said "eff bee eye"."""
    if not _dictionary().knows(word):
        return False
    named = tuple(phone for letter in word for phone in spell(letter))
    return all(said != named for said in _dictionary().word(word).pronunciations)


@cache
def _dictionary() -> Dictionary:
    return Dictionary()


def _between_figures(runs: Sequence[str], at: int) -> bool:
    return 0 < at < len(runs) - 1 and runs[at - 1][0].isdecimal() and runs[at + 1][0].isdecimal()
