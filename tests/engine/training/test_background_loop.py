from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from drawn_recording import CROP, HEIGHT, LIGHT, LIT, OPENING, WIDTH, lit, picture
from numpy.typing import NDArray

from app.engine.background import GRID, STILL, Background, Box, Compositor, Planes
from app.engine.frame import Picture, from_rgb, planes
from app.engine.modes import ModeMouth, Modes, draw_crop
from app.engine.training.appearance import Appearance
from app.engine.training.background_loop import (
    Bake,
    LoopPicture,
    bake_loop,
    bends,
    crop_warp,
    detail_layer,
    loop_pictures,
    noise_of,
    pose_map,
    quadratic,
    region_of,
    robust_fit,
)
from app.engine.training.corpus import Corpus
from app.engine.training.registration import UNCORRECTED, Correction
from app.engine.training.stretches import DISSOLVE, Stretch, joined
from app.engine.training.survey import cut
from app.errors import TrainingFailed

Float = NDArray[np.float32]
Array = NDArray[np.float64]
Mixed = list[list[tuple[int, float]]]

TURNED = np.array([[1.03, 0.05, 21.3], [-0.04, 0.98, 30.6]])
"""From crop to picture."""


def test_the_way_from_crop_to_picture_goes_through_correction_and_pose() -> None:
    correction = Correction(np.array([[1.01, 0.02, -0.7], [0.0, 0.99, 0.4]]))
    pose = np.array([[0.9, -0.1, 5.0], [0.1, 0.9, -2.0]])
    point = np.array([13.0, 9.0])
    corrected = correction.warp[:, :2] @ point + correction.warp[:, 2]
    expected = pose[:, :2] @ (corrected + np.array((CROP.x, CROP.y))) + pose[:, 2]
    np.testing.assert_allclose(crop_warp(pose, CROP, correction) @ [*point, 1], expected)


def test_the_region_holds_the_crop_at_every_pose_and_lies_in_the_picture() -> None:
    still = np.array([[1, 0, CROP.x], [0, 1, CROP.y]], float)
    region = region_of([still, TURNED], CROP, (WIDTH, HEIGHT))
    corners = np.array([[x, y, 1] for x in (0, CROP.width) for y in (0, CROP.height)], float)
    points = np.concatenate([corners @ still.T, corners @ TURNED.T])
    assert not any(side % 2 for side in (region.x, region.y, region.width, region.height))
    assert (points >= (region.x, region.y)).all()
    assert (points <= (region.x + region.width, region.y + region.height)).all()
    assert region.width <= np.ptp(points[:, 0]) + 4
    far = still + np.array([[0, 0, 60], [0, 0, -40]])
    cut_off = region_of([far], CROP, (WIDTH, HEIGHT))
    assert (cut_off.y, cut_off.x + cut_off.width) == (0, WIDTH)
    with pytest.raises(TrainingFailed, match="leaves the picture"):
        region_of([still + np.array([[0, 0, 200], [0, 0, 0]])], CROP, (WIDTH, HEIGHT))


def posed(warp: Array, bend: Array | None = None) -> Background:
    region = Box(10, 14, 94, 86)
    pose = np.stack([pose_map(warp, region, CROP, bend), np.zeros((23, 25, 2), np.float32)])
    return Background(
        np.zeros((2, HEIGHT * 3 // 2, WIDTH), np.uint8), CROP, region, pose, np.ones((56, 64), np.float32)
    )


def test_points_of_the_crop_are_where_the_pose_puts_them() -> None:
    background = posed(TURNED)
    assert background.pose.shape == (2, -(-86 // GRID) + 1, -(-94 // GRID) + 1, 2)
    points = np.array([[0, 0], [63, 0], [31.5, 20], [10, 55], [63, 55]])
    shown = np.column_stack([points, np.ones(5)]) @ TURNED.T - (background.region.x, background.region.y)
    np.testing.assert_allclose(background.forward(0, points.astype(np.float32)), shown, atol=0.02)
    where = background.backward(0)
    for x, y in ((3, 8), (50, 40), (90, 80)):
        inverse = np.linalg.inv(np.vstack([TURNED, [0, 0, 1]]))
        expected = (inverse @ [x + background.region.x, y + background.region.y, 1])[:2]
        np.testing.assert_allclose(where[y, x], expected, atol=0.02)
    np.testing.assert_allclose(background.forward(1, points), points + np.array((CROP.x - 10, CROP.y - 14)), atol=1e-5)


def test_a_bend_moves_points_of_the_crop_further() -> None:
    bend = np.random.default_rng(0).normal(0, 0.5, (6, 2))
    straight, bent = posed(TURNED).backward(0), posed(TURNED, bend).backward(0)
    for x, y in ((20, 30), (50, 40), (70, 60)):
        inside = straight[y, x].astype(float)
        u, v = (inside[0] - 31.5) / 32, (inside[1] - 27.5) / 28
        expected = inside + np.array([1, u, v, u * u, u * v, v * v]) @ bend
        np.testing.assert_allclose(bent[y, x], expected, atol=0.05)


def test_the_terms_of_a_bend() -> None:
    np.testing.assert_array_equal(
        quadratic(np.array([2.0, 0.0]), np.array([3.0, -1.0])), [[1, 2, 3, 4, 6, 9], [1, 0, -1, 0, 0, 1]]
    )


def test_the_fit_is_least_squares_unless_points_are_far_off() -> None:
    random = np.random.default_rng(0)
    terms = quadratic(*random.uniform(-1, 1, (2, 400)))
    truth = random.standard_normal((6, 2))
    noisy = terms @ truth + 0.02 * random.standard_normal((400, 2))
    expected = np.linalg.lstsq(terms, noisy, rcond=None)[0]
    np.testing.assert_allclose(robust_fit(terms, noisy), expected, atol=1e-9)
    noisy[:60] += (5, -8)
    assert np.abs(robust_fit(terms, noisy) - truth).max() < 0.05
    assert np.abs(np.linalg.lstsq(terms, noisy, rcond=None)[0] - truth).max() > 0.3


def turned_crops(truth: Array, corpus: Corpus) -> tuple[list[NDArray[np.uint8]], Float]:
    """Crops that show at p what the mouth at rest shows at p + bend(p), so many as there are bends."""
    rest = corpus.common[: 64 * 56].reshape(56, 64).astype(np.float32)
    y, x = np.mgrid[:56, :64].astype(float)
    terms = quadratic((x - 31.5) / 32, (y - 27.5) / 28)
    crops = []
    for bend in truth:
        where = (np.stack([x, y], -1) + terms @ bend).astype(np.float32)
        luma = cv2.remap(rest, where, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        flat = np.full(64 * 56 * 3 // 2, 128, np.uint8)
        flat[: 64 * 56] = np.clip(np.rint(luma), 0, 255).ravel()
        crops.append(flat)
    return crops, rest


def test_a_known_bend_is_found(corpus: Corpus) -> None:
    truth = np.repeat(np.random.default_rng(1).uniform(-0.9, 0.9, (1, 6, 2)), 6, 0)
    crops, rest = turned_crops(truth, corpus)
    found = bends(crops, rest, corpus.mask, CROP, circular=True)
    assert len(found) == 6
    y, x = np.argwhere(corpus.mask > 0.5).T
    terms = quadratic((x - 31.5) / 32, (y - 27.5) / 28)
    for bend in found:
        assert np.abs(terms @ (bend - truth[0])).max() < 0.35
        assert np.abs(terms @ (bend - truth[0])).mean() < 0.1


def test_bends_are_smooth_in_time_and_go_round(corpus: Corpus) -> None:
    truth = np.zeros((12, 6, 2))
    truth[0, 0, 0] = 2.0  # only the first picture is shifted
    crops, rest = turned_crops(truth, corpus)
    circular, open_ended = (
        np.array(bends(crops, rest, corpus.mask, CROP, circular=each))[:, 0, 0] for each in (True, False)
    )
    assert circular[1] == pytest.approx(circular[11], abs=0.02)
    assert circular[0] < 1
    assert open_ended[11] == pytest.approx(0, abs=0.05)


def test_noise_is_fine_and_nowhere_large() -> None:
    random = np.random.default_rng(0)
    white = random.normal(0, 3, (200, 200)).astype(np.float32)
    found = noise_of(white)
    assert found.std() == pytest.approx(3, rel=0.15)
    y, x = np.mgrid[:200, :200]
    coarse = (20 * np.sin(x / 15) + 10 * np.cos(y / 20)).astype(np.float32)
    assert np.abs(noise_of(white + coarse) - found).mean() < 0.25
    spot = white.copy()
    spot[90:95, 90:95] += 100
    assert np.abs(noise_of(spot)).max() < 2.6 * 3


def flat_rest(appearance: Appearance) -> Float:
    drawn = draw_crop(appearance.modes, appearance.rest)
    return np.concatenate([plane.ravel() for plane in drawn.each()])


def test_detail_is_what_the_clean_picture_has_more_and_nothing_inside_the_mouth(appearance: Appearance) -> None:
    modes = appearance.modes
    size = modes.width * modes.height
    nothing = np.zeros(size * 3 // 2, np.float32)
    assert (detail_layer(modes, appearance.rest, nothing, nothing) == 0).all()
    brighter = detail_layer(modes, appearance.rest, nothing + 4, nothing)
    luma = brighter[:size].reshape(modes.height, modes.width)
    assert luma[4:-4, [6, -7]] == pytest.approx(4, abs=0.05)  # skin
    inside = modes.layer == 0
    y, x = (int(place) for place in np.argwhere(inside).mean(0))
    assert inside[y, x]
    assert luma[2 * y, 2 * x] == pytest.approx(0, abs=0.05)
    assert brighter[size:].max() <= 4.05


def baking(appearance: Appearance, corpus: Corpus, warp: Array) -> Bake:
    region = region_of([warp, np.array([[1, 0, CROP.x], [0, 1, CROP.y]])], CROP, (WIDTH, HEIGHT))
    pose = np.stack(
        [pose_map(warp, region, CROP), pose_map(np.array([[1.0, 0, CROP.x], [0, 1, CROP.y]]), region, CROP)]
    )
    room = np.zeros((2, HEIGHT * 3 // 2, WIDTH), np.uint8)
    background = Background(room, CROP, region, pose.astype(np.float32), corpus.mask)
    return Bake(appearance.modes, appearance.rest, background, ModeMouth(appearance.modes, background))


SHIFT = (1.3, -0.6)
WARP = np.array([[1, 0, CROP.x - SHIFT[0]], [0, 1, CROP.y - SHIFT[1]]])


def models_rest(bake: Bake) -> Float:
    out = Planes.empty(bake.background.region.width, bake.background.region.height)
    bake.mouth.draw(bake.rest, 0, out)
    return out.luma


def test_inside_the_mask_is_the_models_rest_and_outside_nothing_is_touched(
    corpus: Corpus, appearance: Appearance
) -> None:
    bake = baking(appearance, corpus, WARP)
    spoken = int(np.argmax(np.linalg.norm(appearance.coefficients - appearance.rest, axis=1)))
    shown = from_rgb(picture(1.0, SHIFT))
    baked = bake.replace_mouth(LoopPicture(shown, WARP, UNCORRECTED, appearance.coefficients[spoken]), 0)
    region = bake.background.region
    weight, _ = bake.background.posed_mask(0)
    outside = np.ones((HEIGHT, WIDTH), bool)
    region_view = outside[region.y : region.y + region.height, region.x : region.x + region.width]
    region_view[...] = weight == 0
    np.testing.assert_array_equal(planes(baked)[0][outside], planes(shown)[0][outside])
    full = weight > 0.999
    assert full.sum() > 300
    error = region.luma(baked).astype(float) - models_rest(bake)
    before = region.luma(shown).astype(float) - models_rest(bake)
    assert np.abs(error[full]).mean() < 0.25 * np.abs(before[full]).mean()
    assert (planes(shown)[0] == planes(from_rgb(picture(1.0, SHIFT)))[0]).all(), "the picture itself stays"


def test_the_noise_of_the_recording_stays(corpus: Corpus, appearance: Appearance) -> None:
    bake = baking(appearance, corpus, WARP)
    random = np.random.default_rng(0)
    region = bake.background.region
    full = bake.background.posed_mask(0)[0] > 0.999
    clean = from_rgb(picture(OPENING["SIL"], SHIFT)).astype(float)
    left = []
    for _ in range(30):
        noisy = np.clip(np.rint(clean + random.normal(0, 2, clean.shape)), 0, 255).astype(np.uint8)
        baked = bake.replace_mouth(LoopPicture(noisy, WARP, UNCORRECTED, None), 0)
        left.append(region.luma(baked).astype(float))
    deviation = np.std(left, 0)[full].mean()
    assert 0.75 * 2 < deviation < 1.15 * 2
    assert np.abs(np.mean(left, 0) - models_rest(bake))[full].mean() < 2.5


def test_the_models_mouth_is_put_into_the_light_of_its_picture(corpus: Corpus, appearance: Appearance) -> None:
    bake = baking(appearance, corpus, WARP)
    region = bake.background.region
    full, half = (weight > 0.999 for weight in bake.background.posed_mask(0))
    shown = from_rgb(picture(OPENING["SIL"], SHIFT))
    bright = lit(shown, LIGHT)
    mouth = appearance.coefficients[int(np.flatnonzero(corpus.rest & corpus.good)[3])]
    for known, given in ((UNCORRECTED, shown), (LIGHT, bright)):
        for coefficients in (None, mouth):
            baked = bake.replace_mouth(LoopPicture(given, WARP, known, coefficients), 0)
            luma = region.luma(baked).astype(float)[full].mean() - region.luma(given).astype(float)[full].mean()
            assert abs(luma) < 1
            for now, before in zip(region.chroma(baked), region.chroma(given), strict=True):
                assert abs(now.astype(float)[half].mean() - before.astype(float)[half].mean()) < 0.6
    # Where the mouth is known to rest, light that nobody measured is matched too.
    baked = bake.replace_mouth(LoopPicture(bright, WARP, UNCORRECTED, None), 0)
    assert abs(region.luma(baked).astype(float)[full].mean() - region.luma(bright).astype(float)[full].mean()) < 1.5


@pytest.fixture(scope="module")
def mixed(corpus: Corpus) -> Mixed:
    """Of two passages, each entered out of the other by a dissolve."""
    first, second = (corpus.passages[number].frames for number in (0, 1))
    cut = [Stretch(range(span.start + DISSOLVE, span.stop - DISSOLVE)) for span in (first, second)]
    return joined(cut, corpus)


@pytest.fixture(scope="module")
def baked(corpus: Corpus, appearance: Appearance, mixed: Mixed) -> tuple[Modes, Background]:
    return bake(corpus, appearance, mixed)


def bake(corpus: Corpus, appearance: Appearance, mixed: Mixed) -> tuple[Modes, Background]:
    return bake_loop(
        lambda: loop_pictures(corpus, appearance.coefficients, mixed), mixed, corpus.layout.reference, appearance.modes,
        appearance.rest, corpus.common, corpus.crop, corpus.mask, ModeMouth, all_at_rest=False,
    )  # fmt: skip


def test_every_picture_that_the_loop_needs_is_read_once(corpus: Corpus, appearance: Appearance) -> None:
    lit_frames, second = corpus.passages[LIT].frames, int(corpus.starts[1])
    wanted: Mixed = [
        [(second + 4, 1.0)], [(3, 0.5), (lit_frames.start + 50, 0.5)], [(second + 90, 1.0)], [(3, 1.0)]
    ]  # fmt: skip
    found = dict(loop_pictures(corpus, appearance.coefficients, wanted))
    assert list(found) == [3, lit_frames.start + 50, second + 4, second + 90]
    for number, each in found.items():
        passage = next(n for n, p in enumerate(corpus.passages) if number in p.frames)
        assert each.light == corpus.corrections[passage]
        np.testing.assert_allclose(each.warp, crop_warp(corpus.poses[number], CROP, each.light))
        flat = each.light.undo(cut(each.picture, corpus.poses[number], CROP), 64 * 56)
        np.testing.assert_array_equal(flat, corpus.frames.take([number])[0])
        assert (each.coefficients is None) == bool(corpus.rest[number])
        if each.coefficients is not None:
            np.testing.assert_array_equal(each.coefficients, appearance.coefficients[number])


def test_rest_composited_on_the_loop_is_the_loop(appearance: Appearance, baked: tuple[Modes, Background]) -> None:
    modes, background = baked
    compositor = Compositor(background, ModeMouth(modes, background), appearance.rest)
    out = np.empty_like(background.pictures[0])
    for frame in (*range(background.frames), STILL):
        compositor.render(appearance.rest, frame, out)
        np.testing.assert_array_equal(out, background.pictures[background.index(frame)])


def test_every_picture_of_the_loop_shows_the_mouth_at_rest(
    corpus: Corpus, appearance: Appearance, mixed: Mixed, baked: tuple[Modes, Background]
) -> None:
    modes, background = baked
    assert background.frames == len(mixed)
    assert background.crop == CROP
    mouth = ModeMouth(modes, background)
    drawn = Planes.empty(background.region.width, background.region.height)
    errors = []
    for index in range(background.frames):
        mouth.draw(appearance.rest, index, drawn)
        full = background.posed_mask(index)[0] > 0.999
        luma = background.region.luma(background.pictures[index]).astype(float)
        errors.append(np.abs(luma - drawn.luma)[full].mean())
    speech = [not all(corpus.rest[number] for number, _ in parts) for parts in mixed]
    assert any(speech)
    assert np.mean(errors) < 6, "the light of a passage, and noise"
    assert np.max(errors) < 15


def test_poses_of_the_loop_are_those_of_its_pictures(
    corpus: Corpus, mixed: Mixed, baked: tuple[Modes, Background]
) -> None:
    background = baked[1]
    for place, parts in enumerate(mixed):
        shift = sum(share * corpus.poses[number][:, 2] for number, share in parts)
        expected = np.broadcast_to(-shift, background.pose[place].shape)
        np.testing.assert_allclose(background.pose[place], expected, atol=1e-4)
    assert not background.pose[-1].any()


def test_pictures_dissolve_in_their_shares_outside_the_mouth(
    corpus: Corpus, mixed: Mixed, baked: tuple[Modes, Background]
) -> None:
    sources = {
        number: each.picture
        for number, each in loop_pictures(corpus, np.zeros((len(corpus.good), 1), np.float32), mixed)
    }
    assert sum(len(parts) > 1 for parts in mixed) >= DISSOLVE
    for place, parts in enumerate(mixed):
        expected = sum(share * sources[number].astype(float) for number, share in parts)
        shown = planes(baked[1].pictures[place])[0]
        assert np.abs(shown[:20] - expected[:20]).max() <= (0.5001 if len(parts) > 1 else 0)


def test_a_picture_in_two_places_has_the_pose_of_each(corpus: Corpus, appearance: Appearance) -> None:
    frame, other = 20, 33
    both: Mixed = [[(frame, 1.0)], [(frame, 0.5), (other, 0.5)], [(other, 1.0)]]
    alone: Mixed = [[(frame, 1.0)], [(other, 1.0)]]
    _, together = bake(corpus, appearance, both)
    _, apart = bake(corpus, appearance, alone)
    assert together.region == apart.region
    np.testing.assert_array_equal(together.pictures[[0, 2]], apart.pictures[[0, 1]])


def test_the_still_is_the_recordings_mean_mouth_on_the_reference(
    corpus: Corpus, baked: tuple[Modes, Background]
) -> None:
    still, reference = (planes(each)[0].astype(float) for each in (baked[1].pictures[-1], corpus.layout.reference))
    outside = np.ones((HEIGHT, WIDTH), bool)
    outside[CROP.y : CROP.y + CROP.height, CROP.x : CROP.x + CROP.width] = corpus.mask == 0
    np.testing.assert_array_equal(still[outside], reference[outside])
    common = corpus.common[: 64 * 56].reshape(56, 64)
    assert np.abs(CROP.luma(baked[1].pictures[-1]) - common)[corpus.mask > 0.999].max() <= 0.51


def given(shifts: list[tuple[float, float]]) -> Iterator[tuple[int, LoopPicture]]:
    for number, shift in enumerate(shifts):
        warp = np.array([[1, 0, CROP.x - shift[0]], [0, 1, CROP.y - shift[1]]])
        yield number, LoopPicture(from_rgb(picture(OPENING["SIL"], shift)), warp, UNCORRECTED, None)


def test_a_loop_that_is_given_looks_like_itself_and_teaches_detail(corpus: Corpus, appearance: Appearance) -> None:
    shifts = [(1.5 * np.sin(n / 16 * 6.283), 0.7 * np.cos(n / 16 * 6.283)) for n in range(16)]
    told: list[float] = []
    modes, background = bake_loop(
        lambda: given(shifts), [[(n, 1.0)] for n in range(16)], corpus.layout.reference, appearance.modes,
        appearance.rest, corpus.common, CROP, corpus.mask, ModeMouth, all_at_rest=True, progress=told.append,
    )  # fmt: skip
    assert modes.detail.any()
    assert not appearance.modes.detail.any()
    assert told == [n / 16 for n in range(16)]
    for (_, each), shown in zip(given(shifts), background.pictures, strict=False):
        luma, expected = planes(shown)[0].astype(float), planes(each.picture)[0].astype(float)
        assert 10 * np.log10(255**2 / ((luma - expected) ** 2).mean()) > 32


def test_few_pictures_at_rest_teach_no_detail(corpus: Corpus, appearance: Appearance) -> None:
    shifts = [(0.0, 0.0)] * 11
    modes, _ = bake_loop(
        lambda: given(shifts), [[(n, 1.0)] for n in range(11)], corpus.layout.reference, appearance.modes,
        appearance.rest, corpus.common, CROP, corpus.mask, ModeMouth, all_at_rest=True,
    )  # fmt: skip
    assert not modes.detail.any()


def test_pictures_of_another_size_are_refused(corpus: Corpus, appearance: Appearance) -> None:
    def small() -> Iterator[tuple[int, LoopPicture]]:
        tiny: Picture = np.zeros((96 * 3 // 2, 96), np.uint8)
        yield 0, LoopPicture(tiny, WARP, UNCORRECTED, None)

    with pytest.raises(TrainingFailed, match="size"):
        bake_loop(
            small, [[(0, 1.0)]], corpus.layout.reference, appearance.modes, appearance.rest, corpus.common, CROP,
            corpus.mask, ModeMouth, all_at_rest=False,
        )  # fmt: skip


def test_a_single_stretch_goes_round(corpus: Corpus, appearance: Appearance) -> None:
    rounds = joined([Stretch(range(12, 62))], corpus)  # the drawn head is back after fifty frames
    _, background = bake(corpus, appearance, rounds)
    steps = np.abs(np.diff(background.pictures.astype(float), axis=0, append=background.pictures[:1])).mean((1, 2))[:-1]
    last = np.abs(background.pictures[49].astype(float) - background.pictures[0]).mean()
    assert last < 1.5 * np.median(steps)
