"""A tiny avatar pack that is quick to write, to load and to damage."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from app.engine.background import GRID, Background, Box
from app.engine.frame import from_rgb, to_rgb
from app.engine.mmm import MorphableModel
from app.engine.modes import MESH_STEP, Modes
from app.engine.pack import FORMAT, IDLE, LOOP, MODEL, PREVIEW, Manifest, checksums, save_model, write_manifest
from app.engine.training.write_clips import write_idle, write_loop
from app.engine.trajectory import GaussianTrajectory

TINY = Box(16, 12, 24, 20)
TINY_LOOP = 4


def tiny_modes(seed: int = 0) -> Modes:
    random = np.random.default_rng(seed)
    mesh = (TINY.height // MESH_STEP, TINY.width // MESH_STEP)
    pixels = TINY.width * TINY.height * 3 // 2
    return Modes(
        width=TINY.width,
        height=TINY.height,
        flow_mean=(0.2 * random.standard_normal((*mesh, 2))).astype(np.float32),
        flow_modes=(0.1 * random.standard_normal((2, *mesh, 2))).astype(np.float32),
        texture_mean=random.uniform(60, 200, pixels).astype(np.float32),
        texture_modes=random.standard_normal((3, pixels)).astype(np.float32),
        layer=np.ones(mesh, np.float32),
        detail=random.uniform(-3, 3, pixels).astype(np.float32),
    )


def tiny_model(seed: int = 0) -> MorphableModel:
    """Three prototypes; the second is the reference."""
    random = np.random.default_rng(seed)
    images = random.integers(20, 230, (3, TINY.width * TINY.height * 3 // 2)).astype(np.float32)
    flows = random.uniform(-2, 2, (3, TINY.height, TINY.width, 2)).astype(np.float32)
    flows[1] = 0
    return MorphableModel(TINY.width, TINY.height, images, flows, 1)


def tiny_background(seed: int = 0) -> Background:
    """A loop whose head moves by odd, even and fractional pixels."""
    random = np.random.default_rng(seed)
    coarse = random.uniform(40, 220, (TINY_LOOP + 1, 7, 9, 3)).astype(np.float32)
    pictures = np.stack(
        [
            from_rgb(np.clip(cv2.resize(rgb, (64, 48), interpolation=cv2.INTER_CUBIC), 0, 255).astype(np.uint8))
            for rgb in coarse
        ]
    )
    region = Box(TINY.x - 8, TINY.y - 8, TINY.width + 16, TINY.height + 16)
    grid = (TINY_LOOP + 1, region.height // GRID + 1, region.width // GRID + 1, 2)
    shifts = np.array([(0, 0), (3, -1), (-0.5, 1.25), (2.3, 0.7), (0, 0)], np.float32)
    pose = np.broadcast_to(shifts[:, None, None], grid).copy()
    x, y = np.arange(TINY.width), np.arange(TINY.height)
    across = np.clip(np.minimum(x, TINY.width - 1 - x) / 5, 0, 1)
    down = np.clip(np.minimum(y, TINY.height - 1 - y) / 5, 0, 1)
    return Background(pictures, TINY, region, pose, np.minimum(across[None], down[:, None]).astype(np.float32))


def tiny_trajectory() -> GaussianTrajectory:
    random = np.random.default_rng(3)
    return GaussianTrajectory(
        ("AA", "M", "SIL"),
        random.standard_normal((3, 5)),
        random.uniform(0.5, 4, (3, 5)),
        random.standard_normal(5),
        random.uniform(0.5, 2, 5),
    )


def write_tiny(folder: Path, name: str = "tiny") -> Path:
    folder.mkdir(parents=True)
    background = tiny_background()
    save_model(folder / MODEL, tiny_modes(), tiny_model(), tiny_trajectory(), background)
    write_loop(folder / LOOP, background.pictures, 25)
    write_idle(folder / IDLE, background.pictures[:-1], 25)
    cv2.imwrite(str(folder / PREVIEW), to_rgb(background.pictures[0])[..., ::-1])
    manifest = {
        "format": FORMAT, "id": name, "title": "Tiny", "fps": 25, "width": 64, "height": 48, "loop_frames": TINY_LOOP,
        "voice": "mock", "licence": "CC0-1.0", "provenance": "made by a test",
        "consent": {"subject": "nobody", "statement": "noise"}, "files": checksums(folder),
    }  # fmt: skip
    write_manifest(folder, Manifest.model_validate(manifest))
    return folder
