"""The sections about motion: trials, trajectories and phones."""

from __future__ import annotations

import numpy as np

from app.engine.pack import FPS
from app.engine.training.articulation import LEAST_PASSAGES, spoken_passages
from app.engine.training.report.fallbacks import FEW, count_states, heard
from app.engine.training.report.markup import Markup, element, paragraph, plot, section, table
from app.engine.training.report.plots import trajectories as plotted
from app.engine.training.train import Learnt

SENTENCES = 3
"""Whose trajectories are shown."""
FLOW_ROWS, TEXTURE_ROWS = 3, 2
"""Modes whose trajectories are shown."""
NO_VALIDATION = (
    f"The recording has too few passages for a validation part (at least {LEAST_PASSAGES}): nothing was left out, so "
    "nothing can be compared that was not learnt from."
)


def trials(learnt: Learnt) -> Markup:
    """Models and settings on the validation sentences."""
    spoken, options = learnt.articulation, learnt.articulation.options
    chosen = paragraph(
        f"Smoothness {options.smoothness:g}, lips {1000 * options.lead:.0f} ms ahead of the sound, {options.epochs} "
        f"epochs of training; {_chosen(bool(spoken.trials))}."
    )
    if not spoken.trials:
        return section("Trajectories: trials", paragraph(NO_VALIDATION), chosen)
    rows = []
    for trial in spoken.trials:
        score = trial.scores
        rows.append(
            (
                trial.name, f"{score.error_weighted:.3f}", f"{score.correlation_weighted:.3f}",
                f"{score.error:.3f} ± {score.error_deviation:.3f}",
                f"{score.correlation:.3f} ± {score.correlation_deviation:.3f}", f"{score.amplitude:.2f}",
                f"{score.jerk:.2f}",
            )
        )  # fmt: skip
    head = (
        "Model",
        "Error, weighted",
        "Correlation, weighted",
        "Error (AMSE)",
        "Correlation (ACC)",
        "Amplitude",
        "Jerk",
    )
    return section(
        "Trajectories: trials",
        paragraph(
            f"On {len(spoken.validation)} validation sentences. Errors in squared standard deviations; weighted: each "
            "coefficient by its variance, so by what it shows. Amplitude and jerk: synthesised over real."
        ),
        table(head, rows),
        chosen,
    )


def _chosen(tried: bool) -> str:
    return "chosen on the validation sentences, then learnt anew from everything" if tried else "the defaults"


def trajectories(learnt: Learnt) -> Markup:
    """Some validation sentences; nothing if there are none."""
    spoken = learnt.articulation
    if not spoken.validation:
        return Markup("")
    corpus, appearance, model = learnt.corpus, learnt.appearance, spoken.model
    everything = spoken_passages(corpus, appearance.coefficients, appearance.rest)
    flow_count = appearance.modes.flow_count
    places = [
        *range(min(FLOW_ROWS, flow_count)),
        *range(flow_count, min(flow_count + TEXTURE_ROWS, appearance.modes.count)),
    ]
    parts = []
    count = min(SENTENCES, len(spoken.validation))
    for at in np.linspace(0, len(spoken.validation) - 1, count).round().astype(int).tolist():
        number = spoken.validation[at]
        passage = corpus.passages[number]
        counted = corpus.good[passage.frames.start : passage.frames.stop, None]
        standard = (
            (rows - model.offset) / model.scale for rows in (everything[number].coefficients, spoken.predicted[at])
        )
        real, predicted = (rows.astype(np.float32) for rows in standard)
        real = np.where(counted, real, np.float32(np.nan))
        rows = [
            (
                f"flow {place + 1}" if place < flow_count else f"texture {place - flow_count + 1}",
                real[:, place], predicted[:, place],
            )
            for place in places
        ]  # fmt: skip
        parts += [
            element("h3", f"{corpus.takes[passage.take].name}, from {passage.first / FPS:.1f} s"),
            plot(plotted(rows, corpus.phones(passage)), "real and synthesised trajectories", long=True),
        ]
    return section(
        "Trajectories: real and synthesised",
        paragraph("In standard deviations of the recording; by the last model of the table, which had not seen them."),
        *parts,
    )


def phones(learnt: Learnt) -> Markup:
    """How often each phone was heard, and what stands in for those that were not."""
    states = learnt.articulation.model.states
    found, counts = heard(learnt.corpus, states), count_states(states)
    unheard = [each for each in found if not each.times]
    rare = [each.phone for each in found if each.rare]
    most = max((each.times for each in found), default=1) or 1
    rows = []
    for each in found:
        note: object = ""
        if not each.times:
            note = element("strong", f"never heard: shown as {' and '.join(each.instead) or 'learnt before'}")
        elif each.instead:
            note = element("strong", f"not learnt: shown as {' and '.join(each.instead)}")
        elif each.rare:
            note = element("strong", f"fewer than {FEW} times")
        bar = Markup(f'<meter min="0" max="{most}" value="{each.times}"></meter>')
        rows.append((each.phone, each.times, bar, " / ".join(map(str, each.contexts)), note))
    return section(
        "Phones",
        paragraph(
            f"{len(found) - len(unheard)} of {len(found)} phones were heard"
            + (f"; never: {', '.join(each.phone for each in unheard)}" if unheard else "")
            + (f"; fewer than {FEW} times: {', '.join(rare)}" if rare else "")
            + f". {counts.contexts} of {counts.possible} halves beside classes of neighbours were learnt; "
            "others are shown as the half whatever is beside it."
        ),
        table(("Phone", "Heard", "", "Contexts of its halves", ""), rows),
    )
