import asyncio
import os
import signal
import threading
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from recordings import SENTENCES, Clip

from app.align import pocketsphinx
from app.align.aligner import DOUBTFUL, Aligner, Alignment
from app.align.dictionary import Dictionary
from app.align.pocketsphinx import PocketSphinxAligner
from app.errors import AlignmentFailed, InputError, NothingToSay
from app.speech import PHONES, Speech

RATE = 16_000


def covers(alignment: Alignment, duration: float) -> bool:
    phones = alignment.phones
    assert phones[0].start == 0
    assert phones[-1].end == duration
    assert all(before.end == after.start for before, after in pairwise(phones))
    assert all(phone.end > phone.start and phone.symbol in PHONES for phone in phones)
    assert all(word.end > word.start for word in alignment.words)
    assert all(before.end <= after.start for before, after in pairwise(alignment.words))
    return True


@pytest.fixture
def own() -> Iterator[PocketSphinxAligner]:
    """An aligner of the test's own, its process running, to be maltreated."""
    with PocketSphinxAligner() as aligner:
        aligner.warm_up()
        yield aligner


def test_it_is_an_aligner(sphinx: PocketSphinxAligner) -> None:
    assert isinstance(sphinx, Aligner)


def test_phones_cover_the_sound_and_are_where_the_voice_put_them(
    sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]
) -> None:
    errors: list[float] = []
    for sentence, speech in zip(SENTENCES, spoken, strict=True):
        result = sphinx.align(speech.samples, speech.rate, sentence)
        assert covers(result, speech.duration)
        assert [word.text for word in result.words] == sentence.split()
        assert result.guessed == ()
        assert result.confidence > 0.9
        errors += [abs(a.start - b.start) for a, b in zip(result.words, speech.words, strict=True)]
        assert abs(result.words[0].start - speech.words[0].start) < 0.06
        assert abs(result.words[-1].end - speech.words[-1].end) < 0.08
    assert np.median(errors) < 0.02
    assert np.percentile(errors, 90) < 0.05


def test_the_same_sound_gives_the_same_times(sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    first = sphinx.align(spoken[0].samples, spoken[0].rate, SENTENCES[0])
    sphinx.align(spoken[1].samples, spoken[1].rate, SENTENCES[1])
    assert sphinx.align(spoken[0].samples, spoken[0].rate, SENTENCES[0]) == first


def test_a_wrong_transcript_is_doubtful(sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    for speech, wrong in zip(spoken, (*SENTENCES[1:], SENTENCES[0]), strict=True):
        try:
            result = sphinx.align(speech.samples, speech.rate, wrong)
        except AlignmentFailed:
            continue
        assert covers(result, speech.duration)
        assert result.confidence < DOUBTFUL / 10


def test_unknown_words_are_guessed(sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    text = SENTENCES[1].replace("vegetables", "vejtablz").replace("five", "5") + " 😀"
    result = sphinx.align(spoken[1].samples, spoken[1].rate, text)
    assert result.guessed == ("5", "vejtablz.")
    assert [word.text for word in result.words] == text.split()[:-1]
    assert covers(result, spoken[1].duration)
    assert result.confidence > 0.8


def test_a_lexicon_of_ones_own(spoken: tuple[Speech, ...]) -> None:
    with PocketSphinxAligner(Dictionary({"qq": "V EH JH T AH B AH L Z"})) as aligner:
        text = SENTENCES[1].replace("vegetables", "qq")
        assert (
            aligner.align(spoken[1].samples, spoken[1].rate, text).phones
            == aligner.align(spoken[1].samples, spoken[1].rate, SENTENCES[1]).phones
        )


@pytest.mark.parametrize("lead", [0.0, 1.5])
def test_pauses_and_noise_around_the_speech(
    sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...], lead: float
) -> None:
    speech = spoken[2]
    generator = np.random.default_rng(3)
    rest = np.zeros(round(lead * speech.rate), np.float32)
    samples = np.concatenate([rest, speech.samples, rest])
    samples = samples + (0.002 * generator.standard_normal(len(samples))).astype(np.float32)
    result = sphinx.align(samples, speech.rate, SENTENCES[2])
    assert covers(result, len(samples) / speech.rate)
    errors = [a.start - lead - b.start for a, b in zip(result.words, speech.words, strict=True)]
    assert np.median(np.abs(errors)) < 0.02


@pytest.mark.parametrize(
    ("samples", "text", "error"),
    [
        (np.zeros(0, np.float32), "hello", InputError),
        (np.zeros(RATE, np.float32), " ", NothingToSay),
        (np.zeros(RATE, np.float32), "😀 …", NothingToSay),
        (np.zeros(800, np.float32), "hello", AlignmentFailed),
        (np.zeros(3 * RATE, np.float32), "hello", AlignmentFailed),
        (np.zeros(RATE, np.float32), "far too many words for one second of sound " * 5, AlignmentFailed),
    ],
)
def test_bad_input(sphinx: PocketSphinxAligner, samples: np.ndarray, text: str, error: type[Exception]) -> None:
    with pytest.raises(error):
        sphinx.align(samples, RATE, text)


def test_failures_name_the_aligner_and_the_words(sphinx: PocketSphinxAligner) -> None:
    with pytest.raises(AlignmentFailed, match=r"pocketsphinx: .*“hello hello") as caught:
        sphinx.align(np.zeros(RATE // 2, np.float32), RATE, "hello " * 30)
    assert "Is the text" in caught.value.advice


def test_long_sound_is_cut_at_pauses(
    monkeypatch: pytest.MonkeyPatch, sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]
) -> None:
    monkeypatch.setattr(pocketsphinx, "LONGEST", 10.0)
    monkeypatch.setattr(pocketsphinx, "WINDOW", 7.0)
    asked: list[str] = []
    ask = sphinx._ask
    monkeypatch.setattr(sphinx, "_ask", lambda task, *rest: asked.append(task) or ask(task, *rest))
    samples = np.concatenate([speech.samples for speech in spoken * 2])
    rate = spoken[0].rate
    result = sphinx.align(samples, rate, " ".join(SENTENCES * 2))
    assert asked.count("align") > 2
    assert covers(result, len(samples) / rate)
    origins = np.cumsum([0, *(speech.duration for speech in spoken * 2)])
    expected = [
        origin + word.start for origin, speech in zip(origins, spoken * 2, strict=False) for word in speech.words
    ]
    assert len(expected) == len(result.words)
    assert np.percentile(np.abs(np.array([word.start for word in result.words]) - expected), 90) < 0.05
    assert result.confidence > 0.9


def test_long_silence_around_and_inside_is_passed_over(
    monkeypatch: pytest.MonkeyPatch, sphinx: PocketSphinxAligner, spoken: tuple[Speech, ...]
) -> None:
    monkeypatch.setattr(pocketsphinx, "LONGEST", 10.0)
    monkeypatch.setattr(pocketsphinx, "WINDOW", 7.0)
    rate = spoken[0].rate
    rest = (0.0003 * np.random.default_rng(0).standard_normal(round(16 * rate))).astype(np.float32)
    samples = np.concatenate([rest, spoken[0].samples, rest, spoken[1].samples, rest])
    result = sphinx.align(samples, rate, " ".join(SENTENCES[:2]))
    assert covers(result, len(samples) / rate)
    origins = (16.0, 32.0 + spoken[0].duration)
    expected = [o + word.start for o, speech in zip(origins, spoken, strict=False) for word in speech.words]
    assert np.abs(np.array([word.start for word in result.words]) - expected).max() < 0.1


# --- the process ------------------------------------------------------------------------------------------------------


def test_a_killed_process_is_replaced(own: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    first = own.process
    assert first is not None
    os.kill(first, signal.SIGKILL)
    os.waitid(os.P_PID, first, os.WEXITED | os.WNOWAIT)
    assert own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0]).confidence > 0.9
    assert own.process not in (None, first)


def test_a_process_killed_at_work_is_an_error_and_replaced(
    own: PocketSphinxAligner, spoken: tuple[Speech, ...]
) -> None:
    assert own.process is not None
    os.kill(own.process, signal.SIGSTOP)  # it will not have answered when it is killed
    killer = threading.Timer(0.3, os.kill, (own.process, signal.SIGKILL))
    killer.start()
    with pytest.raises(AlignmentFailed, match=r"pocketsphinx: .*signal 9"):
        own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0])
    killer.join()
    assert own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0]).confidence > 0.9


def test_a_time_limit(own: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    stuck = own.process
    assert stuck is not None
    os.kill(stuck, signal.SIGSTOP)
    own.time_limit = 0.3
    with pytest.raises(AlignmentFailed, match="longer than"):
        own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0])
    assert own.process is None
    own.time_limit = None
    assert own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0]).confidence > 0.9


def test_it_can_be_closed_and_used_again(own: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    own.close()
    own.close()
    assert own.process is None
    own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0])
    assert own.process is not None


def test_closing_ends_a_call_under_way(own: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    assert own.process is not None
    os.kill(own.process, signal.SIGSTOP)  # it would not answer before its time limit of half a minute
    closer = threading.Timer(0.3, own.close)
    closer.start()
    with pytest.raises(AlignmentFailed, match="pocketsphinx: "):
        own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0])
    closer.join()
    assert own.process is None
    assert own.align(spoken[0].samples, spoken[0].rate, SENTENCES[0]).confidence > 0.9


async def test_the_event_loop_runs_on(own: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    """Many ticks of the loop while one call is under way: with the decoder in this process there were two."""
    samples = np.concatenate([speech.samples for speech in spoken * 2])
    work = asyncio.create_task(asyncio.to_thread(own.align, samples, spoken[0].rate, " ".join(SENTENCES * 2)))
    ticks = 0
    while not work.done():
        await asyncio.sleep(0.002)
        ticks += 1
    await work
    assert ticks > 30


def test_calls_from_several_threads_wait_for_each_other(own: PocketSphinxAligner, spoken: tuple[Speech, ...]) -> None:
    results: dict[int, Alignment] = {}

    def work(number: int) -> None:
        results[number] = own.align(spoken[number].samples, spoken[number].rate, SENTENCES[number])

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [len(results[number].words) for number in range(4)] == [len(text.split()) for text in SENTENCES]


# --- a real talker ----------------------------------------------------------------------------------------------------


def test_real_speech(sphinx: PocketSphinxAligner, clips: tuple[Clip, ...]) -> None:
    inner: list[float] = []
    onsets: list[float] = []
    for clip in clips:
        result = sphinx.align(clip.samples, clip.rate, clip.transcript.text)
        assert covers(result, len(clip.samples) / clip.rate)
        assert clip.transcript.words is not None
        starts = [a.start - b.start for a, b in zip(result.words, clip.transcript.words, strict=True)]
        onsets.append(abs(starts[0]))
        inner += [abs(start) for start in starts[1:]]
        assert result.confidence > DOUBTFUL, clip.name
    assert np.median(inner) <= 0.025
    assert np.median(onsets) <= 0.060


def test_real_speech_with_wrong_transcripts(sphinx: PocketSphinxAligner, clips: tuple[Clip, ...]) -> None:
    for clip, other in zip(clips, (*clips[3:], *clips[:3]), strict=True):
        try:
            wrong = sphinx.align(clip.samples, clip.rate, other.transcript.text).confidence
        except AlignmentFailed:
            continue
        assert wrong < DOUBTFUL, clip.name
