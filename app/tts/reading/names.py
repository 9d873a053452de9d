"""Titles, abbreviations and Roman numerals: short forms that the words around them explain."""

from __future__ import annotations

from app.tts.reading.numbers import cardinal, ordinal, roman
from app.tts.reading.word_list import these

TITLES: dict[str, str] = {
    "Mr": "Mister", "Mrs": "Missus", "Ms": "Miz", "Mx": "Mix", "Dr": "Doctor", "Prof": "Professor", "St": "Saint",
    "Mt": "Mount", "Ft": "Fort", "Gen": "General", "Gov": "Governor", "Sen": "Senator", "Rep": "Representative",
    "Capt": "Captain", "Cpt": "Captain", "Lt": "Lieutenant", "Col": "Colonel", "Sgt": "Sergeant", "Cmdr": "Commander",
    "Rev": "Reverend", "Hon": "Honorable", "Pres": "President", "Supt": "Superintendent", "Cpl": "Corporal",
    "Maj": "Major", "Adm": "Admiral", "Fr": "Father", "Msgr": "Monsignor", "Messrs": "Messieurs", "Sra": "Señora",
}  # fmt: skip
"""Before a name."""
_AFTER_NAMES = {"Dr": "Drive", "St": "Street", "Mt": "Mount", "Ft": "Fort"}
_UNDOTTED = these("Mr Mrs Ms Mx Dr Prof St")

_DOTTED: dict[str, str] = {
    "jr": "Junior", "sr": "Senior", "inc": "Incorporated", "ltd": "Limited", "co": "Company", "corp": "Corporation",
    "bros": "Brothers", "ave": "Avenue", "blvd": "Boulevard", "rd": "Road", "ln": "Lane", "hwy": "Highway",
    "pkwy": "Parkway", "apt": "Apartment", "bldg": "Building", "dept": "department", "univ": "University",
    "assn": "Association", "govt": "government", "approx": "approximately", "est": "established", "vs": "versus",
    "etc": "et cetera", "ca": "circa", "cf": "compare", "viz": "namely", "incl": "including", "excl": "excluding",
    "max": "maximum", "min": "minimum", "avg": "average", "misc": "miscellaneous", "esp": "especially",
    "e.g": "for example", "i.e": "that is", "eg": "for example", "ie": "that is", "a.k.a": "also known as",
    "ph.d": "P.H.D", "temp": "temperature", "ext": "extension", "tel": "telephone", "al": "al",
}  # fmt: skip
SHORT = {"vs": "versus", "aka": "also known as", "w/o": "without", "w/": "with", "b/c": "because", "c/o": "care of",
          "e.g": "for example", "i.e": "that is", "a.k.a": "also known as", "OK": "okay"}  # fmt: skip
_BEFORE_NUMBER: dict[str, str] = {
    "no": "number", "nos": "numbers", "p": "page", "pp": "pages", "vol": "volume", "vols": "volumes", "ch": "chapter",
    "fig": "figure", "figs": "figures", "sec": "section", "art": "article", "eq": "equation", "pt": "part",
}  # fmt: skip

_COUNTED = these(
    "chapter part act scene section volume book phase article war type level stage class grade bowl apollo gemini "
    "fantasy episode round rocky title appendix figure table tier schedule annex unit lesson season mark league "
    "battalion corps olympiad godfather quartet"
)
_REIGNED = these(
    "Pope King Queen Tsar Emperor Henry Louis Edward George William Charles James Richard Elizabeth Napoleon Pius "
    "Benedict Leo Paul Ramses Frederick Philip Alexander Nicholas Peter Catherine Ivan Umberto Emmanuel Gustav "
    "Christian Ferdinand John Mary Otto Wilhelm Friedrich Innocent Clement Gregory Urban Julius Sixtus Boniface "
    "Adrian Robert David Alfonso Haakon Harald Olaf Leopold Albert Carlos Felipe Ptolemy Darius Xerxes Cyrus Mehmed "
    "Murad Selim Constantine Justinian Theodosius Francis Maximilian Joseph Rudolf Ludwig Victor Margaret Valdemar "
    "Eric Baldwin"
)
_AFTER_FIRST = frozenset(["of", "was", "reigned", "ruled", "became", "died"])


def capitalised(word: str) -> bool:
    """Whether it begins with a capital letter, as names do."""
    return word[:1].isupper()


def abbreviation(word: str, dotted: bool, before: str, following: str) -> str:
    """An abbreviation written out; empty if it is none here.

    Args:
        word: without punctuation.
        dotted: a full stop follows it.
        before: the word before without punctuation, or empty.
        following: the word after without punctuation, or empty.
    """
    if len(word) > 9:
        return ""
    if word in TITLES and (dotted or word in _UNDOTTED):
        if word in _AFTER_NAMES and _of_a_place(before, following):
            return _AFTER_NAMES[word]
        if capitalised(following) or (dotted and word in ("Mr", "Mrs", "Ms", "Dr", "Prof")):
            return TITLES[word]
        return _AFTER_NAMES.get(word, "") if capitalised(before) else ""
    lowered = word.lower()
    if following[:1].isdigit() and lowered in _BEFORE_NUMBER and (dotted or lowered in ("pp", "fig", "vol")):
        return _BEFORE_NUMBER[lowered]
    if dotted and lowered in _DOTTED:
        return _DOTTED[lowered]
    return SHORT.get(word, "")


def _of_a_place(before: str, following: str) -> bool:
    """Whether St. or Dr. stands behind a name ("Main St.", "5th St.") rather than before one."""
    return (capitalised(before) or before[:1].isdigit()) and not capitalised(following)


def roman_enumerator(word: str) -> str:
    """The number of a heading or an item, ``II`` of ``II. Main``; empty for one letter, which may be an initial."""
    return cardinal(roman(word)) if len(word) > 1 and set(word) <= set("IVX") and roman(word) else ""


def roman_numeral(word: str, before: str, following: str) -> str:
    """A Roman numeral after the word that it numbers: ``Chapter IV``, ``Henry VIII``; empty if it is none here.

    A single I counts only after such a word with a capital, and after a name only before "of" and the like, since it is
    nearly always the pronoun.
    """
    value = roman(word)
    if not value or not before:
        return ""
    counted = before.lower() in _COUNTED
    named = before in _REIGNED
    if word == "I":
        if counted and capitalised(before):
            return cardinal(value)
        return f"the {ordinal(value)}" if named and following.lower() in _AFTER_FIRST else ""
    if counted:
        return cardinal(value)
    if named and value < 40:
        return f"the {ordinal(value)}"
    few = len(word) > 1 and set(word) <= set("IVX")
    return cardinal(value) if few and capitalised(before) and not before.isupper() else ""
