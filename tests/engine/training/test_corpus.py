from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from filmed import FPS, ROOT, Array, moving_head, silence, similarity, speaking, spoken, vowel, warped, write_film
from numpy.typing import NDArray

from app.align.transcript import read_transcript
from app.engine.frame import planes
from app.engine.training import corpus as module
from app.engine.training.corpus import Corpus, fingerprint, gather, without
from app.engine.training.footage import shots
from app.engine.training.frame_store import FrameStore
from app.engine.training.survey import cut
from app.engine.training.take import Take, passages, resting
from app.engine.training.workspace import Workspace
from app.errors import TrainingFailed
from app.speech import SILENCE, Phone

GRID = Path(os.environ.get("MARY_GRID") or ROOT.parent / "shared" / "data" / "grid_s1")


def quiet(step: str, share: float) -> None:
    """Tell nobody."""


def sway(count: int, phase: float) -> list[Array]:
    time = np.arange(count) / FPS + phase
    x, y, turn = 7 * np.sin(2.1 * time), 4 * np.sin(3.3 * time), 2 * np.sin(1.7 * time)
    scale = 1 + 0.02 * np.sin(2.7 * time)
    return [similarity(*each, (160, 150)) for each in zip(x, y, turn, scale, strict=True)]


def dimmed(rgb: NDArray[np.uint8], gain: float) -> NDArray[np.uint8]:
    return np.rint(rgb * gain).astype(np.uint8)


def after(frames: int, phones: tuple[Phone, ...]) -> tuple[Phone, ...]:
    """Phones, begun by silence."""
    pause = frames / FPS
    later = [Phone(phone.symbol, phone.start + pause, phone.end + pause) for phone in phones]
    return (Phone(SILENCE, 0, pause), *later)


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Take, ...]:
    """Mary three times: in two lights, her head moved in a known way, and as the studio moved it."""
    folder = tmp_path_factory.mktemp("takes")
    first = [warped(rgb, pose) for rgb, pose in zip(speaking()[:100], sway(100, 0), strict=True)]
    said = [*[speaking()[0]] * 14, *speaking()[100:176]]
    second = [dimmed(warped(rgb, pose), 0.9) for rgb, pose in zip(said, sway(90, 2), strict=True)]
    return (
        Take("first", write_film(folder / "first.mp4", first), spoken(100)),
        Take("second", write_film(folder / "second.mp4", second), after(14, spoken(76, 100))),
        Take("third", write_film(folder / "third.mp4", moving_head()), spoken(48, 16)),
    )  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _short() -> Iterator[None]:
    """Seconds are enough for a test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "LEAST_SECONDS", 5.0)
        yield


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return Workspace(tmp_path_factory.mktemp("work"))


@pytest.fixture(scope="module")
def corpus(takes: tuple[Take, ...], space: Workspace) -> Corpus:
    return gather(takes, space, progress=quiet, workers=1)


class Calls:
    """Counts calls of functions that it stands before."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.of: dict[str, list[Any]] = {"lay_out": [], "survey": [], "_cut_take": []}
        for name in self.of:
            monkeypatch.setattr(module, name, self._counted(name, getattr(module, name)))

    def _counted(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **named: Any) -> Any:
            first = arguments[0]
            self.of[name].append(getattr(getattr(first, "take", first), "name", ""))
            return function(*arguments, **named)

        return counted


def equal(one: Corpus, other: Corpus) -> None:
    for name in ("starts", "poses", "residual", "good", "rest", "common"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert one.layout.crop == other.layout.crop
    assert one.layout.side == other.layout.side
    np.testing.assert_array_equal(one.layout.reference, other.layout.reference)
    np.testing.assert_array_equal(one.layout.template.luma, other.layout.template.luma)
    assert (one.takes, one.passages, one.refused) == (other.takes, other.passages, other.refused)
    for ours, theirs in zip(one.corrections, other.corrections, strict=True):
        np.testing.assert_array_equal(ours.warp, theirs.warp)
        assert (ours.gain, ours.bias, ours.tint) == (theirs.gain, theirs.bias, theirs.tint)
    np.testing.assert_array_equal(one.frames.read(0, len(one.frames)), other.frames.read(0, len(other.frames)))


# --- what comes out ---------------------------------------------------------------------------------------------------


def test_shapes_and_order(corpus: Corpus, takes: tuple[Take, ...]) -> None:
    count = 100 + 90 + 48
    assert corpus.takes == takes
    assert corpus.starts.tolist() == [0, 100, 190, 238]
    assert corpus.poses.shape == (count, 2, 3)
    assert corpus.residual.shape == corpus.good.shape == corpus.rest.shape == (count,)
    crop = corpus.layout.crop
    pixels = crop.width * crop.height * 3 // 2
    assert (len(corpus.frames), corpus.frames.shape) == (count, (pixels,))
    assert corpus.common.shape == (pixels,)
    assert [number for part in corpus.passages for number in part.frames] == list(range(count))
    assert len(corpus.corrections) == len(corpus.passages)
    assert corpus.good.mean() > 0.97
    for number, take in enumerate(takes):
        start, end = corpus.starts[number], corpus.starts[number + 1]
        np.testing.assert_array_equal(corpus.rest[start:end], resting(take.phones, int(end - start)))
        spans = [range(part.first, part.first + len(part.frames)) for part in corpus.passages if part.take == number]
        assert spans == passages(take.phones, int(end - start))


def test_poses_are_those_of_the_heads(corpus: Corpus) -> None:
    face = np.array([[110, 200, 160], [120, 120, 205], [1, 1, 1]])
    for start, true in ((0, sway(100, 0)), (100, sway(90, 2))):
        # the reference is the first picture, which is moved itself
        first = np.vstack([sway(100, 0)[0], [0, 0, 1]])
        expected = np.stack([pose @ np.linalg.inv(first) for pose in true])
        error = np.linalg.norm(corpus.poses[start : start + len(true)] @ face - expected @ face, axis=1)
        assert np.sqrt((error[3:-3] ** 2).mean()) < 0.35


def test_crops_stand_still_and_are_in_one_light(corpus: Corpus) -> None:
    """The same mouth in two takes, of which one is moved otherwise and darker."""
    width, height = corpus.layout.crop.width, corpus.layout.crop.height
    frames = corpus.frames.read(0, len(corpus.frames))[:, : width * height].reshape(-1, height, width).astype(float)
    rest = frames[:190][(corpus.rest & corpus.good)[:190]]
    assert 0.85 < corpus.corrections[1].gain / corpus.corrections[0].gain < 0.95
    inner = corpus.mask > 0.5
    away = np.sqrt(((rest - corpus.common[: width * height].reshape(height, width)) ** 2)[:, inner].mean(1))
    assert np.median(away) < 3.5
    upper = frames[:190, : height // 8, width // 4 : 3 * width // 4]  # nostrils: hardly moved by speech
    assert np.abs(upper - upper.mean(0)).mean() < 3


def test_crops_are_cut_by_pose_and_correction(corpus: Corpus) -> None:
    for number in (3, 120, 200):
        take = int(np.searchsorted(corpus.starts, number, side="right")) - 1
        place = next(at for at, part in enumerate(corpus.passages) if number in part.frames)
        for at, shot in enumerate(shots(corpus.takes[take].video)):
            if at == number - corpus.starts[take]:
                correction = corpus.corrections[place]
                flat = cut(shot.picture, corpus.poses[number], corpus.layout.crop, shift=correction.warp)
                expected = correction.undo(flat, corpus.layout.crop.width * corpus.layout.crop.height)
                np.testing.assert_array_equal(corpus.frames.take([number])[0], expected)


def test_phones_of_a_passage_begin_and_end_with_it(corpus: Corpus) -> None:
    for part in corpus.passages:
        phones = corpus.phones(part)
        assert phones[0].start == 0
        for before, after in pairwise(phones):
            assert after.start == pytest.approx(before.end)
        length = len(part.frames) / FPS
        assert phones[-1].end <= length + 1e-9
        whole = corpus.takes[part.take].phones
        assert phones[-1].end == pytest.approx(min(length, whole[-1].end - part.first / FPS))


def test_some_may_be_left_out(corpus: Corpus) -> None:
    part = corpus.passages[1]
    fewer = without(corpus, [1])
    assert not fewer.good[list(part.frames)].any()
    others = np.setdiff1d(np.arange(len(corpus.good)), list(part.frames))
    np.testing.assert_array_equal(fewer.good[others], corpus.good[others])
    assert corpus.good[list(part.frames)].any()


# --- running again ----------------------------------------------------------------------------------------------------


def test_a_second_run_reads_everything(
    corpus: Corpus, takes: tuple[Take, ...], space: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = Calls(monkeypatch)
    equal(gather(takes, space, progress=quiet, workers=1), corpus)
    assert calls.of == {"lay_out": [], "survey": [], "_cut_take": []}


def test_an_interrupted_run_goes_on_where_it_was(
    corpus: Corpus, takes: tuple[Take, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    space = Workspace(tmp_path)

    def stop(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "_cut_take", stop)
    with pytest.raises(KeyboardInterrupt):
        gather(takes, space, progress=quiet, workers=1)
    monkeypatch.undo()
    calls = Calls(monkeypatch)
    equal(gather(takes, space, progress=quiet, workers=1), corpus)
    assert calls.of == {"lay_out": [], "survey": [], "_cut_take": ["first", "second", "third"]}


def test_other_phones_redo_only_what_depends_on_them(
    corpus: Corpus, takes: tuple[Take, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    space = Workspace(tmp_path)
    gather(takes, space, progress=quiet, workers=1)
    calls = Calls(monkeypatch)
    changed = (takes[0], replace(takes[1], phones=vowel(90)), takes[2])
    again = gather(changed, space, progress=quiet, workers=1)
    assert calls.of == {"lay_out": [], "survey": ["second"], "_cut_take": ["first", "second", "third"]}
    np.testing.assert_array_equal(again.poses, corpus.poses)
    assert again.phones(again.passages[-2])[1].symbol == "AA"


def test_a_changed_film_is_looked_at_again(
    takes: tuple[Take, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    space = Workspace(tmp_path / "work")
    own = replace(takes[0], video=tmp_path / "own.mp4")
    own.video.write_bytes(takes[0].video.read_bytes())
    pair = (own, takes[2])
    gather(pair, space, progress=quiet, workers=1)
    before = fingerprint(own)
    own.video.write_bytes(takes[1].video.read_bytes())
    assert fingerprint(own) != before
    calls = Calls(monkeypatch)
    gather(pair, space, progress=quiet, workers=1)
    assert calls.of["lay_out"] == [""]
    assert calls.of["survey"] == ["first", "third"]


def test_several_workers_find_the_same(corpus: Corpus, takes: tuple[Take, ...], tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []
    again = gather(takes, Workspace(tmp_path), progress=lambda step, share: told.append((step, share)), workers=2)
    np.testing.assert_allclose(again.poses, corpus.poses, atol=1e-3)
    assert again.layout.crop == corpus.layout.crop
    steps = list(dict.fromkeys(step for step, _ in told))
    assert steps == ["finding the face", "following the face", "cutting out the mouth"]
    for step in steps:
        shares = [share for named, share in told if named == step]
        assert shares == sorted(shares)
        assert 0 <= shares[0] <= shares[-1] <= 1


def test_another_take_measured_with_a_finished_layout(corpus: Corpus, takes: tuple[Take, ...], tmp_path: Path) -> None:
    """However short it is."""
    measured = gather(
        takes[2:], Workspace(tmp_path), layout=corpus.layout, common=corpus.common, progress=quiet, workers=1
    )
    assert measured.layout is corpus.layout
    np.testing.assert_array_equal(measured.common, corpus.common)
    np.testing.assert_allclose(measured.poses, corpus.poses[190:], atol=1e-6)


def test_another_common_mouth_cuts_again(corpus: Corpus, takes: tuple[Take, ...], tmp_path: Path) -> None:
    frames: list[FrameStore] = []
    for offset in (0, 10):
        common = (corpus.common + offset).astype(np.float32)
        found = gather(takes[:1], Workspace(tmp_path), layout=corpus.layout, common=common, progress=quiet, workers=1)
        frames.append(found.frames)
        assert found.corrections[0].gain == pytest.approx(1, abs=0.1)
    assert frames[0].path != frames[1].path


# --- what is refused --------------------------------------------------------------------------------------------------


def test_one_broken_take_among_good_ones_is_refused_by_name(takes: tuple[Take, ...], tmp_path: Path) -> None:
    text = tmp_path / "text.mp4"
    text.write_text("no film")
    nobody = write_film(tmp_path / "nobody.mp4", [np.full((320, 320, 3), 90, np.uint8)] * 20)
    wrong = (Take("text", text, vowel(20)), Take("nobody", nobody, silence(20)))
    found = gather((wrong[0], *takes, wrong[1]), Workspace(tmp_path / "work"), progress=quiet, workers=1)
    assert found.takes == takes
    whole = {each.take: each.reason for each in found.refused if each.frame is None}
    assert set(whole) == {"text", "nobody"}
    assert "cannot be decoded" in whole["text"]
    assert whole["nobody"] == "no face found"


def test_too_little(takes: tuple[Take, ...], tmp_path: Path) -> None:
    with pytest.raises(TrainingFailed, match="2 s of usable pictures are too little") as raised:
        gather(takes[2:], Workspace(tmp_path), progress=quiet, workers=1)
    assert "at least 5 s" in raised.value.advice


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda _: (), "nothing to learn from"),
        (lambda takes: (takes[0], takes[0]), "2 takes are called first"),
        (lambda takes: (replace(takes[0], phones=()),), "first holds no phones"),
        (
            lambda takes: (replace(takes[0], video=Path("/nowhere/film.mp4")),),
            "/nowhere/film.mp4 cannot be read",
        ),
    ],
)
def test_wrong_takes(
    takes: tuple[Take, ...], tmp_path: Path, change: Callable[[Any], tuple[Take, ...]], message: str
) -> None:
    with pytest.raises(TrainingFailed, match=message):
        gather(change(takes), Workspace(tmp_path), progress=quiet, workers=1)


# --- a real talker ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    paths = sorted((GRID / "test").glob("*.mpg"))[:4]
    if len(paths) < 4:
        pytest.skip(f"no recordings of the GRID corpus in {GRID} (MARY_GRID names another folder)")
    takes = [Take(path.stem, path, words(path.with_suffix(".align"))) for path in paths]
    return gather(takes, Workspace(tmp_path_factory.mktemp("real")), progress=quiet, workers=1)


def words(path: Path) -> tuple[Phone, ...]:
    """Every word as one long phone: what counts here is where silence is."""
    phones: list[Phone] = []
    at = 0.0
    for word in read_transcript(path).words or ():
        if word.start > at:
            phones.append(Phone(SILENCE, at, word.start))
        phones.append(Phone("AH", word.start, word.end))
        at = word.end
    return (*phones, Phone(SILENCE, at, max(3.0, at + 0.04)))


def test_a_real_nose_stands_still(real: Corpus) -> None:
    """Nostrils are dark spots that no phone moves by much; Lucas and Kanade's method follows them."""
    assert real.good.mean() > 0.95
    box = real.layout.template.box
    size = real.layout.size
    stable = np.stack([
        cv2.warpAffine(planes(shot.picture)[0], pose, size, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
        for take, start in zip(real.takes, real.starts, strict=False)
        for shot, pose in zip(shots(take.video), real.poses[start:], strict=False)
    ])  # fmt: skip
    mean = np.rint(stable.mean(0)).astype(np.uint8)
    top, bottom = (round(box.y + share * box.side) for share in (0.58, 0.72))
    points = []
    for left, right in ((0.36, 0.51), (0.51, 0.66)):
        first, last = (round(box.x + share * box.side) for share in (left, right))
        row, column = np.unravel_index(
            cv2.GaussianBlur(mean, (0, 0), 1.5)[top:bottom, first:last].argmin(), (bottom - top, last - first)
        )
        points.append((first + column, top + row))
    start = np.array(points, np.float32)[:, None]
    moved = []
    for number, picture in enumerate(stable):
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            mean, picture.astype(np.uint8), start, start.copy(), winSize=(15, 11), maxLevel=0
        )
        assert status.all(), number
        moved.append(found[:, 0] - start[:, 0])
    of_take = np.split(np.array(moved), real.starts[1:-1])
    away = np.concatenate([np.linalg.norm(part - np.median(part, 0), axis=2).ravel() for part in of_take])
    assert np.percentile(away, 95) <= 0.7
