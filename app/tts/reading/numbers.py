"""Numbers as English words.

Written here rather than taken from a library: num2words is under the LGPL, inflect is made for plurals and reads
numbers by the way, and hibari's are part of one engine. The rules fill a page.
"""

from __future__ import annotations

import re

MOST_DIGITS = 15  # longer numbers are read digit by digit: number words end somewhere

_ONES = (
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve",
    "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen",
)  # fmt: skip
_TENS = ("", "", "twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
_SCALES = ("", "thousand", "million", "billion", "trillion")
_ORDINALS = {
    "one": "first", "two": "second", "three": "third", "five": "fifth", "eight": "eighth", "nine": "ninth",
    "twelve": "twelfth",
}  # fmt: skip
_ROMAN = {"I": 1, "V": 5, "X": 10, "L": 50, "C": 100, "D": 500, "M": 1000}
_ROMAN_NUMERAL = re.compile(r"(?=.)M{0,3}(?:CM|CD|D?C{0,3})(?:XC|XL|L?X{0,3})(?:IX|IV|V?I{0,3})\Z")
_WITH_POINTS = re.compile(r"([-+±~]?[$€£¥₹₩]?)([1-9][0-9]{0,2}(?:\.[0-9]{3}){2,})(?:,([0-9]{1,2}))?([^\d.,'/:_-]*)\Z")
_WITH_APOSTROPHES = re.compile(
    r"([-+±~]?[$€£¥₹₩]?)([1-9][0-9]{0,2}(?:'[0-9]{3})+)(?:[.,]([0-9]{1,2}))?([^\d.,'/:_-]*)\Z"
)
_THOUSANDS = re.compile(r"[0-9]{1,3}(?:,[0-9]{3})+\Z")

PLAIN = r"(?:[0-9]{1,3}(?:,[0-9]{3})+|[0-9]+)(?:\.[0-9]+)?|\.[0-9]+"
"""A number without a sign, as a regular expression: ``5``, ``1,234.5``, ``.5``."""

_SCIENTIFIC = re.compile(rf"({PLAIN})[eE]([-+]?)([0-9]{{1,3}})\Z")


def cardinal(number: int) -> str:
    """``1234`` as ``one thousand two hundred thirty four``; up to `MOST_DIGITS` digits, digit by digit beyond."""
    if number < 0:
        return "minus " + cardinal(-number)
    if number < 20:
        return _ONES[number]
    if number < 100:
        return _TENS[number // 10] + (f" {_ONES[number % 10]}" if number % 10 else "")
    if number < 1000:
        rest = number % 100
        return f"{_ONES[number // 100]} hundred" + (f" {cardinal(rest)}" if rest else "")
    if number >= 10**MOST_DIGITS:
        return digits(str(number)) if number < 10**1000 else "a very large number"
    groups: list[str] = []
    for scale in _SCALES:
        number, rest = divmod(number, 1000)
        if rest:
            groups.append(f"{cardinal(rest)} {scale}".rstrip())
    return " ".join(reversed(groups))


def ordinal(number: int) -> str:
    """``21`` as ``twenty first``."""
    first, _, last = cardinal(number).rpartition(" ")
    regular = f"{last[:-1]}ieth" if last.endswith("y") else f"{last}th"
    last = _ORDINALS.get(last, regular)
    return f"{first} {last}".lstrip()


def digits(text: str) -> str:
    """Every ASCII digit of a text as a word; the rest is left out."""
    return " ".join(_ONES[ord(letter) - 48] for letter in text if "0" <= letter <= "9")


def year(number: int) -> str:
    """``1999`` as ``nineteen ninety nine``, ``1905`` as ``nineteen oh five``, ``2005`` as ``two thousand five``."""
    century, rest = divmod(number, 100)
    if not 10 <= century <= 99 or (century % 10 == 0 and rest < 10):
        return cardinal(number)
    if rest == 0:
        return f"{cardinal(century)} hundred"
    return f"{cardinal(century)} {'oh ' if rest < 10 else ''}{cardinal(rest)}"


def whole(text: str) -> str:
    """A whole number as it is written, with or without commas; leading zeros make it digits (``007``)."""
    plain = text.replace(",", "")
    if len(plain) > MOST_DIGITS or (len(plain) > 1 and plain[0] == "0"):
        return digits(plain)
    return cardinal(int(plain))


def number(text: str) -> str:
    """A number as `PLAIN` matches it: ``3.14`` as ``three point one four``."""
    before, point, after = text.partition(".")
    said = whole(before) if before else "zero" if point else ""
    return f"{said} point {digits(after)}" if after else said


def scientific(text: str) -> str:
    """``3.2e-5`` as ``three point two times ten to the minus five``; empty if it is no such number."""
    found = _SCIENTIFIC.match(text)
    if not found:
        return ""
    minus = "minus " if found[2] == "-" else ""
    return f"{number(found[1])} times ten to the {minus}{cardinal(int(found[3]))}"


def with_commas(text: str) -> str:
    """A number grouped as elsewhere (``1.000.000,50``, ``10'000``) as ``1,000,000.50``; anything else as it is.

    ``1.000`` is a decimal number, and four parts up to 255 are the address of a computer.
    """
    if "'" not in text and text.count(".") < 2:
        return text
    found = _WITH_POINTS.match(text) or _WITH_APOSTROPHES.match(text)
    if not found:
        return text
    groups = re.split("[.']", found[2])
    if len(groups) == 4 and "." in found[2] and all(int(group) < 256 and group[0] != "0" for group in groups):
        return text
    return f"{found[1]}{','.join(groups)}{'.' + found[3] if found[3] else ''}{found[4]}"


def grouped(text: str) -> bool:
    """Whether it is written with commas between thousands."""
    return _THOUSANDS.match(text) is not None


def one(text: str) -> bool:
    """Whether the number is exactly one, so that what is counted is said in the singular."""
    return text in ("1", "1.0", "1.00")


def plural(word: str) -> str:
    """The plural of a number word or a unit: ``nineties``, ``sixes``, ``halves``."""
    if word.endswith("half"):
        return word[:-1] + "ves"
    if word.endswith("y") and word[-2:-1] not in ("a", "e", "o"):
        return word[:-1] + "ies"
    return word + ("es" if word.endswith(("x", "s")) else "s")


def fraction(above: int, below: int) -> str:
    """``3, 4`` as ``three quarters``; below must be two or more."""
    if below == 2:
        named = "half"
    elif below == 4:
        named = "quarter"
    else:
        named = ordinal(below)
    return f"{cardinal(above)} {named if above == 1 else plural(named)}"


def roman(text: str) -> int:
    """The value of a Roman numeral in capitals; 0 if it is none."""
    if len(text) > 15 or not _ROMAN_NUMERAL.match(text):
        return 0
    values = [_ROMAN[letter] for letter in text]
    return sum(-now if now < after else now for now, after in zip(values, (*values[1:], 0), strict=True))
