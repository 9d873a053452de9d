"""The folders' import rules of docs/architecture.md hold."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

APP = Path(__file__).resolve().parent.parent / "app"
MAY_IMPORT = {
    "tts": {"speech", "errors", "config", "plugins", "answer", "exchange", "worker", "onnx_fields", "align"},
    "align": {"speech", "errors", "plugins", "answer", "exchange", "worker"},
    "engine": {"speech", "errors", "plugins", "onnx_fields"},
    "evaluation": {"speech", "errors", "align", "engine"},
    "stream": {"speech", "errors", "config", "engine"},
    "commands": {"speech", "errors", "config", "tts", "align", "engine", "evaluation", "stream"},
    "api": {"speech", "errors", "config", "tts", "align", "engine", "stream"},
}


def imported(path: Path) -> set[str]:
    """Rooms of `app` that a module imports."""
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        rooms |= {name.split(".")[1] for name in names if name.startswith("app.")}
    return rooms


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_a_room_imports_only_what_it_may(room: str) -> None:
    modules = sorted((APP / room).rglob("*.py"))
    assert modules
    for module in modules:
        assert imported(module) - {room} <= MAY_IMPORT[room], module


def test_speech_imports_nothing_of_ours() -> None:
    assert imported(APP / "speech.py") == set()


@pytest.mark.parametrize("library", ["asyncio", "fastapi", "aiortc"])
def test_the_engine_knows_no_http_and_no_asyncio(library: str) -> None:
    for module in (APP / "engine").rglob("*.py"):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert library not in {name.split(".")[0] for name in names}, module
