from __future__ import annotations

import errno
import hashlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_recording import write_lossless
from marys_takes import MARY, SIZE, marys_takes, pictures
from numpy.typing import NDArray
from tiny_pack import write_tiny

from app.engine.avatar import load_avatar
from app.engine.background import STILL
from app.engine.frame import planes
from app.engine.models.registry import fit
from app.engine.pack import FILES, MANIFEST, MODEL, Pack, load_pack
from app.engine.training import articulation
from app.engine.training import train as module
from app.engine.training.corpus import Corpus
from app.engine.training.further_models import heard_passages
from app.engine.training.identity import Identity, read_identity
from app.engine.training.take import Take
from app.engine.training.train import Learnt, learn, train, workspace_of
from app.engine.training.workspace import Workspace
from app.errors import TrainingFailed, TrainingStopped
from app.speech import SILENCE, Phone

MODELS = ("phone-mean", "gaussian")
AGAIN = {"finding the face", "trajectories", "background", "writing", "further models"}
"""Steps that are quick, and not kept."""


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(articulation, "EPOCHS", 4)
        yield


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> list[Take]:
    return marys_takes(tmp_path_factory.mktemp("takes"))


@pytest.fixture(scope="module")
def identity() -> Identity:
    return read_identity(MARY / "avatar.json")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@dataclass
class Interruptions:
    """What was seen of a training that was interrupted once at every step.

    Attributes:
        steps: at which it was, in order.
        told: steps that each run told of.
        untouched: whether the old pack was whole after each.
        beside: names beside the pack after each.
        kept: a copy of the workspace before the last run.
        learnt: by the last run, its frames in the copy.
        pack: the folder.
    """

    steps: list[str]
    told: list[list[str]]
    untouched: list[bool]
    beside: list[set[str]]
    kept: Path
    learnt: Learnt
    pack: Path


@pytest.fixture(scope="module")
def interrupted(takes: list[Take], identity: Identity, tmp_path_factory: pytest.TempPathFactory) -> Interruptions:
    folder = tmp_path_factory.mktemp("interrupted")
    output, kept = write_tiny(folder / "mary"), tmp_path_factory.mktemp("kept") / "workspace"
    (output / "README.md").write_text("mine")
    before = contents(output)
    seen: list[Learnt] = []
    found = Interruptions([], [], [], [], kept, None, output)  # type: ignore[arg-type]
    while True:
        told: list[str] = []

        def stop(step: str, share: float, told: list[str] = told) -> None:
            assert 0 <= share <= 1
            if step not in told:
                told.append(step)
            if step not in found.steps:
                found.steps.append(step)
                raise KeyboardInterrupt

        if workspace_of(output).exists():
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(workspace_of(output), kept)
        found.told.append(told)
        try:
            train(
                takes,
                identity,
                output,
                models=MODELS,
                workers=1,
                progress=stop,
                extras=lambda learnt, *_: seen.append(learnt),
            )
            break
        except KeyboardInterrupt:
            found.untouched.append(contents(output) == before)
            found.beside.append({path.name for path in folder.iterdir()})
    corpus = seen[0].corpus
    frames = replace(corpus.frames, path=kept / corpus.frames.path.name)
    found.learnt = replace(seen[0], corpus=replace(corpus, frames=frames))
    return found


def test_an_interrupted_training_leaves_the_old_pack_and_nothing_half_written(interrupted: Interruptions) -> None:
    assert interrupted.steps == [
        "finding the face", "following the face", "cutting out the mouth", "components", "landmarks", "flow", "modes",
        "textures", "analysis", "trajectories", "background", "writing", "further models",
    ]  # fmt: skip
    assert all(interrupted.untouched)
    for names in interrupted.beside:
        assert names <= {"mary", ".mary.training"}
    assert not list(interrupted.kept.glob("*.part"))


def test_it_goes_on_where_it_was(interrupted: Interruptions) -> None:
    for number, told in enumerate(interrupted.told):
        finished = set(interrupted.steps[: max(0, number - 1)]) - AGAIN
        if number < len(interrupted.steps) and interrupted.steps[number] in ("textures", "modes"):
            finished.discard("modes")  # of which textures are a part
        if number == interrupted.steps.index("textures") + 1:
            finished.discard("modes")
        assert not finished & set(told), (number, told)
    assert set(interrupted.told[-1]) == AGAIN


def test_in_the_end_the_new_pack_replaces_the_old_and_other_files_stay(
    interrupted: Interruptions, identity: Identity, takes: list[Take]
) -> None:
    assert {path.name for path in interrupted.pack.parent.iterdir()} == {"mary"}
    assert {path.name for path in interrupted.pack.iterdir()} == {*FILES, MANIFEST, "README.md", "models"}
    pack = load_pack(interrupted.pack)
    for name, said in identity.model_dump().items():
        assert pack.manifest.model_dump()[name] == said
    assert (pack.manifest.width, pack.manifest.height) == (SIZE, SIZE)
    assert 50 < pack.manifest.loop_frames <= 250
    expected = tuple(hashlib.sha256(take.video.read_bytes()).hexdigest() for take in takes)
    assert pack.manifest.trained_on == expected
    assert (pack.modes.flow_count, pack.modes.count) == (12, 46)


def test_the_same_bytes_whatever_the_number_of_workers_and_interruptions(
    interrupted: Interruptions, identity: Identity, takes: list[Take], tmp_path: Path
) -> None:
    train(takes, identity, tmp_path / "mary", models=MODELS, workers=2)
    first, again = contents(interrupted.pack), contents(tmp_path / "mary")
    for name in (*FILES, "models/phone-mean.npz", MANIFEST):
        assert first[name] == again[name], name


def test_further_models_are_trained_on_the_same_passages(interrupted: Interruptions) -> None:
    avatar = load_avatar(interrupted.pack)
    assert avatar.trajectories == ("gaussian", "phone-mean")
    learnt = interrupted.learnt
    spoken = heard_passages(learnt.corpus, learnt.appearance.coefficients, learnt.appearance.rest, None)
    own = fit("phone-mean", spoken, learnt.appearance.rest, fps=25)
    phones = spoken[0].phones
    assert np.array_equal(avatar.speaking_by("phone-mean").trajectory(phones, 40), own.predict(phones, 40))


def test_the_trained_avatar_shows_what_was_recorded(interrupted: Interruptions) -> None:
    avatar, corpus = load_avatar(interrupted.pack), interrupted.learnt.corpus
    out = np.empty((SIZE * 3 // 2, SIZE), np.uint8)
    crop, full = corpus.crop, corpus.mask > 0.999
    shown, resting = [], []
    rest = crop.luma(avatar.pack.background.pictures[-1]).astype(float)
    for number in range(0, len(corpus.good), 5):
        avatar.render(interrupted.learnt.appearance.coefficients[number], STILL, out)
        truth = corpus.frames.take([number])[0][: full.size].reshape(full.shape).astype(float)
        shown.append(((crop.luma(out) - truth)[full] ** 2).mean())
        resting.append(((rest - truth)[full] ** 2).mean())
    assert 10 * np.log10(255**2 / np.mean(shown)) > 30
    assert np.mean(shown) < 0.2 * np.mean(resting)


def test_the_trained_avatar_opens_for_vowels_and_closes_for_bilabials(interrupted: Interruptions) -> None:
    avatar, learnt = load_avatar(interrupted.pack), interrupted.learnt
    spoken = [
        Phone(SILENCE, 0, 0.4),
        Phone("AA", 0.4, 0.6),
        Phone("M", 0.6, 0.7),
        Phone("AA", 0.7, 0.9),
        Phone(SILENCE, 0.9, 1.5),
    ]
    out = np.empty((SIZE * 3 // 2, SIZE), np.uint8)
    moved = []
    for coefficients in avatar.trajectory(spoken, 36):
        avatar.render(coefficients, 0, out)
        moved.append(np.abs(planes(out)[0].astype(float) - planes(avatar.pack.background.pictures[0])[0]).mean())
    assert max(moved[10:14]) > 2.5 * min(moved[14:18])
    assert moved[0] < 0.1 * max(moved)
    assert learnt.articulation.validation


# Failures while writing


@pytest.fixture
def known(interrupted: Interruptions, monkeypatch: pytest.MonkeyPatch) -> Learnt:
    """Everything is learnt already."""
    monkeypatch.setattr(module, "learn", lambda *_, **__: interrupted.learnt)
    return interrupted.learnt


def raises(error: BaseException) -> Callable[..., Any]:
    def stop(*_: object, **__: object) -> None:
        raise error

    return stop


@pytest.mark.usefixtures("known")
@pytest.mark.parametrize("fails", ["save_model", "write_loop", "write_idle", "checksums", "write_manifest", "mkdtemp"])
def test_a_full_disk_is_said_and_keeps_the_old_pack_and_the_steps(
    takes: list[Take], identity: Identity, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    output = write_tiny(tmp_path / "mary")
    before = contents(output)
    workspace_of(output).mkdir()
    (workspace_of(output) / "looks-0.npz").write_bytes(b"kept")
    full = OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(module.tempfile if fails == "mkdtemp" else module, fails, raises(full))
    with pytest.raises(TrainingStopped, match=r"mary cannot be written: No space left on device") as raised:
        train(takes, identity, output)
    assert "Make room" in raised.value.advice
    assert contents(output) == before
    assert {path.name for path in tmp_path.iterdir()} == {"mary", ".mary.training"}
    assert list(contents(workspace_of(output))) == ["looks-0.npz"]


@pytest.mark.usefixtures("known")
def test_a_video_that_finds_no_room_is_said_too(
    takes: list[Take], identity: Identity, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = module.write_loop
    monkeypatch.setattr(module, "write_loop", lambda _, *rest: write(Path("/dev/full"), *rest))
    with pytest.raises(TrainingStopped, match=r"mary cannot be written: No space left on device"):
        train(takes, identity, tmp_path / "mary")
    assert not (tmp_path / "mary").exists()


@pytest.mark.usefixtures("known")
def test_a_preview_that_cannot_be_written(
    takes: list[Take], identity: Identity, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module.cv2, "imwrite", lambda *_: False)
    with pytest.raises(TrainingStopped, match=r"preview\.jpg could not be written"):
        train(takes, identity, tmp_path / "mary")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_fills_up_while_learning_keeps_finished_steps(
    interrupted: Interruptions, takes: list[Take], identity: Identity, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "mary"
    shutil.copytree(interrupted.kept, workspace_of(output))
    (coefficients,) = workspace_of(output).glob("coefficients-*.npz")
    coefficients.unlink()
    kept = sorted(path.name for path in workspace_of(output).iterdir())
    monkeypatch.setattr(np, "savez", raises(OSError(errno.ENOSPC, "No space left on device")))
    with pytest.raises(TrainingStopped, match="No space left on device") as raised:
        train(takes, identity, output, workers=1)
    assert "finished steps are kept" in raised.value.advice
    left = [path.name for path in workspace_of(output).iterdir() if path.suffix != ".part"]
    assert sorted(left) == kept
    assert not output.exists()


def test_what_belongs_beside_the_pack_is_written_with_it(
    known: Learnt, takes: list[Take], identity: Identity, tmp_path: Path
) -> None:
    seen: list[tuple[Learnt, Pack]] = []

    def extras(learnt: Learnt, pack: Pack, folder: Path) -> None:
        seen.append((learnt, pack))
        assert (folder / MANIFEST).exists()
        (folder / "report.md").write_text("good")

    manifest = train(takes, identity, tmp_path / "mary", extras=extras)
    assert seen[0][0] is known
    assert seen[0][1].manifest == manifest
    assert (tmp_path / "mary" / "report.md").read_text() == "good"


# A background that is given


def swaying(path: Path, frames: int) -> Path:
    """Mary silent: her first picture, which moves."""
    (still,) = pictures(2, 3)
    luma, blue, red = planes(still)
    shown = []
    for number in range(frames):
        shift = round(2 * np.sin(2 * np.pi * number / frames))
        moved = [np.roll(luma, 2 * shift, 1), np.roll(blue, shift, 1), np.roll(red, shift, 1)]
        shown.append(np.concatenate([plane.ravel() for plane in moved]).reshape(still.shape))
    write_lossless(path, shown)
    return path


def test_a_given_background_is_the_loop(known: Learnt, takes: list[Take], identity: Identity, tmp_path: Path) -> None:
    video = swaying(tmp_path / "idle.mkv", 30)
    train(takes, identity, tmp_path / "mary", background=video)
    background = load_pack(tmp_path / "mary").background
    assert background.frames == 30
    region = background.region
    y, x = background.pose.shape[1] // 2, background.pose.shape[2] // 2
    across = background.pose[:-1, y, x, 0]
    expected = -4 * np.sin(2 * np.pi * np.arange(30) / 30)
    assert np.corrcoef(across, expected)[0, 1] > 0.97
    assert region.width > known.corpus.crop.width


@pytest.mark.usefixtures("known")
def test_a_background_that_is_too_long_or_of_another_size_is_refused(
    takes: list[Take], identity: Identity, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    video = swaying(tmp_path / "idle.mkv", 30)
    monkeypatch.setattr(module, "LONGEST", 1.0)
    with pytest.raises(TrainingFailed, match=r"idle\.mkv has 30 pictures, a loop of this size has at most 25"):
        train(takes, identity, tmp_path / "mary", background=video)
    assert not (tmp_path / "mary").exists()


# What is left out


def test_nothing_is_learnt_from_sentences_left_out(
    interrupted: Interruptions, takes: list[Take], tmp_path: Path
) -> None:
    workspace = Workspace(Path(shutil.copytree(interrupted.kept, tmp_path / "workspace")))
    known = interrupted.learnt.corpus
    second = [number for number, passage in enumerate(known.passages) if passage.take == 1]
    found = learn(takes, workspace, leave_out=second, workers=1)
    start = int(found.corpus.starts[1])
    assert not found.corpus.good[start:].any()
    np.testing.assert_array_equal(found.corpus.good[:start], known.good[:start])
    assert not found.appearance.coefficients[start:].any()
    assert max(found.appearance.prototypes) < start
    said = {phone.symbol for phone in takes[0].phones}
    assert {state.partition(".")[0] for state in found.articulation.model.states} <= said
    assert list(module._digests(found.corpus)) == [hashlib.sha256(takes[0].video.read_bytes()).hexdigest()]


def test_only_sentences_that_are_there_can_be_left_out_and_one_must_stay(
    interrupted: Interruptions, takes: list[Take], tmp_path: Path
) -> None:
    workspace = Workspace(Path(shutil.copytree(interrupted.kept, tmp_path / "workspace")))
    count = len(interrupted.learnt.corpus.passages)
    with pytest.raises(TrainingFailed, match=f"there is no sentence {count}; the recording has {count}"):
        learn(takes, workspace, leave_out=[count], workers=1)
    with pytest.raises(TrainingFailed, match="nothing is left to learn from"):
        learn(takes, workspace, leave_out=range(count), workers=1)


def test_the_loop_is_of_clips_of_the_references_size(corpus: Corpus, tmp_path: Path) -> None:
    small: NDArray[np.uint8] = np.full((96 * 3 // 2, 96), 100, np.uint8)
    write_lossless(tmp_path / "small.mkv", [small] * 3)
    other = replace(corpus.takes[1], video=tmp_path / "small.mkv")
    both = replace(corpus, takes=(corpus.takes[0], other))
    of_second = [number for number, passage in enumerate(corpus.passages) if passage.take == 1]
    assert list(module._of_other_size(both)) == of_second
    assert list(module._of_other_size(corpus)) == []
    only = replace(both, good=both.good & (np.arange(len(both.good)) >= both.starts[1]))
    with pytest.raises(TrainingFailed, match="of the size of the first"):
        module._joined_loop(only, None)  # type: ignore[arg-type]


def test_a_model_that_is_kept_is_the_one_that_was_learnt(interrupted: Interruptions) -> None:
    with np.load(interrupted.pack / MODEL) as stored:
        model = interrupted.learnt.articulation.model
        assert tuple(stored["states"]) == model.states
        np.testing.assert_array_equal(stored["state_mean"], model.mean)
