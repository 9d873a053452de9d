"""SSML and lexicons in requests."""

from __future__ import annotations

import json
import subprocess
import time
from typing import Any

import pytest

SSML = """<speak>One <mark name="half"/> two.<break time="300ms"/><mark name="end"/></speak>"""


def order(**fields: Any) -> tuple[str, str]:
    return ("--json", json.dumps(fields))


def test_marks_become_events_at_their_time(server: str, curl, curl_program: str) -> None:
    made = curl(f"{server}/v1/streams", *order(start="now")).json()
    address = f"{server}/v1/streams/{made['id']}"
    listening = [curl_program, "-sN", "--max-time", "60", f"{address}/events?types=state,word,mark"]
    with subprocess.Popen(listening, stdout=subprocess.PIPE, text=True) as told:
        assert told.stdout is not None
        told.stdout.readline()  # the present state: it is listening
        curl(f"{address}/say", *order(text=SSML))
        give_up = time.monotonic() + 60
        while curl(address).json()["utterances"][0]["state"] != "done":
            assert time.monotonic() < give_up
            time.sleep(0.1)
        curl(address, "-X", "DELETE")
        blocks = told.stdout.read().replace("\r", "").split("\n\n")
    happened = [block.splitlines() for block in blocks if block.startswith("event: ")]
    events = [(name.removeprefix("event: "), json.loads(data.removeprefix("data: "))) for name, data in happened]
    words = {data["text"]: data for name, data in events if name == "word"}
    marks = {data["name"]: data for name, data in events if name == "mark"}
    assert marks["half"]["media_time"] == pytest.approx(words["two."]["media_time"], abs=1e-3)
    assert marks["end"]["media_time"] > words["two."]["end_time"] + 0.2
    assert marks["half"]["wall_ms"] < marks["end"]["wall_ms"]


@pytest.mark.parametrize("path", ["/v1/streams", "/v1/render"])
def test_wrong_ssml_names_the_place(server: str, curl, path: str) -> None:
    answer = curl(server + path, *order(text="<speak>Hello\n <loud>you</loud></speak>"))
    assert answer.status == 422
    problem = answer.json()
    assert "loud" in problem["detail"]
    assert "line 2" in problem["detail"]
    entity = '<!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><speak>&f;</speak>'
    assert curl(server + path, *order(text=entity, markup="ssml")).status == 422


def test_text_that_looks_like_ssml_can_be_read_as_text(server: str, curl) -> None:
    answer = curl(f"{server}/v1/render", *order(text="<speak>Hello", markup="text"))
    assert answer.status == 200


def test_guessed_words_are_told_refused_or_given(server: str, curl) -> None:
    text = "Hello, Qwyxzk."
    made = curl(f"{server}/v1/streams", *order(text=text)).json()
    assert made["utterance"]["guessed"] == ["Qwyxzk"]
    refused = curl(f"{server}/v1/streams", *order(text=text, strict=True))
    assert (refused.status, refused.json()["field"]) == (422, "text")
    assert "Qwyxzk" in refused.json()["detail"]
    given = curl(f"{server}/v1/streams", *order(text=text, strict=True, lexicon={"qwyxzk": "K W IH K"}))
    assert (given.status, given.json()["utterance"]["guessed"]) == (201, [])
    wrong = curl(f"{server}/v1/render", *order(text=text, lexicon={"qwyxzk": "K W XX"}))
    assert (wrong.status, wrong.json()["field"]) == (422, "lexicon")
    rendered = curl(f"{server}/v1/render", *order(text=text))
    assert rendered.headers["mary-guessed"] == "Qwyxzk"
