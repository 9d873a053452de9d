"""The sections that show pictures: the film, how still the head is held, mouths, and the loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.engine.pack import FPS, Pack
from app.engine.training.report.likeness import (
    AMPLIFIED,
    DEVIATIONS,
    ShownMode,
    colour_wheel,
    flow_colours,
    largest_motion,
    shown_difference,
    shown_modes,
)
from app.engine.training.report.likeness import prototypes as shown_prototypes
from app.engine.training.report.loop_seams import loop_parts, seam_pictures, steps
from app.engine.training.report.markup import (
    Markup,
    element,
    figure,
    image,
    jpeg_uri,
    listing,
    paragraph,
    plot,
    section,
    table,
)
from app.engine.training.report.motion import NO_VALIDATION
from app.engine.training.report.plots import histograms, loop_steps
from app.engine.training.report.steadiness import head_motion, nose_motion
from app.engine.training.train import Learnt

WORST = 6
"""Prototypes that are shown beside their drawings."""


def film(clips: Sequence[str], address: str, problem: str = "") -> Markup:
    """The side-by-side film of some clips, at its address; why there is none if there are no clips."""
    if not clips:
        return section("Real and synthesised", paragraph(problem or NO_VALIDATION))
    names = ", ".join(dict.fromkeys(clips))
    return section(
        "Real and synthesised",
        Markup(f'<video controls playsinline preload="metadata" src="{address}"></video>'),
        paragraph(
            "Validation sentences. Left: as recorded. Right: the same pictures with the mouth that the model predicts "
            "from the phones; the trajectory model that predicted it had not seen these sentences. Mouth shapes "
            "themselves were learnt from all of the recording. "
            f"Clips: {names}."
        ),
    )


def steadiness(learnt: Learnt) -> Markup:
    """How well the head is held still."""
    corpus = learnt.corpus
    residual = corpus.residual[corpus.good & np.isfinite(corpus.residual)]
    head, nose = head_motion(corpus), nose_motion(corpus)
    facts: list[tuple[object, object]] = [
        ("Tracker residual", _distribution(residual, "luma levels")),
        ("Head moves", f"{head.shift:.1f} px from its mean place in the clip (95th percentile)"),
        ("Head speed", f"{head.between:.2f} px a picture (95th percentile)"),
        ("Head turns", f"{head.turn:.2f} degrees from its mean (95th percentile)"),
        ("Head grows", f"{100 * head.growth:.1f} % from its mean size (95th percentile)"),
    ]  # fmt: skip
    plots = [
        plot(
            histograms([("", residual)], "tracker residual, luma levels", most=_top(residual)),
            "Residual of the tracker",
        )
    ]
    if nose is None:
        facts.append(("Nostrils", "no clip has enough unbroken pictures to measure them in"))
    else:
        facts += [
            ("Nostrils before", f"{_distribution(nose.before, 'px')} (as recorded, {len(nose.before)} pictures)"),
            ("Nostrils after", f"{_distribution(nose.after, 'px')} (stabilised)"),
        ]
        both = [("as recorded", nose.before), ("stabilised", nose.after)]
        most = _top(np.concatenate([nose.before, nose.after]))
        plots.append(plot(histograms(both, "nostrils off their mean place, px", most=most), "Motion of the nostrils"))
    note = (
        "What is left of the nostrils' motion is the tracker's error, or the face's own motion: noses move with lips."
    )
    return section("Stabilisation", listing(facts), *plots, paragraph(note) if nose else "")


def _top(values: NDArray[np.floating]) -> float:
    return max(1e-3, float(np.percentile(values, 99.5)) * 1.1) if len(values) else 1.0


def _distribution(values: NDArray[np.floating], unit: str) -> str:
    if not len(values):
        return "none"
    middle, high = np.percentile(values, (50, 95))
    return f"median {middle:.2f} {unit}, 95th percentile {high:.2f}, most {values.max():.2f}"


def prototypes(learnt: Learnt) -> Markup:
    """All prototypes, their flows, and those that the model draws worst."""
    found = shown_prototypes(learnt)
    mask = learnt.corpus.mask[..., None]
    largest = largest_motion(learnt.appearance.morphable.flows * mask)
    cells, flows = [], []
    for each in found:
        caption = (f"{each.clip} {each.frame}", Markup("<br>"), f"{each.likeness:.1f} dB")
        kind, note = ("mouth reference", " (reference)") if each.reference else ("mouth", "")
        name = f"prototype, picture {each.frame} of {each.clip}"
        cells.append(figure(image(jpeg_uri(each.mouth), name), *caption, note, kind=kind))
        flows.append(
            figure(image(jpeg_uri(flow_colours(each.flow * mask, largest)), f"flow to {name}"), caption[0], kind=kind)
        )
    likeness = np.array([each.likeness for each in found])
    worst = sorted(found, key=lambda each: each.likeness)[:WORST]
    compared = (
        (
            f"{each.clip} {each.frame}", f"{each.likeness:.1f} dB",
            image(jpeg_uri(each.mouth), "recorded", kind="small"),
            image(jpeg_uri(each.drawn), "drawn", kind="small"),
            image(jpeg_uri(shown_difference(each.difference)), "difference", kind="small"),
        )
        for each in worst
    )  # fmt: skip
    return section(
        "Prototypes",
        paragraph(
            f"The {len(found)} mouths nearest to the centres of the clusters of all mouths (Fu 2011, figure 3-2), each "
            "with how like it the model's drawing is at the coefficients that it was analysed to (peak signal-to-noise "
            f"ratio around the lips): mean {likeness.mean():.1f} dB, least {likeness.min():.1f} dB."
        ),
        element("div", *cells, kind="grid"),
        element("h3", "Flows from the reference"),
        paragraph(
            image(jpeg_uri(colour_wheel()), "colours of the directions", kind="wheel"),
            f" Hue: where a point goes; full colour: {largest:.1f} px and more. Within the mask.",
        ),
        element("div", *flows, kind="grid"),
        element("h3", "Those that the model draws worst"),
        table(("Prototype", "Likeness", "Recorded", "Drawn", f"Difference x {AMPLIFIED:g}"), compared),
    )


def modes(learnt: Learnt) -> Markup:
    """What the first modes of flow and of texture do to the mean mouth."""
    shown = shown_modes(learnt.appearance.modes, learnt.appearance.coefficients[learnt.corpus.good])
    mean = image(jpeg_uri(shown.mean), "mean mouth", kind="small")
    return section("Modes", _ends("Flow mode", shown.flow, mean), _ends("Texture mode", shown.texture, mean))


def _ends(kind: str, some: Sequence[ShownMode], mean: Markup) -> Markup:
    """Modes in columns: their low ends, the mean, their high ends, and their share of the variance."""

    def pictures(side: str) -> list[Markup]:
        chosen = (each.low if side == "low" else each.high for each in some)
        return [image(jpeg_uri(rgb), f"{kind} {at}, {side}", kind="small") for at, rgb in enumerate(chosen, 1)]

    return table(
        (kind, *range(1, len(some) + 1)),
        [
            (f"-{DEVIATIONS:g} deviations", *pictures("low")),
            ("mean", *[mean] * len(some)),
            (f"+{DEVIATIONS:g} deviations", *pictures("high")),
            ("variance", *(f"{100 * each.share:.1f} %" for each in some)),
        ],
    )


def loop(learnt: Learnt, pack: Pack) -> Markup:
    """What the loop is joined from, and its seams."""
    background = pack.background
    parts, differences = loop_parts(learnt.corpus, background), steps(background)
    usual = float(np.median(differences))
    plotted = plot(
        loop_steps(differences, [part.until % background.frames for part in parts]),
        "differences in the loop",
        long=True,
    )
    if not parts:
        wrap = f"From the last picture to the first: {differences[-1]:.2f} luma levels; usual: {usual:.2f}."
        return section("Background loop", paragraph("It was given. ", wrap), plotted, _seam(background.frames, pack))
    rows = [
        (number, part.clip, f"{part.first} to {part.last}", f"{(part.last - part.first + 1) / FPS:.1f} s")
        for number, part in enumerate(parts, 1)
    ]
    seams = []
    for part, after in zip(parts, [*parts[1:], parts[0]], strict=True):
        worst = float(np.take(differences, range(part.until - 9, part.until + 1), mode="wrap").max())
        seams += [
            element("h3", f"From {part.clip} to {after.clip}"),
            paragraph(
                f"Largest difference between two pictures: {worst:.2f} luma levels; usual in the loop: {usual:.2f}."
            ),
            _seam(part.until, pack),
        ]
    return section("Background loop", table(("", "Clip", "Pictures", "Length"), rows), plotted, *seams)


def _seam(until: int, pack: Pack) -> Markup:
    shown = seam_pictures(pack.background, until)
    return element("div", *(figure(image(jpeg_uri(rgb), f"loop {place}"), place) for place, rgb in shown), kind="seam")
