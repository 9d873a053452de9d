"""The process that publishes a stream to a server, by RTMP or WHIP.

It is a process because a call into FFmpeg may wait for a server that has stalled, and nothing in the same process could
end it; `app.stream.push.publishing` starts it and may kill it. It ends by itself too: with its input, on an error, and
by an alarm when the server lets it wait for too long (`app.stream.push.publication`).

On its output are lines of JSON: `{"live": true}` when the server lets the stream be published, `{"keyframe": true}`
when it needs a key frame, a `Failure` before it ends by itself.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import sys
import threading
from dataclasses import asdict

from app.stream.push.pipe import PublishOrder, read_order
from app.stream.push.publication import Failure, Publication, PublishingFailed


def main() -> None:
    """Publish what comes in until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the other end's to handle
    source, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever a library prints must not get between the answers
    logging.disable()  # libraries' messages may hold the URL
    one_at_a_time = threading.Lock()

    def tell(**answer: object) -> None:
        with contextlib.suppress(OSError), one_at_a_time:  # or nobody listens any more
            answers.write(json.dumps(answer) + "\n")
            answers.flush()

    order = read_order(source)
    if order is None:
        return
    publication = _publication(order)
    try:
        publication.connect(lambda: tell(keyframe=True))
        tell(live=True)
        publication.feed(source)
    except PublishingFailed as error:
        tell(**asdict(error.failure))
    except Exception as error:  # not its text, which may hold the URL
        tell(**asdict(Failure(f"publishing failed: {type(error).__name__}")))
    finally:
        with contextlib.suppress(Exception):
            publication.close()


def _publication(order: PublishOrder) -> Publication:
    # Only what is needed is imported: the process is to be there soon.
    if order.kind == "rtmp":
        from app.stream.push.rtmp import RtmpPublication

        return RtmpPublication(order)
    from app.stream.push.whip import WhipPublication

    return WhipPublication(order)


if __name__ == "__main__":
    main()
