"""A stream's life by curl: made, spoken on, interrupted, looked at, ended."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from typing import Any

import pytest


def until(condition: Callable[[], Any], seconds: float = 30) -> Any:
    give_up = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < give_up, "waited in vain"
        time.sleep(0.05)
    return found


def utterance(server: str, curl, path: str, name: str) -> dict[str, Any]:
    report = curl(server + path).json()
    return next(each for each in report["utterances"] if each["id"] == name)


def test_a_new_stream_says_where_everything_is(server: str, curl) -> None:
    before = time.time() * 1000
    answer = curl(f"{server}/v1/streams", "--json", '{"text": "Hello 🙂 there.", "start": "now"}')
    assert answer.status == 201
    assert answer.headers["cache-control"] == "no-store"
    made = answer.json()
    here = f"/v1/streams/{made['id']}"
    assert answer.headers["location"] == here
    assert re.fullmatch(r"[\w-]{22,}", made["id"])
    assert made["urls"] == {
        "self": here,
        "whep": f"{here}/whep",
        "flv": f"{here}/live.flv",
        "mp4": f"{here}/live.mp4",
        "video": f"{here}/video.mp4",
        "captions": f"{here}/captions.vtt",
        "events": f"{here}/events",
        "ws": f"{here}/ws",
    }
    assert made["pushes"] == []
    assert made["avatar"] == "mary"
    assert (made["trajectory"], made["renderer"]) == ("gaussian", "fast")
    assert made["voice"]
    assert made["utterance"]["unread"] == ["🙂"]
    assert made["idle"]["url"] == "/v1/avatars/mary/idle.mp4"
    assert made["idle"] | {"url": ""} == {"url": "", "fps": 25, "frames": 125, "width": 512, "height": 512}
    assert before <= made["server_time_ms"] <= time.time() * 1000
    assert curl(server + made["idle"]["url"], "--head").status == 200
    curl(server + here, "--request", "DELETE")


def test_without_a_text_it_idles(server: str, curl) -> None:
    for options in (("--json", "{}"), ("--request", "POST")):  # a body may be left out
        made = curl(f"{server}/v1/streams", *options).json()
        assert made["utterance"] is None
        report = curl(server + made["urls"]["self"]).json()
        assert report["state"] == "idle"
        assert report["utterances"] == []
        assert report["viewers"] == {"whep": 0, "flv": 0, "mp4": 0, "rtmp": 0, "whip": 0}
        assert report["frames"]["dropped"] == 0
        assert report["idle"] == "stream"
        assert abs(report["server_time_ms"] - time.time() * 1000) < 60_000
        assert curl(server + made["urls"]["self"], "--request", "DELETE").status == 204


@pytest.mark.parametrize(
    ("order", "status"),
    [
        ({"text": "🙂"}, 422),
        ({"text": "  "}, 422),
        ({"text": "Hello.", "speed": 3}, 422),
        ({"text": "Hello.", "voice": "nobody"}, 404),
        ({"text": "Hello.", "avatar": "nobody"}, 404),
        ({"text": "Hello.", "trajectory": "oil"}, 404),
        ({"text": "Hello.", "renderer": "oil"}, 404),
    ],
)
def test_a_refused_order_leaves_no_stream_behind(
    server: str, running, curl, order: dict[str, Any], status: int
) -> None:
    def folders() -> list[str]:
        return sorted(path.name for path in running.temporary.glob("mary-streams-*/*"))

    before = folders()
    assert curl(f"{server}/v1/streams", "--json", json.dumps(order)).status == status
    assert folders() == before


@pytest.mark.parametrize(
    ("order", "detail", "advice"),
    [
        ({"trajectory": "phone-mean"}, "mary has no trajectory model 'phone-mean'", "gaussian"),
        ({"trajectory": "oil"}, "there is no trajectory model 'oil'", "gaussian"),
        ({"renderer": "oil"}, "there is no renderer 'oil'", "fast, reference"),
    ],
)
def test_an_utterance_that_cannot_be_shown_so_is_refused_with_what_there_is(
    server: str, curl, order: dict[str, str], detail: str, advice: str
) -> None:
    here = server + curl(f"{server}/v1/streams", "--json", "{}").json()["urls"]["self"]
    answer = curl(f"{here}/say", "--json", json.dumps({"text": "Hi."} | order))
    problem = answer.json()
    assert (answer.status, problem["detail"], problem["field"]) == (404, detail, next(iter(order)))
    assert advice in problem["advice"]
    assert curl(here).json()["utterances"] == []
    curl(f"{here}/say", "--json", '{"text": "Hi.", "trajectory": "gaussian", "renderer": "fast"}')
    report = curl(here).json()
    assert len(report["utterances"]) == 1
    assert (report["trajectory"], report["renderer"]) == ("gaussian", "fast")
    curl(here, "--request", "DELETE")


def test_what_is_said_is_reported_with_its_timings(server: str, curl) -> None:
    made = curl(f"{server}/v1/streams", "--json", '{"text": "Hi.", "start": "now"}').json()
    here, name = made["urls"]["self"], made["utterance"]["id"]
    until(lambda: utterance(server, curl, here, name)["state"] == "done")
    shown = curl(f"{server}{here}/utterances/{name}/shown", "--json", '{"milliseconds": 321.5}')
    assert shown.status == 204
    done = utterance(server, curl, here, name)
    assert done["characters"] == 3
    assert done["unread"] == []
    assert done["error"] is None
    assert done["media"]["end"] > done["media"]["start"] >= 0
    assert done["timings"]["shown"] == 321.5
    assert {"speech", "trajectory", "first_frame", "first_packet"} <= done["timings"].keys()
    assert done["timings"]["speech"] <= done["timings"]["first_packet"]
    curl(server + here, "--request", "DELETE")


def test_texts_are_queued_and_can_be_cut_short(server: str, curl) -> None:
    long = "This goes on and on, one word after another, until somebody stops it. " * 4
    made = curl(f"{server}/v1/streams", "--json", f'{{"text": "{long}", "start": "now"}}').json()
    here, first = made["urls"]["self"], made["utterance"]["id"]
    said = curl(f"{server}{here}/say", "--json", '{"text": "Second."}')
    assert said.status == 202
    assert said.json()["server_time_ms"] > 0
    second = said.json()["utterance"]["id"]
    until(lambda: utterance(server, curl, here, first)["state"] == "speaking")
    assert utterance(server, curl, here, second)["state"] == "queued"

    assert curl(f"{server}{here}/interrupt", "--request", "POST").status == 202

    assert utterance(server, curl, here, first)["state"] == "interrupted"
    assert utterance(server, curl, here, second)["state"] == "interrupted"
    third = curl(f"{server}{here}/say", "--json", '{"text": "Third.", "interrupt": true, "speed": 2}').json()
    until(lambda: utterance(server, curl, here, third["utterance"]["id"])["state"] == "done")
    assert curl(server + here).json()["state"] == "idle"
    curl(server + here, "--request", "DELETE")


def test_an_ended_stream_is_gone(server: str, curl) -> None:
    made = curl(f"{server}/v1/streams", "--json", "{}").json()
    urls = made["urls"]
    assert curl(server + urls["self"], "--request", "DELETE").status == 204
    for path in (urls["flv"], urls["mp4"], urls["events"]):
        answer = curl(server + path)
        assert answer.status in (404, 410), path
        assert answer.headers["content-type"] == "application/problem+json"
    said = curl(f"{server}{urls['self']}/say", "--json", '{"text": "Hello."}')
    assert said.status in (404, 410)
