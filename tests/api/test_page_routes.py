from __future__ import annotations

import re


def test_the_page_and_its_files_are_served(server: str, curl) -> None:
    page = curl(f"{server}/")
    assert page.status == 200
    assert page.headers["content-type"].startswith("text/html")
    assert page.headers["cache-control"] == "no-cache"
    assert page.headers["x-content-type-options"] == "nosniff"
    files = re.findall(r'(?:src|href)="(/static/[^"]+)"', page.body.decode())
    assert files
    for file in files:
        answer = curl(server + file)
        assert answer.status == 200, file
        assert answer.headers["cache-control"] == "no-cache"
        again = curl(server + file, "--header", f"If-None-Match: {answer.headers['etag']}")
        assert again.status == 304


def test_modules_have_a_type_that_browsers_run(server: str, curl) -> None:
    assert "javascript" in curl(f"{server}/static/main.js").headers["content-type"]


def test_pages_of_other_sites_may_import_the_component(server: str, curl) -> None:
    short = curl(f"{server}/mary.js")
    assert (short.status, short.headers["location"]) == (307, "static/mary.js")
    for answer in (short, curl(f"{server}/static/mary.js")):
        assert answer.headers["access-control-allow-origin"] == "*"


def test_what_is_not_there_is_a_problem(server: str, curl) -> None:
    answer = curl(f"{server}/static/nothing.js")
    assert answer.status == 404
    assert answer.headers["content-type"] == "application/problem+json"
