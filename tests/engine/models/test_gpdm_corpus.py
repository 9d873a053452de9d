from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.engine.models.gpdm_corpus import (
    LONGEST,
    Corpus,
    counted_runs,
    phone_windows,
    pieces,
    prepare,
    remove_means,
    sample,
    vlmm_windows,
)
from app.engine.models.model import Spoken
from app.engine.models.sound import Sound
from app.engine.models.vlmm import learn_vlmm
from app.speech import Phone


def corpus(*said: str, lost: tuple[int, ...] = ()) -> Corpus:
    labels = tuple(tuple(each.split()) for each in said)
    starts = np.concatenate([[0], np.cumsum([len(each) for each in labels])])
    counted = np.ones(starts[-1], bool)
    counted[list(lost)] = False
    zeros = np.zeros((starts[-1], 2), np.float32)
    return Corpus(labels, starts, counted, zeros, zeros, *np.ones((4, 2), np.float32))


def test_pieces_are_runs_cut_where_they_are_long() -> None:
    found = pieces(["AA"] * (LONGEST + 2) + ["B"] + ["AA"], {"AA": 0, "B": 1})
    assert [(each.state, each.stop - each.start) for each in found] == [(0, LONGEST), (0, 2), (1, 1), (0, 1)]


def test_phone_windows_leave_out_what_does_not_count() -> None:
    found = phone_windows(corpus("B AA AA AA", "AA B", lost=(2,)), ["AA", "B"])
    assert [[list(window) for window in each] for each in found] == [[[1], [3], [4]], [[0], [5]]]


def test_vlmm_windows_are_where_the_automaton_is() -> None:
    said = ["SIL AA B AA B AA B SIL"] * 4
    whole = corpus(*said)
    model = learn_vlmm(whole.labels, memory=2, threshold=0.0)
    found = vlmm_windows(whole, model)
    flat = [label for labels in whole.labels for label in labels]
    for state, windows in enumerate(found[1:], 1):
        for window in windows:
            assert tuple(flat[frame] for frame in window) == model.contexts[state]
    # The automaton remembers 'AA B' there, so that 'B' alone has its frames from wherever there is a B.
    assert [list(window) for window in found[model.number["B",]]][:3] == [[2], [4], [6]]


def test_a_sample_is_whole_windows_from_everywhere() -> None:
    windows = [np.arange(5 * at, 5 * at + 5) for at in range(100)]
    chosen = sample(windows, 30)
    assert [int(window[0]) // 5 for window in chosen] == [0, 20, 40, 59, 79, 99]
    assert len(sample(windows[:3], 30)) == 3
    assert len(sample(windows, 2)) == 1


def test_runs_of_what_counts() -> None:
    counted = np.array([1, 1, 0, 1, 0, 0], bool)
    assert [list(run) for run in counted_runs(np.arange(6), counted)] == [[0, 1], [3]]
    assert counted_runs(np.array([4, 5]), counted) == []


def test_what_a_sentence_has_of_its_own_is_removed_whatever_it_says() -> None:
    """Two sentences with the same mouths for the same phones, one of them moved, with other shares of silence."""
    mouths = {"SIL": 0.0, "AA": 4.0}
    labels = [["SIL"] * 6 + ["AA"] * 6, ["SIL"] * 6 + ["AA"] * 6]
    seen = np.array([[mouths[label] + 3.0 * number] for number, row in enumerate(labels) for label in row])
    found = remove_means(seen, labels, np.array([0, 12, 24]), np.ones(24, bool))
    np.testing.assert_allclose(found[:12], found[12:])
    np.testing.assert_allclose(found[6:12] - found[:6], 4.0)


def spoken(*symbols: str) -> Spoken:
    phones = tuple(Phone(symbol, 0.4 * at, 0.4 * (at + 1)) for at, symbol in enumerate(symbols))
    rng = np.random.default_rng(0)
    sound = Sound(rng.standard_normal(16_000).astype(np.float32) * 0.1, 16_000)
    rows = rng.standard_normal((10 * len(symbols), 3)).astype(np.float32) * 5 + 2
    return Spoken(phones, rows, np.ones(len(rows), bool), sound)


def test_a_prepared_corpus_is_in_standard_deviations() -> None:
    found = prepare([spoken("SIL", "AA", "B", "SIL")], np.zeros(3, np.float32), 25)
    for rows in (found.heard, found.seen):
        np.testing.assert_allclose(rows.mean(0), 0, atol=1e-4)
    np.testing.assert_allclose(found.heard.std(0), 1, atol=1e-3)


def test_rare_phones_are_called_what_they_look_like_and_silence_is_added() -> None:
    said = spoken("AA", "B", "B")
    phones = (Phone("AA", 0, 0.4), Phone("P", 0.4, 0.52), Phone("B", 0.52, 1))
    short = replace(said, phones=phones)
    found = prepare([short], np.full(3, 9, np.float32), 25)
    assert "P" not in found.labels[0]
    assert set(found.labels[0]) == {"AA", "B"}
    assert set(found.labels[1]) == {"SIL"}
    shown = found.seen[found.starts[1] :] * found.seen_scale + found.seen_offset
    np.testing.assert_allclose(shown, 9, atol=1e-3)


def test_frames_that_do_not_count_may_hold_anything() -> None:
    one = spoken("SIL", "AA", "B", "SIL")
    one.counted[3] = False
    one.coefficients[3] = np.nan
    assert np.isfinite(prepare([one], np.zeros(3, np.float32), 25).seen).all()


@pytest.mark.parametrize("lost", [(), (0,)])
def test_windows_hold_only_what_counts(lost: tuple[int, ...]) -> None:
    whole = corpus("SIL AA B AA B", "AA B SIL AA B", lost=lost)
    model = learn_vlmm(whole.labels, memory=3, threshold=0.0)
    used = {int(frame) for windows in vlmm_windows(whole, model) for window in windows for frame in window}
    assert used == set(range(10)) - set(lost)
