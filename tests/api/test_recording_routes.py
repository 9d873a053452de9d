"""The caller's own recording: spoken by a stream and made a file of, by the real curl and real ears."""

from __future__ import annotations

import json
import subprocess
import time
import wave
from pathlib import Path

import av
import numpy as np
import pytest

from app.speech import Speech
from app.tts.hibari import HibariEngine

FPS = 25
TEXT = "My mother bought five big maps."
GIVE_UP = 60


@pytest.fixture(scope="module")
def speech() -> Speech:
    return HibariEngine().speak(TEXT)


def wav(path: Path, samples: np.ndarray, rate: int) -> Path:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes((samples * 32767).astype("<i2").tobytes())
    return path


@pytest.fixture
def recording(tmp_path: Path, speech: Speech) -> Path:
    return wav(tmp_path / "speech.wav", speech.samples, speech.rate)


@pytest.fixture
def stream(server: str, curl):
    """The address of a new stream that speaks without a viewer; deleted afterwards."""
    answer = curl(f"{server}/v1/streams", "--json", '{"start": "now"}')
    here = server + answer.headers["location"]
    yield here
    curl(here, "-X", "DELETE")


def utterances(curl, stream: str) -> list[dict[str, object]]:
    return curl(stream).json()["utterances"]


def wait_done(curl, stream: str) -> dict[str, object]:
    give_up = time.monotonic() + GIVE_UP
    while (last := utterances(curl, stream)[-1])["state"] in ("queued", "speaking"):
        assert time.monotonic() < give_up
        time.sleep(0.1)
    return last


def sound_of(file: Path) -> np.ndarray:
    with av.open(str(file)) as container:
        resampler = av.AudioResampler("flt", "mono", 48_000)
        return np.concatenate(
            [part.to_ndarray()[0] for frame in container.decode(audio=0) for part in resampler.resample(frame)]
        )


def test_a_recording_with_its_text_is_spoken_by_a_stream(
    curl, stream: str, recording: Path, speech: Speech, tmp_path: Path
) -> None:
    answer = curl(f"{stream}/audio", "-F", f"audio=@{recording}", "-F", f"text={TEXT}")
    assert answer.status == 202
    said = answer.json()["utterance"]
    assert said["confidence"] > 0.5
    assert (said["doubtful"], said["guessed"], said["unread"]) == (False, [], [])
    last = wait_done(curl, stream)
    assert (last["id"], last["state"], last["characters"]) == (said["id"], "done", len(TEXT))

    words = curl(f"{stream}/captions.vtt?utterance={said['id']}").body.decode()
    assert "mother" in words
    assert "maps." in words

    give_up = time.monotonic() + GIVE_UP
    while (video := curl(f"{stream}/video.mp4")).status == 409:
        assert time.monotonic() < give_up
        time.sleep(0.1)
    file = tmp_path / "said.mp4"
    file.write_bytes(video.body)
    heard = sound_of(file)
    assert abs(len(heard) / 48_000 - speech.duration) < 0.4
    whole = np.interp(
        np.arange(0, speech.duration, 1 / 8000), np.arange(len(speech.samples)) / speech.rate, speech.samples
    )
    there = np.interp(np.arange(0, speech.duration, 1 / 8000), np.arange(len(heard)) / 48_000, heard)
    assert np.corrcoef(np.abs(whole), np.abs(there))[0, 1] > 0.8  # the caller's own sound, at its time


def test_without_a_text_it_is_spoken_and_has_no_words(curl, stream: str, recording: Path) -> None:
    answer = curl(f"{stream}/audio", "-F", f"audio=@{recording}")
    assert answer.status == 202
    assert answer.json()["utterance"]["confidence"] is None
    assert wait_done(curl, stream)["state"] == "done"
    assert "-->" not in curl(f"{stream}/captions.vtt").body.decode()


def test_it_interrupts_what_is_being_said(curl, stream: str, recording: Path) -> None:
    curl(f"{stream}/say", "--json", json.dumps({"text": "This would take a long time to say. " * 10}))
    answer = curl(f"{stream}/audio", "-F", f"audio=@{recording}", "-F", "interrupt=true")
    assert answer.status == 202
    first, second = utterances(curl, stream)[-2:]
    assert first["state"] == "interrupted"
    assert second["id"] == answer.json()["utterance"]["id"]


def test_a_recording_becomes_a_file(server: str, curl, recording: Path, speech: Speech, tmp_path: Path) -> None:
    answer = curl(f"{server}/v1/render", "-F", f"audio=@{recording}", "-F", f"text={TEXT} Zqxia.")
    assert answer.status == 200
    assert answer.headers["content-type"] == "video/mp4"
    assert 0 <= float(answer.headers["mary-confidence"]) <= 1
    assert "Zqxia." in answer.headers["mary-guessed"]
    file = tmp_path / "out.mp4"
    file.write_bytes(answer.body)
    with av.open(str(file)) as container:
        pictures = sum(1 for _ in container.decode(video=0))
    assert abs(pictures / FPS - speech.duration) < 0.3

    alone = curl(f"{server}/v1/render", "-F", f"audio=@{recording}")
    assert alone.status == 200
    assert "mary-confidence" not in alone.headers


@pytest.mark.parametrize("where", ["render", "stream"])
def test_another_text_is_doubtful_and_refused_when_strict(
    server: str, curl, stream: str, recording: Path, where: str
) -> None:
    url = f"{server}/v1/render" if where == "render" else f"{stream}/audio"
    wrong = "text=Seven sheep slept here until noon."
    answer = curl(url, "-F", f"audio=@{recording}", "-F", wrong, "-F", "strict=true")
    assert (answer.status, answer.json()["type"], answer.json()["field"]) == (422, "/problems/invalid-input", "text")
    assert "does not seem to be what is said" in answer.json()["detail"]
    answer = curl(url, "-F", f"audio=@{recording}", "-F", wrong)
    if where == "stream":
        assert (answer.status, answer.json()["utterance"]["doubtful"]) == (202, True)
    else:
        assert (answer.status, float(answer.headers["mary-confidence"]) < 0.5) == (200, True)


def test_an_aligner_that_finds_nothing_is_named(curl, stream: str, recording: Path) -> None:
    text = "Nobody could ever say all of these very many words within so short a time. " * 5
    answer = curl(f"{stream}/audio", "-F", f"audio=@{recording}", "-F", f"text={text}")
    assert (answer.status, answer.json()["type"]) == (502, "/problems/alignment-failed")
    assert "pocketsphinx" in answer.json()["detail"]
    assert utterances(curl, stream) == []


@pytest.mark.parametrize(
    ("fields", "status", "slug", "field"),
    [
        ([], 422, "invalid-input", "audio"),
        (["audio=not a file"], 422, "invalid-input", "audio"),
        (["audio=@{text}"], 422, "invalid-input", "audio"),
        (["audio=@{empty}"], 422, "invalid-input", "audio"),
        (["audio=@{wav}", "speed=2"], 422, "invalid-input", "speed"),
        (["audio=@{wav}", "strict=perhaps"], 422, "invalid-input", "strict"),
        (["audio=@{wav}", "text=🙂"], 422, "nothing-to-say", "text"),
    ],
)
@pytest.mark.parametrize("where", ["render", "stream"])
def test_what_is_wrong_is_told(
    server: str,
    curl,
    stream: str,
    recording: Path,
    tmp_path: Path,
    fields: list[str],
    status: int,
    slug: str,
    field: str,
    where: str,
) -> None:
    (tmp_path / "text").write_text("This is no sound.")
    (tmp_path / "empty").touch()
    files = {"text": tmp_path / "text", "empty": tmp_path / "empty", "wav": recording}
    options = [part for each in fields or ["strict=true"] for part in ("-F", each.format(**files))]
    answer = curl(f"{server}/v1/render" if where == "render" else f"{stream}/audio", *options)
    problem = answer.json()
    assert (answer.status, problem["type"], problem.get("field")) == (status, f"/problems/{slug}", field), problem


def test_json_still_renders_a_text_and_other_bodies_are_refused(server: str, curl, stream: str) -> None:
    assert curl(f"{server}/v1/render", "--json", '{"text": "Hello."}').status == 200
    plain = curl(f"{server}/v1/render", "-H", "Content-Type: text/plain", "-d", "x")
    assert (plain.status, plain.json()["type"]) == (415, "/problems/unsupported-media-type")
    misled = curl(f"{stream}/audio", "--json", "{}")
    assert (misled.status, misled.json()["type"]) == (415, "/problems/unsupported-media-type")
    assert "curl: -F audio=@" in misled.json()["detail"]
    assert misled.json()["advice"]
    no_file = curl(f"{stream}/audio", "-F", "audio=speech.wav").json()
    assert (no_file["status"], no_file["field"], no_file["detail"]) == (422, "audio", "audio must be a file")
    assert "audio=@" in no_file["advice"]
    broken = curl(f"{stream}/audio", "-H", "Content-Type: multipart/form-data; boundary=x", "--data-binary", "nonsense")
    assert broken.status in (400, 422)
    assert curl(f"{server}/v1/streams/nothing/audio", "-F", "audio=@/dev/null").status == 404
    assert curl(f"{stream}/audio").status == 405


def test_a_form_of_a_foreign_page_is_refused(server: str, curl, stream: str, recording: Path) -> None:
    foreign = ("-H", "Sec-Fetch-Site: cross-site", "-H", "Origin: https://elsewhere.example")
    for url in (f"{server}/v1/render", f"{stream}/audio"):
        answer = curl(url, "-F", f"audio=@{recording}", *foreign)
        assert (answer.status, answer.json()["type"]) == (403, "/problems/forbidden")
    elsewhere = curl(f"{stream}/audio", "-F", f"audio=@{recording}", "-H", "Origin: https://elsewhere.example")
    assert elsewhere.status == 403  # browsers say nothing but the origin to an address without TLS
    for strange in ("null", "http://["):
        assert curl(f"{stream}/audio", "-F", f"audio=@{recording}", "-H", f"Origin: {strange}").status == 403
    assert curl(f"{stream}/audio", "-F", f"audio=@{recording}", "-H", "Sec-Fetch-Site: same-origin").status == 202
    own = server.partition("/v1/")[0]
    assert curl(f"{stream}/audio", "-F", f"audio=@{recording}", "-H", f"Origin: {own}").status == 202


def test_too_long_ones_are_refused(own_server, curl, tmp_path: Path, speech: Speech) -> None:
    short = wav(tmp_path / "short.wav", speech.samples[: speech.rate // 2], speech.rate)
    longer = wav(tmp_path / "long.wav", np.tile(speech.samples, 4), speech.rate)
    limits = {"LIMITS__AUDIO_SECONDS": "2", "LIMITS__AUDIO_BYTES": "500000", "ALIGN__RECOGNISER": "mock"}
    with own_server(**limits, LIMITS__TEXT="20") as server:
        assert curl(f"{server.url}/v1/render", "-F", f"audio=@{short}").status == 200
        for options in (["-F", f"audio=@{longer}"], ["-F", f"audio=@{short}", "-F", "text=" + "long " * 9]):
            answer = curl(f"{server.url}/v1/render", *options)
            assert (answer.status, answer.json()["type"]) == (413, "/problems/too-long")
        huge = tmp_path / "huge.wav"
        huge.write_bytes(bytes(700_000))
        answer = curl(f"{server.url}/v1/render", "-F", f"audio=@{huge}")
        assert (answer.status, answer.json()["type"]) == (413, "/problems/too-long")


def test_at_the_end_no_process_of_the_aligner_is_left(own_server, curl, recording: Path) -> None:
    def aligners(parent: int) -> list[str]:
        table = subprocess.run(["ps", "-eo", "ppid,pid,args"], capture_output=True, text=True, check=True).stdout
        rows = [line.split(None, 2) for line in table.splitlines() if "sphinx_worker" in line]
        return [pid for ppid, pid, _ in rows if int(ppid) == parent]

    with own_server() as server:
        assert curl(f"{server.url}/v1/render", "-F", f"audio=@{recording}", "-F", f"text={TEXT}").status == 200
        (worker,) = aligners(server.process.pid)
        server.process.terminate()
        server.process.wait(20)
    assert not Path(f"/proc/{worker}").exists()
