"""Reads FLV as it arrives, tag by tag (Adobe Flash Video File Format Specification 10.1, annex E)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

AUDIO, VIDEO = 8, 9
FILE_HEAD, TAG_HEAD, SIZE_BEHIND = 9 + 4, 11, 4


@dataclass(frozen=True, slots=True)
class Tag:
    """One packet.

    Attributes:
        kind: `AUDIO` or `VIDEO`.
        seconds: its time of presentation on the stream's clock.
        arrived: Unix time at which the last byte of it had come.
    """

    kind: int
    seconds: float
    arrived: float


class FlvReader:
    """Takes bytes in pieces of any size, gives the packets complete with them; metadata and codec headers are none."""

    def __init__(self) -> None:
        self._waiting = bytearray()
        self._head_read = False

    def feed(self, data: bytes, arrived: float) -> Iterator[Tag]:
        """The tags that end in `data`.

        Raises:
            ValueError: this is no FLV.
        """
        self._waiting += data
        if not self._head_read:
            if len(self._waiting) < FILE_HEAD:
                return
            if self._waiting[:3] != b"FLV":
                raise ValueError("no FLV")
            del self._waiting[:FILE_HEAD]
            self._head_read = True
        while len(self._waiting) >= TAG_HEAD:
            size = int.from_bytes(self._waiting[1:4], "big")
            end = TAG_HEAD + size + SIZE_BEHIND
            if len(self._waiting) < end:
                return
            tag = bytes(self._waiting[:end])
            del self._waiting[:end]
            if int.from_bytes(tag[-SIZE_BEHIND:], "big") != TAG_HEAD + size:
                raise ValueError("a tag is not as long as it says")
            milliseconds, body = int.from_bytes(tag[7:8] + tag[4:7], "big"), tag[TAG_HEAD:-SIZE_BEHIND]
            if tag[0] in (AUDIO, VIDEO) and body[1] == 1:  # as opposed to a codec's header
                if tag[0] == VIDEO:
                    milliseconds += int.from_bytes(body[2:5], "big", signed=True)
                yield Tag(tag[0], milliseconds / 1000, arrived)
