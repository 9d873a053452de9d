"""The command `mary`, run as people run it: in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import wave
from pathlib import Path

import av
import numpy as np
import pytest

from app.tts.hibari import HibariEngine

ROOT = Path(__file__).resolve().parent.parent
FPS = 25
RATE = 16_000


def command(*arguments: str, folder: Path) -> tuple[list[str], dict[str, object]]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MARY_")}
    environment |= {"MARY_SPEECH__ENGINE": "mock", "COLUMNS": "200"}
    return [sys.executable, "-m", "app", *arguments], {"cwd": folder, "env": environment}


@pytest.fixture
def mary(tmp_path: Path):
    def run(*arguments: str, text: str = "") -> subprocess.CompletedProcess[str]:
        call, options = command(*arguments, folder=tmp_path)
        return subprocess.run(call, **options, input=text, capture_output=True, text=True, timeout=90, check=False)  # type: ignore[call-overload, no-any-return]

    return run


@pytest.fixture
def sound(tmp_path: Path) -> Path:
    """Two seconds of a tone."""
    path = tmp_path / "speech.wav"
    samples = (8000 * np.sin(np.arange(2 * RATE) * 0.1)).astype("<i2")
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes(samples.tobytes())
    return path


@pytest.fixture
def written(tmp_path: Path):
    def write(entries: object) -> Path:
        path = tmp_path / "phones.json"
        path.write_text(entries if isinstance(entries, str) else json.dumps(entries))
        return path

    return write


def pictures(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]


def test_help_names_all_commands(mary) -> None:
    shown = mary("--help")
    assert shown.returncode == 0
    for name in ("serve", "say", "voices", "avatars", "train", "evaluate", "align-server", "bench"):
        assert name in shown.stdout


def test_the_version(mary) -> None:
    assert mary("--version").stdout.startswith("mary 0.")


def test_the_command_is_installed() -> None:
    program = Path(sys.executable).parent / "mary"
    assert subprocess.run([program, "--version"], capture_output=True, check=True).stdout.startswith(b"mary ")


def test_a_text_becomes_a_file(mary, tmp_path: Path) -> None:
    said = mary("say", "Hello, world. 🙂", "-o", "hello.mp4")
    assert said.returncode == 0, said.stderr
    assert "🙂" in said.stderr
    with av.open(str(tmp_path / "hello.mp4")) as container:
        assert [stream.codec_context.name for stream in container.streams] == ["h264", "aac"]
    assert len(pictures(tmp_path / "hello.mp4")) > FPS / 2
    assert [path.name for path in tmp_path.iterdir()] == ["hello.mp4"]


def test_a_text_can_come_from_standard_input(mary, tmp_path: Path) -> None:
    assert mary("say", "-", "-o", "hello.mp4", "--speed", "2", text="Hello.").returncode == 0
    assert (tmp_path / "hello.mp4").exists()


def test_given_sound_is_spoken_with_the_head_still(mary, sound: Path, written, tmp_path: Path) -> None:
    phones = written([["HH", 0.5, 0.6], ["AA", 0.6, 1.2], ["M", 1.2, 1.4]])
    said = mary("say", "--audio", str(sound), "--phones", str(phones), "--still", "-o", "out.mp4")
    assert said.returncode == 0, said.stderr
    frames = pictures(tmp_path / "out.mp4")
    assert abs(len(frames) - 2 * FPS) <= 6  # two seconds, and the mouth closing
    # Above the eyes and in the corners nothing moves: differences are the encoder's alone.
    top = np.stack([frame[:64] for frame in frames[: 2 * FPS]]).astype(int)
    assert np.abs(top - top[0]).mean() < 1.0


def test_a_recording_is_spoken_with_its_text_or_without(mary, tmp_path: Path) -> None:
    speech = HibariEngine().speak("My mother bought five big maps.")
    recording = tmp_path / "speech.wav"
    with wave.open(str(recording), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(speech.rate)
        file.writeframes((speech.samples * 32767).astype("<i2").tobytes())
    text = ("--text", "My mother bought five big maps.")
    for options, told in ((text, ""), ((), ""), (("--text", "Zqx my mother bought five big maps."), "Zqx")):
        said = mary("say", "--audio", str(recording), *options, "-o", "out.mp4")
        assert said.returncode == 0, said.stderr
        assert told in said.stderr
        assert abs(len(pictures(tmp_path / "out.mp4")) / FPS - speech.duration) < 0.3
    wrong = ("--text", "Seven sheep slept here until noon.")
    said = mary("say", "--audio", str(recording), *wrong, "-o", "out.mp4")
    assert "does not seem to be what is said" in said.stderr
    (tmp_path / "out.mp4").unlink()
    said = mary("say", "--audio", str(recording), *wrong, "--strict", "-o", "out.mp4")
    assert said.returncode == 2
    assert not (tmp_path / "out.mp4").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["say"], "text"),
        (["say", ""], "text"),
        (["say", "🙂"], "nothing to say"),
        (["say", "Hello", "--avatar", "nobody"], "nobody"),
        (["say", "Hello", "--avatar", "../mary"], "../mary"),
        (["say", "Hello", "--voice", "nobody"], "nobody"),
        (["say", "Hello", "--trajectory", "phone-mean"], "mary has: gaussian"),
        (["say", "Hello", "--renderer", "oil"], "fast, reference"),
        (["train", "nothing", "-o", "out", "--models", "oil"], "'oil'"),
        (["say", "Hello", "--speed", "9"], "--speed"),
        (["say", "Hello", "--config", "{config}"], "speech.voice"),
        (["say", "Hello", "-o", "no/such/folder/x.mp4"], "no/such/folder"),
        (["say", "Hello", "-o", "."], "cannot be written"),
        (["say", "--audio", "x.wav"], "x.wav cannot be read as sound"),
        (["say", "--audio", "{config}", "--text", "Hello"], "cannot be read as sound"),
        (["say", "--phones", "x.json"], "--audio"),
        (["say", "Hello", "--text", "Hello"], "twice"),
        (["say", "--audio", "x.wav", "--phones", "x.json", "--text", "Hello"], "--phones"),
        (["say", "--audio", "x.wav", "--phones", "x.json"], "x.wav"),
        (["say", "Hello", "--config", "nothing.yaml"], "nothing.yaml"),
        (["train", "nothing", "-o", "out"], "nothing"),
        (["serve", "--port", "70000"], "--port"),
        (["sing"], "sing"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(mary, tmp_path: Path, arguments: list[str], words: str) -> None:
    config = tmp_path.with_suffix(".yaml")
    config.write_text(f"{{speech: {{voice: nobody}}, avatars: {{folder: {ROOT / 'avatars'}}}}}")
    ended = mary(*(argument.replace("{config}", str(config)) for argument in arguments))
    assert ended.returncode == 2
    assert words in ended.stderr
    assert "Traceback" not in ended.stderr
    assert list(tmp_path.iterdir()) == []


def test_training_without_consent_is_exit_code_2(mary, tmp_path: Path) -> None:
    (tmp_path / "anna.mp4").write_bytes(b"")
    ended = mary("train", "anna.mp4", "-o", "out")
    assert ended.returncode == 2
    assert "consent" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stopped_it_leaves_nothing(tmp_path: Path, sent: signal.Signals, code: int) -> None:
    long = "This goes on and on, one word after another, until somebody stops it. " * 60
    call, options = command("say", long, "-o", "long.mp4", folder=tmp_path)
    with subprocess.Popen(call, **options, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:  # type: ignore[call-overload]
        give_up = time.monotonic() + 60
        while not list(tmp_path.iterdir()):  # the file being written, beside its place
            assert process.poll() is None
            assert time.monotonic() < give_up
            time.sleep(0.02)
        time.sleep(0.5)
        process.send_signal(sent)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == code
    assert b"Traceback" not in errors
    assert list(tmp_path.iterdir()) == []


def test_voices_and_avatars_are_listed(mary) -> None:
    assert "mock" in mary("voices").stdout
    listed = mary("avatars").stdout
    assert "mary" in listed
    assert "512x512" in listed


def test_words_that_no_dictionary_has_are_told_refused_or_given(mary, tmp_path: Path) -> None:
    film = str(tmp_path / "word.mp4")
    assert "pronounced by guess: Qwyxzk" in mary("say", "Hi, Qwyxzk.", "-o", film).stderr
    refused = mary("say", "Hi, Qwyxzk.", "-o", film, "--strict")
    assert refused.returncode == 2
    assert "no dictionary has Qwyxzk" in refused.stderr
    given = mary("say", "Hi, Qwyxzk.", "-o", film, "--strict", "--lexicon", "Qwyxzk=K W IH K S")
    assert (given.returncode, given.stderr) == (0, "")
    for wrong in ("Qwyxzk", "Qwyxzk=K XX"):
        assert mary("say", "Hi.", "-o", film, "--lexicon", wrong).returncode == 2
