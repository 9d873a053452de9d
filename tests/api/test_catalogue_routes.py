from __future__ import annotations

import json
import shutil
from pathlib import Path

import av
import pytest

from app.tts.registry import create, names

AVATARS = Path(__file__).resolve().parents[2] / "avatars"


def test_avatars_are_listed(server: str, curl) -> None:
    listed = curl(f"{server}/v1/avatars").json()
    assert listed["default"] == "mary"
    mary = next(avatar for avatar in listed["avatars"] if avatar["id"] == "mary")
    assert (mary["fps"], mary["width"], mary["height"]) == (25, 512, 512)
    assert mary["title"]
    assert mary["voice"]
    assert mary["trajectories"][0] == "gaussian"
    assert mary["renderers"] == ["fast", "reference"]


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


def test_a_damaged_avatar_is_left_out_and_named_without_its_place(own_server, curl, tmp_path: Path) -> None:
    folder = tmp_path / "faces"
    folder.mkdir()
    (folder / "mary").symlink_to(AVATARS / "mary")
    cracked = folder / "cracked"
    cracked.mkdir()
    for file in (AVATARS / "mary").iterdir():
        if file.is_file():
            shutil.copy(file, cracked)
    manifest = json.loads((cracked / "manifest.json").read_text())
    (cracked / "manifest.json").write_text(json.dumps(manifest | {"id": "cracked"}))
    (cracked / "model.npz").write_bytes(b"no model")
    with own_server(AVATARS__FOLDER=str(folder)) as server:
        listed = curl(f"{server.url}/v1/avatars").json()
        assert [avatar["id"] for avatar in listed["avatars"]] == ["mary"]
        order = '{"text": "Hello.", "avatar": "cracked"}'
        for path, *options in [
            ("/v1/streams", "--json", order),
            ("/v1/render", "--json", order),
            ("/v1/avatars/cracked/idle.mp4",),
            ("/v1/avatars/cracked/preview.jpg",),
        ]:
            answer = curl(server.url + path, *options)
            assert answer.status == 500
            problem = answer.json()
            assert problem["type"] == "/problems/bad-pack"
            assert problem["detail"] == "the avatar 'cracked' is damaged"
            assert str(tmp_path) not in answer.body.decode()
        assert str(cracked) in server.log.read_text()


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


def test_voices_of_all_engines_are_listed(server: str, curl) -> None:
    listed = curl(f"{server}/v1/voices?all=true").json()
    assert listed["engine"] == "mock"
    assert [engine["name"] for engine in listed["engines"]] == list(names())
    assert {"hibari", "mock"} <= {voice["engine"] for voice in listed["voices"]}
    assert not next(engine for engine in listed["engines"] if engine["name"] == "hibari")["missing"]


def test_a_voice_that_is_not_installed_is_refused(
    own_server, curl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HIBARI_HOME", str(tmp_path / "empty"))
    with own_server(SPEECH__ENGINE="hibari") as server:
        voices = {voice["id"]: voice for voice in curl(f"{server.url}/v1/voices").json()["voices"]}
        assert not voices["emma"]["installed"]
        for path in ("/v1/streams", "/v1/render"):
            answer = curl(server.url + path, "--json", '{"text": "Hello.", "voice": "emma"}')
            assert answer.status == 422
            problem = answer.json()
            assert problem["type"] == "/problems/missing-extra"
            assert problem["field"] == "voice"
            assert "emma" in problem["detail"]
            assert voices["emma"]["missing"] in problem["advice"]
