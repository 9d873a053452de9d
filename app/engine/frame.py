"""Pictures as the whole house passes them: I420 planes in one array, BT.709, limited range.

A picture is a contiguous uint8 array of shape (H * 3 // 2, W): the luma plane, then both chroma planes at half
resolution. Chroma is sited as H.264's default has it: level with the even luma columns, half-way between two rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
FloatPlane = NDArray[np.float32]

KR, KB = 0.2126, 0.0722  # ITU-R BT.709-6, item 3.2
_LUMA = np.array([KR, 1 - KR - KB, KB], np.float32) * (219 / 255)
_BLUE = np.array([-KR, -(1 - KR - KB), 1 - KB], np.float32) / (2 * (1 - KB)) * (224 / 255)
_RED = np.array([1 - KR, -(1 - KR - KB), -KB], np.float32) / (2 * (1 - KR)) * (224 / 255)


def empty(width: int, height: int) -> Picture:
    """An uninitialised picture; both sides must be even."""
    if width % 2 or height % 2:
        raise ValueError(f"4:2:0 needs even sides, got {width}x{height}")
    return np.empty((height * 3 // 2, width), np.uint8)


def planes(picture: Picture) -> tuple[Picture, Picture, Picture]:
    """Views of luma (H, W) and both chroma planes (H/2, W/2) of a picture, which must be contiguous."""
    if not picture.flags.c_contiguous:
        raise ValueError("planes of a picture that is not contiguous would be copies")
    height, width = picture.shape[0] * 2 // 3, picture.shape[1]
    chroma = picture.reshape(-1)[height * width :].reshape(2, height // 2, width // 2)
    return picture[:height], chroma[0], chroma[1]


def to_planes(rgb: NDArray[np.uint8]) -> tuple[FloatPlane, FloatPlane, FloatPlane]:
    """Full-range RGB (H, W, 3) to unrounded BT.709 limited-range planes: luma (H, W), chroma (H/2, W/2) about 128."""
    colour = rgb.astype(np.float32)
    luma = colour @ _LUMA + np.float32(16)
    blue, red = (_halve(colour @ weights) + np.float32(128) for weights in (_BLUE, _RED))
    return luma, blue, red


def _halve(plane: FloatPlane) -> FloatPlane:
    """Half resolution at the declared siting: (1 2 1)/4 about even columns, the mean of two rows."""
    padded = np.pad(plane, ((0, 0), (1, 1)), mode="edge")
    across = (padded[:, :-2:2] + 2 * padded[:, 1:-1:2] + padded[:, 2::2]) * np.float32(0.25)
    halved: FloatPlane = (across[::2] + across[1::2]) * np.float32(0.5)
    return halved


def from_rgb(rgb: NDArray[np.uint8]) -> Picture:
    """RGB (H, W, 3) to a picture."""
    luma, blue, red = to_planes(rgb)
    return join(luma, blue, red)


def join(luma: FloatPlane, blue: FloatPlane, red: FloatPlane) -> Picture:
    """Planes, rounded and clipped, to a picture."""
    picture = empty(luma.shape[1], luma.shape[0])
    for target, plane in zip(planes(picture), (luma, blue, red), strict=True):
        target[...] = np.clip(np.rint(plane), 0, 255)
    return picture


def to_rgb(picture: Picture) -> NDArray[np.uint8]:
    """A picture as RGB (H, W, 3), for looking at and for previews; chroma is interpolated at its siting."""
    luma, blue, red = (plane.astype(np.float32) for plane in planes(picture))
    height, width = luma.shape
    b, r = (_double(plane - 128, height, width) * (255 / 224) for plane in (blue, red))
    y = (luma - 16) * (255 / 219)
    red_out = y + 2 * (1 - KR) * r
    blue_out = y + 2 * (1 - KB) * b
    green = (y - KR * red_out - KB * blue_out) / (1 - KR - KB)
    rgb: NDArray[np.uint8] = np.clip(np.rint(np.stack([red_out, green, blue_out], -1)), 0, 255).astype(np.uint8)
    return rgb


def _double(plane: FloatPlane, height: int, width: int) -> FloatPlane:
    columns = np.minimum(np.arange(width) / 2, plane.shape[1] - 1)
    rows = np.clip((np.arange(height) - 0.5) / 2, 0, plane.shape[0] - 1)
    x0, y0 = columns.astype(int), rows.astype(int)
    x1, y1 = np.minimum(x0 + 1, plane.shape[1] - 1), np.minimum(y0 + 1, plane.shape[0] - 1)
    fx, fy = (columns - x0).astype(np.float32), (rows - y0).astype(np.float32)[:, None]
    upper = plane[y0][:, x0] * (1 - fx) + plane[y0][:, x1] * fx
    lower = plane[y1][:, x0] * (1 - fx) + plane[y1][:, x1] * fx
    doubled: FloatPlane = upper * (1 - fy) + lower * fy
    return doubled
