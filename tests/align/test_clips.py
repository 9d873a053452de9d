from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from locked import lock

from app.align.clips import VIDEO_SUFFIXES, Clip, find_clips
from app.errors import InputError

Make = Callable[..., Path]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """`make("a/b.mp4", text="…")`: a file and the folders above it."""

    def write(name: str, text: str = "hello") -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write


def said(clips: list[Clip]) -> dict[str, str | None]:
    """What file says what is said in each clip."""
    return {clip.name: clip.transcript.name if clip.transcript else None for clip in clips}


# --- videos -----------------------------------------------------------------------------------------------------------


def test_folders_are_searched_and_sorted(make: Make, tmp_path: Path) -> None:
    for name in ("b/2.mp4", "b/1.MOV", "a/deep/3.webm", "notes.txt", "a/picture.jpg", ".hidden/4.mp4", "a/._3.mp4"):
        make(name)
    clips = find_clips([tmp_path])
    assert [clip.name for clip in clips] == ["a/deep/3", "b/1", "b/2"]
    assert [clip.video for clip in clips] == [tmp_path / "a/deep/3.webm", tmp_path / "b/1.MOV", tmp_path / "b/2.mp4"]


def test_every_kind_of_video(make: Make, tmp_path: Path) -> None:
    for number, suffix in enumerate(VIDEO_SUFFIXES):
        make(f"{number:02}{suffix}")
    assert len(find_clips([tmp_path])) == len(VIDEO_SUFFIXES)


def test_names_begin_where_all_videos_are(make: Make, tmp_path: Path) -> None:
    assert [clip.name for clip in find_clips([make("x/y/a.mp4")])] == ["a"]
    make("x/z/a.mp4")
    assert [clip.name for clip in find_clips([tmp_path])] == ["y/a", "z/a"]


def test_names_are_unique(make: Make, tmp_path: Path) -> None:
    for name in ("a.mp4", "a.mov", "b.mp4", "a.mp4.mkv"):
        make(name)
    assert [clip.name for clip in find_clips([tmp_path])] == ["a.mov", "a.mp4", "a.mp4.mkv", "b"]


def test_a_video_named_twice_is_one(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b, _ = make("b.mp4"), make("a.mp4")
    monkeypatch.chdir(tmp_path)
    assert [clip.video for clip in find_clips([b, tmp_path, Path("b.mp4")])] == [b, tmp_path / "a.mp4"]


def test_a_video_may_have_any_suffix_if_it_is_named(make: Make) -> None:
    assert find_clips([make("a.vob")])[0].name == "a"


def test_a_folder_may_be_called_like_a_video(make: Make, tmp_path: Path) -> None:
    inside = make("x.mp4/y.mp4")
    assert [clip.video for clip in find_clips([tmp_path])] == [inside]
    assert [clip.video for clip in find_clips([tmp_path / "x.mp4"])] == [inside]
    (tmp_path / "empty.mp4").mkdir()
    with pytest.raises(InputError, match=r"no video in .*empty\.mp4"):
        find_clips([tmp_path / "empty.mp4"])


def test_no_videos(make: Make, tmp_path: Path) -> None:
    make("a.txt")
    with pytest.raises(InputError, match="no video in") as caught:
        find_clips([tmp_path])
    assert ".mp4" in caught.value.advice
    with pytest.raises(InputError, match="no video in nothing given"):
        find_clips([])


def test_a_missing_path(make: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"video .*gone\.mp4 is not there"):
        find_clips([make("a.mp4"), tmp_path / "gone.mp4"])
    with pytest.raises(InputError, match=r"transcript .*gone\.txt is not there"):
        find_clips([make("a.mp4")], [tmp_path / "gone.txt"])


def test_a_pipe_is_no_video(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mp4")
    with pytest.raises(InputError, match="neither a file nor a folder"):
        find_clips([tmp_path / "a.mp4"])
    with pytest.raises(InputError, match="no video in"):
        find_clips([tmp_path])


def test_a_locked_folder(make: Make, tmp_path: Path) -> None:
    make("a/b.mp4")
    lock(tmp_path / "a")
    try:
        with pytest.raises(InputError, match="cannot be read: Permission denied"):
            find_clips([tmp_path])
    finally:
        (tmp_path / "a").chmod(0o700)


# --- a transcript beside each -----------------------------------------------------------------------------------------


def test_the_transcript_beside_a_video_that_knows_most_of_times(make: Make, tmp_path: Path) -> None:
    for name in ("a.mp4", "a.txt", "a.VTT", "b.mp4", "b.TXT", "c.mp4", "d.mp4", "d.align", "d.TextGrid", "e.txt"):
        make(name)
    assert said(find_clips([tmp_path])) == {"a": "a.VTT", "b": "b.TXT", "c": None, "d": "d.TextGrid"}


def test_two_of_one_kind_beside_a_video(make: Make, tmp_path: Path) -> None:
    for name in ("a.mp4", "a.txt", "a.TXT"):
        make(name)
    with pytest.raises(InputError, match=r"a\.mp4 has several transcripts: .*a\.TXT, .*a\.txt"):
        find_clips([tmp_path])


# --- transcripts given ------------------------------------------------------------------------------------------------


def test_one_for_one_whatever_its_name(make: Make) -> None:
    assert said(find_clips([make("a.mp4")], [make("t/what I say.txt")])) == {"a": "what I say.txt"}


def test_a_folder_of_transcripts(make: Make, tmp_path: Path) -> None:
    for name in ("v/a.mp4", "v/b.mp4", "v/b.txt", "t/a.align", "t/a.txt", "t/other.txt"):
        make(name)
    assert said(find_clips([tmp_path / "v"], [tmp_path / "t"])) == {"a": "a.align", "b": None}


def test_trees_of_the_same_shape(make: Make, tmp_path: Path) -> None:
    for name in ("v/s1/1.mp4", "v/s2/1.mp4", "v/s3/1.mp4", "t/s1/1.txt", "t/s2/1.txt"):
        make(name)
    clips = find_clips([tmp_path / "v"], [tmp_path / "t"])
    assert [clip.transcript for clip in clips] == [tmp_path / "t/s1/1.txt", tmp_path / "t/s2/1.txt", None]


def test_folders_of_each_talker(make: Make, tmp_path: Path) -> None:
    for name in ("s1/video/1.mp4", "s1/align/1.align", "s2/video/1.mp4", "s2/align/1.align"):
        make(name)
    clips = find_clips([tmp_path], [tmp_path])
    assert [clip.transcript for clip in clips] == [tmp_path / "s1/align/1.align", tmp_path / "s2/align/1.align"]


def test_transcripts_that_are_as_near_as_each_other(make: Make, tmp_path: Path) -> None:
    for name in ("v/1.mp4", "x/1.txt", "y/1.txt"):
        make(name)
    with pytest.raises(InputError, match="several transcripts"):
        find_clips([tmp_path / "v"], [tmp_path / "x", tmp_path / "y"])


def test_transcripts_of_other_videos(make: Make) -> None:
    with pytest.raises(InputError, match=r"none of the transcripts belongs to a video: x\.txt"):
        find_clips([make("a.mp4"), make("b.mp4")], [make("x.txt")])
    with pytest.raises(InputError, match=r"x\.pdf: no kind of transcript"):
        find_clips([make("a.mp4")], [make("x.pdf")])


# --- lists ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "a|Hello there.\nb|More.\n",
        "\ufeffname\ttext\r\na.mp4\tHello there.\r\n\r\nb.mov\tMore.\r\n",
        "a|Hello there|Hello there.\nb|More.|\nsome other clip|Not here.\n",
    ],
)
@pytest.mark.parametrize("name", ["list.txt", "metadata.csv", "list.tsv"])
def test_a_list_for_all(make: Make, tmp_path: Path, text: str, name: str) -> None:
    make("v/a.mp4"), make("v/b.mov"), make("v/c.mp4")
    path = make(name, text)
    assert [(clip.name, clip.transcript, clip.text) for clip in find_clips([tmp_path / "v"], [path])] == [
        ("a", path, "Hello there."),
        ("b", path, "More."),
        ("c", None, None),
    ]


def test_a_list_for_one(make: Make) -> None:
    (clip,) = find_clips([make("a.mp4")], [make("list.txt", "a|Hello.\nb|More.")])
    assert clip.text == "Hello."


def test_names_with_folders_in_a_list(make: Make, tmp_path: Path) -> None:
    make("v/s1/1.mp4"), make("v/s2/1.mp4")
    clips = find_clips([tmp_path / "v"], [make("list.txt", "s1/1|One.\ns2/1|Two.")])
    assert [clip.text for clip in clips] == ["One.", "Two."]
    with pytest.raises(InputError, match="1 is the name of both") as caught:
        find_clips([tmp_path / "v"], [make("short.txt", "1|One.")])
    assert "s1/1 and s2/1" in caught.value.advice


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a|Hello.\nb More.", "line 2: expected “name|text”, found “b More.”"),
        ("a|Hello.\n\na|More.", "line 3: there is another line for a"),
    ],
)
def test_faults_in_a_list_are_named(make: Make, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        find_clips([make("a.mp4"), make("b.mp4")], [make("list.txt", text)])
    assert caught.value.message == f"list.txt: {message}"


def test_two_lists_that_differ(make: Make) -> None:
    lists = [make("one.txt", "a|Hello.\nb|More."), make("two.txt", "a|Hello you.")]
    with pytest.raises(InputError, match="in several lists"):
        find_clips([make("a.mp4"), make("b.mp4")], lists)


def test_a_list_and_files(make: Make, tmp_path: Path) -> None:
    make("v/a.mp4"), make("v/b.mp4"), make("t/b.align"), make("t/list.txt", "a|Hello.")
    assert said(find_clips([tmp_path / "v"], [tmp_path / "t"])) == {"a": "list.txt", "b": "b.align"}
