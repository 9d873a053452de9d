"""Phones as the viseme numbers and names that users of other services know."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Viseme:
    """One mouth shape.

    Attributes:
        azure: 0 to 21, as Microsoft's speech services number them.
        oculus: one of the 15 names of Meta's LipSync.
    """

    azure: int
    oculus: str


_OF = {
    "SIL": Viseme(0, "sil"),
    "AE": Viseme(1, "aa"),
    "AH": Viseme(1, "aa"),
    "AA": Viseme(2, "aa"),
    "AO": Viseme(3, "oh"),
    "EH": Viseme(4, "E"),
    "EY": Viseme(4, "E"),
    "UH": Viseme(4, "ou"),
    "ER": Viseme(5, "RR"),
    "IH": Viseme(6, "ih"),
    "IY": Viseme(6, "ih"),
    "Y": Viseme(6, "ih"),
    "UW": Viseme(7, "ou"),
    "W": Viseme(7, "ou"),
    "OW": Viseme(8, "oh"),
    "AW": Viseme(9, "aa"),
    "OY": Viseme(10, "oh"),
    "AY": Viseme(11, "aa"),
    "HH": Viseme(12, "kk"),
    "R": Viseme(13, "RR"),
    "L": Viseme(14, "nn"),
    "S": Viseme(15, "SS"),
    "Z": Viseme(15, "SS"),
    "CH": Viseme(16, "CH"),
    "JH": Viseme(16, "CH"),
    "SH": Viseme(16, "CH"),
    "ZH": Viseme(16, "CH"),
    "DH": Viseme(17, "TH"),
    "F": Viseme(18, "FF"),
    "V": Viseme(18, "FF"),
    "D": Viseme(19, "DD"),
    "T": Viseme(19, "DD"),
    "N": Viseme(19, "nn"),
    "TH": Viseme(17, "TH"),
    "G": Viseme(20, "kk"),
    "K": Viseme(20, "kk"),
    "NG": Viseme(20, "nn"),
    "B": Viseme(21, "PP"),
    "M": Viseme(21, "PP"),
    "P": Viseme(21, "PP"),
}


def viseme(phone: str) -> Viseme:
    """The shape of an ARPAbet phone without stress, or of ``SIL``."""
    return _OF[phone]
