"""The log: one line an event, from structlog and from the standard library alike. No text that was spoken, no keys."""

from __future__ import annotations

import logging
import sys

import structlog

_LET_GO = "ASGI callable returned without completing response."
"""What uvicorn calls an error when a viewer that takes nothing is let go, of which app/api/live.py has told already."""


def configure(level: int = logging.INFO) -> None:
    """Write all logs to standard error, coloured on a terminal."""
    shared: list[structlog.typing.Processor] = [
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="%H:%M:%S", utc=False),
    ]
    structlog.configure(
        processors=[
            structlog.stdlib.filter_by_level,
            *shared,
            structlog.stdlib.PositionalArgumentsFormatter(),
            structlog.processors.StackInfoRenderer(),
            structlog.stdlib.ProcessorFormatter.wrap_for_formatter,
        ],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=True,
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                structlog.dev.ConsoleRenderer(
                    colors=sys.stderr.isatty(),
                    pad_event_to=0,
                    # The other ones print local variables: what was said, keys, passwords.
                    exception_formatter=structlog.dev.plain_traceback,
                ),
            ],
            foreign_pre_chain=[*shared, structlog.stdlib.ExtraAdder()],
        )
    )
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)
    logging.getLogger("uvicorn.error").addFilter(lambda record: record.getMessage() != _LET_GO)
    for chatty in ("aiortc", "aioice", "uvicorn", "asyncio", "libav", "numba", "sse_starlette"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
