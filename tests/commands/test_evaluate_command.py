"""`mary evaluate` as people run it, on a piece of Mary's recording."""

from __future__ import annotations

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

ROOT = Path(__file__).resolve().parents[2]
MARY = ROOT / "avatars" / "mary"


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "app", "evaluate", *arguments]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    call = command(*arguments)
    return subprocess.run(call, cwd=ROOT, env=environment(), capture_output=True, text=True, timeout=100, check=False)


def environment(**more: str) -> dict[str, str]:
    plain = {name: value for name, value in os.environ.items() if not name.startswith("MARY_")}
    return plain | {"COLUMNS": "200"} | more


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second and a half of Mary with the transcript beside it, and a video without one."""
    folder = tmp_path_factory.mktemp("clips")
    with (
        av.open(str(MARY / "recording" / "recording.mp4")) as source,
        av.open(str(folder / "hello.mp4"), "w") as target,
    ):
        streams = {stream.index: target.add_stream_from_template(stream) for stream in source.streams}
        for packet in source.demux():
            if packet.dts is not None and packet.pts * packet.time_base < 1.5:
                packet.stream = streams[packet.stream.index]
                target.mux(packet)
    shutil.copy(MARY / "recording" / "recording.TextGrid", folder / "hello.TextGrid")
    shutil.copy(folder / "hello.mp4", folder / "untold.mp4")
    return folder


def test_an_avatar_is_measured(clips: Path, tmp_path: Path) -> None:
    done = run(
        str(clips), "--avatar", "mary", "--json", str(tmp_path / "figures.json"), "--output", str(tmp_path / "out")
    )
    assert done.returncode == 0, done.stderr
    assert "mary, open test: 1 clips, 1 sentences" in done.stdout
    assert "Only an open test: the avatar has learnt from none of these clips." in done.stdout
    assert "it has no transcript" in done.stdout
    assert "following the face" in done.stderr
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert set(figures["tests"]) == {"open"}
    assert figures["refused"] == [{"take": "untold", "frame": None, "reason": "it has no transcript"}]
    assert json.loads((tmp_path / "out" / "evaluation.json").read_text()) == figures
    assert (tmp_path / "out" / "open-psnr.svg").is_file()
    assert (tmp_path / "out" / "open-models.svg").is_file()
    compared = figures["tests"]["open"]["comparison"]
    assert [row["model"] for row in compared["rows"]] == ["rest", "gaussian", "analysed"]
    assert [its["renderer"] for its in compared["rows"][1]["rendered"]] == ["fast"]
    assert "The common space comes from these clips themselves" in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"figures.json", "out"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--avatar", "nobody"], "there is no avatar 'nobody'"),
        (["--avatar", "mary", "--gains", "much"], "--gains takes numbers"),
        (["--avatar", "mary", "--sizes", "1.5"], "--sizes takes whole numbers"),
        (["--avatar", "mary", "--models", "gaussian,oil"], "there is no trajectory model 'oil'"),
        (["--avatar", "mary", "--models", "phone-mean"], "mary has no trajectory model 'phone-mean'"),
        (["--avatar", "mary", "--renderers", "oil"], "there is no renderer 'oil'"),
        (["--avatar", "mary", "--json", "nowhere/figures.json"], "nowhere is not there"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(clips: Path, arguments: list[str], words: str) -> None:
    done = run(str(clips), *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert not done.stdout
    assert "Traceback" not in done.stderr


def test_videos_without_transcripts_cannot_be_measured(clips: Path) -> None:
    done = run(str(clips / "untold.mp4"), "--avatar", str(MARY))
    assert done.returncode == 2
    assert "untold: it has no transcript" in done.stderr


def test_interrupted_it_leaves_nothing(clips: Path, tmp_path: Path) -> None:
    call = command(str(clips), "--avatar", "mary", "--output", str(tmp_path / "out"))
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with subprocess.Popen(call, cwd=ROOT, env=environment(TMPDIR=str(temporary)), stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        assert any(b"following the face" in line for line in process.stderr)
        time.sleep(0.5)
        assert list(temporary.glob("mary-evaluate-*"))
        process.send_signal(signal.SIGINT)
        process.stderr.read()
    assert process.returncode != 0
    assert not (tmp_path / "out").exists()
    assert not list(temporary.glob("mary-evaluate-*"))
