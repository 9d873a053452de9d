from __future__ import annotations

import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from drawn_recording import BROKEN
from numpy.typing import NDArray

from app.engine.mmm import MorphableModel
from app.engine.modes import Modes, draw_crop
from app.engine.training.appearance import PROTOTYPES, Appearance, learn_appearance
from app.engine.training.corpus import Corpus
from app.engine.training.frame_store import FrameStore
from app.engine.training.layout import mouth_box
from app.engine.training.take import speaking
from app.engine.training.workspace import Workspace
from app.errors import TrainingFailed

Float = NDArray[np.float32]


def learnt(corpus: Corpus, folder: Path, *, seed: int = 0, workers: int = 1) -> Appearance:
    return learn_appearance(corpus, Workspace(folder), seed=seed, progress=lambda *_: None, workers=workers)


def assert_same(first: Appearance, second: Appearance) -> None:
    for part, kind in (("modes", Modes), ("morphable", MorphableModel)):
        for field in fields(kind):
            a, b = getattr(getattr(first, part), field.name), getattr(getattr(second, part), field.name)
            np.testing.assert_array_equal(a, b, err_msg=f"{part}.{field.name}")
    np.testing.assert_array_equal(first.coefficients, second.coefficients)
    np.testing.assert_array_equal(first.rest, second.rest)
    assert first.prototypes == second.prototypes


def luma_of(flat: NDArray[np.uint8]) -> Float:
    return flat[: 64 * 56].reshape(56, 64).astype(np.float32)


def test_every_good_frame_is_drawn_again_from_its_coefficients(corpus: Corpus, appearance: Appearance) -> None:
    rows, columns = mouth_box(corpus.crop, corpus.layout.side)
    common = corpus.common[: 64 * 56].reshape(56, 64)
    errors, without = [], []
    for number in np.flatnonzero(corpus.good)[::3]:
        truth = luma_of(corpus.frames.take([int(number)])[0])
        drawn = draw_crop(appearance.modes, appearance.coefficients[number]).luma
        errors.append(((drawn - truth)[rows, columns] ** 2).mean())
        without.append(((common - truth)[rows, columns] ** 2).mean())
    ratios = 10 * np.log10(255**2 / np.array(errors))
    assert ratios.mean() > 30
    assert ratios.min() > 24
    assert np.mean(errors) < 0.05 * np.mean(without)


def test_rest_is_the_mean_mouth_at_rest(corpus: Corpus, appearance: Appearance) -> None:
    resting = [n for n in range(len(corpus.good)) if corpus.good[n] and corpus.rest[n]]
    np.testing.assert_allclose(appearance.rest, appearance.coefficients[resting].mean(0), rtol=1e-4, atol=1e-3)


def test_prototypes_are_frames_and_the_reference_is_an_open_mouth(corpus: Corpus, appearance: Appearance) -> None:
    model = appearance.morphable
    assert 30 <= len(appearance.prototypes) <= PROTOTYPES
    assert len(model.images) == len(model.flows) == len(appearance.prototypes)
    for number, image in zip(appearance.prototypes, model.images, strict=True):
        assert corpus.good[number]
        np.testing.assert_array_equal(image, corpus.frames.take([number])[0])
    assert not model.flows[model.reference].any()
    spoken = np.concatenate(
        [speaking(take.phones, int(n)) for take, n in zip(corpus.takes, np.diff(corpus.starts), strict=True)]
    )
    assert np.mean([spoken[number] for number in appearance.prototypes]) > 0.8
    dark = [(luma_of(image)[18:40, 16:48] < 60).sum() for image in model.images]
    assert dark[model.reference] > 0.6 * max(dark)


def test_the_same_whatever_the_number_of_workers(corpus: Corpus, appearance: Appearance, tmp_path: Path) -> None:
    assert_same(appearance, learnt(corpus, tmp_path, workers=2))


def test_nothing_is_learnt_from_frames_that_are_not_good(
    corpus: Corpus, appearance: Appearance, tmp_path: Path
) -> None:
    frames = corpus.frames.read(0, len(corpus.frames)).copy()
    broken = np.flatnonzero(~corpus.good)
    assert len(broken) == sum(map(len, BROKEN.values()))
    frames[broken] = 255 - frames[broken]
    store = FrameStore.create(tmp_path / "frames-poisoned.rows", len(frames), frames.shape[1:], np.uint8)
    store.write(0, frames)
    assert_same(appearance, learnt(replace(corpus, frames=store), tmp_path / "work"))
    assert not appearance.coefficients[broken].any()
    assert appearance.coefficients[corpus.good].any(1).all()


def test_finished_steps_are_not_done_again(
    corpus: Corpus, appearance: Appearance, learning: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(learning, tmp_path / "copy"))
    told: list[str] = []
    again = learn_appearance(
        corpus, Workspace(copy), seed=0, progress=lambda step, _: told.append(step), workers=1
    )  # fmt: skip
    assert told == []
    assert_same(appearance, again)


def test_other_phones_of_the_same_frames_are_learnt_anew(
    corpus: Corpus, appearance: Appearance, learning: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(learning, tmp_path / "copy"))
    rest = corpus.rest.copy()
    rest[np.flatnonzero(rest)[:60]] = False
    told: list[str] = []
    other = learn_appearance(
        replace(corpus, rest=rest), Workspace(copy), seed=0, progress=lambda step, _: told.append(step), workers=1
    )
    assert "landmarks" in told
    assert not np.array_equal(other.rest, appearance.rest)


def test_a_recording_without_rest(corpus: Corpus, tmp_path: Path) -> None:
    with pytest.raises(TrainingFailed, match="no silence in which the mouth rests") as raised:
        learnt(replace(corpus, rest=np.zeros_like(corpus.rest)), tmp_path)
    assert raised.value.advice == "Record a second of it."


def test_few_frames_are_enough_to_learn_something(corpus: Corpus, tmp_path: Path) -> None:
    good = corpus.good.copy()
    good[60:] = False
    few = learnt(replace(corpus, good=good), tmp_path)
    assert len(few.coefficients) == len(corpus.good)
    assert np.isfinite(few.coefficients).all()
