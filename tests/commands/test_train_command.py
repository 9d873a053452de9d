"""`mary train` as people use it: consent, names, refused clips, interruption, the finished avatar."""

from __future__ import annotations

import fcntl
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import pytest
from rich.console import Console

from app.commands.train import Asked, run
from app.engine.avatar import AvatarShelf, load_avatar
from app.engine.background import STILL
from app.engine.frame import empty
from app.engine.training.footage import shots
from app.engine.training.train import workspace_of
from app.errors import InputError, TrainingFailed
from app.speech import Phone

ROOT = Path(__file__).resolve().parents[2]
RECORDING = ROOT / "avatars" / "mary" / "recording" / "recording.mp4"
GRID = Path(os.environ.get("MARY_GRID") or ROOT.parent / "shared" / "data" / "grid_s1")
NOBODY = Asked(None, "", "heart", "", "", "")
AGREED = Asked(None, "", "heart", "", "a test", "agreed for a test")


def train(inputs: list[Path], output: Path, asked: Asked, **changed: object) -> tuple[str, str]:
    out, err = io.StringIO(), io.StringIO()
    options = {
        "background": None,
        "leave_out": [],
        "models": [],
        "aligner": "pocketsphinx",
        "seed": 0,
        "workers": 0,
    } | changed
    run(inputs, [], output, asked, **options, out=Console(file=out, width=200), err=Console(file=err, width=200))  # type: ignore[arg-type]
    return out.getvalue(), err.getvalue()


@pytest.fixture(scope="session")
def grid_clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve clips of a real talker, a broken one, and one with another's transcript."""
    found = sorted((GRID / "train").glob("*.mpg"))[:240:20]
    if len(found) < 12:
        pytest.skip(f"no recordings of the GRID corpus in {GRID} (MARY_GRID names another folder)")
    folder = tmp_path_factory.mktemp("grid") / "clips"
    folder.mkdir()
    for path in found:
        for file in (path, path.with_suffix(".align")):
            shutil.copy(file, folder / file.name)
    (folder / "zz_broken.mpg").write_bytes(b"this is no video")
    (folder / "zz_broken.txt").write_text("bin blue at a one now")
    shutil.copy(found[0], folder / "zz_other.mpg")
    (folder / "zz_other.txt").write_text(
        "the quick brown fox jumps over the lazy dog near the river bank every morning"
    )
    return folder


def test_without_consent_nothing_is_made(tmp_path: Path) -> None:
    with pytest.raises(TrainingFailed, match="consent") as caught:
        train([RECORDING], tmp_path / "anna", NOBODY)
    assert "--consent" in caught.value.advice
    assert not list(tmp_path.iterdir())


def test_a_name_that_no_avatar_can_have(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Anna Smith"):
        train([RECORDING], tmp_path / "Anna Smith", AGREED)


def test_no_videos(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError):
        train([tmp_path / "empty"], tmp_path / "anna", AGREED)
    with pytest.raises(InputError, match="nothing"):
        train([tmp_path / "nothing"], tmp_path / "anna", AGREED)


def test_a_clip_to_leave_out_that_is_not_there(tmp_path: Path, grid_clips: Path) -> None:
    with pytest.raises(InputError, match="nobody"):
        train([grid_clips], tmp_path / "s1", AGREED, leave_out=["nobody"])


def test_ten_seconds_are_too_little(tmp_path: Path, grid_clips: Path) -> None:
    few = sorted(grid_clips.glob("*.mpg"))[:3]
    with pytest.raises(TrainingFailed, match="too little") as caught:
        train(few, tmp_path / "s1", AGREED)
    assert "at least" in caught.value.advice
    assert not (tmp_path / "s1").exists()


@pytest.mark.timeout(300)
def test_a_real_talker_from_end_to_end_interrupted_once(tmp_path: Path, grid_clips: Path) -> None:
    output = tmp_path / "avatars" / "s1"
    call = [
        sys.executable, "-m", "app", "train", str(grid_clips), "-o", str(output), "--subject", "a test",
        "--consent", "measuring",
    ]  # fmt: skip
    with subprocess.Popen(call, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True) as begun:
        assert begun.stderr is not None
        for line in begun.stderr:
            if "flow" in line:
                break
        os.killpg(begun.pid, signal.SIGINT)
        assert begun.wait(30) != 0
    assert not output.exists()
    kept = {path.name.split("-")[0] for path in workspace_of(output).iterdir()}
    assert {"alignments", "layout", "survey0"} <= kept
    surveyed = time.time()
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert "12 of 14 clips" in done.stdout
    assert "word starts" in done.stdout
    assert (output / "report.html").stat().st_size > 50_000
    for name, reason in (("zz_broken", "video"), ("zz_other", "do not say")):
        assert any(name in line and reason in line for line in done.stderr.splitlines()), done.stderr
    assert not workspace_of(output).exists()
    assert json.loads((output / "avatar.json").read_text())["consent"]["subject"] == "a test"
    assert (output / "manifest.json").stat().st_mtime >= surveyed
    shelf = AvatarShelf(output.parent, default="s1")
    assert [manifest.id for manifest in shelf.usable()] == ["s1"]
    avatar = load_avatar(output)
    spoken = avatar.trajectory((Phone("B", 0, 0.1), Phone("AY", 0.1, 0.4), Phone("SIL", 0.4, 0.8)), 20)
    quiet, loud = (empty(avatar.manifest.width, avatar.manifest.height) for _ in range(2))
    avatar.render(None, STILL, quiet)
    avatar.render(spoken[6], STILL, loud)
    crop = avatar.pack.background.crop
    moved = abs(crop.luma(loud).astype(int) - crop.luma(quiet)).mean()
    assert moved > 1
    outside = loud.astype(int) - quiet
    box = avatar.pack.background.region
    outside[: avatar.manifest.height][box.y : box.y + box.height, box.x : box.x + box.width] = 0
    assert not outside[: avatar.manifest.height].any()


def test_two_trainings_of_one_avatar_do_not_meet(tmp_path: Path) -> None:
    workspace = workspace_of(tmp_path / "anna")
    workspace.mkdir()
    with (workspace / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="being trained already"):
            train([RECORDING], tmp_path / "anna", AGREED)


def test_a_still_picture_is_no_talker(tmp_path: Path, grid_clips: Path) -> None:
    for path in sorted(grid_clips.glob("[a-y]*.mpg")):
        picture = next(shots(path)).picture
        with av.open(str(path)) as source, av.open(str(tmp_path / f"{path.stem}.mkv"), "w") as film:
            video = film.add_stream("libx264", rate=25, options={"crf": "23"})
            video.width, video.height, video.pix_fmt = picture.shape[1], picture.shape[0] * 2 // 3, "yuv420p"
            sound = film.add_stream("aac", rate=44_100)
            for _ in range(75):
                film.mux(video.encode(av.VideoFrame.from_ndarray(picture, format="yuv420p")))
            for frame in source.decode(audio=0):
                film.mux(sound.encode(frame))
            film.mux(video.encode(None))
            film.mux(sound.encode(None))
        shutil.copy(path.with_suffix(".align"), tmp_path / f"{path.stem}.align")
    with pytest.raises(TrainingFailed, match="does not move"):
        train([tmp_path], tmp_path / "still", AGREED)
    assert not (tmp_path / "still").exists()
