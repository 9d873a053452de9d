from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.engine.models.vlmm import START, Vlmm, information, learn_vlmm

sentences = st.lists(st.lists(st.sampled_from(["AA", "B", "SIL"]), min_size=1, max_size=12), min_size=1, max_size=4)


def occurrences(said: list[list[str]], string: tuple[str, ...]) -> int:
    return sum(
        tuple(labels[at : at + len(string)]) == string for labels in said for at in range(len(labels) - len(string) + 1)
    )


def gained(said: list[list[str]], string: tuple[str, ...]) -> float:
    """Eq. 13 to the letter."""
    tokens = {label for labels in said for label in labels}

    def chance(token: str, context: tuple[str, ...]) -> float:
        return occurrences(said, (*context, token)) / sum(occurrences(said, (*context, each)) for each in tokens)

    probability = occurrences(said, string) / sum(map(len, said))
    followed = [token for token in tokens if occurrences(said, (*string, token))]
    return probability * sum(
        chance(token, string) * math.log(chance(token, string) / chance(token, string[1:])) for token in followed
    )


@given(sentences, st.sampled_from([0.0, 0.01, 0.05]))
@settings(max_examples=40, deadline=None)
def test_contexts_are_those_of_equation_13_and_what_the_automaton_needs(
    said: list[list[str]], threshold: float
) -> None:
    memory = 3
    found = set(learn_vlmm(said, memory=memory, threshold=threshold).contexts)
    seen = {
        tuple(labels[at : at + length])
        for labels in said for length in range(2, memory + 1) for at in range(len(labels) - length + 1)
    }  # fmt: skip
    informative = {each for each in seen if gained(said, each) > threshold + 1e-12}
    assert informative <= found
    for string in found:
        assert not string or (string[1:] in found and string[:-1] in found)
        inside_one = any(
            string == each[at : at + len(string)] for each in informative for at in range(len(each) - len(string) + 1)
        )
        near = any(abs(gained(said, each) - threshold) <= 1e-12 for each in seen)
        assert len(string) < 2 or inside_one or near


@given(sentences, sentences)
@settings(max_examples=60, deadline=None)
def test_stretches_cover_a_sentence_once_and_spell_it(said: list[list[str]], new: list[list[str]]) -> None:
    model = learn_vlmm(said, memory=3, threshold=0.01)
    labels = [label for label in new[0] if label in model.tokens]
    stretches = model.stretches(labels)
    assert [frame for each in stretches for frame in range(each.start, each.stop)] == list(range(len(labels)))
    for each in stretches:
        assert model.contexts[each.state] == tuple(labels[each.start : each.stop])


def test_probabilities_are_frequencies() -> None:
    model = learn_vlmm([["AA", "B", "AA", "B", "AA", "AA"]], memory=1, threshold=0.0)
    row = dict(zip(model.tokens, model.next[model.number["AA",]], strict=True))
    assert row == {"AA": pytest.approx(1 / 3), "B": pytest.approx(2 / 3)}
    assert model.next[model.number[START]].sum() == pytest.approx(1)


def automaton(*contexts: str, never: tuple[str, str] | None = None) -> Vlmm:
    strings = (START, *(tuple(each.split()) for each in contexts))
    tokens = ("AA", "B", "SIL")
    following = np.full((len(strings), 3), 1 / 3)
    if never:
        following[strings.index(tuple(never[0].split())), tokens.index(never[1])] = 0.0
    return Vlmm(strings, tokens, following)


def test_the_next_state_is_the_longest_suffix_that_is_remembered() -> None:
    model = automaton("AA", "B", "SIL", "AA B", "B AA", "AA B AA")
    path = [model.contexts[state] for state in model.traverse(["SIL", "AA", "B", "AA", "AA", "B", "SIL"])]
    assert path == [("SIL",), ("AA",), ("AA", "B"), ("AA", "B", "AA"), ("AA",), ("AA", "B"), ("SIL",)]


def test_what_never_followed_makes_the_automaton_forget() -> None:
    model = automaton("AA", "B", "SIL", "AA B", never=("AA", "B"))
    assert [model.contexts[state] for state in model.traverse(["AA", "B"])] == [("AA",), ("B",)]


def test_tracking_back_takes_what_the_last_states_remember() -> None:
    """As 4.2.1 has it: frames 3-4 are 'B AA', frame 2 is what the automaton was in there, 'AA B' with frame 1."""
    model = automaton("AA", "B", "SIL", "AA B", "B AA", "B B")
    stretches = model.stretches(["SIL", "AA", "B", "B", "AA"])
    assert [model.contexts[each.state] for each in stretches] == [("SIL",), ("AA", "B"), ("B", "AA")]
    kept = model.stretches(["SIL", "AA", "B", "B", "AA"], lambda state: model.contexts[state] != ("B", "AA"))
    assert [model.contexts[each.state] for each in kept] == [("SIL",), ("AA",), ("B", "B"), ("AA",)]


def test_a_higher_threshold_remembers_less() -> None:
    rng = np.random.default_rng(0)
    said = [list(rng.choice(["AA", "B", "SIL"], 60, p=[0.5, 0.3, 0.2])) for _ in range(5)]
    sizes = [len(learn_vlmm(said, memory=4, threshold=each).contexts) for each in (0.0, 0.003, 0.01, 1.0)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] == 4


def test_information_is_the_divergence() -> None:
    assert information(np.array([2.0, 2.0]), np.array([1.0, 3.0])) == pytest.approx(
        0.5 * math.log(2) + 0.5 * math.log(2 / 3)
    )
