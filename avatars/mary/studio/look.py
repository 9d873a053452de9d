"""What makes Mary herself: every number of her shape, colours, hair and lighting that is a matter of taste."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Colour = tuple[float, float, float]
"""Linear RGB, 0..1."""


@dataclass(frozen=True)
class Look:
    """Lengths are in decimetres of MakeHuman's frame (x to her left, y up, z to the front), y often from the eyes up.

    Attributes:
        shape: weights of MakeHuman's shape targets (path under `targets`, without ending).
        expression: face units at rest; a pose that names the same unit replaces it.
        skin, skin_patches, skin_red, skin_yellow, skin_dark: colours that noise and masks mix.
        freckles: how strong, 0..1.
        lip, lip_patches, lip_share: lip colours and how much of them covers the skin.
        scalp: colour of the skin under the hair.
        iris, iris_inner, enamel, shirt: further colours.
        hair_melanin, brow_melanin, lash_melanin: darkness, 0..1; at 0.86 the colours of `hair_material` are as
            written there.
        hair_strands, hair_width: how many (about), and a factor on their thickness.
        hairline: height of the hairline over the eyes at the azimuths `HAIRLINE_AZIMUTHS`.
        parting: x of the parting.
        hair_end: height of the hair's end over the eyes.
        clumping: how much strands of hair stick together, 0..1.
        brow: rows of (x, height over the eyes, half thickness) from the inner to the outer end.
        brow_strands, lash_strands: hairs a side.
        collar_height, collar_tilt: of the plane that cuts the shirt from the body, from the neck joint; forward slope.
        frame_height: what the picture's height shows at the face, dm.
        frame_centre: how far under the eyes the picture's centre is.
        key, fill, catch, rim_right, rim_left: lamps, watts. The catch light is small: it makes the glint in the eyes.
        ambience: strength of the light from everywhere.
        backdrop_edge, backdrop_centre: colours.
    """

    shape: Mapping[str, float] = field(
        default_factory=lambda: {
            "macrodetails/caucasian-female-young": 1.0,
            "macrodetails/universal-female-young-averagemuscle-averageweight": 1.0,
            "head/head-oval": 0.5,
            "neck/neck-scale-horiz-decr": 0.5,
            "eyes/l-eye-scale-incr": 0.35,
            "eyes/r-eye-scale-incr": 0.35,
            "chin/chin-width-decr": 0.25,
            "mouth/mouth-lowerlip-volume-incr": 0.25,
            "mouth/mouth-upperlip-volume-incr": 0.2,
            "head/head-age-incr": 0.12,
            "nose/nose-point-width-decr": 0.2,
            "eyebrows/eyebrows-trans-down": 0.3,
        }
    )
    expression: Mapping[str, float] = field(
        default_factory=lambda: {
            "eyeWideLeft": 0.24,
            "eyeWideRight": 0.20,
            "mouthSmileLeft": 0.19,
            "mouthSmileRight": 0.165,
            "browInnerUp": 0.03,
            "browOuterUpLeft": 0.05,
        }
    )
    skin: Colour = (0.56, 0.31, 0.21)
    skin_patches: Colour = (0.62, 0.37, 0.26)
    skin_red: Colour = (0.50, 0.17, 0.12)
    skin_yellow: Colour = (0.62, 0.39, 0.24)
    skin_dark: Colour = (0.30, 0.13, 0.085)
    freckles: float = 0.45
    lip: Colour = (0.40, 0.105, 0.10)
    lip_patches: Colour = (0.47, 0.15, 0.135)
    lip_share: float = 0.85
    scalp: Colour = (0.03, 0.018, 0.012)
    iris: Colour = (0.045, 0.040, 0.024)
    iris_inner: Colour = (0.06, 0.03, 0.012)
    enamel: Colour = (0.56, 0.49, 0.385)
    shirt: Colour = (0.02, 0.03, 0.05)
    hair_melanin: float = 0.86
    brow_melanin: float = 0.82
    lash_melanin: float = 0.97
    hair_strands: int = 42_000
    hair_width: float = 1.25
    hairline: tuple[float, ...] = (0.72, 0.70, 0.62, 0.50, 0.34, -0.02, -0.10, 0.20, -0.05, -0.45, -0.75, -0.8)
    parting: float = 0.26
    hair_end: float = -1.02
    clumping: float = 0.9
    brow: tuple[tuple[float, float, float], ...] = (
        (0.125, 0.165, 0.036),
        (0.20, 0.188, 0.042),
        (0.30, 0.212, 0.036),
        (0.39, 0.215, 0.026),
        (0.45, 0.200, 0.018),
        (0.50, 0.180, 0.010),
    )
    brow_strands: int = 640
    lash_strands: int = 95
    collar_height: float = 0.12
    collar_tilt: float = -0.42
    frame_height: float = 3.25
    frame_centre: float = 0.20
    key: float = 34
    fill: float = 5
    catch: float = 8
    rim_right: float = 4.0
    rim_left: float = 3.0
    ambience: float = 0.20
    backdrop_edge: Colour = (0.10, 0.115, 0.13)
    backdrop_centre: Colour = (0.33, 0.36, 0.39)


HAIRLINE_AZIMUTHS = (0, 20, 38, 50, 60, 72, 84, 95, 112, 130, 155, 180)
"""Degrees from the front; where `Look.hairline` is given."""

MARY = Look()
