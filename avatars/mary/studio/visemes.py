"""The shapes of the mouth: what Mary's face does for each kind of phone."""

from __future__ import annotations

from collections.abc import Mapping

_PAIRED = frozenset(
    ["mouthSmile", "mouthStretch", "mouthLowerDown", "mouthUpperUp", "mouthPress", "mouthDimple", "cheekSquint",
     "eyeBlink", "eyeSquint", "eyeWide"]
)  # fmt: skip


def both_sides(controls: Mapping[str, float]) -> dict[str, float]:
    """The controls with those that exist for each side of the face given to both."""
    sides: dict[str, float] = {}
    for name, weight in controls.items():
        if name in _PAIRED:
            sides[f"{name}Left"] = sides[f"{name}Right"] = weight
        else:
            sides[name] = weight
    return sides


VISEMES: dict[str, dict[str, float]] = {
    name: both_sides(controls)
    for name, controls in {
        "sil": {},
        "mbp": {"mouthPress": 0.34, "mouthRollLower": 0.30, "mouthRollUpper": 0.28, "mouthPucker": 0.12,
                "xRound": 0.06},
        "fv": {"jawOpen": 0.15, "xTuck": 1.0, "mouthUpperUp": 0.5},
        "th": {"jawOpen": 0.31, "mouthLowerDown": 0.5, "mouthUpperUp": 0.4, "tOut": 1.0, "tThin": 1},
        "tdn": {"jawOpen": 0.14, "mouthLowerDown": 0.7, "mouthUpperUp": 0.4, "mouthStretch": 0.15, "tL": 0.8},
        "sz": {"jawOpen": 0.07, "mouthLowerDown": 0.9, "mouthUpperUp": 0.5, "mouthStretch": 0.3, "tTip": 0.2},
        "l": {"jawOpen": 0.30, "mouthLowerDown": 0.3, "mouthUpperUp": 0.25, "tL": 1.0},
        "kg": {"jawOpen": 0.22, "mouthLowerDown": 0.4, "mouthUpperUp": 0.3, "tBody": 0.8},
        "sh": {"jawOpen": 0.10, "mouthFunnel": 0.75, "xRound": 0.35, "mouthLowerDown": 0.3, "mouthUpperUp": 0.2},
        "r": {"jawOpen": 0.16, "mouthFunnel": 0.45, "xRound": 0.40, "tBody": 0.4},
        "w": {"jawOpen": 0.13, "mouthPucker": 0.8, "xRound": 0.80, "mouthFunnel": 0.1, "mouthClose": 0.06},
        "uw": {"jawOpen": 0.17, "mouthPucker": 0.7, "xRound": 0.70, "mouthFunnel": 0.2, "mouthClose": 0.06},
        "ow": {"jawOpen": 0.34, "mouthFunnel": 0.45, "mouthPucker": 0.3, "xRound": 0.65},
        "ao": {"jawOpen": 0.48, "mouthFunnel": 0.4, "xRound": 0.45},
        "aa": {"jawOpen": 0.68, "mouthLowerDown": 0.25, "mouthUpperUp": 0.25},
        "ae": {"jawOpen": 0.52, "mouthLowerDown": 0.5, "mouthUpperUp": 0.45, "mouthStretch": 0.35,
               "mouthSmile": 0.2},
        "eh": {"jawOpen": 0.36, "mouthLowerDown": 0.45, "mouthUpperUp": 0.35, "mouthStretch": 0.25,
               "mouthSmile": 0.1},
        "ih": {"jawOpen": 0.22, "mouthLowerDown": 0.5, "mouthUpperUp": 0.35, "mouthStretch": 0.25,
               "mouthSmile": 0.12, "tBody": 0.4},
        "iy": {"jawOpen": 0.12, "mouthLowerDown": 0.7, "mouthUpperUp": 0.4, "mouthStretch": 0.5,
               "mouthSmile": 0.3, "tBody": 0.7},
        "ah": {"jawOpen": 0.34, "mouthLowerDown": 0.3, "mouthUpperUp": 0.2},
        "er": {"jawOpen": 0.22, "mouthFunnel": 0.45, "xRound": 0.35, "mouthLowerDown": 0.1, "tBody": 0.5},
        "hh": {"jawOpen": 0.24, "mouthLowerDown": 0.3, "mouthUpperUp": 0.2},
    }.items()
}  # fmt: skip
"""Face units and the controls of `face` and `tongue`, by the viseme's name."""

SMILE = both_sides({"mouthSmile": 0.55, "cheekSquint": 0.4, "eyeSquint": 0.15, "mouthDimple": 0.1})
