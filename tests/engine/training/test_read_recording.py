from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace
from drawn_recording import CROP, LOOP_SHIFTS, OPENING, crop_of, picture, timed, write_lossless, write_png

from app.engine.background import Box
from app.engine.frame import from_rgb
from app.engine.training.recording import (
    Recording,
    Sentence,
    check_phones,
    flatten,
    read,
    read_clip,
    read_json,
    read_picture,
)
from app.errors import TrainingFailed
from app.speech import Phone


@pytest.fixture
def folder(drawn: Path, tmp_path: Path) -> Path:
    """A recording of the test's own, to be spoilt."""
    return Path(shutil.copytree(drawn, tmp_path / "spoilt"))


def edit(path: Path, change: Callable[[Any], Any]) -> None:
    content = json.loads(path.read_text())
    changed = change(content)
    path.write_text(json.dumps(content if changed is None else changed))


def test_a_recording_is_read(recording: Recording, drawn: Path) -> None:
    assert recording.folder == drawn
    assert recording.crop == Box(*CROP)
    assert recording.fps == 25
    assert recording.size == (96, 80)
    assert recording.frames.shape == (88, 64 * 48 * 3 // 2)
    assert recording.frames.dtype == np.uint8
    assert recording.phones == tuple(timed()[0])
    assert recording.sentences[0] == Sentence("mama", 0.4, 1.0)
    assert recording.still().shape == (80, 96, 3)
    assert len(list(recording.loop())) == len(LOOP_SHIFTS)
    warp, step = recording.loop_map()
    assert (warp.shape, step) == ((4, 20, 24, 2), 4)


def test_frames_are_in_the_order_of_their_names(recording: Recording, drawn: Path) -> None:
    for number in (0, 9, 10, 50, 87):
        rgb = read_picture(drawn / "recording" / "mouth" / f"{number:05d}.png")
        np.testing.assert_array_equal(recording.frames[number], flatten(rgb))


def test_flattened_frames_are_the_planes_of_a_picture() -> None:
    rgb = crop_of(picture(0.5))
    np.testing.assert_array_equal(flatten(rgb), from_rgb(rgb).reshape(-1))


def test_pictures_and_clips_are_rgb(folder: Path) -> None:
    red = np.full((80, 96, 3), (200, 10, 30), np.uint8)
    write_png(folder / "recording" / "still.png", red)
    write_lossless(folder / "idle" / "frames.mkv", [red] * 2)
    np.testing.assert_array_equal(read_picture(folder / "recording" / "still.png"), red)
    for frame in read_clip(folder / "idle" / "frames.mkv"):
        np.testing.assert_array_equal(frame, red)


def test_a_clip_tagged_bt709_is_decoded_as_such(tmp_path: Path) -> None:
    colour = (200, 60, 30)
    with av.open(str(tmp_path / "clip.mkv"), "w") as output:
        stream = output.add_stream("libx264", rate=25, options={"crf": "1"})
        stream.width, stream.height, stream.pix_fmt = 32, 16, "yuv444p"
        stream.codec_context.colorspace, stream.codec_context.color_range = Colorspace.ITU709, ColorRange.MPEG
        r, g, b = (level / 255 for level in colour)
        y = 0.2126 * r + 0.7152 * g + 0.0722 * b
        levels = (16 + 219 * y, 128 + 224 * (b - y) / 1.8556, 128 + 224 * (r - y) / 1.5748)
        planes = np.stack([np.full((16, 32), round(level), np.uint8) for level in levels])
        output.mux(stream.encode(av.VideoFrame.from_ndarray(planes, format="yuv444p")))
        output.mux(stream.encode(None))
    shown = next(read_clip(tmp_path / "clip.mkv"))
    assert np.abs(shown.astype(int) - colour).max() <= 3


def test_a_clip_may_hold_the_mouth(folder: Path, recording: Recording) -> None:
    pictures = sorted((folder / "recording" / "mouth").glob("*.png"))
    write_lossless(folder / "recording" / "mouth.mkv", [read_picture(path) for path in pictures])
    shutil.rmtree(folder / "recording" / "mouth")
    np.testing.assert_array_equal(read(folder).frames, recording.frames)


def test_sentences_are_cut_in_the_middle_of_the_pauses(recording: Recording) -> None:
    spans = recording.spans()
    assert [span.start for span in spans] == [0, round(1.24 * 25), round(2.32 * 25)]
    assert [span.stop for span in spans] == [31, 58, 88]


def test_without_a_transcript_all_is_one_sentence(recording: Recording) -> None:
    assert replace(recording, sentences=()).spans() == [range(88)]


BOX, PHONES, TRANSCRIPT = "box.json", "phones.json", "transcript.json"


@pytest.mark.parametrize("name", [BOX, PHONES, TRANSCRIPT])
def test_a_missing_or_broken_file_is_named(folder: Path, name: str) -> None:
    path = folder / "recording" / name
    for content, message in ((b"{,", "is no JSON"), (b'"\xff"', "is no JSON"), (b"3", name)):
        path.write_bytes(content)
        with pytest.raises(TrainingFailed, match=message) as raised:
            read(folder)
        assert str(path) in raised.value.message
    path.unlink()
    with pytest.raises(TrainingFailed, match="cannot be read: No such file"):
        read(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda box: box.update(x=15), "4:2:0 needs even numbers"),
        (lambda box: box.update(h=47), "4:2:0 needs even numbers"),
        (lambda box: box.update(frame=[97, 80]), "4:2:0 needs even numbers"),
        (lambda box: box.update(x=60), "not inside the frame"),
        (lambda box: box.update(y=-2), "not inside the frame"),
        (lambda box: box.update(w=0), "not inside the frame"),
        (lambda box: box.update(fps=0), "0 frames a second"),
        (lambda box: box.pop("fps"), "needs x, y, w, h, fps and frame"),
        (lambda box: box.update(frame=[96]), "needs x, y, w, h, fps and frame"),
        (lambda box: box.update(w="wide"), "needs x, y, w, h, fps and frame"),
        (lambda box: box.update(w=62), "mouth picture 0 is 64x48, box.json says 62x48"),
    ],
)
def test_a_wrong_box(folder: Path, change: Callable[[Any], Any], message: str) -> None:
    edit(folder / "recording" / BOX, change)
    with pytest.raises(TrainingFailed, match=message):
        read(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda _: [], "holds no phones"),
        (lambda phones: phones[3].__setitem__(0, "AA1"), "phone 3 is 'AA1', which is not ARPAbet without stress"),
        (lambda phones: phones[3].__setitem__(1, 0.1), r"phone 3 \(M\) does not start where the last one ends"),
        (lambda phones: phones[2].__setitem__(2, 0.1), r"phone 2 \(AA\) does not start"),
        (lambda phones: phones[3].append(1), r"needs a list of \[phone, start, end\]"),
        (lambda phones: phones[3].__setitem__(1, "soon"), r"needs a list of \[phone, start, end\]"),
        (lambda phones: phones[:9], "88 frames last 3.52 s, the phones 2.08 s|the phones"),
    ],
)
def test_wrong_phones(folder: Path, change: Callable[[Any], Any], message: str) -> None:
    edit(folder / "recording" / PHONES, change)
    with pytest.raises(TrainingFailed, match=message):
        read(folder)


def test_phones_may_be_of_no_length_but_not_of_less() -> None:
    check_phones([Phone("AA", 0, 0), Phone("SIL", 0, 1)], "here")
    with pytest.raises(TrainingFailed, match="here: phone 0"):
        check_phones([Phone("AA", 1, 0)], "here")


def test_a_wrong_transcript(folder: Path) -> None:
    edit(folder / "recording" / TRANSCRIPT, lambda sentences: sentences[1].pop("end"))
    with pytest.raises(TrainingFailed, match="needs a list of text, start and end"):
        read(folder)


def test_without_mouth_pictures(folder: Path) -> None:
    shutil.rmtree(folder / "recording" / "mouth")
    with pytest.raises(TrainingFailed, match=r"has neither mouth.mkv nor mouth/\*.png"):
        read(folder)


def test_pictures_that_are_none(folder: Path) -> None:
    (folder / "recording" / "mouth" / "00003.png").write_bytes(b"\x89PNG and no more")
    with pytest.raises(TrainingFailed, match=r"00003.png is missing or no picture"):
        read(folder)
    (folder / "recording" / "mouth.mkv").write_bytes(b"not a film")
    with pytest.raises(TrainingFailed, match=r"mouth.mkv cannot be decoded"):
        read(folder)


def test_an_odd_one_out_among_the_pictures(folder: Path) -> None:
    write_png(folder / "recording" / "mouth" / "00010.png", np.zeros((48, 60, 3), np.uint8))
    with pytest.raises(TrainingFailed, match=r"mouth picture 10 is 60x48, box.json says 64x48"):
        read(folder)


def test_fewer_pictures_than_the_phones_last(folder: Path) -> None:
    for number in range(60, 88):
        (folder / "recording" / "mouth" / f"{number:05d}.png").unlink()
    with pytest.raises(TrainingFailed, match=r"60 frames last 2.40 s, the phones 3.52 s") as raised:
        read(folder)
    assert raised.value.advice == "Frames and phones must be of the same recording."


def test_a_still_or_a_loop_of_another_size(folder: Path, recording: Recording) -> None:
    spoilt = replace(recording, folder=folder)
    write_png(folder / "recording" / "still.png", picture(OPENING["SIL"])[:, :90])
    with pytest.raises(TrainingFailed, match=r"still.png is 90x80, box.json says 96x80"):
        spoilt.still()
    write_lossless(folder / "idle" / "frames.mkv", [picture(0)[:64]])
    with pytest.raises(TrainingFailed, match=r"frames.mkv is 96x64, box.json says 96x80"):
        list(spoilt.loop())


def test_a_missing_still_or_loop(folder: Path, recording: Recording) -> None:
    spoilt = replace(recording, folder=folder)
    (folder / "recording" / "still.png").unlink()
    (folder / "idle" / "frames.mkv").unlink()
    with pytest.raises(TrainingFailed, match=r"still.png is missing or no picture"):
        spoilt.still()
    with pytest.raises(TrainingFailed, match=r"frames.mkv cannot be decoded"):
        list(spoilt.loop())


def test_pose_maps_that_are_none(folder: Path, recording: Recording) -> None:
    spoilt, path = replace(recording, folder=folder), folder / "idle" / "warp.npz"
    for content in (b"", b"PK\x03\x04 cut", b"text"):
        path.write_bytes(content)
        with pytest.raises(TrainingFailed, match=r"warp.npz is no pose map"):
            spoilt.loop_map()
    flat = np.zeros((4, 20, 24), np.float32)
    for arrays in (
        {"warp": flat[..., None].repeat(2, 3)},
        {"step": np.array(4)},
        {"warp": flat, "step": np.array(4)},
        {"warp": flat[..., None].repeat(2, 3), "step": np.array(0)},
        {"warp": np.array([{}], object), "step": np.array(4)},
    ):
        np.savez(path, **arrays)
        with pytest.raises(TrainingFailed, match=r"warp.npz is no pose map"):
            spoilt.loop_map()
    path.unlink()
    with pytest.raises(TrainingFailed, match=r"warp.npz is no pose map"):
        spoilt.loop_map()


def test_json_is_read_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"name": "Zoë"}', encoding="utf-8")
    assert read_json(tmp_path / "a.json") == {"name": "Zoë"}
