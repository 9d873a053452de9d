from __future__ import annotations

import datetime
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import av
import numpy as np
import pytest
from drawn_learnt import CROP, FRAMES, HEIGHT, MOUTH, TONE, WIDTH, Drawn, drawn, shift
from numpy.typing import NDArray

from app.engine.frame import planes
from app.engine.pack import FPS
from app.engine.training.footage import shots
from app.engine.training.report.loop_seams import loop_parts
from app.engine.training.report.page import FILM, PAGE, write_report
from app.engine.training.report.side_by_side import Stage, captions, choose_scenes, redrawn, write_side_by_side
from app.engine.training.report.steadiness import nose_motion
from app.engine.training.take import Refusal
from app.speech import Word

NAMES = ("<b>.mp4", "two", "three", "four", "five", "six", "seven", "eight")
REFUSED = (
    Refusal("lost", None, "no face found"),
    *(Refusal("two", frame, f"the head moves too fast: {10 + frame} pixels in one picture") for frame in (4, 5, 6, 9)),
)
DAY = datetime.date(2020, 2, 3)


class Page(HTMLParser):
    """What a page holds: its tags, the addresses in it, and its text."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.text = ""
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href") and value]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += data + " "


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    return drawn(tmp_path_factory.mktemp("clips"), NAMES, refused=REFUSED)


@pytest.fixture(scope="module")
def folder(found: Drawn, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pack")
    refused = [("<script>.mov", "text and sound do not fit (0.31)"), ("b.mov", "text and sound do not fit (0.22)")]
    write_report(
        found.learnt, found.pack, folder, refused_clips=refused, agreement_lines=["8 of 10 clips fit <well>"], date=DAY
    )
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / PAGE).read_text(encoding="utf-8"))


def words(page: Page) -> str:
    return re.sub(r"\s+", " ", page.text)


# The page


def test_the_page_is_whole_and_needs_nothing_but_the_film(folder: Path, page: Page) -> None:
    assert page.open == []
    assert {address for address in page.addresses if not address.startswith("data:image/")} == {FILM}
    assert {path.name for path in folder.iterdir()} == {PAGE, FILM}


def test_what_was_learnt_from(page: Page) -> None:
    text = words(page)
    assert "8 used, 1 refused in training" in text
    assert f"{236 / FPS:.1f} s of usable pictures of {240 / FPS:.1f} s" in text
    assert "236 of 240 pictures" in text
    assert "64 x 48 pixels at (52, 66)" in text
    assert "8, of which 1 for validation" in text
    assert "2020-02-03" in text
    assert "8 of 10 clips fit <well>" in text


def test_rejections_are_grouped_by_reason(page: Page) -> None:
    text = words(page)
    assert "text and sound do not fit (0.22 to 0.31) 2 clips <script>.mov; b.mov" in text
    assert "no face found 1 clip lost" in text
    assert "the head moves too fast: 14 to 19 pixels in one picture 4 pictures two: 4 to 6, 9" in text


def test_names_are_text_and_never_markup(page: Page) -> None:
    assert "<b>.mp4" in page.text
    assert "Nobody & <i>Co</i>: training report" in page.text
    assert not {"b", "i", "script", "well"} & set(page.tags)


def test_phones_that_were_never_heard_say_what_stands_in(page: Page) -> None:
    text = words(page)
    assert "4 of 39 phones were heard" in text
    assert "B 0 0 / 0 never heard: shown as P.0 and P.1" in text
    assert "AE 0 0 / 0 never heard: shown as EH.0 and EH.1" in text
    assert re.search(r"EH 2 \d / \d fewer than 5 times", text)
    assert re.search(r"AA 8 \d / \d M", text)


def test_all_prototypes_and_modes_are_shown(found: Drawn, page: Page) -> None:
    text = words(page)
    assert "The 3 mouths" in text
    assert text.count("(reference)") == 1
    assert len(found.learnt.articulation.trials) == 4
    for trial in found.learnt.articulation.trials:
        assert f"{trial.name} {trial.scores.error_weighted:.3f}" in text


def test_the_loop_names_its_clips(found: Drawn, page: Page) -> None:
    parts = loop_parts(found.learnt.corpus, found.pack.background)
    assert parts
    assert parts[-1].until == found.pack.background.frames
    for part in parts:
        assert 0 <= min(part.first, part.last) <= max(part.first, part.last) < FRAMES
        assert f"{part.clip} {part.first} to {part.last}" in words(page)


def test_the_same_training_gives_the_same_files(found: Drawn, folder: Path, tmp_path: Path) -> None:
    write_report(found.learnt, found.pack, tmp_path, date=DAY)
    assert (tmp_path / FILM).read_bytes() == (folder / FILM).read_bytes()
    first = (tmp_path / PAGE).read_bytes()
    write_report(found.learnt, found.pack, tmp_path, date=DAY)
    assert (tmp_path / PAGE).read_bytes() == first


def test_one_clip_with_a_given_loop_has_no_film(tmp_path: Path) -> None:
    one = drawn(tmp_path, ["only"], given_loop=True, sound=False)
    assert one.learnt.articulation.validation == ()
    (tmp_path / "pack").mkdir()
    write_report(one.learnt, one.pack, tmp_path / "pack")
    assert [path.name for path in (tmp_path / "pack").iterdir()] == [PAGE]
    page = Page((tmp_path / "pack" / PAGE).read_text(encoding="utf-8"))
    assert page.open == []
    assert "video" not in page.tags
    assert "too few passages for a validation part" in words(page)
    assert "It was given." in words(page)
    assert "Nothing." in words(page)


def test_a_film_that_cannot_be_made_does_not_lose_the_report(found: Drawn, tmp_path: Path) -> None:
    poses = found.learnt.corpus.poses.copy()
    poses[..., 2] += 500
    away = replace(found.learnt, corpus=replace(found.learnt.corpus, poses=poses))
    write_report(away, found.pack, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [PAGE]
    said = words(Page((tmp_path / PAGE).read_text(encoding="utf-8")))
    assert "The film could not be made: the mouth leaves the picture." in said


# The nose


def test_the_nose_moves_as_the_head_does_and_is_still_afterwards(found: Drawn) -> None:
    nose = nose_motion(found.learnt.corpus)
    assert nose is not None
    assert len(nose.before) == len(nose.after) == 236
    moved = np.array([shift(frame) for frame in range(FRAMES)], float)
    expected = np.hypot(*(moved - moved.mean(0)).T)
    np.testing.assert_allclose(nose.before[:FRAMES], expected, atol=0.15)
    assert nose.after.max() < 0.1


# The film


def decoded(path: Path) -> NDArray[np.uint8]:
    with av.open(str(path)) as container:
        return np.stack([frame.to_ndarray(format="yuv420p") for frame in container.decode(video=0)])


def test_the_film_plays_in_browsers_and_is_as_long_as_its_sentences(found: Drawn, folder: Path) -> None:
    scenes = choose_scenes(found.learnt)
    seconds = sum(scene.frames for scene in scenes) / FPS
    assert [found.learnt.corpus.takes[scene.passage.take].name for scene in scenes] == ["four"]
    assert seconds == pytest.approx(1.2)
    with av.open(str(folder / FILM)) as container:
        video, audio = container.streams.video[0], container.streams.audio[0]
        assert (video.codec_context.name, audio.codec_context.name) == ("h264", "aac")
        assert video.codec_context.pix_fmt == "yuv420p"
        assert video.average_rate == FPS
        assert (video.width, video.height) == Stage.of((WIDTH, HEIGHT)).size
        assert video.start_time == audio.start_time == 0
        assert float(video.duration * video.time_base) == pytest.approx(seconds)
        assert float(audio.duration * audio.time_base) == pytest.approx(seconds, abs=0.03)
    content = (folder / FILM).read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")


def test_both_halves_differ_only_at_the_mouth(folder: Path) -> None:
    luma = decoded(folder / FILM)[:, :HEIGHT].astype(float)
    off = np.abs(luma[..., :WIDTH] - luma[..., WIDTH:])
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    near = np.hypot(x - MOUTH[0], y - MOUTH[1]) < 32
    far = ~near & (x > 2) & (x < WIDTH - 3)  # blocks of the coder cross the middle
    assert off[:, near].max() > 30
    assert off[:, far].max() < 15
    assert off[:, far].mean() < 1.5


def test_the_mouth_is_the_predicted_one_at_the_heads_place(found: Drawn) -> None:
    scene = choose_scenes(found.learnt)[0]
    corpus, appearance = found.learnt.corpus, found.learnt.appearance
    own = replace(scene, coefficients=appearance.coefficients[scene.passage.frames.start : scene.passage.frames.stop])
    rest = corpus.rest[scene.passage.frames.start : scene.passage.frames.stop]
    offset = own.coefficients[rest].mean(0) - appearance.rest
    own = replace(own, coefficients=own.coefficients - offset)
    for recorded, drawn_again in redrawn(found.learnt, own):
        window = (slice(CROP.y + 8, CROP.y + 40), slice(CROP.x + 12, CROP.x + 52))
        off = planes(recorded)[0][window].astype(float) - planes(drawn_again)[0][window]
        assert np.sqrt((off**2).mean()) < 4, "its own analysed mouth is the mouth it has"
    closed = replace(scene, coefficients=np.repeat(appearance.rest[None], FRAMES, 0))
    darkest = []
    for at, (recorded, drawn_again) in enumerate(redrawn(found.learnt, closed)):
        across, down = shift(at)
        inside = (slice(MOUTH[1] + down + 3, MOUTH[1] + down + 6), slice(MOUTH[0] + across - 4, MOUTH[0] + across + 5))
        darkest.append((planes(recorded)[0][inside].mean(), planes(drawn_again)[0][inside].mean()))
    recorded_luma, closed_luma = np.array(darkest).T
    assert recorded_luma.min() < 70, "the recorded mouth opens"
    assert closed_luma.min() > 110, "a closed one leaves nothing of it"


def test_the_recorded_picture_is_not_touched(found: Drawn) -> None:
    scene = choose_scenes(found.learnt)[0]
    video = found.learnt.corpus.takes[scene.passage.take].video
    for shot, (recorded, _) in zip(shots(video), redrawn(found.learnt, scene), strict=True):
        np.testing.assert_array_equal(shot.picture, recorded)


def heard(path: Path) -> tuple[NDArray[np.float32], int]:
    with av.open(str(path)) as container:
        frames = list(container.decode(audio=0))
    return np.concatenate([frame.to_ndarray()[0] for frame in frames]), frames[0].sample_rate


def test_the_sound_is_that_of_the_clip_on_its_clock(folder: Path) -> None:
    samples, rate = heard(folder / FILM)
    loud = np.flatnonzero(np.abs(samples) > 0.1) / rate
    assert loud.min() == pytest.approx(0.4, abs=0.02)
    assert loud.max() == pytest.approx(0.72, abs=0.02)
    spoken = samples[round(0.45 * rate) : round(0.65 * rate)]
    spectrum = np.abs(np.fft.rfft(spoken * np.hanning(len(spoken))))
    assert spectrum.argmax() * rate / len(spoken) == pytest.approx(TONE, abs=6)


def test_clips_of_other_sizes_and_without_sound_are_fitted_in(
    found: Drawn, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = choose_scenes(found.learnt)[0]
    take = found.learnt.corpus.takes[scene.passage.take]
    with av.open(str(take.video)) as source, av.open(str(tmp_path / "silent.mp4"), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    takes = tuple(replace(each, video=tmp_path / "silent.mp4") for each in found.learnt.corpus.takes)
    silent = replace(found.learnt, corpus=replace(found.learnt.corpus, takes=takes))
    monkeypatch.setattr("app.engine.training.report.side_by_side.WIDEST", 100)
    write_side_by_side(silent, [scene], tmp_path / "film.mp4")
    assert np.abs(heard(tmp_path / "film.mp4")[0]).max() < 1e-3
    assert decoded(tmp_path / "film.mp4").shape[2] == 200


@pytest.mark.parametrize(
    ("times", "seconds"),
    [(1, 1.2), (40, 20.0)],
)
def test_the_film_has_an_end(found: Drawn, times: int, seconds: float) -> None:
    spoken = found.learnt.articulation
    more = replace(spoken, validation=spoken.validation * times, predicted=spoken.predicted * times)
    scenes = choose_scenes(replace(found.learnt, articulation=more))
    total = sum(scene.frames for scene in scenes) / FPS
    assert seconds - 1.3 < total <= seconds


def test_captions_say_the_word_and_the_phone(found: Drawn) -> None:
    scene = choose_scenes(found.learnt)[0]
    assert captions(found.learnt, scene) == ["SIL"] * 10 + ["M"] * 2 + ["AA"] * 3 + ["P"] * 3 + ["SIL"] * 12
    words = [Word("Café", 0.4, 0.62), Word("donaudampfschiff", 0.62, 0.72)]
    said = captions(found.learnt, scene, words)
    assert said[9:19] == ["SIL", *["Cafe M"] * 2, *["Cafe AA"] * 3, *["donaudampfsc.. P"] * 3, "SIL"]


def test_captions_stay_under_their_pictures() -> None:
    stage = Stage.of((1280, 720))
    assert stage.size == (1280, 360 + 32)
    picture = np.full((1080, 1280), 200, np.uint8)
    shown = planes(stage.show(picture, picture, "AA"))[0]
    assert (shown[:360] == 200).all()
    for half in (shown[360:, :640], shown[360:, 640:]):
        assert half.max() > 200, "a label"
        assert half[:, :4].max() == half[:, -4:].max() == half[:2].max() == half[-2:].max(), "with room about it"
    tall = np.full((300, 100), 200, np.uint8)
    fitted = planes(stage.show(tall, tall, ""))[0]
    assert (fitted[:360, 235:400] == 200).all()
    assert fitted[:360, :220].max() < 50
