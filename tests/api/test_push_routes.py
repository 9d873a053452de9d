"""Pushes by curl, to a real RTMP server, played by ffprobe."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from typing import Any

import pytest
from rtmp_server import TOKEN, RtmpServer

NOWHERE = "rtmp://127.0.0.1:1/live/key"


def until(condition: Callable[[], Any], seconds: float = 30) -> Any:
    give_up = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < give_up, "waited in vain"
        time.sleep(0.05)
    return found


@pytest.fixture(scope="session")
def ffprobe() -> str:
    program = shutil.which("ffprobe")
    if program is None:
        reason = "ffprobe is not installed: apt-get install ffmpeg"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    return program


def test_the_services_own_server_plays_a_stream(own_server, curl, rtmp_server: RtmpServer, ffprobe: str) -> None:
    rtmp_server.start()
    own = f"rtmp://user:hunter2@{rtmp_server.address}/live"
    with own_server(PUSH__RTMP=own, PUSH__MAX="2", PUSH__RETRY_SECONDS="0.2") as server:
        made = curl(f"{server.url}/v1/streams", "--json", '{"transport": "rtmp"}').json()
        here, plays = server.url + made["urls"]["self"], made["urls"]["rtmp"]
        assert plays.startswith(f"rtmp://{rtmp_server.address}/live/")
        assert made["id"] not in plays
        (push,) = made["pushes"]
        assert push | {"id": "", "state": ""} == {
            "id": "",
            "kind": "rtmp",
            "target": f"rtmp://{rtmp_server.address}/live/…",
            "state": "",
            "error": None,
            "retries": 0,
        }
        until(lambda: curl(here).json()["pushes"][0]["state"] == "live")
        assert curl(here).json()["viewers"] == {"whep": 0, "flv": 0, "mp4": 0, "rtmp": 1, "whip": 0}
        probed = subprocess.run(
            [ffprobe, "-v", "error", "-show_entries", "stream=codec_name,width,sample_rate", "-of", "json", plays],
            capture_output=True,
            check=True,
            timeout=60,
        )
        streams = {each["codec_name"]: each for each in json.loads(probed.stdout)["streams"]}
        assert streams["h264"]["width"] == 512
        assert streams["aac"]["sample_rate"] == "48000"

        added = curl(f"{here}/pushes", "--json", json.dumps({"url": NOWHERE}))
        assert added.status == 201
        assert added.headers["location"] == f"{made['urls']['self']}/pushes/{added.json()['id']}"
        full = curl(f"{here}/pushes", "--json", json.dumps({"url": NOWHERE}))
        assert (full.status, full.json()["type"]) == (503, "/problems/over-capacity")
        assert "retry-after" in full.headers
        streams_before = list(server.temporary.glob("mary-streams-*/*"))
        refused = curl(f"{server.url}/v1/streams", "--json", json.dumps({"rtmp_url": NOWHERE}))
        assert refused.status == 503
        assert list(server.temporary.glob("mary-streams-*/*")) == streams_before
        ended = curl(server.url + added.headers["location"], "--request", "DELETE")
        assert ended.status == 204
        assert [push["state"] for push in curl(here).json()["pushes"]] == ["live", "ended"]
        assert curl(f"{here}/pushes/nobody", "--request", "DELETE").status == 404

        curl(here, "--request", "DELETE")
        log = server.log.read_text()
        assert f"push to rtmp://{rtmp_server.address}/live/…: live" in log
        assert "hunter2" not in log
        assert plays.rpartition("/")[2] not in log
    assert "hunter2" not in json.dumps(made)


def test_what_becomes_of_a_push_is_an_event(server: str, curl, rtmp_server: RtmpServer) -> None:
    rtmp_server.start()
    order = {"rtmp_url": rtmp_server.url(f"private?token={TOKEN}", "locked")}
    made = curl(f"{server}/v1/streams", "--json", json.dumps(order)).json()
    assert "rtmp" not in made["urls"]
    here = server + made["urls"]["self"]
    until(lambda: curl(here).json()["pushes"][0]["state"] == "live")
    events = subprocess.Popen(["curl", "-sN", f"{here}/events"], stdout=subprocess.PIPE, text=True)
    with events:
        assert events.stdout is not None
        assert events.stdout.readline() == "event: state\n"
        added = curl(f"{here}/pushes", "--json", json.dumps({"url": NOWHERE})).json()
        seen = ""
        while '"retrying"' not in seen:
            seen += events.stdout.readline()
        curl(here, "--request", "DELETE")
        events.wait(30)
    data = json.loads(seen.partition("event: push\ndata: ")[2])
    assert data == {
        "id": added["id"],
        "state": "retrying",
        "error": "the server cannot be reached: Connection refused",
    }


@pytest.mark.parametrize(
    ("order", "field"),
    [
        ({"transport": "rtmp"}, "transport"),
        ({"transport": "srt"}, "transport"),
        ({"rtmp_url": "file:///tmp/x.flv"}, "rtmp_url"),
        ({"rtmp_url": "rtmp://host/app/key live=1"}, "rtmp_url"),
        ({"rtmp_url": "https://host/whip"}, "rtmp_url"),
        ({"rtmp_url": "rtmp://host/app/key", "transport": "rtmp"}, "rtmp_url"),
        ({"rtmp_url": ""}, "rtmp_url"),
        ({"rtmp_url": 5}, "rtmp_url"),
        ({"whip_url": "rtmp://host/app/key"}, "whip_url"),
        ({"whip_url": "pipe:1"}, "whip_url"),
        ({"whip_token": "x"}, "whip_token"),
        ({"whip_url": "https://host/whip", "whip_token": "a b"}, "token"),
    ],
)
def test_targets_that_are_not_allowed_are_refused(
    server: str, running, curl, order: dict[str, Any], field: str
) -> None:
    before = list(running.temporary.glob("mary-streams-*/*"))
    answer = curl(f"{server}/v1/streams", "--json", json.dumps(order))
    assert (answer.status, answer.json()["type"]) == (422, "/problems/invalid-input")
    assert answer.json()["field"] == field
    assert list(running.temporary.glob("mary-streams-*/*")) == before


def test_a_stream_without_a_server_says_what_to_do(server: str, curl) -> None:
    problem = curl(f"{server}/v1/streams", "--json", '{"transport": "rtmp"}').json()
    assert "rtmp_url" in problem["advice"]
    assert "MARY_PUSH__RTMP" in problem["advice"]


def test_a_stream_that_has_ended_takes_no_push(server: str, curl) -> None:
    here = server + curl(f"{server}/v1/streams", "--json", "{}").json()["urls"]["self"]
    curl(here, "--request", "DELETE")
    assert curl(f"{here}/pushes", "--json", json.dumps({"url": NOWHERE})).status in (404, 410)
    assert curl(f"{here}/pushes", "--json", "{}").status == 422
    assert curl(f"{here}/pushes", "--data", "url=x").status == 415
