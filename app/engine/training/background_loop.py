"""The background loop of a pack: pictures of the recording, their mouths replaced by the model's mouth at rest.

Speech starts from the lips that the loop shows, so they are the model's. What the pictures have beyond the model stays:
in what repeats from picture to picture (fine skin and lip texture) it becomes the texture's `detail` and moves along
with the mouth; the rest, the camera's noise, stays where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from app.engine.background import GRID, Background, Box, Mouth, Planes
from app.engine.frame import Picture
from app.engine.mmm import pull
from app.engine.modes import Modes, densify, draw_crop, split_texture
from app.engine.training.corpus import Corpus
from app.engine.training.fit_modes import area_ratio
from app.engine.training.footage import shots
from app.engine.training.landmark_flow import dense_flow
from app.engine.training.registration import Correction
from app.engine.training.survey import cut
from app.errors import TrainingFailed

Float = NDArray[np.float32]
Array = NDArray[np.float64]

NOISE_BLUR = 1.5
"""Pixels: what is coarser than this in the difference between picture and model is no noise."""
NOISE_LIMIT = 2.5
"""Deviations beyond which a difference is no noise either."""
LEAST_RESTING = 12
"""Pictures at rest that detail is learnt from at least."""
BENT = 1.5
"""Frames: smoothing in time of what bends a pose beyond an affine map."""


@dataclass(frozen=True)
class LoopPicture:
    """One picture of the loop to be.

    Attributes:
        picture: (H * 3 // 2, W), as recorded.
        warp: (2, 3) affine from the crop's coordinates to the picture's.
        light: of its passage.
        coefficients: (K,) of its mouth; None where it is known to rest.
    """

    picture: Picture
    warp: Array
    light: Correction
    coefficients: Float | None


def crop_warp(pose: Array, crop: Box, correction: Correction) -> Array:
    """(2, 3) from crop coordinates to a picture's, for its pose and its passage's correction."""
    to_reference = np.array([[1, 0, crop.x], [0, 1, crop.y], [0, 0, 1.0]])
    warp: Array = pose @ to_reference @ np.vstack([correction.warp, [0, 0, 1]])
    return warp


def loop_pictures(
    corpus: Corpus, coefficients: Float, mixed: list[list[tuple[int, float]]]
) -> Iterator[tuple[int, LoopPicture]]:
    """Every recorded picture that the loop needs, each once, with its corpus frame number, take by take."""
    needed = sorted({number for parts in mixed for number, _ in parts})
    takes = np.searchsorted(corpus.starts, needed, side="right") - 1
    ends = np.array([passage.frames.stop for passage in corpus.passages])
    owner = dict(zip(needed, np.searchsorted(ends, needed, side="right").tolist(), strict=True))
    for take in dict.fromkeys(takes.tolist()):
        start = int(corpus.starts[take])
        wanted = {number - start for number, of in zip(needed, takes, strict=True) if of == take}
        for at, shot in enumerate(shots(corpus.takes[take].video)):
            if at in wanted:
                number = start + at
                correction = corpus.corrections[owner[number]]
                warp = crop_warp(corpus.poses[number], corpus.crop, correction)
                mouth = None if corpus.rest[number] else coefficients[number]
                yield number, LoopPicture(shot.picture.copy(), warp, correction, mouth)
            if at >= max(wanted):
                break


def region_of(warps: list[Array], crop: Box, size: tuple[int, int]) -> Box:
    """The part of the picture that the crop touches at any pose, all numbers even."""
    corners = np.array([[0, crop.width, 0, crop.width], [0, 0, crop.height, crop.height], [1, 1, 1, 1]])
    points = np.concatenate([warp @ corners for warp in warps], 1)
    left, top = (max(0, 2 * int(np.floor(low / 2))) for low in points.min(1))
    right = min(size[0], 2 * int(np.ceil(points[0].max() / 2)))
    bottom = min(size[1], 2 * int(np.ceil(points[1].max() / 2)))
    if right - left < 2 or bottom - top < 2:
        raise TrainingFailed("the mouth leaves the picture")
    return Box(left, top, right - left, bottom - top)


def pose_map(warp: Array, region: Box, crop: Box, bend: Array | None = None) -> Float:
    """(rows, columns, 2) displacement from each `GRID`th pixel of the region to its point in the reference picture.

    Args:
        warp: from crop coordinates to the picture's.
        region: of the picture.
        crop: in the reference picture.
        bend: (6, 2) quadratic displacement from the stabilised crop to the reference's, in the terms of `quadratic`.
    """
    columns = np.arange(0, region.width + GRID, GRID) + region.x
    rows = np.arange(0, region.height + GRID, GRID) + region.y
    x, y = np.meshgrid(columns.astype(np.float64), rows.astype(np.float64))
    inverse = np.linalg.inv(np.vstack([warp, [0, 0, 1]]))[:2]
    inside: Array = np.stack([x, y, np.ones_like(x)], -1) @ inverse.T
    if bend is not None:
        inside = inside + quadratic(*_unit(inside[..., 0], inside[..., 1], crop)) @ bend
    moved: Float = (inside + np.array([crop.x, crop.y]) - np.stack([x, y], -1)).astype(np.float32)
    return moved


def _unit(x: Array, y: Array, crop: Box) -> tuple[Array, Array]:
    """Crop coordinates with the crop's edges at -1 and 1."""
    return (x - (crop.width - 1) / 2) / (crop.width / 2), (y - (crop.height - 1) / 2) / (crop.height / 2)


def quadratic(across: Array, down: Array) -> Array:
    """(..., 6) terms up to the second degree: a turning head moves its face so, within a tenth of a pixel."""
    return np.stack([np.ones_like(across), across, down, across * across, across * down, down * down], -1)


AFFINE = 3
"""The first three terms of `quadratic`: what a flat face would do."""


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


def bends(crops: list[NDArray[np.uint8]], rest: Float, mask: Float, crop: Box, *, circular: bool) -> list[Array]:
    """For pictures that all show the mouth at rest: how each differs from the reference by more than its affine.

    A head that turns brings near points further than far ones. Flow between the stabilised crop and the mouth at rest
    is fitted by a quadratic, smoothed in time.

    Args:
        crops: (P,) planes each, stabilised.
        rest: (h, w) luma of the mouth at rest.
        mask: (h, w) where the face is.
        crop: its size counts.
        circular: whether the first picture follows the last.
    """
    y, x = np.mgrid[: crop.height : 2, : crop.width : 2].astype(np.float64)
    face = mask[::2, ::2] > 0.5
    terms = quadratic(*_unit(x[face], y[face], crop))
    found = []
    for flat in crops:
        luma = flat[: crop.width * crop.height].reshape(crop.height, crop.width).astype(np.float32)
        flow = dense_flow(luma, rest)[::2, ::2][face].astype(np.float64)
        found.append(robust_fit(terms, flow))
    smooth: Array = gaussian_filter1d(np.stack(found), BENT, axis=0, mode="wrap" if circular else "nearest")
    return list(smooth)


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
    pulled = pull(split_texture((clean - recorded).astype(np.float32), *size), dense)
    width, height = size
    seen = np.clip((area_ratio(flow) - 0.3) / 0.4, 0, 1)
    seen = cv2.GaussianBlur(cv2.erode(seen.astype(np.float32), np.ones((3, 3), np.uint8)), (0, 0), 1)
    full = cv2.resize(seen, size, interpolation=cv2.INTER_LINEAR)
    quarter = cv2.resize(seen, (width // 2, height // 2), interpolation=cv2.INTER_AREA).ravel()
    weight: Float = np.concatenate([full.ravel(), quarter, quarter]).astype(np.float32)
    result: Float = pulled * weight
    return result


@dataclass(frozen=True)
class Bake:
    """Makes the pictures of a loop from recorded ones.

    Attributes:
        modes: with their detail.
        rest: (K,) the mouth at rest.
        background: with poses and mask, and room for the pictures.
        mouth: draws mouths on it.
    """

    modes: Modes
    rest: Float
    background: Background
    mouth: Mouth

    def replace_mouth(self, shown: LoopPicture, index: int) -> Picture:
        """The picture with the model's mouth at rest in place of its own, in its light and with its noise."""
        region = self.background.region
        picture = shown.picture.copy()
        luma_weight, chroma_weight = self.background.posed_mask(index)
        drawn = Planes.empty(region.width, region.height)
        self.mouth.draw(self.rest, index, drawn)
        light = shown.light
        rest = [drawn.luma * light.gain + light.bias, drawn.blue + light.tint[0], drawn.red + light.tint[1]]
        own = self.rest if shown.coefficients is None else shown.coefficients
        self.mouth.draw(own, index, drawn)
        model = [drawn.luma * light.gain + light.bias, drawn.blue + light.tint[0], drawn.red + light.tint[1]]
        targets = (region.luma(picture), *region.chroma(picture))
        for target, plane, seen, weight in zip(
            targets, rest, model, (luma_weight, chroma_weight, chroma_weight), strict=True
        ):
            difference = target.astype(np.float32) - seen
            own_light = _soft(difference, weight) if shown.coefficients is None else np.float32(0)
            mixed = target + weight * (plane + own_light + noise_of(difference) - target)
            target[...] = np.clip(np.rint(mixed), 0, 255)
        return picture


def noise_of(difference: Float) -> Float:
    """The noise in a difference (h, w) between a picture and its model: fine, and nowhere large."""
    fine = difference - cv2.GaussianBlur(difference, (0, 0), NOISE_BLUR)
    deviation = 1.4826 * float(np.median(np.abs(fine))) + 1e-3
    return cast(Float, np.clip(fine, -NOISE_LIMIT * deviation, NOISE_LIMIT * deviation))


def _soft(difference: Float, weight: Float) -> Float:
    """What the light of one picture adds to the model, smooth over a third of the mask."""
    sigma = weight.shape[1] / 10
    total = cv2.GaussianBlur(difference * weight, (0, 0), sigma)
    return total / np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 0.05)  # type: ignore[return-value]


def bake_loop(
    shown: Callable[[], Iterator[tuple[int, LoopPicture]]],
    mixed: list[list[tuple[int, float]]],
    still: Picture,
    modes: Modes,
    rest: Float,
    common: Float,
    crop: Box,
    mask: Float,
    mouth: Callable[[Modes, Background], Mouth],
    *,
    all_at_rest: bool,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Modes, Background]:
    """The pack's background, and the modes with their detail layer.

    Args:
        shown: starts a pass over the pictures that the loop needs.
        mixed: what each picture of the loop is mixed from (`app.engine.training.stretches.joined`).
        still: the reference picture.
        modes: without detail.
        rest: (K,) coefficients at rest.
        common: (P,) mean recorded picture at rest.
        crop, mask: of the mouth.
        mouth: makes what draws mouths.
        all_at_rest: whether every picture shows the mouth at rest: its pose and its light can then be found on the
            mouth itself.
        progress: told the share done.
    """
    height, width = still.shape[0] * 2 // 3, still.shape[1]
    warps: dict[int, Array] = {}
    crops: dict[int, NDArray[np.uint8]] = {}
    for number, each in shown():
        if each.picture.shape != still.shape:
            raise TrainingFailed("the loop's pictures are not of the size of the recording's")
        warps[number] = each.warp
        if each.coefficients is None:
            flat = cut(each.picture, each.warp, Box(0, 0, crop.width, crop.height))
            crops[number] = each.light.undo(flat, crop.width * crop.height)
    luma = draw_crop(modes, rest).luma
    bend: dict[int, Array] = {}
    if all_at_rest:
        order = sorted(crops)
        bent = bends([crops[number] for number in order], luma, mask, crop, circular=True)
        bend = dict(zip(order, bent, strict=True))
    resting = [_unbent(crops[number], bend.get(number), crop) for number in crops]
    if len(resting) >= LEAST_RESTING:
        clean = np.mean(resting, 0).astype(np.float32)
        modes = replace(modes, detail=detail_layer(modes, rest, clean, common))
    region = region_of([*warps.values(), np.array([[1, 0, crop.x], [0, 1, crop.y]])], crop, (width, height))
    poses = []
    for parts in mixed:
        maps = [share * pose_map(warps[number], region, crop, bend.get(number)) for number, share in parts]
        poses.append(np.sum(maps, 0))
    zero = np.zeros_like(poses[0])
    pictures = np.zeros((len(mixed) + 1, *still.shape), np.uint8)
    pictures[-1] = _still(still, common, crop, mask)
    background = Background(pictures, crop, region, np.stack([*poses, zero]).astype(np.float32), mask)
    baking = Bake(modes, rest, background, mouth(modes, background))
    sums: dict[int, Float] = {}
    wanted: dict[int, list[tuple[int, float]]] = {}
    for place, parts in enumerate(mixed):
        for number, share in parts:
            wanted.setdefault(number, []).append((place, share))
    for done, (number, each) in enumerate(shown()):
        for place, share in wanted[number]:  # of pictures that are mixed, both mouths have the pose of the mix
            baked = baking.replace_mouth(each, place)
            if len(mixed[place]) == 1:
                pictures[place] = baked
                continue
            sums[place] = sums.get(place, np.zeros(still.shape, np.float32)) + np.float32(share) * baked
        progress(done / max(1, len(warps)))
    for place, total in sums.items():
        pictures[place] = np.clip(np.rint(total), 0, 255)
    return modes, background


def _unbent(flat: NDArray[np.uint8], bend: Array | None, crop: Box) -> Float:
    """(P,) a stabilised crop with its bend taken away."""
    size = (crop.width, crop.height)
    own = split_texture(flat.astype(np.float32), *size)
    if bend is None:
        return flat.astype(np.float32)
    y, x = np.mgrid[: crop.height, : crop.width].astype(np.float64)
    back = quadratic(*_unit(x, y, crop)) @ bend  # small and smooth: its own inverse up to sign
    return pull(own, (-back).astype(np.float32))


def _still(still: Picture, common: Float, crop: Box, mask: Float) -> Picture:
    """The reference picture with the recording's mean mouth at rest."""
    picture = still.copy()
    parts = split_texture(common, crop.width, crop.height)
    half = cv2.resize(mask, (crop.width // 2, crop.height // 2), interpolation=cv2.INTER_AREA)
    shown = (crop.luma(picture), *crop.chroma(picture))
    for target, part, weight in zip(shown, parts.each(), (mask, half, half), strict=True):
        target[...] = np.clip(np.rint(target + weight * (part - target)), 0, 255)
    return picture
