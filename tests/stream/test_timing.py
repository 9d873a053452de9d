from __future__ import annotations

from app.stream.timing import KEPT_UTTERANCES, LatencyLog, LoggedUtterance, UtteranceTimings, stage_percentiles


class Clock:
    now = 5.0

    def __call__(self) -> float:
        return self.now


def test_marks_are_milliseconds_after_the_request_and_the_first_one_counts() -> None:
    clock = Clock()
    timings = UtteranceTimings(clock)
    clock.now = 5.25
    timings.mark("trajectory")
    clock.now = 5.1
    timings.mark("speech")
    clock.now = 6.0
    timings.mark("speech")
    timings.set("shown", 321.04)
    timings.set("shown", 999.0)
    assert timings.milliseconds() == {"speech": 100.0, "trajectory": 250.0, "shown": 321.0}
    assert list(timings.milliseconds()) == ["speech", "trajectory", "shown"]


def test_the_log_gives_percentiles_of_what_was_reached_and_forgets_the_oldest() -> None:
    log = LatencyLog()
    assert stage_percentiles([]) == {}
    for n in range(KEPT_UTTERANCES + 20):
        timings = UtteranceTimings()
        timings.set("speech", float(n))
        if n == 119:
            timings.set("shown", 7.0)
        log.add(LoggedUtterance("s", str(n), 10, timings))
    assert log.utterances()[0].utterance == "20"
    assert len(log.utterances()) == KEPT_UTTERANCES
    stages = stage_percentiles(entry.timings.milliseconds() for entry in log.utterances())
    assert list(stages) == ["speech", "shown"]
    assert (stages["speech"].n, stages["speech"].p50) == (100, 69.5)
    assert 113 < stages["speech"].p95 < stages["speech"].p99 < 119
    assert (stages["shown"].p50, stages["shown"].n) == (7.0, 1)
