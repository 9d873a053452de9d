"""The process that serves: uvicorn, ended within a bounded time also while viewers are connected.

uvicorn waits for open answers before it tells the application to end; live streams, event streams and players that
never hang up would hold it for ever. So the streams are ended first, at the signal: every long answer then comes to its
own end, and only what is stuck is cut off after `server.shutdown_seconds`.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import threading
from types import FrameType

import structlog
import uvicorn

from app.api.application import body_limit, create_app
from app.api.service import Service
from app.config import Settings
from app.errors import ConfigError

LAST_RESORT_SECONDS = 0.8
"""How long after `server.shutdown_seconds` the process is ended whatever still runs in it."""

PING_SECONDS = 20.0
"""How often a WebSocket is asked whether it lives, and how long it may take to answer."""

_log = structlog.get_logger("mary.server")


class Server(uvicorn.Server):
    """Ends the service's streams before it waits for their viewers."""

    def __init__(self, config: uvicorn.Config, service: Service, shutdown_seconds: float) -> None:
        super().__init__(config)
        self._service = service
        self._shutdown_seconds = shutdown_seconds
        service.on_failure = self.stop

    def stop(self) -> None:
        """Begin to end. Safe from a signal handler."""
        self.should_exit = True

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:  # noqa: ARG002
        """SIGTERM or Ctrl-C: end; a second Ctrl-C waits for nothing.

        uvicorn's own handler raises the signal once more at the end, so that the process would seem to have been
        killed; a service that was asked to end and did has succeeded.
        """
        if self.should_exit and sig == signal.SIGINT:
            self.force_exit = True
            return
        self.stop()
        last_resort = threading.Timer(self._shutdown_seconds + LAST_RESORT_SECONDS, self._end_now)
        last_resort.daemon = True
        last_resort.start()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams, then wait for the answers still open, at most `shutdown_seconds` together."""
        _log.info("stopping")
        for listener in self.servers:
            listener.close()
        started = asyncio.get_running_loop().time()
        try:
            await asyncio.wait_for(self._service.close(), self._shutdown_seconds / 2)
        except TimeoutError:
            _log.warning("streams did not end in time")
        except Exception:
            _log.exception("ending the streams failed")
        spent = asyncio.get_running_loop().time() - started
        # uvicorn takes whole seconds by its types, and any number in fact
        self.config.timeout_graceful_shutdown = max(self._shutdown_seconds - spent, 0.1)  # type: ignore[assignment]
        await super().shutdown(sockets)

    def _end_now(self) -> None:
        _log.error("something did not end in time")
        os._exit(1)


def serve(settings: Settings) -> None:
    """Serve until SIGTERM or Ctrl-C.

    Raises:
        ConfigError: the address cannot be listened on.
        MaryError: an avatar or the speech engine could not be loaded.
    """
    host, port = settings.server.host, settings.server.port
    listener = _listen(host, port)
    app = create_app(settings)
    service: Service = app.state.service
    config = uvicorn.Config(
        app,
        log_config=None,  # app/api/logs.py has done it
        access_log=False,  # a stream's address is the key to it: app/api/middleware.py logs the route instead
        server_header=False,
        ws="websockets-sansio",
        ws_max_size=body_limit(settings),
        ws_ping_interval=PING_SECONDS,
        ws_ping_timeout=PING_SECONDS,
        lifespan="on",
    )
    server = Server(config, service, settings.server.shutdown_seconds)
    for number in (signal.SIGINT, signal.SIGTERM):  # from now on, not only once uvicorn runs
        signal.signal(number, server.handle_exit)
    shown = "localhost" if host in {"0.0.0.0", "::", ""} else host
    _log.info(f"Mary is at http://{shown}:{listener.getsockname()[1]}")
    server.run(sockets=[listener])
    if service.failure is not None:
        raise service.failure


def _listen(host: str, port: int) -> socket.socket:
    try:
        (family, _, _, _, address), *_ = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        return socket.create_server(address[:2], family=family, backlog=2048)
    except OSError as error:
        raise ConfigError(
            f"cannot listen on {host}:{port}: {error.strerror or error}",
            field="server.port",
            advice="Another port: mary serve --port 8081, or MARY_SERVER__PORT=8081.",
        ) from error
