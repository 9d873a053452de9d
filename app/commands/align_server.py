"""`mary align-server`: an aligner for other machines, until it is told to end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Mapping
from typing import Any

from rich.console import Console

from app.align.align_server import PATH, AlignServer
from app.align.registry import create
from app.errors import InputError


def run(aligner: str, options: Mapping[str, Any], *, host: str, port: int, workers: int, out: Console) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        aligner: name of the one that is served.
        options: its section of the settings.
        host, port: where to listen; port 0 takes a free one.
        workers: sounds that are aligned at once.
        out: where the address is told, once it answers.

    Raises:
        InputError: the address cannot be listened on, or the aligner would ask this server.
        NotFound, MissingExtra, ConfigError, AlignmentFailed: the aligner.
    """
    if aligner == "xmlrpc":
        raise InputError("xmlrpc only asks a server like this one", advice="--aligner pocketsphinx", field="aligner")
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    server = AlignServer(lambda: create(aligner, options), host=host, port=port, workers=workers)
    thread = threading.Thread(target=server.serve_forever, name="align-server", daemon=True)
    thread.start()
    try:
        server.warm_up()
        shown = f"[{host}]" if ":" in host else host
        out.print(f"{aligner}: http://{shown}:{server.server_port}{PATH}", highlight=False, soft_wrap=True)
        ended.wait()
    finally:
        server.end()
        thread.join()
