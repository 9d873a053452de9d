from __future__ import annotations

import numpy as np
import pytest
from test_hmm import FPS, REST, sentence

from app.engine.models import hmm_training
from app.engine.models.hmm_context import QUIET, THIS, contexts
from app.engine.models.hmm_rows import HEARD, ROWS, heard_rows, rows_of
from app.engine.models.hmm_states import slots_of
from app.engine.models.hmm_training import Observed, Settings, aligned, learn, observed, untrained
from app.engine.models.model import Spoken
from app.speech import Phone


@pytest.mark.parametrize("heard", [False, True])
def test_states_are_found_where_what_is_seen_or_heard_changes(heard: bool) -> None:
    random = np.random.default_rng(0)
    labels = contexts([Phone("AA" if at % 2 else "B", at, at + 1) for at in range(60)], ("SIL", "AA", "B"))
    lengths = np.array([random.multinomial(10, [0.2, 0.5, 0.3]) + 2 for _ in labels])
    state = np.repeat(np.tile(np.arange(3), len(labels)), lengths.ravel())
    change = 4.0 * state[:, None] + random.normal(0, 0.5, (len(state), 2))
    noise = random.normal(0, 0.5, change.shape)
    data = Observed(
        np.append(0, np.cumsum(lengths.sum(1))), labels, slots_of(labels)[1], change if heard else None,
        noise if heard else change, np.ones(len(state), bool),
    )  # fmt: skip
    found = aligned(data)[:, :3]
    assert (found == lengths).mean() > 0.97


def test_everything_that_is_learnt_from_lies_on_one_clock() -> None:
    spoken = [sentence(1), sentence(2)]
    heard = [heard_rows(each.sound, 0, rows_of(len(each.counted)), FPS) for each in spoken if each.sound]
    base = untrained(spoken, REST, FPS)
    data = observed(spoken, heard, base, 0)
    assert data.heard is not None
    assert data.heard.shape == (data.starts[-1], HEARD)
    assert len(data.seen) == len(data.sure) == data.starts[-1] == sum(rows_of(len(each.counted)) for each in spoken)
    second = int(data.starts[len(spoken[0].phones)])
    standard = (spoken[1].coefficients - REST) / base.scale
    np.testing.assert_allclose(data.seen[second::ROWS, :2], standard, atol=1e-6)
    loud = data.heard[:, 0] > data.heard[:, 0].mean()
    speech = np.repeat(data.contexts[:, THIS] != QUIET, np.diff(data.starts))
    assert (loud == speech).mean() > 0.95


def test_with_few_sentences_each_is_left_out_once_and_with_fewer_nothing_is_chosen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hmm_training, "LEADS", (8,))
    monkeypatch.setattr(hmm_training, "PENALTIES", (50.0,))
    monkeypatch.setattr(hmm_training, "DYNAMICS", (1.0,))
    folds: list[int] = []
    grow_all = hmm_training.grow_all

    def counted(data: Observed, *rest: object, **named: object) -> object:
        folds.append(int((data.contexts[:, THIS] == QUIET).sum() // 2))
        return grow_all(data, *rest, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(hmm_training, "grow_all", counted)
    spoken: list[Spoken] = [sentence(seed) for seed in range(8)]
    told: list[float] = []
    model, settings = learn(spoken, REST, fps=FPS, progress=told.append)
    assert settings.lead == 8
    assert folds == [6, 6, 7, 7, 7, 7, 8]
    assert model.hearing is not None
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert learn(spoken[:3], REST, fps=FPS)[1] == Settings()
    assert folds[7:] == [3]
