"""Every recipe of docs/recipes.md does what it says, pasted as it stands."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import av
import pytest

ROOT = Path(__file__).resolve().parent.parent
_BLOCK = re.compile(r"^## (?P<title>.+?)$(?:(?!^## ).)*?^```(?P<language>sh|python)$(?P<code>.+?)^```$", re.M | re.S)
RECIPES = [match.groupdict() for match in _BLOCK.finditer((ROOT / "docs" / "recipes.md").read_text(encoding="utf-8"))]


def test_every_block_belongs_to_a_recipe() -> None:
    text = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    assert len(RECIPES) == len(re.findall(r"^```(?:sh|python)$", text, re.M)) == len(re.findall(r"^## ", text, re.M))


@pytest.mark.parametrize("recipe", RECIPES, ids=[recipe["title"] for recipe in RECIPES])
@pytest.mark.usefixtures("curl_program")
def test_a_recipe(server: str, tmp_path: Path, recipe: dict[str, str], request: pytest.FixtureRequest) -> None:
    code = recipe["code"].replace("http://localhost:8080", server)
    if "rtmp://localhost" in code:
        elsewhere = request.getfixturevalue("rtmp_server")
        elsewhere.start()
        code = code.replace("rtmp://localhost", f"rtmp://{elsewhere.address}")
    interpreter = ["bash", "-euo", "pipefail", "-c"] if recipe["language"] == "sh" else [sys.executable, "-c"]
    done = subprocess.run(
        [*interpreter, code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "/problems/" not in done.stdout, done.stdout
    assert done.stdout or list(tmp_path.iterdir())
    for name in re.findall(r"[\w-]+\.(?:mp4|flv)(?![\w?])", code):
        if name.startswith(("live.flv", "video.mp4")) and not (tmp_path / name).exists():
            continue  # an address
        with av.open(str(tmp_path / name)) as container:
            assert {stream.type for stream in container.streams} == {"video", "audio"}
            assert sum(1 for _ in container.decode(video=0)) > 10
    for name in ("events.txt",) if "events.txt" in code else ():
        told = (tmp_path / name).read_text()
        assert all(f'"text": "{word}"' in told for word in ("One", "two", "three."))
    for name in re.findall(r"-o ([\w-]+\.vtt)", code):
        assert (tmp_path / name).read_text().startswith("WEBVTT\n\n00:")
