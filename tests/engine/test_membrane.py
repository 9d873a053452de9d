from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.membrane import Membrane, Stitcher

Float = NDArray[np.float32]
HEIGHT, WIDTH = 60, 80


def ellipse() -> NDArray[np.bool_]:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    inside: NDArray[np.bool_] = ((x - 40) / 26) ** 2 + ((y - 30) / 20) ** 2 < 1
    return inside


def rectangle() -> NDArray[np.bool_]:
    inside = np.zeros((HEIGHT, WIDTH), bool)
    inside[10:50, 14:66] = True
    return inside


def smooth_target() -> Float:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.rint(110 + 0.4 * x + 10 * np.sin(y / 15)).astype(np.float32)


def textured_source() -> Float:
    """Another light, and something in the middle."""
    texture = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 60, (24, 36)).astype(np.float32), (0, 0), 1.5)
    source = np.tile(70 + 0.3 * np.arange(WIDTH, dtype=np.float32), (HEIGHT, 1))
    source[18:42, 22:58] += texture
    return np.clip(np.rint(source), 0, 255).astype(np.float32)


def test_a_membrane_is_the_mean_of_its_neighbours_and_keeps_the_edge() -> None:
    edge = np.random.default_rng(1).uniform(-20, 20, (HEIGHT, WIDTH)).astype(np.float32)
    membrane = Membrane(ellipse())
    found = membrane.stretch(edge)
    around = (found[:-2, 1:-1] + found[2:, 1:-1] + found[1:-1, :-2] + found[1:-1, 2:]) / 4
    inside = membrane.inside[1:-1, 1:-1]
    np.testing.assert_allclose(found[1:-1, 1:-1][inside], around[inside], atol=1e-4)
    assert np.array_equal(found[~membrane.inside], edge[~membrane.inside])
    assert found[membrane.inside].max() <= edge[membrane.edge].max()


def test_a_plane_is_its_own_membrane_even_where_the_region_touches_the_edge() -> None:
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    np.testing.assert_allclose(Membrane(np.ones((HEIGHT, WIDTH), bool)).stretch(2 * x - y), 2 * x - y, atol=1e-3)


@pytest.mark.parametrize(("region", "most", "usual"), [(rectangle, 4.0, 1.0), (ellipse, None, 2.5)])
def test_it_stitches_as_opencv_does(region, most: float | None, usual: float) -> None:  # type: ignore[no-untyped-def]
    # OpenCV solves on the mask's bounding box and keeps the target's gradients outside of the mask: in a rectangle
    # nearly the same equations, elsewhere not along the edge.
    inside, source, target = region(), textured_source(), smooth_target()
    x, y, width, height = cv2.boundingRect(inside.astype(np.uint8))
    three = [np.repeat(plane.astype(np.uint8)[..., None], 3, 2) for plane in (source, target)]
    centre = (x + width // 2, y + height // 2)
    cloned = cv2.seamlessClone(*three, inside.astype(np.uint8) * 255, centre, cv2.NORMAL_CLONE)[..., 0].astype(float)
    membrane = Membrane(inside)
    mine = np.where(membrane.inside, source + membrane.stretch(target - source), target)
    assert np.abs(source - cloned)[inside].mean() > 20
    assert np.sqrt(((mine - cloned) ** 2).mean()) < usual
    if most is not None:
        assert np.abs(mine - cloned).max() < most


def planes_of(luma: Float) -> Float:
    half = cv2.resize(luma, (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA)
    return np.concatenate([luma.ravel(), half.ravel(), half.ravel()])


def test_stitched_planes_are_the_target_outside_and_have_the_sources_gradients_inside() -> None:
    mask = ellipse().astype(np.float32)
    source, target = textured_source(), smooth_target()
    found = Stitcher(mask).stitched(planes_of(source), planes_of(target))
    luma = found[: WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)
    assert np.array_equal(luma[mask == 0], target[mask == 0])
    left = cv2.Laplacian(luma - source, cv2.CV_32F)  # of what was added: nothing
    assert np.abs(left[cv2.erode(mask, np.ones((3, 3))) > 0]).max() < 1e-3
    blue = found[WIDTH * HEIGHT :][: WIDTH * HEIGHT // 4].reshape(HEIGHT // 2, WIDTH // 2)
    half = planes_of(target)[WIDTH * HEIGHT :][: WIDTH * HEIGHT // 4].reshape(HEIGHT // 2, WIDTH // 2)
    assert np.array_equal(blue[0], half[0])


def test_a_wall_seen_beyond_the_cheek_does_not_spread_over_the_mouth() -> None:
    mask = ellipse().astype(np.float32)
    source, target = textured_source(), smooth_target()
    walled = target.copy()
    walled[:, 62:] += 90
    stitcher = Stitcher(mask)
    plain, beside = (stitcher.stitched(planes_of(source), planes_of(each)) for each in (target, walled))
    difference = (beside - plain)[: WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)
    assert np.abs(difference[20:40, 20:58]).max() < 8
    membrane = Membrane(mask > 0)
    spread = membrane.stretch(walled - source) - membrane.stretch(target - source)
    assert np.abs(spread[20:40, 20:58]).max() > 30
