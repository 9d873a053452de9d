"""The process in which pocketsphinx runs: it holds Python's global lock, and C code may crash or never end.

`app.align.pocketsphinx` is the other end of it (see `app.worker`). It ends when its input does.

Questions are ``{"task": name, "words": [[pronunciation, ...], ...]}`` with samples (int16, 16 kHz). The tasks:

- ``hello`` answers true.
- ``align`` answers ``[[word, phone, first frame, frames, score], ...]`` (word -1: silence), null if nothing was found.
- ``begin`` takes sound that says only the first of the words; answers ``[[word, first frame, frames], ...]`` or null.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from typing import Any

from pocketsphinx import Decoder

from app.worker import serve

SEARCH_BEAM = 1e-300  # nothing is pruned: the usual beams lose the end of every fifth sentence
_NUMBER = re.compile(r"w(\d+)")


def main() -> None:
    """Answer questions until the input ends."""
    with tempfile.TemporaryDirectory(prefix="mary-align-") as folder:
        path = os.path.join(folder, "empty.dict")  # noqa: PTH118
        with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123
            file.write("ah AH\n")  # our words bring their pronunciations; without the big dictionary it loads in 5 ms
        serve(lambda question, samples: (_answer(question["task"], path, question["words"], samples), b""))


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
