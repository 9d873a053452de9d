from __future__ import annotations

import subprocess
import time
from pathlib import Path

import av

FPS = 25


def left_over(folder: Path) -> list[Path]:
    return list(folder.glob("mary-render-*"))


def test_a_text_becomes_a_file(server: str, running, curl, tmp_path: Path) -> None:
    answer = curl(f"{server}/v1/render", "--json", '{"text": "Hello, world. This is a file.", "speed": 1.5}')
    assert answer.status == 200
    assert answer.headers["content-type"] == "video/mp4"
    assert answer.headers["cache-control"] == "no-store"
    file = tmp_path / "hello.mp4"
    file.write_bytes(answer.body)
    with av.open(str(file)) as container:
        video, sound = container.streams.video[0], container.streams.audio[0]
        assert (video.codec_context.name, sound.codec_context.name) == ("h264", "aac")
        assert (video.codec_context.width, video.codec_context.height) == (512, 512)
        assert video.average_rate == FPS
        pictures = sum(1 for _ in container.decode(video=0))
    with av.open(str(file)) as container:
        seconds = sum(frame.samples for frame in container.decode(audio=0)) / 48_000
    assert pictures > FPS
    assert abs(pictures / FPS - seconds) < 0.1
    assert answer.body.index(b"moov") < answer.body.index(b"mdat")
    assert left_over(running.temporary) == []


def test_when_the_caller_hangs_up_the_work_stops(server: str, running, curl, curl_program: str) -> None:
    long = "This sentence is said again and again, until nobody listens any more. " * 100
    caller = subprocess.Popen(
        [curl_program, "-s", "-o", "/dev/null", f"{server}/v1/render", "--json", f'{{"text": "{long}"}}']
    )
    give_up = time.monotonic() + 30
    while not left_over(running.temporary):
        assert time.monotonic() < give_up
        time.sleep(0.02)
    caller.terminate()
    caller.wait(10)
    while left_over(running.temporary):
        assert time.monotonic() < give_up, "the file is still being made"
        time.sleep(0.05)
    # and the place it took is free again
    assert curl(f"{server}/v1/render", "--json", '{"text": "Next."}').status == 200


def test_what_cannot_be_read_is_named_in_a_header(server: str, curl) -> None:
    answer = curl(f"{server}/v1/render", "--json", '{"text": "Hello 😀, 你好."}')
    assert answer.status == 200
    assert answer.headers["mary-unread"] == "%F0%9F%98%80, %E4%BD%A0%E5%A5%BD"
    assert "mary-unread" not in curl(f"{server}/v1/render", "--json", '{"text": "Hello."}').headers
