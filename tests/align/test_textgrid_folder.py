from __future__ import annotations

import wave
from pathlib import Path

import numpy as np
import pytest
from test_transcript import grid

from app.align.aligner import Aligner, Alignment
from app.align.pocketsphinx import PocketSphinxAligner
from app.align.registry import create
from app.align.textgrid_folder import TextGridAligner
from app.errors import AlignmentFailed, ConfigError, NothingToSay
from app.speech import SILENCE, Phone, Speech, Word

RATE = 16_000
BLUE = [(0.0, 0.5, ""), (0.5, 1.0, "blue"), (1.0, 1.6, "fire"), (1.6, 2.0, "")]
PHONES = [
    (0.0, 0.5, ""), (0.5, 0.6, "B"), (0.6, 0.7, "L"), (0.7, 1.0, "UW1"), (1.0, 1.2, "F"), (1.2, 1.5, "AY1"),
    (1.5, 1.6, "ER0"), (1.6, 2.0, "sil"),
]  # fmt: skip


def sound(seconds: float = 2.0, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(-0.5, 0.5, round(seconds * RATE))
    return (np.round(noise * 32767) / 32767).astype(np.float32)


def write_wav(path: Path, samples: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes(np.round(samples * 32767).astype("<i2").tobytes())


def put(path: Path, words=BLUE, phones=PHONES) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(grid(words=words, phones=phones) if phones else grid(words=words), encoding="utf-8")


def made(folder: Path, **options: object) -> TextGridAligner:
    aligner = create("textgrid", {"folder": str(folder), **options})
    assert isinstance(aligner, TextGridAligner)
    return aligner


def test_times_by_what_is_said(tmp_path: Path) -> None:
    put(tmp_path / "speaker" / "a.TextGrid")
    aligner = made(tmp_path)
    assert isinstance(aligner, Aligner)
    found = aligner.align(sound(), RATE, "“Blue” FIRE!")
    assert [(phone.symbol, phone.start) for phone in found.phones] == [
        (SILENCE, 0.0), ("B", 0.5), ("L", 0.6), ("UW", 0.7), ("F", 1.0), ("AY", 1.2), ("ER", 1.5), (SILENCE, 1.6),
    ]  # fmt: skip
    assert found.phones[-1].end == 2.0
    assert found.words == (Word("“Blue”", 0.5, 1.0), Word("FIRE!", 1.0, 1.6))
    assert (found.guessed, found.confidence) == ((), 1.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("blue-fire", [("blue-fire", 0.5, 1.6)]),
        ("bluefire — !", [("bluefire", 0.5, 1.6)]),
        ("bl ue fire", [("bl", 0.5, 1.0), ("fire", 1.0, 1.6)]),
    ],
)
def test_words_that_are_divided_otherwise(tmp_path: Path, text: str, words: list[tuple[str, float, float]]) -> None:
    put(tmp_path / "a.TextGrid")
    assert made(tmp_path).align(sound(), RATE, text).words == tuple(Word(*word) for word in words)


@pytest.mark.parametrize("ending", [".lab", ".txt"])
def test_the_text_that_was_aligned_lies_in_the_corpus(tmp_path: Path, ending: str) -> None:
    """The Montreal Forced Aligner writes <unk> for words that it does not know."""
    words = [(0.0, 0.5, ""), (0.5, 1.0, "<unk>"), (1.0, 1.6, "fire"), (1.6, 2.0, "")]
    phones = [(0.0, 0.5, ""), (0.5, 1.0, "spn"), *PHONES[4:]]
    put(tmp_path / "aligned" / "anna" / "a.TextGrid", words, phones)
    corpus = tmp_path / "corpus" / "anna" / f"a{ending}"
    corpus.parent.mkdir(parents=True)
    corpus.write_text("Qwyx fire.\n", encoding="utf-8")
    found = made(tmp_path / "aligned", corpus=str(tmp_path / "corpus")).align(sound(), RATE, "Qwyx fire.")
    assert found.words == (Word("fire.", 1.0, 1.6),)
    assert found.phones[0] == Phone(SILENCE, 0.0, 1.0)


def test_the_same_text_twice_is_told_apart_by_length_then_by_sound(tmp_path: Path) -> None:
    put(tmp_path / "a.TextGrid")
    put(tmp_path / "b.TextGrid", [(0.0, 2.02, "blue fire")], [(0.0, 1.0, "AA"), (1.0, 2.02, "B")])
    put(tmp_path / "c.TextGrid", phones=[(0.0, 2.0, "AA")])
    aligner = made(tmp_path)
    assert aligner.align(sound(2.02), RATE, "blue fire").phones[0].symbol == "AA"
    with pytest.raises(AlignmentFailed, match=r"several files: a\.TextGrid, c\.TextGrid") as caught:
        aligner.align(sound(), RATE, "blue fire")
    assert "corpus" in caught.value.advice
    write_wav(tmp_path / "a.wav", sound(seed=1))
    write_wav(tmp_path / "c.wav", sound(seed=2))
    assert aligner.align(sound(seed=1), RATE, "blue fire").phones[1].symbol == "B"
    assert aligner.align(sound(seed=2), RATE, "blue fire").phones[0].symbol == "AA"
    with pytest.raises(AlignmentFailed, match="several files"):
        aligner.align(sound(seed=3), RATE, "blue fire")


def test_what_is_not_there(tmp_path: Path) -> None:
    put(tmp_path / "a.TextGrid")
    aligner = made(tmp_path)
    with pytest.raises(AlignmentFailed, match=r"aligner textgrid: none of 1 TextGrid files in .* says “red fire”") as e:
        aligner.align(sound(), RATE, "red fire")
    assert "NAME.TextGrid" in e.value.advice
    with pytest.raises(AlignmentFailed, match=r"the sound is 2\.50 s long, a\.TextGrid 2\.00 s"):
        aligner.align(sound(2.5), RATE, "blue fire")
    with pytest.raises(NothingToSay):
        aligner.align(sound(), RATE, "…")
    assert aligner.align(sound(2.04), RATE, "blue fire").phones[-1].end == 2.04


def test_files_that_cannot_be_used_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.TextGrid").write_text("nonsense")
    put(tmp_path / "b.TextGrid", phones=[])
    aligner = made(tmp_path)
    with pytest.raises(AlignmentFailed, match=r"none of 2 .*; 2 cannot be used, the first because: a\.TextGrid: "):
        aligner.align(sound(), RATE, "blue fire")
    put(tmp_path / "a.TextGrid", phones=[(0.0, 2.0, "sil")])
    with pytest.raises(AlignmentFailed, match="has no phone"):
        aligner.align(sound(), RATE, "blue fire")


def test_files_come_change_and_go(tmp_path: Path) -> None:
    aligner = made(tmp_path)
    with pytest.raises(AlignmentFailed, match="none of 0"):
        aligner.align(sound(), RATE, "blue fire")
    put(tmp_path / "a.TextGrid")
    assert aligner.align(sound(), RATE, "blue fire").words
    put(tmp_path / "a.TextGrid", [(0.0, 2.0, "something else")])
    with pytest.raises(AlignmentFailed, match="none of 1"):
        aligner.align(sound(), RATE, "blue fire")
    (tmp_path / "a.lab").write_text("blue fire")
    assert aligner.align(sound(), RATE, "blue fire")
    (tmp_path / "a.TextGrid").unlink()
    with pytest.raises(AlignmentFailed, match="none of 0"):
        aligner.align(sound(), RATE, "blue fire")


def test_what_another_aligner_found(tmp_path: Path, sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    """There and back: pocketsphinx's times, written as the Montreal Forced Aligner writes them."""
    text = "Every morning she drinks a cup of strong black coffee."
    speech = spoken[3]
    found = sphinx.align(speech.samples, speech.rate, text)
    words = [(word.start, word.end, word.text.lower().strip(".")) for word in found.words]
    put(tmp_path / "a.TextGrid", words, [(each.start, each.end, each.symbol) for each in found.phones])
    again = made(tmp_path).align(speech.samples, speech.rate, text)
    assert again == Alignment(found.phones, found.words, (), 1.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [({}, "folder"), ({"folder": "/no/such"}, "no folder /no/such"), ({"folder": "/", "corpus": "/no"}, "corpus")],
)
def test_wrong_options_are_named(options: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=rf"align\.aligners\.textgrid.*{said}"):
        create("textgrid", options)
