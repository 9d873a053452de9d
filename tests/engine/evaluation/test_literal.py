from __future__ import annotations

import cv2
import numpy as np
import pytest

from app.engine.evaluation.literal import LiteralReader, prototype_modes
from app.engine.mmm import MorphableModel, common_textures
from app.engine.modes import MESH_STEP, draw_crop

WIDTH, HEIGHT = 48, 40


@pytest.fixture
def model() -> MorphableModel:
    """Four smooth prototypes; the first is the reference."""
    random = np.random.default_rng(0)

    def smooth(channels: int, sigma: float) -> np.ndarray:
        return cv2.GaussianBlur(random.standard_normal((HEIGHT, WIDTH, channels)).astype(np.float32), (0, 0), sigma)

    images = []
    for _ in range(4):
        luma = smooth(1, 2).ravel()
        images.append(np.concatenate([128 + 40 * luma / luma.std(), np.full(WIDTH * HEIGHT // 2, 128)]))
    flows = np.stack([30 * smooth(2, 8) for _ in range(4)])
    flows *= np.hanning(HEIGHT)[None, :, None, None] * np.hanning(WIDTH)[None, None, :, None]
    flows[0] = 0
    return MorphableModel(WIDTH, HEIGHT, np.array(images, np.float32), flows.astype(np.float32), 0)


def test_what_the_model_drew_is_read_again(model: MorphableModel) -> None:
    textures = common_textures(model)
    importance = np.outer(np.hanning(HEIGHT), np.hanning(WIDTH)).astype(np.float32)
    reader = LiteralReader(model, importance, textures)
    alpha, beta = np.float32([0, 0.6, 0.2, 0.1]), np.float32([0.5, 0.0, 0.2, 0.3])
    drawn = draw_crop(
        prototype_modes(model, textures, np.ones((HEIGHT // 2, WIDTH // 2), np.float32)), np.r_[alpha, beta]
    )
    frame = np.concatenate([np.clip(np.rint(plane), 0, 255).astype(np.uint8).ravel() for plane in drawn.each()])
    found_alpha, found_beta = reader(frame, np.tensordot(alpha, model.flows, 1).astype(np.float32))
    assert found_alpha == pytest.approx(alpha, abs=0.01)
    assert found_beta == pytest.approx(beta, abs=0.05)
    assert found_beta.sum() == pytest.approx(1, abs=1e-5)


def test_the_fast_form_draws_what_the_literal_model_does(model: MorphableModel) -> None:
    modes = prototype_modes(
        model, common_textures(model), np.ones((HEIGHT // MESH_STEP, WIDTH // MESH_STEP), np.float32)
    )
    alpha, beta = np.float32([0, 0.3, 0.3, 0.2]), np.float32([0.4, 0.3, 0.2, 0.1])
    fast, literal = draw_crop(modes, np.r_[alpha, beta]).luma, model.synthesise(alpha, beta).luma
    inner = (slice(6, -6), slice(6, -6))
    assert np.sqrt(np.mean((fast - literal)[inner] ** 2)) < 4
