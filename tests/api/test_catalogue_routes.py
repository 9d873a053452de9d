from __future__ import annotations

from pathlib import Path

import av
import pytest

from app.tts.registry import create


def test_avatars_are_listed(server: str, curl) -> None:
    listed = curl(f"{server}/v1/avatars").json()
    assert listed["default"] == "mary"
    mary = next(avatar for avatar in listed["avatars"] if avatar["id"] == "mary")
    assert (mary["fps"], mary["width"], mary["height"]) == (25, 512, 512)
    assert mary["title"]
    assert mary["voice"]


def test_the_idle_clip_loops_over_all_frames(server: str, curl, tmp_path: Path) -> None:
    mary = curl(f"{server}/v1/avatars").json()["avatars"][0]
    clip = curl(server + mary["idle"])
    assert clip.headers["content-type"] == "video/mp4"
    file = tmp_path / "idle.mp4"
    file.write_bytes(clip.body)
    with av.open(str(file)) as container:
        assert sum(1 for _ in container.decode(video=0)) == 125
    part = curl(server + mary["idle"], "--range", "0-99")
    assert (part.status, part.body) == (206, clip.body[:100])


def test_the_preview_is_a_picture(server: str, curl) -> None:
    preview = curl(f"{server}/v1/avatars/mary/preview.jpg")
    assert preview.headers["content-type"] == "image/jpeg"
    assert preview.body.startswith(b"\xff\xd8")


@pytest.mark.parametrize("path", ["/v1/avatars/mary/idle.mp4", "/v1/avatars/mary/preview.jpg"])
def test_head_works(server: str, curl, path: str) -> None:
    answer = curl(server + path, "--head")
    assert answer.status == 200
    assert int(answer.headers["content-length"]) > 0


def test_voices_are_listed(server: str, curl) -> None:
    listed = curl(f"{server}/v1/voices").json()
    ids = [voice["id"] for voice in listed["voices"]]
    assert ids == [voice.id for voice in create("mock").voices()]
    assert listed["default"] in ids
    assert listed["voices"][0].keys() == {
        "id", "name", "language", "sex", "rate", "licence", "engine", "installed", "missing"
    }  # fmt: skip
