from __future__ import annotations

import appendix_a
import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.avatar import Avatar
from app.engine.background import STILL, Background, Planes
from app.engine.mmm import Conversion, MorphableModel, MorphMouth, alpha_gain, common_textures, halve_flow, pull
from app.engine.modes import MESH_STEP, ModeMouth, Modes, split_texture
from app.engine.warp import invert_mesh, pixel_grid, sample

Float = NDArray[np.float32]


def halved(flow: Float) -> Float:
    height, width = flow.shape[0] // 2, flow.shape[1] // 2
    return (flow.reshape(height, 2, width, 2, 2).mean((1, 3)) / 2).astype(np.float32)


@pytest.mark.parametrize(
    ("alpha", "beta"),
    [
        ((0.3, 0, 0.6), (0.2, 0.5, 0.3)),
        ((1, 0, 0), (0, 1, 0)),
        ((-0.4, 0, 1.3), (0.7, 0, 0.3)),
        ((0, 0, 0), (0, 0, 1)),
    ],
)
def test_the_morph_is_the_equation_written_out(
    model: MorphableModel, alpha: tuple[float, ...], beta: tuple[float, ...]
) -> None:
    a, b = np.array(alpha, np.float32), np.array(beta, np.float32)
    morph = model.synthesise(a, b)
    split = [split_texture(image, model.width, model.height) for image in model.images]
    luma = appendix_a.morph(np.stack([each.luma for each in split]), model.flows, a, b)
    np.testing.assert_allclose(morph.luma, luma, atol=1e-2)
    flows = np.stack([halved(flow) for flow in model.flows])
    for shown, images in (
        (morph.blue, np.stack([each.blue for each in split])),
        (morph.red, np.stack([each.red for each in split])),
    ):
        np.testing.assert_allclose(shown, appendix_a.morph(images - 128, flows, a, b) + 128, atol=1e-2)


def test_a_prototype_at_its_own_shape_is_itself(model: MorphableModel) -> None:
    for number, image in enumerate(model.images):
        one = np.eye(3, dtype=np.float32)[number]
        for shown, plane in zip(
            model.synthesise(one, one).each(), split_texture(image, model.width, model.height).each(), strict=True
        ):
            np.testing.assert_allclose(shown, plane, atol=1e-4)


def test_flows_for_chroma_are_half_as_long(model: MorphableModel) -> None:
    np.testing.assert_allclose(halve_flow(model.flows[0]), halved(model.flows[0]), atol=1e-6)
    np.testing.assert_allclose(model.half_flows, np.stack([halved(flow) for flow in model.flows]), atol=1e-6)


def test_pulling_reads_the_image_where_the_flow_points() -> None:
    x, y = np.moveaxis(pixel_grid(24, 20), -1, 0)
    half_x, half_y = np.moveaxis(pixel_grid(12, 10), -1, 0)
    image = Planes(4 * x + 3 * y, 2 * half_x, 5 * half_y)
    pulled = split_texture(pull(image, np.full((20, 24, 2), (1.5, -0.5), np.float32)), 24, 20)
    np.testing.assert_allclose(pulled.luma[3:-3, 3:-4], (4 * (x + 1.5) + 3 * (y - 0.5))[3:-3, 3:-4], atol=0.3)
    np.testing.assert_allclose(pulled.blue[2:-2, 2:-3], (2 * (half_x + 0.75))[2:-2, 2:-3], atol=0.1)
    np.testing.assert_allclose(pulled.red[2:-2, 2:-3], (5 * (half_y - 0.25))[2:-2, 2:-3], atol=0.3)


def test_alpha_is_ridge_regression_on_the_flows(model: MorphableModel) -> None:
    flat = model.flows.reshape(3, -1).astype(np.float64)
    target = 0.3 * flat[0] + 0.6 * flat[2]
    ridge = 1e-4 * (flat**2).sum() / 3
    stacked = np.concatenate([flat.T, np.sqrt(ridge) * np.eye(3)])
    expected = np.linalg.lstsq(stacked, np.concatenate([target, np.zeros(3)]), rcond=None)[0]
    alpha = alpha_gain(model.flows) @ target
    np.testing.assert_allclose(alpha, expected, atol=1e-9)
    np.testing.assert_allclose(alpha, [0.3, 0, 0.6], atol=2e-3)
    assert alpha[1] == 0


def test_common_textures_are_the_images_on_the_references_grid(model: MorphableModel) -> None:
    common = common_textures(model)
    assert common.shape == model.images.shape
    np.testing.assert_allclose(common[1], model.images[1], atol=1e-4)


def exact_modes(model: MorphableModel, modes: Modes) -> Modes:
    """Modes in which the three prototypes can be told apart without error."""
    common = common_textures(model).astype(np.float64)
    mean = common.mean(0)
    texture = np.linalg.qr((common - mean)[:2].T)[0].T
    flows = model.flows[[0, 2], ::2, ::2].reshape(2, -1).astype(np.float64)
    return Modes(
        model.width, model.height, np.zeros_like(modes.flow_mean),
        np.linalg.qr(flows.T)[0].T.reshape(2, *modes.flow_mean.shape).astype(np.float32),
        mean.astype(np.float32), texture.astype(np.float32), modes.layer, np.zeros_like(modes.detail),
    )  # fmt: skip


def test_modes_convert_to_the_alpha_and_beta_they_stand_for(model: MorphableModel, modes: Modes) -> None:
    exact = exact_modes(model, modes)
    convert = Conversion(model, exact)
    alpha, beta = np.array([0.4, 0, 0.5]), np.array([0.2, 0.5, 0.3])
    flow = np.tensordot(alpha, model.flows[:, ::2, ::2], 1).ravel()
    texture = beta @ common_textures(model) - exact.texture_mean
    coefficients = np.concatenate([exact.flow_modes.reshape(2, -1) @ flow, exact.texture_modes @ texture])
    found = convert(coefficients.astype(np.float32))
    np.testing.assert_allclose(found[0], alpha, atol=2e-3)
    np.testing.assert_allclose(found[1], beta, atol=2e-3)


def test_converted_betas_are_on_the_simplex_whatever_the_mouth(mary: Avatar, spoken: Float) -> None:
    convert = Conversion(mary.pack.morphable, mary.pack.modes)
    for coefficients in (mary.rest, *spoken[::12], 5 * spoken[30]):
        alpha, beta = convert(coefficients)
        assert alpha.shape == beta.shape == (len(mary.pack.morphable.images),)
        assert alpha[mary.pack.morphable.reference] == 0
        assert (beta >= 0).all()
        assert abs(float(beta.sum()) - 1) < 1e-5


def test_a_morph_moves_with_the_head(model: MorphableModel, modes: Modes, background: Background) -> None:
    mouth = MorphMouth(model, modes, background)
    coefficients = np.array([0.5, -0.5, 1, 2, -1], np.float32)
    still, moved = (Planes.empty(background.region.width, background.region.height) for _ in range(2))
    mouth.draw(coefficients, 4, still)
    mouth.draw(coefficients, 1, moved)  # by whole pixels: shift (3, -1)
    np.testing.assert_allclose(moved.luma[12:28, 12:26], still.luma[11:27, 15:29], atol=1e-3)


LIPS = np.s_[45:115, 40:140]
"""Of Mary's crop: lips and chin, where everything happens."""


def psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    return float(10 * np.log10(255**2 / ((a[LIPS].astype(float) - b[LIPS]) ** 2).mean()))


def test_the_serving_form_shows_what_the_reference_shows(mary: Avatar, literal_mary: Avatar, spoken: Float) -> None:
    pictures, box = mary.pack.background.pictures, mary.pack.background.crop
    widest = int(np.abs(spoken[:, 0] - mary.rest[0]).argmax())
    for row in (14, 22, 30, 40, widest):
        fast, literal = (np.zeros_like(pictures[0]) for _ in range(2))
        mary.render(spoken[row], STILL, fast)
        literal_mary.render(spoken[row], STILL, literal)
        alike = psnr(box.luma(fast), box.luma(literal))
        assert alike > 34, row  # 35.4 at the widest, 40 in the mean
        assert alike > psnr(box.luma(pictures[-1]), box.luma(literal)) + 3, "than a mouth at rest is"


def test_the_references_rest_is_the_loop_to_the_pixel_too(literal_mary: Avatar) -> None:
    out = np.zeros_like(literal_mary.pack.background.pictures[0])
    for frame in (0, 1, 2, STILL):
        literal_mary.render(literal_mary.rest, frame, out)
        index = literal_mary.pack.background.index(frame)
        np.testing.assert_array_equal(out, literal_mary.pack.background.pictures[index])


def test_both_forms_draw_into_the_same_region(model: MorphableModel, modes: Modes, background: Background) -> None:
    for mouth in (ModeMouth(modes, background), MorphMouth(model, modes, background)):
        out = Planes(*(np.full_like(plane, np.nan) for plane in Planes.empty(40, 36).each()))
        mouth.draw(np.zeros(5, np.float32), 2, out)
        assert all(np.isfinite(plane).all() for plane in out.each())


def test_the_inside_of_a_wide_mouth_is_as_sharp_as_the_references(
    mary: Avatar, literal_mary: Avatar, spoken: Float
) -> None:
    modes, box = mary.pack.modes, mary.pack.background.crop
    moved = np.abs(np.stack([modes.flow(row) - modes.flow(mary.rest) for row in spoken])).mean((1, 2, 3))
    kept = []
    for row in np.argsort(moved)[-len(spoken) // 5 :: 3]:
        where = pixel_grid(modes.width, modes.height).copy()
        shown = where[::MESH_STEP, ::MESH_STEP] + modes.flow(spoken[row])
        depth = np.empty((modes.height, modes.width), np.float32)
        invert_mesh(shown[..., 0].copy(), shown[..., 1].copy(), MESH_STEP, modes.layer, where, depth)
        inside = sample(modes.layer, where / np.float32(MESH_STEP), smooth=False) < 0.5
        fast, literal = (np.zeros_like(mary.pack.background.pictures[0]) for _ in range(2))
        mary.render(spoken[row], STILL, fast)
        literal_mary.render(spoken[row], STILL, literal)
        fine, coarse = (
            sum(((slope**2) * inside).sum() for slope in np.gradient(box.luma(picture).astype(float)))
            for picture in (fast, literal)
        )
        assert inside.sum() > 150
        kept.append(fine / coarse)
    assert min(kept) > 0.9, kept
