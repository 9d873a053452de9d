from __future__ import annotations

import numpy as np
import pytest

from app.engine.models.hmm_context import THIS, contexts, questions
from app.engine.models.hmm_states import MOST, SLOTS, SPEECH, slots_of
from app.engine.models.hmm_stream import FLOOR, Stream, gathered, grown, load_stream, stored_stream, tied
from app.engine.stored_arrays import StoredArrays
from app.errors import BadPack
from app.speech import Phone

NAMES = ("SIL", "AA", "B", "S", "IY")


def material(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Contexts, states, rows and which are usable; rows hang on the phone, its state and what comes next."""
    random = np.random.default_rng(seed)
    symbols = ["SIL", *(str(random.choice(NAMES[1:])) for _ in range(150)), "SIL"]
    labels = contexts([Phone(symbol, at, at + 1) for at, symbol in enumerate(symbols)], NAMES)
    firsts, counts = slots_of(labels)
    states = np.zeros((len(labels), MOST), np.int64)
    rows = []
    for at, (first, many) in enumerate(zip(firsts, counts, strict=True)):
        states[at, :many] = random.integers(8, 14, many)
        for state in range(many):
            place = [labels[at, 1] + 5 * (first + state), 3.0 * labels[at, 2] * (state == 2)]
            rows.append(random.normal(place, 0.5, (states[at, state], 2)))
    stacked = np.concatenate(rows)
    return labels, states, stacked, random.random(len(stacked)) < 0.9


@pytest.fixture(scope="module")
def stream() -> Stream:
    labels, states, rows, usable = material()
    found = gathered(labels, states, rows, usable)
    return tied(found, grown(found, penalty=0.3))


def test_a_leaf_is_the_mean_and_variance_of_the_rows_that_fall_into_it(stream: Stream) -> None:
    labels, states, rows, usable = material()
    owner = np.repeat(stream.leaves(labels).ravel(), states.ravel())
    floor = FLOOR * rows[usable].var(0)
    assert len(stream.mean) > SLOTS
    seen = np.unique(owner[usable])
    assert len(seen) > SLOTS // 2
    for leaf in seen:
        mine = rows[usable & (owner == leaf)]
        np.testing.assert_allclose(stream.mean[leaf], mine.mean(0), atol=1e-9)
        np.testing.assert_allclose(stream.variance[leaf], np.maximum(mine.var(0), floor), atol=1e-9)


def test_slots_that_were_never_passed_have_the_mean_of_all(stream: Stream) -> None:
    labels, _, rows, usable = material()
    firsts, counts = slots_of(labels)
    passed = set(np.concatenate([np.arange(a, a + b) for a, b in zip(firsts, counts, strict=True)]).tolist())
    offsets = np.cumsum([0, *(tree.leaves for tree in stream.trees)])
    for slot in set(range(SLOTS)) - passed:
        np.testing.assert_allclose(stream.mean[offsets[slot]], rows[usable].mean(0), atol=1e-9)


def test_the_last_states_of_phones_are_told_apart_by_what_comes_next(stream: Stream) -> None:
    places = np.array(questions().column)
    assert set(places[stream.trees[2].question[stream.trees[2].question >= 0]]) >= {2}


def test_trees_ask_about_no_other_columns_than_they_may() -> None:
    found = gathered(*material())
    for tree in grown(found, penalty=0.1, columns=[THIS]):
        assert set(questions().column[tree.question[tree.question >= 0]]) <= {THIS}


def test_gaussians_of_speech_come_before_those_of_silence(stream: Stream) -> None:
    labels, _, _, _ = material()
    firsts, counts = slots_of(labels)
    used = np.arange(MOST) < counts[:, None]
    leaves = stream.leaves(labels)
    assert (leaves[used & (firsts < SPEECH)[:, None]] < stream.spoken).all()
    assert (leaves[used & (firsts >= SPEECH)[:, None]] >= stream.spoken).all()


def test_it_is_read_as_it_was_stored(stream: Stream) -> None:
    again = load_stream(StoredArrays("a file", stored_stream(stream.rounded(), "seen")), "seen", 2)
    labels, _, _, _ = material()
    assert np.array_equal(again.leaves(labels), stream.leaves(labels))
    assert np.array_equal(again.mean, stream.rounded().mean)
    assert np.array_equal(again.variance, stream.rounded().variance)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("seen_yes", lambda a: np.zeros_like(a)),
        ("seen_question", lambda a: np.where(a >= 0, 9999, a)),
        ("seen_question", lambda a: a + 0.5),
        ("seen_nodes", lambda a: a + 1),
        ("seen_nodes", lambda a: -a),
        ("seen_mean", lambda a: a[:-1]),
        ("seen_mean", lambda a: a * np.nan),
        ("seen_variance", lambda a: 0 * a),
    ],
)
def test_arrays_that_are_no_stream_are_refused(stream: Stream, name: str, change) -> None:  # type: ignore[no-untyped-def]
    arrays = stored_stream(stream, "seen")
    with pytest.raises(BadPack):
        load_stream(StoredArrays("a file", arrays | {name: change(arrays[name])}), "seen", 2)
