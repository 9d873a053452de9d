"""How much skin flickers that should be at rest: a figure for the choice of samples and denoiser."""

from __future__ import annotations

import numpy as np

from avatars.mary.studio.boxes import Box
from avatars.mary.studio.images import read_picture
from avatars.mary.studio.workspace import Workspace

PATCHES = {"nose": Box(74, 2, 28, 20), "right cheek": Box(2, 2, 20, 38), "left cheek": Box(154, 2, 20, 38),
           "neck": Box(70, 136, 36, 11)}  # fmt: skip
"""Within the mouth's box."""


def flicker(workspace: Workspace, frames: range) -> None:
    """Print, for each patch, levels of 255: spread over time, mean and largest change from frame to frame."""
    for name, path in (("rendered", workspace.mouth), ("clean", workspace.clean_mouth)):
        files = [path(frame) for frame in frames]
        if not all(file.exists() for file in files):
            continue
        pictures = np.stack([read_picture(file) for file in files])
        for patch, box in PATCHES.items():
            rows, columns = box.slices
            seen = pictures[:, rows, columns]
            change = np.abs(np.diff(seen, axis=0))
            step = np.abs(np.diff(seen.mean((1, 2)), axis=0)).max()
            print(
                f"{name:8} {patch:11} spread {seen.std(0).mean():.2f}  mean change {change.mean():.2f}  "
                f"99th percentile {np.percentile(change, 99):.1f}  largest step of the patch's mean {step:.2f}"
            )
