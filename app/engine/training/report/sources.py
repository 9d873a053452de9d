"""The first sections: what was learnt from, and what was not."""

from __future__ import annotations

from collections.abc import Sequence

from app.engine.pack import FPS, Pack
from app.engine.training.report.fallbacks import count_states
from app.engine.training.report.markup import Markup, element, listing, paragraph, section, table
from app.engine.training.report.rejections import Rejection, group, spans
from app.engine.training.train import Learnt

MOST_NAMED = 30
"""Clips that are named for one reason."""


def overview(learnt: Learnt, pack: Pack) -> Markup:
    """What was learnt, and from how much."""
    corpus, manifest, modes = learnt.corpus, pack.manifest, learnt.appearance.modes
    good, total = int(corpus.good.sum()), len(corpus.good)
    at_rest = int((corpus.good & corpus.rest).sum())
    refused = {refusal.take for refusal in corpus.refused if refusal.frame is None}
    states, crop = count_states(learnt.articulation.model.states), corpus.crop
    return section(
        "What was learnt from",
        listing(
            [
                ("Avatar", f"{manifest.title} ({manifest.id})"),
                ("Pictures", f"{manifest.width} x {manifest.height}, {manifest.fps:g} a second"),
                ("Clips", f"{len(corpus.takes)} used, {len(refused)} refused in training"),
                ("Time", f"{good / FPS:.1f} s of usable pictures of {total / FPS:.1f} s"),
                ("Usable", f"{good} of {total} pictures; {at_rest} show the mouth at rest"),
                ("Passages", f"{len(corpus.passages)}, of which {len(learnt.articulation.validation)} for validation"),
                ("Mouth crop", f"{crop.width} x {crop.height} pixels at ({crop.x}, {crop.y})"),
                ("Face", f"{corpus.layout.side:.0f} pixels"),
                ("Prototypes", len(learnt.appearance.prototypes)),
                ("Modes", f"{modes.flow_count} of flow, {len(modes.texture_modes)} of texture"),
                ("States", f"{states.halves} halves of phones, {states.contexts} contexts, {states.silences} silences"),
                ("Loop", f"{manifest.loop_frames} pictures, {manifest.loop_frames / FPS:.1f} s"),
            ]
        ),
    )  # fmt: skip


def rejected(learnt: Learnt, before: Sequence[tuple[str, str]]) -> Markup:
    """What nothing was learnt from, by reason, with those clips that training was not given."""
    corpus = learnt.corpus
    reasons = group(corpus.refused, before)
    left_out = int((~corpus.good).sum()) - sum(refusal.frame is not None for refusal in corpus.refused)
    if not reasons and left_out <= 0:
        return section("What was rejected", paragraph("Nothing."))
    rows = [(each.reason, _amount(each), _where(each)) for each in reasons]
    note = paragraph(f"{left_out} more pictures were left out on request.") if left_out > 0 else ""
    return section("What was rejected", table(("Reason", "How much", "Where"), rows, kind="wide") if rows else "", note)


def _amount(rejection: Rejection) -> str:
    whole, part = len(rejection.clips), rejection.pictures
    amounts = [f"{whole} {'clip' if whole == 1 else 'clips'}"] if whole else []
    return ", ".join([*amounts, f"{part} {'picture' if part == 1 else 'pictures'}"] if part else amounts)


def _where(rejection: Rejection) -> str:
    named = [*rejection.clips, *(f"{clip}: {spans(numbers)}" for clip, numbers in rejection.frames)]
    more = f"; and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    return "; ".join(named[:MOST_NAMED]) + more


def agreement(lines: Sequence[str]) -> Markup:
    """What was found about how text and sound agree; nothing if nothing was."""
    if not lines:
        return Markup("")
    return section("Text and sound", element("ul", *(element("li", line) for line in lines)))
