from __future__ import annotations

import time


def test_a_loaded_service_is_alive_and_ready(server: str, curl) -> None:
    assert curl(f"{server}/healthz").json() == {"status": "ok"}
    assert curl(f"{server}/readyz").json() == {"status": "ready"}


def test_it_is_alive_before_it_is_ready(own_server, curl) -> None:
    with own_server(wait=False) as server:
        assert curl(f"{server.url}/healthz").status == 200
        probed = curl(f"{server.url}/readyz")
        if probed.status != 200:  # nearly always: loading takes longer than asking
            assert probed.status == 503
            assert int(probed.headers["retry-after"]) > 0
            assert probed.json()["type"] == "/problems/over-capacity"
        assert curl(f"{server.url}/v1/voices").status == 200, "early requests wait instead of failing"
        assert curl(f"{server.url}/readyz").status == 200


def test_the_interface_describes_itself(server: str, curl) -> None:
    described = curl(f"{server}/openapi.json").json()
    answers = described["paths"]["/v1/streams/{stream_id}/whep"]["post"]["responses"]
    assert "application/problem+json" in answers["4XX"]["content"]
    assert "422" not in answers, "FastAPI's own kind of error is not used"
    assert curl(f"{server}/docs").status == 200


def test_the_log_holds_no_keys_and_no_texts(own_server, curl) -> None:
    with own_server() as server:
        made = curl(
            f"{server.url}/v1/streams", "--json", '{"text": "Nobody may read xylophone.", "start": "now"}'
        ).json()
        curl(server.url + made["urls"]["self"])
        curl(server.url + made["urls"]["self"], "--request", "DELETE")
        time.sleep(0.2)
        log = server.log.read_text()
    assert "/v1/streams/{stream_id}" in log
    assert made["id"] not in log
    assert "xylophone" not in log
