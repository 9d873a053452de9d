from __future__ import annotations

import time


def test_every_stage_of_the_last_utterances(server: str, curl) -> None:
    made = curl(f"{server}/v1/streams", "--json", '{"text": "How long?", "start": "now"}').json()
    name = made["utterance"]["id"]
    give_up = time.monotonic() + 30
    while True:
        table = curl(f"{server}/v1/latency").json()
        entry = next(each for each in table["utterances"] if each["utterance"] == name)
        if "first_packet" in entry["timings"]:
            break
        assert time.monotonic() < give_up
        time.sleep(0.05)
    (counts,) = table["speech"]
    assert counts["engine"] == "mock"
    assert counts["native"] >= 1
    assert counts["fallback"] == 0
    assert entry["characters"] == 9
    assert made["id"] not in str(table), "a stream's address is the key to it"
    for stage in ("speech", "trajectory", "first_frame", "first_packet"):
        row = table["stages"][stage]
        assert row["n"] >= 1
        assert row["p50"] <= row["p95"] <= row["p99"]
    curl(server + made["urls"]["self"], "--request", "DELETE")
