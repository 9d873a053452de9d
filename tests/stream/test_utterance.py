from __future__ import annotations

from app.errors import SpeechFailed
from app.stream.utterance import Utterance


def test_a_report_tells_what_is_known() -> None:
    utterance = Utterance(12, ("☃",))
    assert len(utterance.id) >= 22
    assert utterance.report().media is None
    assert not utterance.finished
    utterance.start = 50
    assert utterance.report().media == (2.0, None)
    utterance.end = 75
    utterance.state = "done"
    utterance.timings.set("speech", 3.0)
    report = utterance.report()
    assert (report.characters, report.unread, report.media) == (12, ("☃",), (2.0, 3.0))
    assert report.timings == {"speech": 3.0}
    assert utterance.finished


def test_errors_become_messages() -> None:
    ours, other = Utterance(1), Utterance(1)
    ours.fail(SpeechFailed("hibari: no sound"))
    other.fail(ValueError("odd"))
    assert (ours.error, other.error) == ("hibari: no sound", "ValueError: odd")
    assert ours.narrated


def test_cancelling_forgets_what_is_ready() -> None:
    utterance = Utterance(1)
    utterance.ready.append(None)  # type: ignore[arg-type]
    utterance.cancel()
    assert utterance.narrated
    assert not utterance.ready
