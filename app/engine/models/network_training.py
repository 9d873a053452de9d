"""Training of networks: an ensemble each for what they may read, all on the same recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.engine.models.model import Spoken
from app.engine.models.network_features import Hearing, phone_features
from app.engine.models.network_layers import PAST, Adam, Weights, backward, forward, random_weights
from app.engine.models.network_pictures import Pictures
from app.engine.training.articulation import LEFT_OUT, Articulation

Float = NDArray[np.float32]

LONGEST = 100
"""Frames of a piece that is trained on at once; longer ones are cut, and read what is before the cut all the same."""
LOUDER = 4.0
"""dB by which sound is made louder or softer at random, at most."""
DECIBEL = np.log(10) / 10 * np.sqrt(40)
"""What one adds to the first cepstral coefficient: 40 filters, an orthonormal transform."""


@dataclass(frozen=True)
class Options:
    """How networks are trained.

    Attributes:
        hidden: units of each layer.
        members: networks whose mean is what is said: each errs in its own way.
        epochs: times that everything is seen.
        least_steps: of the optimiser; for short recordings there are more epochs.
        batch: pieces a step.
        rate: of Adam at first; falls to zero as a cosine.
        decay: of the weights.
        drop: share of units that are switched off in training.
        speed: how much errors of the speed count beside those of the place.
    """

    hidden: int = 128
    members: int = 3
    epochs: int = 40
    least_steps: int = 400
    batch: int = 16
    rate: float = 2e-3
    decay: float = 0.05
    drop: float = 0.2
    speed: float = 0.5


@dataclass(frozen=True)
class Lessons:
    """Pieces of a recording as they are trained on.

    Attributes:
        features: (N, PAST + T, F).
        wanted: (N, PAST + T, K) in standard deviations; zero where they do not count.
        counted: (N, PAST + T, 1) 1 where they do.
    """

    features: Float
    wanted: Float
    counted: Float


def features_of(
    spoken: Spoken, first: int, count: int, fps: float, trained: Sequence[str], hearing: Hearing | None, phones: bool
) -> Float:
    """(count, F) of some frames of a sentence: of its phones, its sound, or of the one beside the other."""
    found = [phone_features(spoken.phones, first, count, fps, trained)] if phones else []
    if hearing is not None:
        assert spoken.sound is not None
        found.append(hearing.features(spoken.sound, first, count, fps))
    return np.concatenate(found, 1)


def lessons(
    spoken: Sequence[Spoken], standard: tuple[Float, Float], fps: float, trained: Sequence[str],
    hearing: Hearing | None, *, phones: bool,
) -> Lessons:  # fmt: skip
    """Sentences cut into pieces of one length.

    Args:
        spoken: sentences.
        standard: (K,) mean and deviation of coefficients.
        fps: frames a second.
        trained: see `phone_features`.
        hearing: None if sound is not read.
        phones: whether phones are.
    """
    length = min(LONGEST, max(len(each.counted) for each in spoken))
    made = []
    for each in spoken:
        for first in range(0, len(each.counted), length):
            x = features_of(each, first - PAST, PAST + length, fps, trained, hearing, phones)
            rows = each.coefficients[first : first + length]
            valid = each.counted[first : first + length]
            wanted, counted = np.zeros((len(x), rows.shape[1])), np.zeros((len(x), 1))
            counted[PAST : PAST + len(rows), 0] = valid
            wanted[PAST : PAST + len(rows)][valid] = (rows[valid] - standard[0]) / standard[1]
            if valid.any():
                made.append((x, wanted, counted))
    return Lessons(*(np.stack(part).astype(np.float32) for part in zip(*made, strict=True)))


def error_and_slope(
    said: Float, wanted: Float, counted: Float, speed: float, importance: Float | None = None
) -> tuple[float, Float]:
    """Half the squared error of places and speeds, a frame, and its gradient in what was said.

    Args:
        said, wanted: (B, T, K).
        counted: (B, T, 1) 1 where they count.
        speed: how much errors of the speed count.
        importance: (K,) of the columns; all alike without it.
    """
    total = max(float(counted.sum()), 1.0)
    each = np.ones(said.shape[2], said.dtype) if importance is None else importance
    place = (said - wanted) * counted
    both = counted[:, 1:] * counted[:, :-1]
    pace = (np.diff(said, axis=1) - np.diff(wanted, axis=1)) * both
    slope = place.copy()
    slope[:, 1:] += np.float32(speed) * pace
    slope[:, :-1] -= np.float32(speed) * pace
    error = 0.5 * (float((place**2 @ each).sum()) + speed * float((pace**2 @ each).sum())) / total
    return error, slope * (each / np.float32(total))


def seen_error_and_slope(
    said: Float, wanted: Float, counted: Float, speed: float, pictures: Pictures | None
) -> tuple[float, Float]:
    """`error_and_slope`, half of it of what is seen (`network_pictures`) if that is known."""
    if pictures is None:
        return error_and_slope(said, wanted, counted, speed)
    own, slope = error_and_slope(said, wanted, counted, speed, np.asarray((1 + pictures.seen) / 2, np.float32))
    shape, count = said.shape[:2], said.shape[2]
    shown, first, second = pictures.components(said.reshape(-1, count))
    true = pictures.components(wanted.reshape(-1, count))[0].reshape(*shape, -1)
    error, outer = error_and_slope(shown.reshape(*shape, -1), true, counted, speed, pictures.importance)
    back = pictures.slope(outer.reshape(-1, outer.shape[2]), first, second)[0].reshape(*shape, count)
    return (own + error) / 2, np.asarray((slope + back) / 2, np.float32)


def train(
    given: Lessons, options: Options, seed: int, *, pictures: Pictures | None = None,
    loudness: tuple[int, float] | None = None, progress: Callable[[float], None] = lambda _: None,
) -> Weights:  # fmt: skip
    """One network.

    Args:
        given: what is learnt from.
        options: see `Options`.
        seed: of the weights, the order, and what is switched off.
        pictures: how errors look, if that is known.
        loudness: first of the features that are loudness (every 20th from there on), and the deviation that one of them
            stands for: sound is made louder and softer. None: it stays.
        progress: told the share done.
    """
    random = np.random.default_rng(seed)
    count = len(given.features)
    weights = random_weights(given.features.shape[2], options.hidden, given.wanted.shape[2], random)
    optimiser = Adam(weights, options.decay)
    a_round = -(-count // options.batch)
    rounds = max(options.epochs, -(-options.least_steps // a_round))
    for number in range(rounds):
        order = random.permutation(count)
        for step in range(a_round):
            chosen = order[step * options.batch : (step + 1) * options.batch]
            x = given.features[chosen]
            if loudness is not None:
                gain = random.uniform(-LOUDER, LOUDER, (len(chosen), 1, 1)) * DECIBEL / loudness[1]
                x[:, :, loudness[0] :: 20] += gain.astype(np.float32)
            done = forward(weights, x, drop=options.drop, random=random)
            _, slope = seen_error_and_slope(
                done.out, given.wanted[chosen], given.counted[chosen], options.speed, pictures
            )
            share = (number * a_round + step) / (rounds * a_round)
            rate = options.rate * 0.5 * (1 + np.cos(np.pi * share))
            optimiser.step(weights, backward(weights, done, slope), float(rate))
        progress((number + 1) / rounds)
    return weights


def unstandardised(weights: Weights, standard: tuple[Float, Float]) -> Weights:
    """The same network, saying coefficients as they are."""
    mean, deviation = standard
    return weights | {"w": weights["w"] * deviation, "b": weights["b"] * deviation + mean}


SHARES = tuple(number / 10 for number in range(11))
ALIKE = 0.01
"""Of the error: what is not worse by more is not worse, and the least such share is taken, for the networks that will
speak have heard more, and where there is sound they err less. Not of so few sentences that each is left out once."""
FEW_SHARE = 0.8
"""Share of the Gaussians where there are too few sentences to leave any out."""


def best_share(
    articulation: Articulation, spoken: Sequence[Spoken], standard: tuple[Float, Float], trained: Sequence[str],
    fps: float, options: Options, seed: int, pictures: Pictures | None,
) -> float:  # fmt: skip
    """The least share of the Gaussians, mixed with networks, that errs hardly more than the best, on unheard sentences.

    Args:
        articulation: the Gaussians, and what they say of sentences left out.
        spoken: what they were learnt from.
        standard, trained, fps: see `lessons`.
        options, seed, pictures: see `train`.
    """
    if not articulation.validation:
        return FEW_SHARE
    held = list(articulation.validation)
    said = dict(zip(held, articulation.predicted, strict=True))
    weight = np.ones_like(standard[1]) if pictures is None else (1 + pictures.seen) / 2
    errors = np.zeros(len(SHARES))
    for fold in folds(held, len(spoken)):
        learnt = [each for place, each in enumerate(spoken) if place not in fold]
        given = lessons(learnt, standard, fps, trained, None, phones=True)
        members = options.members if len(held) < len(spoken) else 1  # every sentence left out once is many networks
        networks = [train(given, options, seed + member, pictures=pictures) for member in range(members)]
        for place in fold:
            each = spoken[place]
            x = features_of(each, -PAST, PAST + len(each.counted), fps, trained, None, phones=True)
            own = np.mean([forward(weights, x[None]).out[0, PAST:] for weights in networks], 0)
            true, other = ((rows - standard[0]) / standard[1] for rows in (each.coefficients, said[place]))
            for at, share in enumerate(SHARES):
                error = (own + share * (other - own) - true)[each.counted]
                errors[at] += float((error**2 @ weight).sum())
    alike = ALIKE if len(held) < len(spoken) else 0.0
    return next(share for share, error in zip(SHARES, errors, strict=True) if error <= errors.min() * (1 + alike))


def folds(held: Sequence[int], count: int) -> list[list[int]]:
    """Sentences that are left out together: some of all, or, where every one is left out once, every so manyth."""
    if len(held) < count:
        return [list(held)]
    parts = min(LEFT_OUT, count)
    return [list(range(part, count, parts)) for part in range(parts)]
