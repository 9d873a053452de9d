"""What is told about a connection that did not come about; the rest is tested with a real server in test_publisher."""

from __future__ import annotations

import socket

import pytest

from app.stream.push.publication import Failure
from app.stream.push.rtmp import SEND_BUFFER, bound_sockets, explain

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


def test_connections_that_ffmpeg_opened_do_not_wait_long() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as connection:
        before = connection.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
        bound_sockets(2.5)
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 2500
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) == 2 * SEND_BUFFER < before
