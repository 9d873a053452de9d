from __future__ import annotations

from pathlib import Path

import pytest

from app.align.aligner import Alignment
from app.align.alignment_cache import AlignmentCache, Entry
from app.align.clips import Clip
from app.errors import InputError
from app.speech import Phone, Word

THIRD = 1 / 3
ENTRY = Entry(
    Alignment((Phone("SIL", 0.0, THIRD), Phone("AY", THIRD, 1.0)), (Word("Ⅰ", THIRD, 1.0),), ("Ⅰ",), 0.1 + 0.2),
    -0.02,
    0.5,
)


@pytest.fixture
def clip(tmp_path: Path) -> Clip:
    video, transcript = tmp_path / "a.mp4", tmp_path / "a.txt"
    video.write_bytes(b"video")
    transcript.write_bytes(b"text")
    return Clip("a", video, transcript)


def test_what_is_written_is_read(tmp_path: Path, clip: Clip) -> None:
    key = AlignmentCache(tmp_path / "x/y").key(clip, "mock")
    AlignmentCache(tmp_path / "x/y").write(key, ENTRY)
    assert AlignmentCache(tmp_path / "x/y").read(key) == ENTRY
    assert [path.name for path in (tmp_path / "x/y").iterdir()] == [f"{key}.json"]


def test_the_key_is_the_content(tmp_path: Path, clip: Clip) -> None:
    cache = AlignmentCache(tmp_path)
    key = cache.key(clip, "mock")
    moved = clip.video.rename(tmp_path / "b.mp4")
    assert cache.key(Clip("b", moved, clip.transcript), "mock") == key
    assert cache.key(Clip("b", moved, clip.transcript), "other") != key
    assert cache.key(Clip("b", moved, clip.transcript, "text"), "mock") != key
    assert clip.transcript is not None
    other_kind = clip.transcript.rename(tmp_path / "a.vtt")
    assert cache.key(Clip("b", moved, other_kind), "mock") != key
    moved.write_bytes(b"other video")
    assert cache.key(Clip("b", moved, other_kind.rename(tmp_path / "a.txt")), "mock") != key


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff", b"{}", b'{"phones": [], "words": [], "guessed": []}'])
def test_what_cannot_be_read_is_as_if_it_were_not_there(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "key.json").write_bytes(content)
    assert AlignmentCache(tmp_path).read("key") is None
    AlignmentCache(tmp_path).write("key", ENTRY)
    assert AlignmentCache(tmp_path).read("key") == ENTRY


def test_a_cut_off_entry_is_ignored(tmp_path: Path) -> None:
    cache = AlignmentCache(tmp_path)
    cache.write("key", ENTRY)
    whole = (tmp_path / "key.json").read_bytes()
    for size in range(len(whole)):
        (tmp_path / "key.json").write_bytes(whole[:size])
        assert cache.read("key") is None


def test_nothing_written_is_no_fault(tmp_path: Path) -> None:
    cache = AlignmentCache(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    cache.write("key", ENTRY)
    assert cache.read("key") is None


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be used to keep alignments"):
        AlignmentCache(tmp_path / "file")
