from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from app.config import Settings, load
from app.errors import ConfigError

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(autouse=True)
def no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    for name in list(os.environ):
        if name.upper().startswith("MARY_"):
            monkeypatch.delenv(name)


@pytest.fixture
def written(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "config.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_the_file_in_the_repository_names_every_key_with_its_default() -> None:
    values = yaml.safe_load((ROOT / "config.yaml").read_text())
    defaults = Settings().model_dump(mode="json")
    assert values == defaults


def test_a_file_is_read(written) -> None:
    settings = load(written("server: {port: 9000}\nstream: {crf: 30}\n"))
    assert settings.server.port == 9000
    assert settings.stream.crf == 30
    assert settings.server.host == "0.0.0.0"


def test_an_empty_file_means_the_defaults(written) -> None:
    assert load(written("# nothing\n")).server == Settings().server


def test_the_environment_wins_over_the_file(written, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MARY_SERVER__PORT", "9001")
    settings = load(written("server: {port: 9000, host: localhost}\n"))
    assert (settings.server.port, settings.server.host) == (9001, "localhost")


def test_lists_come_from_the_environment_as_json(written, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MARY_WEBRTC__ADDRESSES", '["192.0.2.1"]')
    assert load(written("")).webrtc.addresses == ["192.0.2.1"]


def test_what_webrtc_needs_behind_a_firewall(written) -> None:
    text = """
    webrtc:
      addresses: [203.0.113.5, "2001:db8::1"]
      ports: 50000-50100
      stun: stun:stun.example.org:3478
      turn: {url: "turns:turn.example.org?transport=tcp", username: mary, credential: "se\\"cret"}
      ice_servers: [{urls: "stun:stun.example.org"}, {urls: ["turn:a", "turns:b"], username: u, credential: c}]
    server: {cors_origins: ["https://www.example.org", "http://localhost:3000", "http://[::1]:80", "*"]}
    """
    webrtc = load(written(text)).webrtc
    assert webrtc.port_range == range(50000, 50101)
    assert [server.urls for server in webrtc.ice_servers] == [["stun:stun.example.org"], ["turn:a", "turns:b"]]
    assert Settings().webrtc.port_range is None


def test_relative_folders_are_relative_to_the_file(written) -> None:
    path = written("avatars: {folder: faces}\n")
    assert load(path).avatars.folder == path.parent / "faces"


def test_a_folder_from_the_environment_is_taken_as_it_is(written, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MARY_AVATARS__FOLDER", "faces")
    assert load(written("")).avatars.folder == Path("faces")


def test_without_a_file_here_that_of_the_repository_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load().avatars.folder == ROOT / "avatars"


@pytest.mark.parametrize(
    ("text", "field", "words"),
    [
        ("server: {prot: 1}", "server.prot", "unknown key"),
        ("servers: {port: 1}", "servers", "unknown key"),
        ("server: {port: 70000}", "server.port", "70000"),
        ("server: {port: high}", "server.port", "'high'"),
        ("engine: {renderer: slow}", "engine.renderer", "'slow'"),
        ("stream: [1, 2]", "stream", "valid"),
        ("stream: {preset: fastest}", "stream.preset", "'fastest'"),
        ("render: {preset: fastest}", "render.preset", "'veryslow'"),
        ("push: {rtmp: localhost/live}", "push.rtmp", "match pattern"),
        ("webrtc: {ice_servers: [{url: x}]}", "webrtc.ice_servers.0.urls", "required"),
        ("webrtc: {ice_servers: [{urls: 'http://x'}]}", "webrtc.ice_servers.0.urls.0", "http://x"),
        ("webrtc: {ice_servers: [{urls: 'turn:x>'}]}", "webrtc.ice_servers.0.urls.0", "turn:x>"),
        ("webrtc: {ice_servers: [{urls: []}]}", "webrtc.ice_servers.0.urls", "at least 1"),
        ("webrtc: {ice_servers: [{urls: 'turn:x', credential: 'ü'}]}", "webrtc.ice_servers.0.credential", "ü"),
        ("webrtc: {addresses: [www.example.org]}", "webrtc.addresses.0", "no host name"),
        *(
            (f"webrtc: {{ports: {ports!r}}}", "webrtc.ports", "range of ports")
            for ports in ("50000", "50100-50000", "80-90", "60000-70000", "50000-50100,6", "a-b", " ")
        ),
        ("webrtc: {stun: 'stuns:stun.example.org'}", "webrtc.stun", "stuns:"),
        ("webrtc: {turn: {url: 'stun:x', username: a, credential: b}}", "webrtc.turn.url", "stun:x"),
        ("webrtc: {turn: {url: 'turn:x'}}", "webrtc.turn.username", "required"),
        *(
            (f"server: {{cors_origins: [{origin!r}]}}", "server.cors_origins.0", "not an origin")
            for origin in (
                "www.example.org",
                "https://www.example.org/",
                "https://*.example.org",
                "null",
                "ftp://x",
                "",
            )
        ),
    ],
)
def test_wrong_values_are_named(written, text: str, field: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        load(written(text))
    assert caught.value.field == field
    assert "config.yaml" in caught.value.message
    assert caught.value.advice


@pytest.mark.parametrize("text", ["- 1\n- 2\n", "just words", "a: [", "\x00"])
def test_what_is_no_mapping_is_refused(written, text: str) -> None:
    with pytest.raises(ConfigError):
        load(written(text))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load(tmp_path / "nothing.yaml")


@pytest.mark.parametrize("name", ["MARY_PORT", "MARY_SERVER__PROT", "MARY_SERVERS__PORT"])
def test_unknown_variables_are_refused(written, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv(name, "1")
    with pytest.raises(ConfigError, match=name):
        load(written(""))


@pytest.mark.parametrize(("name", "value"), [("MARY_SERVER__PORT", "many"), ("MARY_WEBRTC__ADDRESSES", "[oops")])
def test_wrong_variables_are_named(written, monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(ConfigError) as caught:
        load(written(""))
    assert name in caught.value.message or "addresses" in caught.value.message


def test_settings_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Settings().server.port = 1  # type: ignore[misc]
