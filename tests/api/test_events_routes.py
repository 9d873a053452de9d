"""Words, mouth shapes and captions, compared with the sound that viewers get."""

from __future__ import annotations

import io
import json
import subprocess
import time
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

TEXT = "Papa, go to the bar, <bo>. Baba & Bo."


def listen(url: str) -> subprocess.Popen[str]:
    return subprocess.Popen(["curl", "-s", "-N", url], stdout=subprocess.PIPE, text=True)


def events(body: str) -> list[tuple[str, dict[str, Any]]]:
    found = []
    for block in body.replace("\r", "").strip().split("\n\n"):
        fields = dict(line.split(": ", 1) for line in block.splitlines() if not line.startswith(":"))
        if fields:
            found.append((fields["event"], json.loads(fields["data"])))
    return found


def onsets(path: Path) -> list[float]:
    """Where sound begins after at least 0.1 s of silence, seconds."""
    blocks: list[tuple[float, float]] = []
    with av.open(str(path)) as container:
        for frame in container.decode(audio=0):
            samples = frame.to_ndarray()[0]
            for at in range(0, len(samples) - 127, 128):
                blocks.append((frame.time + at / 48_000, float(np.abs(samples[at : at + 128]).max())))
    loud_until, found = -1.0, []
    for seconds, peak in blocks:
        if peak > 0.05:
            if seconds - loud_until > 0.1:
                found.append(seconds)
            loud_until = seconds
    return found


def test_words_and_captions_have_the_times_at_which_they_are_heard(server: str, curl, tmp_path: Path) -> None:
    made = curl(f"{server}/v1/streams", "--json", json.dumps({"text": TEXT, "once": True})).json()
    urls = {name: server + path for name, path in made["urls"].items()}
    with listen(urls["events"]) as told, listen(urls["captions"] + "?live=true") as live:
        assert told.stdout is not None
        assert live.stdout is not None
        beginning = told.stdout.readline()  # both are listening before anything is said
        first_line = live.stdout.readline()
        heard = tmp_path / "live.mp4"
        heard.write_bytes(curl(urls["mp4"]).body)
        happened = events(beginning + told.stdout.read())
        live_captions = first_line + live.stdout.read()

    words = [data for name, data in happened if name == "word"]
    assert [word["text"] for word in words] == TEXT.split()
    starts = onsets(heard)
    after_silence = [
        word
        for before, word in zip([None, *words], words, strict=False)
        if before is None or word["media_time"] - before["end_time"] > 0.1
    ]
    assert len(after_silence) >= 3
    for word in after_silence:
        assert min(abs(start - word["media_time"]) for start in starts) < 0.06, (word, starts)
    wall = {round(word["wall_ms"] - 1000 * word["media_time"]) for word in words}
    assert max(wall) - min(wall) <= 1, "one clock"

    visemes = [data for name, data in happened if name == "viseme"]
    started = next(data for name, data in happened if name == "speak_started")
    edge = started["media_time"]
    for viseme in visemes:  # without gaps, from the beginning to the end
        assert viseme["media_time"] == pytest.approx(edge, abs=1e-3)
        edge = viseme["end_time"]
    ended = next(data for name, data in happened if name == "speak_ended")
    assert edge == pytest.approx(ended["media_time"], abs=1e-3)
    assert {"PP", "sil", "aa"} <= {viseme["oculus"] for viseme in visemes}
    order = [name for name, _ in happened if name in ("word", "speak_started", "speak_ended")]
    assert (order[0], order[-1]) == ("speak_started", "speak_ended")

    answer = curl(urls["captions"])
    assert (answer.status, answer.headers["content-type"]) == (200, "text/vtt; charset=utf-8")
    assert answer.headers["cache-control"] == "no-store"
    captions = answer.body.decode()
    assert live_captions == captions
    assert captions.startswith("WEBVTT\n\n")
    assert "&lt;bo&gt;" in captions
    own = curl(f"{urls['captions']}?utterance={made['utterance']['id']}").body.decode()
    assert own.split("\n")[2].startswith("00:00:00.0"), "its own video begins with the first word"
    with av.open(io.BytesIO(answer.body), format="webvtt") as container:
        cues = [float(packet.pts * packet.time_base) for packet in container.demux() if packet.size]
    assert cues[0] == pytest.approx(words[0]["media_time"], abs=2e-3)


def test_only_the_events_asked_for_are_told(server: str, curl) -> None:
    made = curl(f"{server}/v1/streams", "--json", '{"text": "One two.", "start": "now", "once": true}').json()
    body = curl(server + made["urls"]["events"] + "?types=word,speak_ended").body.decode()
    assert {name for name, _ in events(body)} == {"word", "speak_ended"}


@pytest.mark.parametrize(
    ("path", "status"),
    [("events?types=weather", 422), ("captions.vtt?utterance=none", 404), ("captions.vtt?live=true&utterance=x", 422)],
)
def test_what_is_not_there_is_refused(server: str, curl, path: str, status: int) -> None:
    made = curl(f"{server}/v1/streams", "--json", "{}").json()
    answer = curl(f"{server}{made['urls']['self']}/{path}")
    assert answer.status == status
    assert answer.headers["content-type"] == "application/problem+json"
    curl(server + made["urls"]["self"], "--request", "DELETE")


def test_captions_end_where_speech_was_cut_short(server: str, curl) -> None:
    made = curl(f"{server}/v1/streams", "--json", json.dumps({"text": "word " * 60, "start": "now"})).json()
    here = server + made["urls"]["self"]
    give_up = time.monotonic() + 30
    while curl(f"{here}/captions.vtt").body.count(b"word") < 4:
        assert time.monotonic() < give_up
        time.sleep(0.05)
    curl(f"{here}/interrupt", "--request", "POST")
    report = curl(here).json()["utterances"][0]
    captions = curl(f"{here}/captions.vtt").body.decode()
    last = captions.strip().split("\n\n")[-1].split(" --> ")[1].split("\n")[0]
    hours, minutes, seconds = last.split(":")
    assert 3600 * int(hours) + 60 * int(minutes) + float(seconds) <= report["media"]["end"]
    assert captions.count("word") < 60
    curl(here, "--request", "DELETE")
