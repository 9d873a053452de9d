"""Rendered mouths made clean: noise averaged away over time, and set into the still so that no seam can be seen.

Hair, background and all that does not move come from the still, which was rendered well: they do not flicker.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from avatars.mary.studio.boxes import MOUTH
from avatars.mary.studio.images import Picture, blurred, read_picture, to_bytes, write_picture
from avatars.mary.studio.smoothstep import smoothstep
from avatars.mary.studio.workspace import Workspace

NEIGHBOURS = 3  # frames before and after that are averaged in
AGREEMENT = 3.2  # levels: how far a neighbour may be off to be averaged in
STILL_WEIGHT = 1.5  # of the still, which is cleaner than any frame
MARGIN = 12  # pixels over which the box fades out
LIPS = (257 - MOUTH.x, 342 - MOUTH.y, 58, 46)  # an ellipse around the mouth's inside: centre, half axes, pixels


def rendered_frames(workspace: Workspace) -> int:
    """How many frames from the first on have been rendered."""
    same = workspace.read_mouths().representatives()
    missing = (frame for frame, first in enumerate(same) if not workspace.mouth(first).exists())
    return next(missing, len(same))


def clean_mouths(workspace: Workspace, frames: int) -> None:
    """Write the clean mouths of the first frames; those there already are kept, but for the last few."""
    same = workspace.read_mouths().representatives()
    still = read_picture(workspace.still)[MOUTH.slices]
    done = next((frame for frame in range(frames) if not workspace.clean_mouth(frame).exists()), frames)

    @lru_cache(maxsize=4 * NEIGHBOURS)
    def rendered(frame: int) -> Picture:
        return read_picture(workspace.mouth(same[frame]))

    for frame in range(max(0, done - NEIGHBOURS - 1), frames):
        around = range(max(0, frame - NEIGHBOURS), min(frames, frame + NEIGHBOURS + 1))
        others = [rendered(other) for other in around if other != frame]
        steadied = _steady(rendered(frame), others, still)
        write_picture(workspace.clean_mouth(frame), set_into(still, steadied))


def _steady(picture: Picture, neighbours: list[Picture], still: Picture) -> Picture:
    """The mean with those neighbours, and the still, that agree with the picture around each pixel."""
    soft = blurred(picture, 1.5)
    total, weight = picture.copy(), np.ones((*picture.shape[:2], 1), np.float32)
    for other, trust in [*((neighbour, 1.0) for neighbour in neighbours), (still, STILL_WEIGHT)]:
        difference = blurred(np.abs(blurred(other, 1.5) - soft).max(2), 1.5)
        share = (trust * np.exp(-((difference / AGREEMENT) ** 2)))[..., None]
        total += share * other
        weight += share
    return (total / weight).astype(np.float32)


def set_into(still: Picture, picture: Picture) -> Picture:
    """The picture's skin and mouth on the still; both are of the mouth's box."""
    mask = _skin(picture)
    return picture * mask + still * (1 - mask)


def _skin(picture: Picture) -> Picture:
    """(h, w, 1) 1 on this picture's skin (the jaw's outline moves) and in the mouth; 0 on hair, shirt and backdrop."""
    red, blue = picture[..., 0], picture[..., 2]
    warm = np.clip((red - blue - 10) / 14, 0, 1) * np.clip((red - 70) / 30, 0, 1)
    x, y = np.meshgrid(np.arange(MOUTH.width, dtype=np.float32), np.arange(MOUTH.height, dtype=np.float32))
    centre_x, centre_y, half_width, half_height = LIPS
    mouth = ((x - centre_x) / half_width) ** 2 + ((y - centre_y) / half_height) ** 2 < 1
    closed = cv2.morphologyEx(np.maximum(warm, mouth.astype(np.float32)), cv2.MORPH_CLOSE, np.ones((5, 5)))
    soft = blurred(cv2.erode(closed, np.ones((3, 3))), 0.8)
    mask: Picture = (soft * edge_ramp(MOUTH.width, MOUTH.height, MARGIN))[..., None]
    return mask


def edge_ramp(width: int, height: int, margin: int) -> Picture:
    """(h, w) 0 at the edges of a box, 1 from `margin` pixels on."""
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    nearest = np.minimum.reduce([x, width - 1 - x, y, height - 1 - y])
    return smoothstep(0, 1, nearest / margin).astype(np.float32)


def whole_frames(workspace: Workspace, frames: int) -> Iterator[NDArray[np.uint8]]:
    """The first frames of the recording, (512, 512, 3) RGB."""
    picture = to_bytes(read_picture(workspace.still))
    for frame in range(frames):
        whole = picture.copy()
        whole[MOUTH.slices] = to_bytes(read_picture(workspace.clean_mouth(frame)))
        yield whole
