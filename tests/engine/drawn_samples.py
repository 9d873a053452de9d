"""A library of samples for the tiny pack, and a pack with it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
from tiny_pack import TINY, tiny_background

from app.engine.membrane import Stitcher
from app.engine.pack import MODEL, MODELS, checksums, digest, load_manifest, write_manifest
from app.engine.selection import still_crop
from app.engine.selection_library import NAME, SampleLibrary, save_library
from app.engine.training.selection_samples import encoded

SAMPLES = 40
BREAK = 20
"""Where a second passage begins."""


def drawn_samples(seed: int = 0) -> SampleLibrary:
    """Mouths that walk about, two passages."""
    random = np.random.default_rng(seed)
    background = tiny_background()
    still, stitcher = still_crop(background), Stitcher(background.mask)
    phase, pace = random.uniform(0, 6, 5), random.uniform(0.2, 0.5, 5)
    rows = (1.5 * np.sin(np.arange(SAMPLES)[:, None] * pace + phase)).astype(np.float32)
    shapes = random.normal(0, 6, (5, len(still))).astype(np.float32)
    pictures = np.stack([stitcher.stitched(still + 15 + row @ shapes, still) for row in rows])
    follows = np.ones(SAMPLES, bool)
    follows[[0, BREAK]] = False
    lips = (np.eye(5) * [1, 0.8, 0.6, 0.4, 0.2]).astype(np.float32)
    return SampleLibrary(
        TINY.width, TINY.height, np.clip(np.rint(pictures), 0, 255).astype(np.uint8), rows, follows, lips,
        (4, 16, 4, 20),
    )  # fmt: skip


def add_samples(tiny: Path, folder: Path) -> SampleLibrary:
    """Copy the tiny pack and put samples into it."""
    shutil.copytree(tiny, folder)
    library = drawn_samples()
    save_library(folder / MODELS / f"{NAME}.npz", library, encoded(library), modes=digest(folder / MODEL))
    manifest = load_manifest(folder)
    write_manifest(folder, manifest.model_copy(update={"files": checksums(folder)}))
    return library
