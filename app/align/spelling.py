"""Phones of a word by a plain table of spellings: the last resort, when nothing that knows English is at hand."""

from __future__ import annotations

import re
import unicodedata

_SPELLED: dict[str, str] = {
    "tch": "CH", "igh": "AY", "ough": "AO", "tion": "SH AH N", "sion": "ZH AH N", "ture": "CH ER",
    "th": "TH", "sh": "SH", "ch": "CH", "ph": "F", "ng": "NG", "ck": "K", "wh": "W", "qu": "K W", "zh": "ZH",
    "gh": "G", "ee": "IY", "ea": "IY", "oo": "UW", "ou": "AW", "ow": "OW", "ai": "EY", "ay": "EY", "oi": "OY",
    "oy": "OY", "au": "AO", "aw": "AO", "ew": "UW", "er": "ER", "ir": "ER", "ur": "ER", "or": "AO R", "ar": "AA R",
    "ce": "S", "ci": "S IH", "cy": "S IY", "ge": "JH",
    "a": "AE", "b": "B", "c": "K", "d": "D", "e": "EH", "f": "F", "g": "G", "h": "HH", "i": "IH", "j": "JH", "k": "K",
    "l": "L", "m": "M", "n": "N", "o": "OW", "p": "P", "q": "K", "r": "R", "s": "S", "t": "T", "u": "AH", "v": "V",
    "w": "W", "x": "K S", "y": "IY", "z": "Z", "ß": "S", "ø": "ER", "æ": "EH", "œ": "ER", "ð": "DH", "þ": "TH",
    "0": "Z IY R OW", "1": "W AH N", "2": "T UW", "3": "TH R IY", "4": "F AO R", "5": "F AY V", "6": "S IH K S",
    "7": "S EH V AH N", "8": "EY T", "9": "N AY N",
    "&": "AE N D", "%": "P ER S EH N T", "@": "AE T", "+": "P L AH S", "=": "IY K W AH L Z", "$": "D AA L ER Z",
    "#": "N AH M B ER", "£": "P AW N D Z", "€": "Y UH R OW Z", "°": "D IH G R IY Z",
}  # fmt: skip
_LONGEST = max(map(len, _SPELLED))
_SINGLE: dict[str, str] = {
    "a": "EY", "b": "B IY", "c": "S IY", "d": "D IY", "e": "IY", "f": "EH F", "g": "JH IY", "h": "EY CH", "i": "AY",
    "j": "JH EY", "k": "K EY", "l": "EH L", "m": "EH M", "n": "EH N", "o": "OW", "p": "P IY", "q": "K Y UW",
    "r": "AA R", "s": "EH S", "t": "T IY", "u": "Y UW", "v": "V IY", "w": "D AH B AH L Y UW", "x": "EH K S",
    "y": "W AY", "z": "Z IY",
}  # fmt: skip
_SILENT_E = re.compile(r"(?<=[aeiouy][b-df-hj-np-tv-xz])e(?=s?$)")
_DOUBLED = re.compile(r"([b-df-hj-np-tv-xz])\1+")


def spell(word: str) -> tuple[str, ...]:
    """ARPAbet of a word, longest spelling first; letters without a vowel are named one by one (``XYZ``).

    Returns:
        no phone if no letter or digit of the word is known (an emoji, another script).
    """
    plain = "".join(
        letter for letter in unicodedata.normalize("NFKD", word).lower() if not unicodedata.combining(letter)
    )
    if plain.isalpha() and not set(plain) & set("aeiouyøæœ") and all(letter in _SINGLE for letter in plain):
        return tuple(" ".join(_SINGLE[letter] for letter in plain).split())
    if plain in _SINGLE:
        return tuple(_SINGLE[plain].split())
    letters = _SILENT_E.sub("", _DOUBLED.sub(r"\1", plain))
    phones: list[str] = []
    at = 0
    while at < len(letters):
        size = next((n for n in range(_LONGEST, 0, -1) if letters[at : at + n] in _SPELLED), 0)
        if size:
            phones += _SPELLED[letters[at : at + size]].split()
        at += size or 1
    return tuple(phones)
