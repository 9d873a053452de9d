"""An aligner on another machine, asked by XML-RPC: `mary align-server` there, or any server that answers alike."""

from __future__ import annotations

import httpx
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from app.align.align_server import PATH, PORT
from app.align.aligner import Alignment, checked
from app.align.alignment_message import MOST_BYTES, BadMessage, call, read_answer
from app.align.dictionary import NO_LEXICON, Lexicon
from app.errors import AlignmentFailed
from app.exchange import Exchange, ExchangeFailed, Url


class XmlRpcOptions(BaseModel):
    """Options of the aligner.

    Attributes:
        url: of the server.
        seconds: limit for one sound, new trials included; a sound that is longer than that has as long as it lasts.
        connect_seconds: limit for one trial to connect.
        retries: further trials after a failed connection or an answer 408, 429 or 5xx: a server that is busy.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: Url = f"http://127.0.0.1:{PORT}{PATH}"
    seconds: float = Field(default=10.0, gt=0, le=600)
    connect_seconds: float = Field(default=2.0, gt=0, le=60)
    retries: int = Field(default=2, ge=0, le=10)


class XmlRpcAligner:
    """See `app.align.aligner.Aligner`. What it understands is what its server does."""

    name = "xmlrpc"
    Options = XmlRpcOptions

    def __init__(self, options: XmlRpcOptions = XmlRpcOptions()) -> None:  # noqa: B008 (it is frozen)
        self._options = options
        self._host = httpx.URL(options.url).netloc.decode("ascii", "replace")
        self._exchange = Exchange(
            seconds=options.seconds,
            connect_seconds=options.connect_seconds,
            retries=options.retries,
            most_bytes=MOST_BYTES,
            secrets=[httpx.URL(options.url).password],
        )

    def align(self, samples: NDArray[np.float32], rate: int, text: str, *, lexicon: Lexicon = NO_LEXICON) -> Alignment:
        checked(samples, rate, text)
        duration = len(samples) / rate
        question = call(samples, rate, text, lexicon)
        if len(question) > MOST_BYTES:
            raise self._failed(f"{duration:.0f} s of sound are too much for one message", "Cut it into parts.")
        try:
            answer = self._exchange.ask(
                "POST",
                self._options.url,
                headers={"Content-Type": "text/xml"},
                content=question,
                seconds=max(self._options.seconds, duration),
            )
        except ExchangeFailed as error:
            raise self._failed(error.reason, error.advice) from error
        try:
            return read_answer(answer.body, duration)
        except AlignmentFailed as error:
            raise self._failed(f"{self._host}: {error.message}", "Is the text that which is said?") from error
        except BadMessage as error:
            advice = "Is url the address of an aligner? See docs/speech.md."
            raise self._failed(f"{self._host} sent something else than an alignment: {error}", advice) from error

    def close(self) -> None:
        """End all connections. May be called again; the next call connects anew."""
        self._exchange.close()

    def _failed(self, message: str, advice: str) -> AlignmentFailed:
        return AlignmentFailed(f"aligner {self.name}: {message}", advice=advice)
