"""The process in which pocketsphinx runs: it holds Python's global lock, and C code may crash or never end.

Talks through its standard input and output (`app.align.pocketsphinx` is the other end): a 4-byte length, JSON, then the
samples (int16, 16 kHz); the answer is a 4-byte length and JSON. It ends when its input does.

Requests are ``{"task": name, "words": [[pronunciation, ...], ...], "bytes": n}``, answers ``{"answer": ...}`` or, after
a failure, ``{"error": message}``. The tasks:

- ``hello`` answers true.
- ``align`` answers ``[[word, phone, first frame, frames, score], ...]`` (word -1: silence), null if nothing was found.
- ``begin`` takes sound that says only the first of the words; answers ``[[word, first frame, frames], ...]`` or null.
"""

from __future__ import annotations

import json
import os
import re
import signal
import struct
import sys
import tempfile
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

from pocketsphinx import Decoder

SEARCH_BEAM = 1e-300  # nothing is pruned: the usual beams lose the end of every fifth sentence
_NUMBER = re.compile(r"w(\d+)")
_HEADER = struct.Struct(">I")


def main() -> None:
    """Answer requests until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the other end's to handle
    source, sink = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints must not get between the answers
    with tempfile.TemporaryDirectory(prefix="mary-align-") as folder:
        path = os.path.join(folder, "empty.dict")  # noqa: PTH118
        with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123
            file.write("ah AH\n")  # our words bring their pronunciations; without the big dictionary it loads in 5 ms
        while (request := read(source)) is not None:
            samples = source.read(request["bytes"])
            try:
                write(sink, {"answer": _answer(request["task"], path, request["words"], samples)})
            except Exception as error:
                write(sink, {"error": f"{type(error).__name__}: {error}"})


def _answer(task: str, dictionary: str, words: Sequence[Sequence[str]], samples: bytes) -> Any:
    match task:
        case "align":
            return _align(_decoder(dictionary, words), len(words), samples)
        case "begin":
            return _begin(_decoder(dictionary, words), len(words), samples)
        case "hello":
            return True
        case _:
            raise ValueError(f"no task {task!r}")


def read(source: BinaryIO) -> Any:
    """One message; None at the end of the input."""
    header = source.read(_HEADER.size)
    if len(header) < _HEADER.size:
        return None
    (size,) = _HEADER.unpack(header)
    body = source.read(size)
    return json.loads(body) if len(body) == size else None


def write(sink: BinaryIO, message: Any) -> None:
    """Send one message."""
    body = json.dumps(message).encode()
    sink.write(_HEADER.pack(len(body)) + body)
    sink.flush()


def _decoder(dictionary: str, words: Sequence[Sequence[str]]) -> Decoder:
    """A new decoder that knows word n as ``wn``: the same request always has the same answer."""
    decoder = Decoder(
        lm=None,
        dict=dictionary,
        samprate=16000,
        loglevel="FATAL",
        bestpath=False,
        beam=SEARCH_BEAM,
        wbeam=SEARCH_BEAM,
        pbeam=SEARCH_BEAM,
    )
    for number, pronunciations in enumerate(words):
        for variant, said in enumerate(pronunciations, 1):
            decoder.add_word(f"w{number}" if variant == 1 else f"w{number}({variant})", said, False)
    return decoder


def _align(decoder: Decoder, count: int, samples: bytes) -> Any:
    """Two passes: the first chooses pronunciations and pauses, the second finds the phones."""
    decoder.set_align_text(" ".join(f"w{number}" for number in range(count)))
    _decode(decoder, samples)
    if decoder.hyp() is None:
        return None
    decoder.set_alignment()
    _decode(decoder, samples)
    alignment = decoder.get_alignment()
    if alignment is None:
        return None
    return [
        [_number(word.name), phone.name, phone.start, phone.duration, phone.score]
        for word in alignment.words()
        for phone in word
    ]


def _begin(decoder: Decoder, count: int, samples: bytes) -> Any:
    """One pass through a chain of words that may be left after any of them."""
    last = count + 1
    steps: list[tuple[Any, ...]] = [(number, number + 1, 1.0, f"w{number}") for number in range(count)]
    steps += [(number, last, 1.0) for number in range(1, count + 1)]
    decoder.add_fsg("begin", decoder.create_fsg("begin", 0, last, steps))
    decoder.activate_search("begin")
    _decode(decoder, samples)
    if decoder.hyp() is None:
        return None
    return list(_heard(decoder))


def _heard(decoder: Decoder) -> Iterator[list[int]]:
    for segment in decoder.seg():
        number = _number(segment.word)
        if number >= 0:
            yield [number, segment.start_frame, segment.end_frame + 1 - segment.start_frame]


def _decode(decoder: Decoder, samples: bytes) -> None:
    decoder.start_utt()
    decoder.process_raw(samples, full_utt=True)
    decoder.end_utt()


def _number(name: str) -> int:
    found = _NUMBER.match(name)
    return int(found[1]) if found else -1


if __name__ == "__main__":
    main()
