"""Prepares text for speaking: cleans it of what cannot be read.

Everything here runs in time linear in the length of the text, whatever the text is.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from app.tts.html_tags import strip_html
from app.tts.markdown import strip_markdown


@dataclass(frozen=True, slots=True)
class Cleaned:
    """Text that can be read, and what was taken out of it.

    Attributes:
        text: NFKC, straight quotes, single spaces, ``\\n`` between lines and ``\\n\\n`` between paragraphs.
        unread: the longest runs that cannot be read (emoji, other scripts), each once, in order of first appearance.
    """

    text: str
    unread: tuple[str, ...] = ()


# NFKC would change what these say (x² to x2, 1½ to 11⁄2, ™ to TM, µ to a Greek letter); engines read them as they are.
_KEPT = "²³½¼¾™®©°µ×÷±£€¥¢₹₩§¶→•"
_NOT_KEPT = re.compile(f"[^{_KEPT}]+")

_SAME = str.maketrans(
    {
        **dict.fromkeys("‘’‚‛ʼʻ′‹›＇`´", "'"),
        **dict.fromkeys("“”„‟″«»「」『』《》〈〉〝〞", '"'),
        **dict.fromkeys("‐‑‒−⁃﹣－", "-"),
        **dict.fromkeys("—―⸺⸻", "—"),
        **dict.fromkeys("。｡", ". "),
        **dict.fromkeys("、،", ", "),
        **dict.fromkeys("·‣▪●◦", " "),
        "؟": "? ",
        "؛": "; ",
        "¡": " ",
        "¿": " ",
        "⁄": "/",
        "…": "...",
        **dict.fromkeys("\r\v\f\x1c\x1d\x1e\x85\u2028\u2029", "\n"),
        "\t": " ",
    }
)

_FOLDED = str.maketrans(
    {
        "ł": "l", "Ł": "L", "đ": "d", "Đ": "D", "ħ": "h", "Ħ": "H", "ı": "i", "ŧ": "t", "Ŧ": "T", "ŋ": "ng", "Ŋ": "Ng",
        "œ": "oe", "Œ": "Oe", "ĸ": "k", "ſ": "s", "ƒ": "f", "ə": "e", "Ə": "E", "ɛ": "e", "Ɛ": "E", "ɔ": "o", "Ɔ": "O",
        "ẞ": "SS", "ơ": "o", "Ơ": "O", "ư": "u", "Ư": "U", "ɓ": "b", "Ɓ": "B", "ɗ": "d", "Ɗ": "D", "ƙ": "k", "Ƙ": "K",
    }
)  # fmt: skip

_MARKS_IN_A_ROW = 8  # more combining marks on one letter are decoration, and slow to put into canonical order
_EDGE_SPACES = re.compile(r" *\n *")
_BLANK_LINES = re.compile(r"\n{2,}")
_SPACES = re.compile(r"[^\S\n]+")
_SPACE_BEFORE_STOP = re.compile(r"(?<=\S) +(?=[,.;:!?]+(?:[\s\"')]|$))")
_HYPHENS = re.compile(r"-{2,}")
_RANGE = re.compile(r"(?<=\d) ?– ?(?=\d)")


def clean(text: str, *, markdown: bool = True) -> Cleaned:
    """Normalise a text and take out what cannot be read.

    Compatibility forms become plain (NFKC); control and invisible characters go; quotes and dashes become the simple
    ones; Latin letters keep their accents. Emoji, other scripts and unknown symbols become spaces and are reported.
    `markdown`: its marks go, too, and HTML's tags (`app.tts.markdown`, `app.tts.html_tags`).
    """
    plain = _few_marks(text.replace("\r\n", "\n"))
    if markdown:
        plain = strip_markdown(strip_html(plain))
    plain = _NOT_KEPT.sub(lambda run: unicodedata.normalize("NFKC", run[0].translate(_SAME)).translate(_SAME), plain)
    plain, unread = _readable(plain)
    plain = _RANGE.sub("-", plain).replace("–", "—")
    plain = _HYPHENS.sub("—", plain)
    plain = _EDGE_SPACES.sub("\n", _SPACES.sub(" ", plain))
    plain = _BLANK_LINES.sub("\n\n", plain)
    plain = _SPACE_BEFORE_STOP.sub("", plain)
    return Cleaned(plain.strip(), tuple(dict.fromkeys(unread)))


def fold(text: str) -> str:
    """Latin letters beyond Latin-1 as their base letters (ł as l, ệ as e); everything else as it is."""
    if text.isascii():
        return text
    return "".join(character if ord(character) < 256 else _base(character) for character in text)


def speakable(text: str) -> bool:
    """Whether there is anything in a cleaned text to be heard: a letter, a digit or a symbol that has a name."""
    return any(character.isalnum() or character in _NAMED for character in text)


_NAMED = frozenset("&%@#+=<>/©§°±×÷→^¶")
_PUNCTUATION = {"Pi": '"', "Pf": '"', "Ps": "(", "Pe": ")", "Pd": "–", "Pc": "_"}


def _base(character: str) -> str:
    folded = character.translate(_FOLDED)
    if folded != character:
        return folded
    stripped = "".join(part for part in unicodedata.normalize("NFD", character) if not unicodedata.combining(part))
    stripped = stripped.translate(_FOLDED)
    return stripped if stripped and all(ord(part) < 256 for part in stripped) else character


def _few_marks(text: str) -> str:
    if text.isascii():
        return text
    kept: list[str] = []
    row = 0
    for character in text:
        row = row + 1 if unicodedata.combining(character) else 0
        if row <= _MARKS_IN_A_ROW:
            kept.append(character)
    return "".join(kept)


def _readable(text: str) -> tuple[str, list[str]]:
    """The text with a space for each unreadable run, and the runs."""
    kept: list[str] = []
    unread: list[str] = []
    run: list[str] = []
    for character in text:
        reading = _reading(character, bool(run))
        if reading is None:
            run.append(character if unicodedata.category(character) != "Cs" else "\N{REPLACEMENT CHARACTER}")
            continue
        if run:
            unread.append("".join(run))
            run.clear()
            kept.append(" ")
        kept.append(reading)
    if run:
        unread.append("".join(run))
    return "".join(kept), unread


def _reading(character: str, in_run: bool) -> str | None:
    """What stands for a character in cleaned text; None: it cannot be read."""
    if " " <= character <= "~" or character == "\n" or character in _KEPT or character in "—–":
        return character
    category = unicodedata.category(character)
    if category[0] == "M" or category in ("Cf", "Sk", "Lm"):
        return None if in_run else ""  # joins and colours of an emoji, vowel signs of a script; else decoration
    if category == "Cc":
        return ""
    if category[0] == "Z":
        return " "
    if category in ("Ll", "Lu", "Lt", "Lo") and (ord(character) < 256 or _base(character) != character):
        return character
    return _PUNCTUATION.get(category)
