from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.engine.avatar import Avatar
from app.engine.background import Box
from app.engine.evaluation.talker import Talker, common_of, side_of
from app.engine.modes import MESH_STEP, Modes, draw_crop
from app.engine.training.fit_modes import Weights
from app.engine.training.layout import CROP, importance
from app.engine.training.take import Take


@pytest.mark.parametrize("side", [135.0, 136.6, 137.0])
def test_the_side_is_found_by_the_weights_that_the_modes_are_orthonormal_in(side: float) -> None:
    crop = Box(0, 0, *(2 * round(share * side / 2) for share in CROP))
    weight = Weights.of(importance(crop, side)).flow
    mesh = weight.shape[:2]
    random = np.random.default_rng(0).standard_normal((6, *mesh, 2)) * np.sqrt(weight)
    axes = np.linalg.qr(random.reshape(6, -1).T)[0].T.reshape(6, *mesh, 2)
    flow = np.where(weight > 0, axes / np.sqrt(np.maximum(weight, 1e-9)), 0).astype(np.float32)
    pixels = crop.width * crop.height * 3 // 2
    blank = np.zeros(pixels, np.float32)
    modes = Modes(
        crop.width, crop.height, np.zeros((*mesh, 2), np.float32), flow, blank, np.zeros((0, pixels), np.float32),
        np.ones(mesh, np.float32), blank,
    )  # fmt: skip
    assert side_of(modes, crop) == pytest.approx(side, abs=0.06)


def test_the_layout_is_that_of_the_still_picture(talker: Talker, mary: Avatar) -> None:
    crop = mary.pack.background.crop
    assert talker.layout.crop == crop
    assert talker.layout.side * CROP[0] == pytest.approx(crop.width, abs=1.01)
    rows, columns = talker.window
    assert 0 < rows.start < rows.stop < crop.height
    assert 0 < columns.start < columns.stop < crop.width
    assert len(common_of(mary.pack)) == crop.width * crop.height * 3 // 2


def test_a_drawn_mouth_is_read_again(talker: Talker, takes: list[Take]) -> None:
    """What is read draws the same picture, and its flow follows the coefficients'."""
    errors = []
    for coefficients in talker.trajectory.predict(takes[1].phones, 50)[12:50:9]:
        drawn = draw_crop(talker.modes, coefficients)
        frame = np.concatenate([np.clip(np.rint(plane), 0, 255).astype(np.uint8).ravel() for plane in drawn.each()])
        found = talker.reader.coefficients(frame, talker.reader.flow_of(frame))
        again = draw_crop(talker.modes, found)
        errors.append(np.mean((again.luma - drawn.luma)[talker.window] ** 2))
    assert 10 * np.log10(255**2 / np.mean(errors)) > 38


def test_reading_is_least_squares_even_if_modes_are_not_orthonormal(talker: Talker) -> None:
    """Modes stretched by two, coefficients halved: the same flow."""
    reader = talker.reader
    frame = talker.common.astype(np.uint8)
    flow = reader.flow_of(frame)
    modes = replace(reader.modes, flow_modes=2 * reader.modes.flow_modes)
    count = modes.flow_count
    plain, stretched = (each.coefficients(frame, flow) for each in (reader, replace(reader, modes=modes)))
    assert stretched[:count] == pytest.approx(plain[:count] / 2, rel=1e-3, abs=1e-3)
    assert stretched[count:] == pytest.approx(plain[count:], rel=1e-2, abs=0.05)
    assert flow[::MESH_STEP].shape[0] == modes.flow_mean.shape[0]
