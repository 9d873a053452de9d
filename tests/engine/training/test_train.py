from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_recording import FPS
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from app.engine.avatar import load_avatar
from app.engine.background import STILL
from app.engine.frame import planes, to_rgb
from app.engine.pack import FILES, MANIFEST, MODEL, load_pack
from app.engine.training import train as module
from app.engine.training.recording import Recording, read_picture
from app.engine.training.train import Trained, learn, train
from app.errors import TrainingFailed
from app.speech import SILENCE, Phone


@pytest.fixture(scope="module")
def pack(drawn: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained") / "nobody"
    train(drawn, folder)
    return folder


@pytest.fixture
def folder(drawn: Path, tmp_path: Path) -> Path:
    """A recording of the test's own, to be spoilt."""
    return Path(shutil.copytree(drawn, tmp_path / "spoilt"))


def model_arrays(folder: Path) -> dict[str, NDArray[Any]]:
    with np.load(folder / MODEL) as stored:
        return dict(stored)


def test_a_trained_pack_loads_and_says_what_it_is(pack: Path) -> None:
    loaded = load_pack(pack)
    manifest = loaded.manifest
    assert (manifest.id, manifest.title, manifest.voice) == ("nobody", "Nobody", "mock")
    assert (manifest.width, manifest.height, manifest.fps, manifest.loop_frames) == (96, 80, FPS, 4)
    assert manifest.consent.statement == "an ellipse"
    assert sorted(path.name for path in pack.iterdir()) == sorted((*FILES, MANIFEST))
    assert (loaded.modes.flow_count, loaded.modes.count) == (12, 46)
    assert len(loaded.morphable.images) == 46
    assert not loaded.morphable.flows[loaded.morphable.reference].any()
    assert {"AA", "EH", "M", "P", SILENCE, "SIL.after0", "SIL.before0"} <= set(loaded.trajectory.states)
    preview = read_picture(pack / "preview.jpg")
    assert np.abs(preview.astype(int) - to_rgb(loaded.background.pictures[0])).mean() < 3


def test_a_trained_avatar_shows_what_was_recorded(pack: Path, recording: Recording) -> None:
    avatar = load_avatar(pack)
    rows = avatar.trajectory(recording.phones, len(recording.frames))
    box, out, ratios, resting = recording.crop, np.empty((120, 96), np.uint8), [], []
    rest = box.luma(avatar.pack.background.pictures[-1]).astype(float)
    for coefficients, frame in zip(rows, recording.frames, strict=True):
        avatar.render(coefficients, STILL, out)
        truth = frame[: box.width * box.height].reshape(box.height, box.width).astype(float)
        ratios.append(10 * np.log10(255**2 / ((box.luma(out) - truth) ** 2).mean()))
        resting.append(10 * np.log10(255**2 / ((rest - truth) ** 2).mean()))
    assert np.mean(ratios) > 32, np.mean(ratios)
    assert np.min(ratios) > 22, np.min(ratios)
    moving = np.array(resting) < 30
    assert np.mean(np.array(ratios)[moving]) > np.mean(np.array(resting)[moving]) + 6


def test_a_trained_mouth_opens_for_vowels_and_closes_for_bilabials(pack: Path) -> None:
    avatar = load_avatar(pack)
    spoken = [Phone(SILENCE, 0, 0.3), Phone("AA", 0.3, 0.6), Phone("M", 0.6, 0.72), Phone("AA", 0.72, 1.0)]
    out = np.empty((120, 96), np.uint8)
    dark = []
    for coefficients in avatar.trajectory(spoken, 25):
        avatar.render(coefficients, 0, out)
        dark.append(int((planes(out)[0][25:55, 30:66] < 60).sum()))
    assert dark[10] > 100
    assert dark[0] == 0
    assert min(dark[14:18]) < 0.2 * dark[10]


def test_the_same_seed_gives_the_same_model(drawn: Path, pack: Path, tmp_path: Path) -> None:
    threadpool_limits(2)  # on however many cores: sums in another order must not choose another prototype
    module.cv2.setNumThreads(2)
    train(drawn, tmp_path / "again")
    first, again = model_arrays(pack), model_arrays(tmp_path / "again")
    assert first.keys() == again.keys()
    for name, array in first.items():
        np.testing.assert_array_equal(array, again[name], err_msg=name)


def test_progress_names_the_steps_in_order(drawn: Path, tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []
    train(drawn, tmp_path / "pack", progress=lambda step, share: told.append((step, share)))
    steps = list(dict.fromkeys(step for step, _ in told))
    assert steps == ["reading", "components", "flow", "modes", "trajectories", "background", "writing"]
    assert all(0 <= share <= 1 for _, share in told)
    assert told[-1] == ("writing", 1)


class Interrupted(Exception):
    pass


@pytest.mark.parametrize("step", ["reading", "components", "flow", "modes", "trajectories", "background", "writing"])
def test_an_interrupted_training_leaves_nothing_behind(drawn: Path, tmp_path: Path, step: str) -> None:
    def stop(name: str, _share: float) -> None:
        if name == step:
            raise Interrupted

    with pytest.raises(Interrupted):
        train(drawn, tmp_path / "out" / "pack", progress=stop)
    assert not list(tmp_path.rglob("*.npz"))
    assert not (tmp_path / "out" / "pack").exists()


@pytest.mark.parametrize("fails", ["save_model", "write_loop", "write_idle", "checksums", "write_manifest"])
def test_a_failure_while_writing_leaves_the_old_pack_and_no_draft(
    drawn: Path, pack: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    output = Path(shutil.copytree(pack, tmp_path / "nobody"))
    (output / "README.md").write_text("mine")
    before = {path.name: path.read_bytes() for path in output.iterdir()}

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, fails, stop)
    with pytest.raises(KeyboardInterrupt):
        train(drawn, output, seed=1)
    assert {path.name: path.read_bytes() for path in output.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["nobody"]


def test_a_new_training_replaces_the_pack_and_keeps_other_files(drawn: Path, pack: Path, tmp_path: Path) -> None:
    output = Path(shutil.copytree(pack, tmp_path / "nobody"))
    (output / "README.md").write_text("mine")
    (output / MODEL).write_bytes(b"damaged")
    train(drawn, output)
    load_pack(output)
    assert (output / "README.md").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["nobody"]


# What is wrong with a recording


def edit(path: Path, change: Callable[[Any], Any]) -> None:
    content = json.loads(path.read_text())
    changed = change(content)
    path.write_text(json.dumps(content if changed is None else changed))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda identity: identity.pop("consent") and None, r"avatar\.json: consent: Field required"),
        (lambda identity: identity["consent"].update(subject=""), r"avatar.json: consent.subject"),
        (lambda identity: identity.update(id="No Body"), "avatar.json: id"),
        (lambda identity: identity.update(shoe_size=39), "avatar.json: shoe_size: Extra inputs"),
        (lambda _: [], r"avatar\.json must hold an object"),
    ],
)
def test_an_identity_that_is_wrong(folder: Path, tmp_path: Path, change: Callable[[Any], Any], message: str) -> None:
    edit(folder / "avatar.json", change)
    with pytest.raises(TrainingFailed, match=message):
        train(folder, tmp_path / "pack")
    assert not (tmp_path / "pack").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["spoilt"]


def test_no_identity(folder: Path, tmp_path: Path) -> None:
    (folder / "avatar.json").unlink()
    with pytest.raises(TrainingFailed, match=r"avatar\.json is missing"):
        train(folder, tmp_path / "pack")


def test_a_recording_without_rest(recording: Recording) -> None:
    talking = tuple(replace(phone, symbol="AA") if phone.symbol == SILENCE else phone for phone in recording.phones)
    with pytest.raises(TrainingFailed, match="no silence in which the mouth rests") as raised:
        learn(replace(recording, phones=talking))
    assert raised.value.advice == "Record a second of it."


def test_pauses_too_short_to_rest_in_are_no_rest(recording: Recording) -> None:
    hurried = (Phone("AA", 0, 1), Phone(SILENCE, 1, 1.3), Phone("AA", 1.3, 3.52))
    with pytest.raises(TrainingFailed, match="rests"):
        learn(replace(recording, phones=hurried))


def test_a_sentence_that_is_not_there_cannot_be_left_out(drawn: Path, tmp_path: Path) -> None:
    with pytest.raises(TrainingFailed, match="there is no sentence 3; the recording has 3"):
        train(drawn, tmp_path / "pack", leave_out=[3])


def test_no_sentence_left(recording: Recording) -> None:
    with pytest.raises(TrainingFailed, match="no sentence is left"):
        learn(recording, leave_out=range(3))


def test_a_preview_that_cannot_be_written(drawn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.cv2, "imwrite", lambda *_: False)
    with pytest.raises(TrainingFailed, match=r"preview\.jpg could not be written"):
        train(drawn, tmp_path / "pack")
    assert list(tmp_path.iterdir()) == []


# Leaving sentences out


def assert_same_model(first: Trained, second: Trained) -> None:
    for name in ("flow_mean", "flow_modes", "texture_mean", "texture_modes", "layer"):
        np.testing.assert_array_equal(getattr(first.modes, name), getattr(second.modes, name), err_msg=name)
    np.testing.assert_array_equal(first.morphable.images, second.morphable.images)
    np.testing.assert_array_equal(first.morphable.flows, second.morphable.flows)
    assert first.trajectory.states == second.trajectory.states
    for name in ("mean", "precision", "offset", "scale"):
        np.testing.assert_array_equal(getattr(first.trajectory, name), getattr(second.trajectory, name), err_msg=name)
    np.testing.assert_array_equal(first.coefficients, second.coefficients)
    np.testing.assert_array_equal(first.rest, second.rest)
    np.testing.assert_array_equal(first.rest_frames, second.rest_frames)


@pytest.mark.parametrize("left_out", [0, 1, 2])
def test_nothing_is_learnt_from_frames_left_out(recording: Recording, left_out: int) -> None:
    span = recording.spans()[left_out]
    poisoned = recording.frames.copy()
    poisoned[span.start : span.stop] = np.random.default_rng(0).integers(
        0, 256, poisoned[span.start : span.stop].shape, np.uint8
    )
    clean = learn(recording, leave_out=[left_out])
    assert_same_model(clean, learn(replace(recording, frames=poisoned), leave_out=[left_out]))
    assert (clean.coefficients[span.start : span.stop] == 0).all()
    assert not set(clean.rest_frames) & set(span)


def test_phones_only_said_in_frames_left_out_are_unknown(recording: Recording) -> None:
    assert "P" in learn(recording).trajectory.states
    assert "P" not in learn(recording, leave_out=[1]).trajectory.states
