"""What is told about a connection that did not come about; the rest is tested with a real server in test_publisher."""

from __future__ import annotations

import pytest

from app.stream.publication import Failure
from app.stream.publish_rtmp import explain

BROKEN = OSError(5, "Input/output error")


@pytest.mark.parametrize(
    ("error", "messages", "expected"),
    [
        (
            BROKEN,
            ["Server version 1", "Sending publish command for 'key'", "Server error: Already publishing\n", "more"],
            Failure(
                "the server refused to publish: wrong key, not authenticated, or in use", True, "Already publishing"
            ),
        ),
        (
            BROKEN,
            ["Server version 1"],
            Failure("the server refused the application of the URL, or wants a login", True),
        ),
        (BROKEN, ["Handshaking..."], Failure("the server cannot be reached: Input/output error")),
        (BROKEN, ["Failed to resolve hostname x"], Failure("the server's name cannot be resolved")),
        (ValueError("rtmp://user:secret@host"), [], Failure("the server cannot be reached: ValueError")),
    ],
)
def test_failures_are_told_by_how_far_it_got(error: Exception, messages: list[str], expected: Failure) -> None:
    assert explain(error, messages) == expected
