"""Avatar packs: a folder that holds everything one avatar needs. Loading checks all of it before any is used.

    manifest.json   what it is, whose face, who agreed, which voice, and a checksum of every other file
    model.npz       modes, prototypes with flows, trajectory Gaussians, pose track and mask
    loop.mkv        the background loop and, last, the recording's rest pose; lossless
    idle.mp4        the same loop for browsers
    preview.jpg
    models/*.npz    further trajectory models and what further renderers need, if there are any

The loop is a lossless H.264 clip, a tenth of its raw size.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import av
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.engine.background import GRID, Background, Box
from app.engine.mmm import MorphableModel
from app.engine.models.gaussian import load_gaussian
from app.engine.modes import MESH_STEP, Modes
from app.engine.stored_arrays import MOST_BYTES, StoredArrays, read_arrays
from app.engine.trajectory import GaussianTrajectory
from app.errors import BadPack

FORMAT = 1
MODEL, LOOP, IDLE, PREVIEW = "model.npz", "loop.mkv", "idle.mp4", "preview.jpg"
MANIFEST = "manifest.json"
FILES = (MODEL, LOOP, IDLE, PREVIEW)
MODELS = "models"
EXTRA = re.compile(rf"{MODELS}/([a-z0-9][a-z0-9-]{{0,63}})\.npz")
"""Files that a pack may have besides."""
FPS = 25
"""Frames a second of every avatar: sound and picture of all streams share one clock."""
Half = NDArray[np.float16]


class Consent(BaseModel):
    """Whose face it is, and what they agreed to."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    subject: str = Field(min_length=1)
    statement: str = Field(min_length=1)


class Manifest(BaseModel):
    """`manifest.json`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1]
    id: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")
    title: str = Field(min_length=1)
    fps: float = Field(ge=FPS, le=FPS)
    width: int = Field(gt=0, le=4096, multiple_of=2)
    height: int = Field(gt=0, le=4096, multiple_of=2)
    loop_frames: int = Field(gt=0, le=3000)
    phone_set: Literal["ARPAbet"] = "ARPAbet"
    voice: str
    licence: str
    provenance: str
    consent: Consent
    files: dict[str, str]
    trained_on: tuple[str, ...] = ()
    """SHA-256 of the videos that were learnt from: what is measured on others is an open test."""
    trajectory: str = ""
    """The trajectory model that it speaks with unless another is asked for; empty: the one in `model.npz`."""
    renderer: str = ""
    """And what draws it; empty: the usual renderer."""

    @property
    def extras(self) -> tuple[str, ...]:
        """Names of the files in `models/`, without ending, in order."""
        matches = (EXTRA.fullmatch(name) for name in sorted(self.files))
        return tuple(match[1] for match in matches if match)


@dataclass(frozen=True)
class Pack:
    """A loaded pack: the numbers of one avatar."""

    folder: Path
    manifest: Manifest
    modes: Modes
    morphable: MorphableModel
    trajectory: GaussianTrajectory
    background: Background


def load_pack(folder: Path) -> Pack:
    """Read and check a pack.

    Raises:
        BadPack: a file is missing, changed, of another version, or holds something else than it should.
    """
    manifest = check_files(folder)
    arrays = read_arrays(folder / MODEL)
    try:
        modes = _modes(arrays)
        morphable = _morphable(arrays, modes)
        trajectory = _trajectory(arrays, modes, manifest)
        pictures = _pictures(folder / LOOP, manifest)
        background = _background(arrays, pictures, manifest, modes)
    except KeyError as error:
        raise BadPack(f"{folder / MODEL} lacks {error}", advice="Train the avatar again.") from error
    return Pack(folder, manifest, modes, morphable, trajectory, background)


def check_files(folder: Path) -> Manifest:
    """Check the manifest, and that every file it lists is there and unchanged, without reading what they hold.

    Raises:
        BadPack: see `load_pack`.
    """
    manifest = load_manifest(folder)
    others = [name for name in manifest.files if name not in FILES and not EXTRA.fullmatch(name)]
    if others or not set(FILES) <= set(manifest.files):
        raise BadPack(f"{folder}/manifest.json lists {sorted(manifest.files)}, a pack has {sorted(FILES)}")
    for name, expected in manifest.files.items():
        path = folder / name
        if path.is_symlink() or not path.is_file() or (folder / MODELS).is_symlink():
            raise BadPack(f"{path} is missing or no plain file", advice="Restore the pack from where it came.")
        if digest(path) != expected:
            raise BadPack(f"{path} is damaged: its checksum differs", advice="Restore the pack from where it came.")
    return manifest


def load_manifest(folder: Path) -> Manifest:
    """Read and check `manifest.json` alone."""
    path = folder / MANIFEST
    try:
        return Manifest.model_validate_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadPack(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BadPack(f"{path} is no text") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise BadPack(f"{path}: {where}: {first['msg']}", advice="Train the avatar again with this version.") from error


def save_model(
    path: Path, modes: Modes, morphable: MorphableModel, trajectory: GaussianTrajectory, background: Background
) -> None:
    """Write `model.npz`; pictures and flows are rounded to half precision, which costs nothing one could see."""
    arrays: dict[str, Any] = {
        "size": np.array([modes.width, modes.height]),
        "flow_mean": modes.flow_mean,
        "flow_modes": modes.flow_modes.astype(np.float16),
        "texture_mean": modes.texture_mean.astype(np.float16),
        "texture_modes": modes.texture_modes.astype(np.float16),
        "layer": modes.layer.astype(np.uint8),
        "detail": modes.detail.astype(np.float16),
        "prototypes": np.clip(np.rint(morphable.images), 0, 255).astype(np.uint8),
        "prototype_flows": morphable.flows.astype(np.float16),
        "reference": np.array([morphable.reference], np.int32),
        **trajectory.to_arrays(),
        "crop": np.array([background.crop.x, background.crop.y, background.crop.width, background.crop.height]),
        "region": np.array(
            [background.region.x, background.region.y, background.region.width, background.region.height]
        ),
        "pose": background.pose.astype(np.float16),
        "mask": np.rint(background.mask * 255).astype(np.uint8),
    }
    np.savez_compressed(path, **arrays)


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a pack, for its manifest."""
    extras = (f"{MODELS}/{path.name}" for path in sorted((folder / MODELS).glob("*.npz")))
    return {name: digest(folder / name) for name in (*FILES, *extras)}


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write `manifest.json`, last of all: a folder without one is no pack."""
    text = json.dumps(manifest.model_dump(mode="json"), indent=2, ensure_ascii=False)
    (folder / MANIFEST).write_text(text + "\n", encoding="utf-8")


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _modes(arrays: StoredArrays) -> Modes:
    width, height = (int(side) for side in arrays.numbers("size", (2,)))
    if not (0 < width <= 2048 and 0 < height <= 2048) or width % 2 or height % 2:
        raise BadPack(f"{MODEL}: the mouth region is {width}x{height}")
    mesh = (-(-height // MESH_STEP), -(-width // MESH_STEP))
    pixels = width * height * 3 // 2
    return Modes(
        width, height,
        arrays.numbers("flow_mean", (*mesh, 2)),
        arrays.numbers("flow_modes", (-1, *mesh, 2)),
        arrays.numbers("texture_mean", (pixels,)),
        arrays.numbers("texture_modes", (-1, pixels)),
        arrays.numbers("layer", mesh),
        arrays.numbers("detail", (pixels,)),
    )  # fmt: skip


def _morphable(arrays: StoredArrays, modes: Modes) -> MorphableModel:
    images = arrays.numbers("prototypes", (-1, len(modes.texture_mean)))
    flows = arrays.numbers("prototype_flows", (len(images), modes.height, modes.width, 2))
    reference = int(arrays.numbers("reference", (1,))[0])
    if not 0 <= reference < len(images):
        raise BadPack(f"{MODEL}: the reference is prototype {reference} of {len(images)}")
    return MorphableModel(modes.width, modes.height, images, flows, reference)


def _trajectory(arrays: StoredArrays, modes: Modes, manifest: Manifest) -> GaussianTrajectory:
    model = load_gaussian(arrays)
    if len(model.scale) != modes.count:
        raise BadPack(f"{MODEL}: trajectories have {len(model.scale)} coefficients, mouths {modes.count}")
    if abs(model.fps - manifest.fps) > 1e-3:
        raise BadPack(f"{MODEL}: trajectories are of {model.fps:g} frames a second, the manifest says {manifest.fps:g}")
    return model


def _pictures(path: Path, manifest: Manifest) -> NDArray[np.uint8]:
    count = 0
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            if (stream.width, stream.height) != (manifest.width, manifest.height):
                raise BadPack(f"{path} is {stream.width}x{stream.height}, not {manifest.width}x{manifest.height}")
            shape = (manifest.loop_frames + 1, manifest.height * 3 // 2, manifest.width)
            if math.prod(shape) > MOST_BYTES:
                raise BadPack(f"{path} unpacks to {math.prod(shape)} bytes, more than {MOST_BYTES}")
            pictures = np.empty(shape, np.uint8)
            for frame in container.decode(stream):
                if frame.format.name != "yuv420p" or count == len(pictures):
                    raise BadPack(f"{path} has more frames than the manifest says, or another pixel format")
                pictures[count] = frame.to_ndarray()
                count += 1
    except (OSError, IndexError, av.FFmpegError) as error:
        raise BadPack(f"{path} cannot be decoded: {error}") from error
    if count != len(pictures):
        raise BadPack(f"{path} has {count} frames, expected {len(pictures)}")
    return pictures


def _background(arrays: StoredArrays, pictures: NDArray[np.uint8], manifest: Manifest, modes: Modes) -> Background:
    crop, region = (Box(*(int(side) for side in arrays.numbers(name, (4,)))) for name in ("crop", "region"))
    for name, box in (("crop", crop), ("region", region)):
        across = 0 <= box.x < box.x + box.width <= manifest.width
        down = 0 <= box.y < box.y + box.height <= manifest.height
        if not (across and down) or any(side % 2 for side in (box.x, box.y, box.width, box.height)):
            raise BadPack(f"{MODEL}: the {name} {box} leaves the picture, is empty or is odd")
    if (crop.width, crop.height) != (modes.width, modes.height):
        raise BadPack(f"{MODEL}: the crop is {crop.width}x{crop.height}, the texture {modes.width}x{modes.height}")
    grid = (-(-region.height // GRID) + 1, -(-region.width // GRID) + 1)
    pose = arrays.numbers("pose", (len(pictures), *grid, 2))
    mask = arrays.numbers("mask", (modes.height, modes.width)) / np.float32(255)
    return Background(pictures, crop, region, pose, mask)
