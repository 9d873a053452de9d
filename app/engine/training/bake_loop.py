"""The background loop of a pack: the recording's idle frames, their mouths replaced by the model's mouth at rest.

Where skin hardly moves, the loop keeps its own pixels; the lips become the model's, so that speech starts from them
without a jump. What the loop's cleaner rendering has and the recording's frames lack (fine skin and lip texture) goes
into the model's texture as `detail`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.background import GRID, Background, Box, Mouth, Planes
from app.engine.frame import from_rgb, planes, to_planes
from app.engine.mmm import pull
from app.engine.modes import Modes, densify
from app.engine.training.chained_flow import edge_taper
from app.engine.training.fit_modes import area_ratio
from app.engine.training.recording import Recording
from app.errors import TrainingFailed

Float = NDArray[np.float32]
Array = NDArray[np.float64]


def activity(frames: NDArray[np.uint8], width: int, height: int) -> Float:
    """(H, W) standard deviation over time of the luma of (T, P) frames, smoothed by two pixels."""
    luma = frames[:, : width * height].reshape(-1, height, width)
    spread = luma.std(0, dtype=np.float64).astype(np.float32)
    return _soften(spread, 2)


def mouth_mask(active: Float) -> Float:
    """(H, W) 1 where anything moves, falling smoothly to 0 elsewhere and at the edge of the crop."""
    moving = cv2.dilate((active > 0.6).astype(np.float32), np.ones((9, 9), np.uint8))
    moving = _soften(moving, 3)
    height, width = active.shape
    mask: Float = moving * edge_taper(width, height)
    return mask


def replaced_mask(active: Float) -> Float:
    """(H, W) 1 where, or near where, anything moves visibly; 0 on calm skin.

    Where the loop's own pixels stay, they stay put while the mouth moves under them: along lips and jaw that would show
    as a ghost of the mouth at rest.
    """
    near = cv2.dilate(active, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)))
    share = np.clip((near - 0.8) / 1.2, 0, 1)
    return _soften(share * share * (3 - 2 * share), 2)


def _soften(image: NDArray[Any], sigma: float) -> Float:
    return cast(Float, cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma).astype(np.float32))


def _halve(image: Float) -> Float:
    size = (image.shape[1] // 2, image.shape[0] // 2)
    return cast(Float, cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32))


def detail_layer(modes: Modes, rest: Float, clean: Float, recorded: Float) -> Float:
    """(P,) clean minus recorded mouth at rest, pulled onto the texture grid; nothing inside the mouth, unseen at rest.

    Args:
        modes: whose grid.
        rest: (K,) coefficients at rest.
        clean, recorded: (P,) planes of the two pictures at rest.
    """
    flow = modes.flow(rest)
    size = (modes.width, modes.height)
    dense = densify(flow, *size)
    difference = clean - recorded
    width, height = size
    luma = difference[: width * height].reshape(height, width)
    half = difference[width * height :].reshape(2, height // 2, width // 2)
    pulled = pull(Planes(luma, half[0], half[1]), dense)
    seen = np.clip((area_ratio(flow) - 0.3) / 0.4, 0, 1)
    seen = cv2.GaussianBlur(cv2.erode(seen.astype(np.float32), np.ones((3, 3), np.uint8)), (0, 0), 1)
    full = cv2.resize(seen, size, interpolation=cv2.INTER_LINEAR)
    quarter = cv2.resize(seen, (width // 2, height // 2), interpolation=cv2.INTER_AREA).ravel()
    weight: Float = np.concatenate([full.ravel(), quarter, quarter]).astype(np.float32)
    result: Float = pulled * weight
    return result


def pose_track(recording: Recording, margin: int = 16) -> tuple[Box, Float]:
    """The region that mouths touch, and the pose maps (L + 1, rows, columns, 2); the last one is the still's, zero.

    The recording's dense map jumps where the face ends and hair or neck begin; a mouth drawn through it would tear
    there. The mouth belongs to the face, so each pose is the face's own motion, a smooth function of the place.
    """
    warp, step = recording.loop_map()
    crop, (width, height) = recording.crop, recording.size
    left, top = max(0, crop.x - margin), max(0, crop.y - margin)
    right, bottom = min(width, crop.x + crop.width + margin), min(height, crop.y + crop.height + margin)
    region = Box(left, top, right - left, bottom - top)
    x, y = np.meshgrid(np.arange(warp.shape[2]) * step, np.arange(warp.shape[1]) * step)
    centre = np.array([crop.x + crop.width / 2, crop.y + crop.height / 2])
    half = np.array([crop.width / 2, crop.height / 2])
    across, down = (x - centre[0]) / half[0], (y - centre[1]) / half[1]
    face = across**2 + down**2 < 1
    sampled = _quadratic(across[face], down[face])
    columns = (np.arange(0, region.width + GRID, GRID) + region.x - centre[0]) / half[0]
    rows = (np.arange(0, region.height + GRID, GRID) + region.y - centre[1]) / half[1]
    wanted = _quadratic(*np.meshgrid(columns, rows))
    maps = [wanted @ robust_fit(sampled, frame[face].astype(np.float64)) for frame in warp]
    return region, np.stack([*maps, np.zeros_like(maps[0])]).astype(np.float32)


def _quadratic(across: Array, down: Array) -> Array:
    """(..., 6) terms up to the second degree: a turning head moves its face so, within a tenth of a pixel."""
    return np.stack([np.ones_like(across), across, down, across * across, across * down, down * down], -1)


AFFINE = 3
"""The first three terms of `_quadratic`: what a flat face would do."""


def robust_fit(terms: Array, displacement: Array, *, scale: float = 0.3, rounds: int = 15) -> Array:
    """Coefficients (6, 2) of a least-squares fit that points off the face (hair, neck) do not pull along.

    Args:
        terms: (n, 6).
        displacement: (n, 2), pixels.
        scale: pixels; a point that is further off counts by the inverse square of its distance.
        rounds: of reweighting.
    """
    weight = np.ones(len(terms))
    fitted = np.zeros((terms.shape[1], 2))
    for turn in range(rounds):
        used = terms[:, :AFFINE] if turn < rounds // 2 else terms  # a bent start would bend after the hair
        root = np.sqrt(weight)[:, None]
        fitted = cast(Array, np.linalg.lstsq(used * root, displacement * root, rcond=None)[0])
        off = np.linalg.norm(displacement - used @ fitted, axis=1)
        weight = 1 / np.maximum(1, off / scale) ** 2
    return fitted


def bake(
    recording: Recording,
    frames: NDArray[np.uint8],
    modes: Modes,
    rest: Float,
    recorded_rest: Float,
    mouth: Callable[[Modes, Background], Mouth],
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Modes, Background]:
    """The pack's background, and the modes with their detail layer.

    Args:
        recording: whose loop and still.
        frames: (T, P) planes of the frames learnt from: where they differ, the mouth moves.
        modes: without detail.
        rest: (K,) coefficients at rest.
        recorded_rest: (P,) mean planes of the recorded frames at rest.
        mouth: makes what draws mouths.
        progress: told the share done.

    Raises:
        TrainingFailed: still, loop or pose track are missing or do not fit the recording.
    """
    crop = recording.crop
    still = recording.still()
    cut = still[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]
    clean = np.concatenate([plane.ravel() for plane in to_planes(cut)])
    modes = replace(modes, detail=detail_layer(modes, rest, clean, recorded_rest))
    active = activity(frames, crop.width, crop.height)
    mask = mouth_mask(active)
    pictures = [from_rgb(frame) for frame in recording.loop()]
    still_picture = from_rgb(still)
    half = (slice(crop.y // 2, (crop.y + crop.height) // 2), slice(crop.x // 2, (crop.x + crop.width) // 2))
    size, quarter = crop.width * crop.height, crop.width * crop.height // 4
    luma, blue, red = planes(still_picture)
    parts = np.split(np.clip(np.rint(recorded_rest), 0, 255).astype(np.uint8), [size, size + quarter])
    inside = cv2.erode((mask > 0).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
    soft = _soften(inside, 2) * mask
    _mix(luma[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width], parts[0].reshape(mask.shape), soft)
    soft_half = _halve(soft)
    for plane, part in ((blue, parts[1]), (red, parts[2])):
        _mix(plane[half], part.reshape(soft_half.shape), soft_half)
    region, pose = pose_track(recording)
    if len(pose) != len(pictures) + 1:
        raise TrainingFailed(f"the loop has {len(pictures)} frames, its pose track {len(pose) - 1}")
    background = Background(np.stack([*pictures, still_picture]), crop, region, pose, mask)
    drawer = mouth(modes, background)
    drawn = Planes.empty(region.width, region.height)
    replace_lips = Background(background.pictures, crop, region, pose, replaced_mask(active) * (mask > 0))
    for index in range(len(pictures)):
        progress(index / len(pictures))
        drawer.draw(rest, index, drawn)
        luma_weight, chroma_weight = replace_lips.posed_mask(index)
        picture = background.pictures[index]
        _mix(region.luma(picture), drawn.luma, luma_weight)
        for plane, drawn_plane in zip(region.chroma(picture), (drawn.blue, drawn.red), strict=True):
            _mix(plane, drawn_plane, chroma_weight)
    return modes, background


def _mix(target: NDArray[np.uint8], source: NDArray[np.uint8] | Float, weight: Float) -> None:
    """target += weight * (source - target), rounded."""
    mixed = target + weight * (source.astype(np.float32) - target)
    target[...] = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
