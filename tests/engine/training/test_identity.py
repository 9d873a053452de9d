from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from app.engine.pack import Consent
from app.engine.training.identity import Identity, read_identity
from app.errors import TrainingFailed

NOBODY = {
    "id": "nobody", "title": "Nobody", "voice": "mock", "licence": "CC0-1.0", "provenance": "drawn by a test",
    "consent": {"subject": "nobody", "statement": "an ellipse"},
}  # fmt: skip


def written(folder: Path, content: Any) -> Path:
    path = folder / "avatar.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_an_identity_is_read(tmp_path: Path) -> None:
    found = read_identity(written(tmp_path, NOBODY))
    consent = Consent(subject="nobody", statement="an ellipse")
    assert found == Identity(
        id="nobody", title="Nobody", voice="mock", licence="CC0-1.0", provenance="drawn by a test", consent=consent
    )


def test_marys_is_one() -> None:
    found = read_identity(Path(__file__).resolve().parents[3] / "avatars" / "mary" / "avatar.json")
    assert found.id == "mary"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda identity: identity.pop("consent") and None, r"avatar\.json: consent: Field required"),
        (lambda identity: identity["consent"].update(subject=""), r"avatar\.json: consent\.subject"),
        (
            lambda identity: identity["consent"].pop("statement") and None,
            r"avatar\.json: consent\.statement: Field required",
        ),
        (lambda identity: identity.update(id="No Body"), r"avatar\.json: id"),
        (lambda identity: identity.update(id="../mary"), r"avatar\.json: id"),
        (lambda identity: identity.update(licence=""), r"avatar\.json: licence"),
        (lambda identity: identity.update(shoe_size=39), r"avatar\.json: shoe_size: Extra inputs"),
        (lambda _: [], r"avatar\.json: the file: Input should be"),
        (lambda _: "nobody", r"avatar\.json: the file: Input should be"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, change: Callable[[Any], Any], message: str) -> None:
    content = json.loads(json.dumps(NOBODY))
    changed = change(content)
    with pytest.raises(TrainingFailed, match=message):
        read_identity(written(tmp_path, content if changed is None else changed))


def test_none_at_all(tmp_path: Path) -> None:
    with pytest.raises(TrainingFailed, match=r"avatar\.json is missing: .*consent") as raised:
        read_identity(tmp_path / "avatar.json")
    assert "docs/training.md" in raised.value.advice


@pytest.mark.parametrize("content", [b"{", b"", b"\xff\xfe\x00"])
def test_no_json(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "avatar.json").write_bytes(content)
    with pytest.raises(TrainingFailed, match=r"avatar\.json is no JSON"):
        read_identity(tmp_path / "avatar.json")


def test_a_folder(tmp_path: Path) -> None:
    (tmp_path / "avatar.json").mkdir()
    with pytest.raises(TrainingFailed, match=r"avatar\.json cannot be read: Is a directory"):
        read_identity(tmp_path / "avatar.json")
