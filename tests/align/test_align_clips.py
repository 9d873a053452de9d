from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from films import click, film
from locked import lock
from numpy.typing import NDArray
from recordings import SENTENCES

from app.align.agreement import agreement
from app.align.align_clips import Aligned, SpokenClip, align_clips
from app.align.aligner import Alignment
from app.align.clips import Clip, find_clips
from app.align.mock import MockAligner
from app.align.pocketsphinx import PocketSphinxAligner
from app.errors import AlignmentFailed, MissingExtra
from app.speech import Phone, Speech, Word

ROOT = Path(__file__).resolve().parents[2]
RATE = 16_000
NUMBERS = ("one", "two", "three", "four", "five", "six")
SOUND_AT = (0.0, 0.48, 0.0, 0.2)


class Counting(MockAligner):
    """Counts what it is asked for, over all of its kind."""

    asked: list[str]

    def align(self, samples: NDArray[np.float32], rate: int, text: str) -> Alignment:
        self.asked.append(text)
        return super().align(samples, rate, text)


@pytest.fixture
def counting() -> type[Counting]:
    return type("Own", (Counting,), {"asked": []})


@pytest.fixture(scope="session")
def corpus(tmp_path_factory: pytest.TempPathFactory, spoken: tuple[Speech, ...]) -> Path:
    """`SENTENCES` as films, the sound of some later than the picture."""
    folder = tmp_path_factory.mktemp("corpus")
    for number, (speech, sentence, at) in enumerate(zip(spoken, SENTENCES, SOUND_AT, strict=True)):
        film(folder / f"{number}.mkv", speech.samples, speech.rate, sound_at=at)
        (folder / f"{number}.txt").write_text(sentence)
    return folder


def tones(folder: Path, count: int) -> list[Clip]:
    """Films of a beep, for the mock."""
    time = np.arange(RATE) / RATE
    for number in range(count):
        samples = (0.3 * np.sin(time * 2000) * (abs(time - 0.5) < 0.4)).astype(np.float32)
        film(folder / f"{number}.mkv", samples * (1 - 0.01 * number))
        (folder / f"{number}.txt").write_text(f"hello number {NUMBERS[number]}")
    return find_clips([folder])


def fits(spoken: SpokenClip, duration: float) -> bool:
    phones = spoken.phones
    assert phones[0].start == 0.0
    assert phones[-1].end == pytest.approx(duration, abs=0.001)
    assert all(before.end == after.start for before, after in pairwise(phones))
    return True


def reasons(result: Aligned) -> dict[str, str]:
    return {refused.clip.name: refused.reason for refused in result.refused}


# --- what is found ----------------------------------------------------------------------------------------------------


def test_phones_are_on_the_clock_of_the_video(corpus: Path, spoken: tuple[Speech, ...]) -> None:
    shares: list[float] = []
    clips = find_clips([corpus])
    result = align_clips(clips, PocketSphinxAligner, workers=2, progress=shares.append)
    assert result.refused == ()
    assert shares == [0.25, 0.5, 0.75, 1.0]
    for found, clip, speech, at in zip(result.spoken, clips, spoken, SOUND_AT, strict=True):
        assert found.clip == clip
        assert fits(found, speech.duration + at)
        assert found.aligner == "pocketsphinx"
        assert found.given is None
        errors = [ours.start - word.start - at for ours, word in zip(found.words, speech.words, strict=True)]
        assert np.median(np.abs(errors)) < 0.025
    assert align_clips(clips, PocketSphinxAligner, workers=1) == result


def test_phones_of_a_transcript_are_taken_at_their_word(tmp_path: Path) -> None:
    def none() -> MockAligner:
        raise AssertionError("no aligner is needed")

    film(tmp_path / "a.mkv", click(2.0, 1.0), sound_at=0.5)
    tiers = {"words": [(0, 1, ""), (1, 1.5, "hi"), (1.5, 2, "")], "phones": [(1, 1.2, "HH"), (1.2, 1.5, "AY1")]}
    rows = ['"ooTextFile"', '"TextGrid"', "0", "2", "<exists>", "2"]
    for name, intervals in tiers.items():
        rows += ['"IntervalTier"', f'"{name}"', "0", "2", str(len(intervals))]
        rows += [f'{start} {end} "{label}"' for start, end, label in intervals]
    (tmp_path / "a.TextGrid").write_text("\n".join(rows))
    for _ in range(2):
        (found,) = align_clips(find_clips([tmp_path]), none, cache=tmp_path / "cache").spoken
        assert fits(found, 2.5)
        assert found.phones[1:3] == (Phone("HH", 1.5, 1.7), Phone("AY", 1.7, 2.0))
        assert found.words == found.given == (Word("hi", 1.5, 2.0),)
        assert (found.confidence, found.aligner) == (1.0, "")


def test_times_of_words_are_moved_to_the_clock_of_the_video(tmp_path: Path) -> None:
    (clip,) = tones(tmp_path, 1)
    film(clip.video, click(2.0, 1.0), picture_at=0.32)
    (tmp_path / "0.align").write_text("0 5000 bin\n5000 10000 blue\n10000 25000 now\n")
    (found,) = align_clips(find_clips([tmp_path]), lambda: Sure()).spoken
    assert found.given is not None
    assert [word.text for word in found.given] == ["blue", "now"]
    assert [word.start for word in found.given] == pytest.approx([0.0, 0.08])


class Sure(MockAligner):
    """Never doubts."""

    def align(self, samples: NDArray[np.float32], rate: int, text: str) -> Alignment:
        return replace(super().align(samples, rate, text), confidence=1.0)


def test_a_line_of_a_list(tmp_path: Path, counting: type[Counting]) -> None:
    (tmp_path / "v").mkdir()
    tones(tmp_path / "v", 2)
    path = tmp_path / "list.txt"
    path.write_text("0|good morning\n1|good evening everybody\n")
    result = align_clips(find_clips([tmp_path / "v"], [path]), counting)
    assert [" ".join(word.text for word in found.words) for found in result.spoken] == counting.asked
    assert counting.asked == ["good morning", "good evening everybody"]


def test_the_order_is_that_of_the_clips_for_any_number_of_workers(tmp_path: Path) -> None:
    clips = tones(tmp_path, 6)[::-1]
    expected = align_clips(clips, MockAligner)
    assert [found.clip.name for found in expected.spoken] == ["5", "4", "3", "2", "1", "0"]
    for workers in (0, 2, 5, 50):
        assert align_clips(clips, MockAligner, workers=workers) == expected


def test_no_clips() -> None:
    assert align_clips([], MockAligner) == Aligned((), ())


def test_the_calls_in_the_documentation_work(
    corpus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs/speech.md").read_text("utf-8")
    (example,) = re.findall(r"```py\n(.*?)```", page, re.DOTALL)
    (tmp_path / "recordings").symlink_to(corpus)
    monkeypatch.chdir(tmp_path)
    exec(example, {})
    assert capsys.readouterr().out == "4 () None\n"
    assert len(list((tmp_path / "alignments").iterdir())) == 4


# --- what is refused --------------------------------------------------------------------------------------------------


def test_each_clip_that_cannot_be_used_says_why(tmp_path: Path) -> None:
    good = tones(tmp_path, 2)
    sound = click(1.0, 0.5)
    film(tmp_path / "silent.mp4", None)
    film(tmp_path / "radio.mp4", sound, codec="aac", form="fltp", picture="")
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "text.mp4").write_text("not a video")
    (tmp_path / "cut.mp4").write_bytes(film(tmp_path / "x.mp4", sound, codec="aac", form="fltp").read_bytes()[:2000])
    (tmp_path / "x.mp4").unlink()
    for name in ("wordless", "latin", "blank", "untold", "fast"):
        film(tmp_path / f"{name}.mkv", sound)
    for name in ("silent", "radio", "empty", "text", "cut", "untold"):
        (tmp_path / f"{name}.txt").write_text("hello there")
    (tmp_path / "untold.txt").unlink()
    (tmp_path / "wordless.txt").write_text("ⴰ")
    (tmp_path / "latin.txt").write_bytes(b"caf\xe9")
    (tmp_path / "blank.txt").write_text(" \n")
    (tmp_path / "fast.txt").write_text("too many words for this " * 9)
    clips = find_clips([tmp_path])
    gone = [Clip("gone", tmp_path / "gone.mp4", tmp_path / "0.txt"), Clip("folder", tmp_path, tmp_path / "0.txt")]
    result = align_clips([*clips, *gone], MockAligner, workers=3, cache=tmp_path / "cache")
    assert [found.clip for found in result.spoken] == good
    found = reasons(result)
    expected = {
        "blank": "blank.txt: the transcript has no words",
        "cut": "it cannot be read as a video: ",
        "empty": "it is empty",
        "fast": "the transcript does not fit what is said (confidence 0.00)",
        "folder": " cannot be read: Is a directory",
        "gone": "gone.mp4 cannot be read: No such file or directory",
        "latin": "latin.txt: not UTF-8 at byte 3",
        "radio": "it has no picture",
        "silent": "it has no sound",
        "text": "it cannot be read as a video: ",
        "untold": "it has no transcript",
        "wordless": "the transcript has no word that sounds",
    }
    assert sorted(found) == sorted(expected)
    for name, reason in expected.items():
        assert reason in found[name], name
    assert "Is fast.txt what is said in fast.mkv?" in [refused.advice for refused in result.refused]
    assert align_clips([*clips, *gone], MockAligner) == result


def test_locked_files_are_refused(tmp_path: Path) -> None:
    clips = tones(tmp_path, 3)
    assert clips[1].transcript is not None
    lock(clips[0].video)
    lock(clips[1].transcript)
    for cache in (None, tmp_path / "cache"):
        result = align_clips(clips, MockAligner, cache=cache)
        assert [found.clip for found in result.spoken] == clips[2:]
        assert all("Permission denied" in reason for reason in reasons(result).values())


def test_exchanged_transcripts_are_refused(corpus: Path) -> None:
    clips = find_clips([corpus])
    clips[1], clips[3] = (replace(clips[at], transcript=clips[other].transcript) for at, other in ((1, 3), (3, 1)))
    result = align_clips(clips, PocketSphinxAligner, workers=2)
    assert [found.clip.name for found in result.spoken] == ["0", "2"]
    for reason in reasons(result).values():
        assert "does not fit what is said" in reason or "do not say" in reason


def test_a_film_that_is_cut_off_is_refused_with_what_is_missing(tmp_path: Path, spoken: tuple[Speech, ...]) -> None:
    path = film(
        tmp_path / "a.mp4", spoken[1].samples, spoken[1].rate, codec="aac", form="fltp",
        options={"movflags": "faststart"},
    )  # fmt: skip
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"mdat") + (len(data) - data.index(b"mdat")) // 3])
    (tmp_path / "a.txt").write_text(SENTENCES[1])
    (refused,) = align_clips(find_clips([tmp_path]), PocketSphinxAligner).refused
    assert "missing" in refused.advice or "do not say" in refused.reason


def test_what_an_aligner_raises_of_its_own_is_about_one_clip(tmp_path: Path) -> None:
    class Odd(MockAligner):
        name = "odd"

        def align(self, samples: NDArray[np.float32], rate: int, text: str) -> Alignment:
            if "two" in text:
                raise ZeroDivisionError("by zero")
            return super().align(samples, rate, text)

    result = align_clips(tones(tmp_path, 3), Odd)
    assert reasons(result) == {"1": "aligner odd: ZeroDivisionError: by zero"}


def test_an_aligner_that_cannot_be_made_is_not_about_clips(tmp_path: Path) -> None:
    def make() -> MockAligner:
        raise MissingExtra("not installed")

    with pytest.raises(MissingExtra):
        align_clips(tones(tmp_path, 3), make, workers=2)


# --- what is kept -----------------------------------------------------------------------------------------------------


def test_what_was_found_is_not_looked_for_again(tmp_path: Path, counting: type[Counting]) -> None:
    clips, cache = tones(tmp_path, 4), tmp_path / "cache"
    first = align_clips(clips, counting, cache=cache, workers=2)
    assert len(counting.asked) == 4
    assert align_clips(clips, counting, cache=cache) == first
    assert len(counting.asked) == 4
    assert clips[2].transcript is not None
    clips[2].transcript.write_text("other words")
    for number, path in enumerate(sorted(cache.iterdir())):
        if number == 0:
            path.write_text(path.read_text()[:-20])
    again = align_clips(clips, counting, cache=cache)
    assert again.refused == ()
    assert len(counting.asked) - 4 in (1, 2)  # the damaged entry may have been that of the changed transcript
    assert align_clips(clips, counting, cache=cache) == again


def test_a_run_that_was_broken_off_goes_on_where_it_was(tmp_path: Path, counting: type[Counting]) -> None:
    clips, cache = tones(tmp_path, 6), tmp_path / "cache"

    def interrupt(share: float) -> None:
        if share >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        align_clips(clips, counting, cache=cache, workers=2, progress=interrupt)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("align-clips")]
    done = len(list(cache.glob("*.json")))
    assert 3 <= done == len(counting.asked)
    result = align_clips(clips, counting, cache=cache, workers=2)
    assert len(counting.asked) == 6
    assert result == align_clips(clips, MockAligner)


def test_a_run_broken_off_ends_an_aligner_at_work(corpus: Path) -> None:
    made: list[PocketSphinxAligner] = []

    def make() -> PocketSphinxAligner:
        aligner = PocketSphinxAligner()
        aligner.warm_up()
        made.append(aligner)
        return aligner

    def stop(_: float) -> None:
        for aligner in made:
            if aligner.process is not None:
                os.kill(aligner.process, signal.SIGSTOP)  # it will not answer any more
        raise KeyboardInterrupt

    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        align_clips(find_clips([corpus]), make, workers=2, progress=stop)
    assert time.monotonic() - began < 10
    assert [aligner.process for aligner in made] == [None] * len(made)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("align-clips")]


PROGRAM = """
import sys
from pathlib import Path
from app.align.align_clips import align_clips
from app.align.clips import find_clips
from app.align.pocketsphinx import PocketSphinxAligner
clips = find_clips([Path(sys.argv[1])]) * 500
align_clips(clips, PocketSphinxAligner, workers=2, progress=lambda share: print(share, flush=True))
"""


def test_interrupted_it_leaves_no_process_behind(corpus: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(corpus)],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        process.stdout.readline()
        began = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all
        _, errors = process.communicate(timeout=30)
        assert time.monotonic() - began < 10
        assert errors.decode().rstrip().endswith("KeyboardInterrupt")
        assert process.returncode != 0
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)


# --- a real talker ----------------------------------------------------------------------------------------------------


def real(clips: Sequence[Any], folder: Path) -> list[Clip]:
    found = {clip.name: clip for clip in find_clips([folder])}
    return [found[clip.name] for clip in clips][:6]


def test_real_clips(clips: tuple[Any, ...], grid: Path) -> None:
    chosen = real(clips, grid / "test")
    result = align_clips(chosen, PocketSphinxAligner, workers=2)
    assert result.refused == ()
    found = agreement(result.spoken)
    assert found is not None
    assert found.inner is not None
    assert found.onsets is not None
    assert found.words == 36
    assert found.inner.median <= 25
    assert found.onsets.median <= 60


def test_real_clips_with_exchanged_transcripts(clips: tuple[Any, ...], grid: Path) -> None:
    chosen = real(clips, grid / "test")
    chosen[1], chosen[4] = (replace(chosen[at], transcript=chosen[other].transcript) for at, other in ((1, 4), (4, 1)))
    result = align_clips(chosen, PocketSphinxAligner, workers=2)
    assert {refused.clip.name for refused in result.refused} == {chosen[1].name, chosen[4].name}


def test_an_aligner_that_fails_is_not_kept(tmp_path: Path) -> None:
    class Failing(MockAligner):
        def align(self, *_: object) -> Alignment:
            raise AlignmentFailed("aligner mock: its process ended (signal 9)", advice="Try again.")

    clips = tones(tmp_path, 1)
    (refused,) = align_clips(clips, Failing, cache=tmp_path / "cache").refused
    assert (refused.reason, refused.advice) == ("aligner mock: its process ended (signal 9)", "Try again.")
    assert align_clips(clips, MockAligner, cache=tmp_path / "cache").refused == ()
