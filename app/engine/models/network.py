"""Our own trajectory model: small convolutional networks that read phones, sound, or both.

One ensemble for each of them. From phones and sound, what is said is the mean of what the ensemble that reads only
phones and the one that reads both say; the sound counts only if it is the talker's own voice (of another, synthetic
ones for example, the networks know nothing). From sound alone speaks the ensemble that reads only sound.

Networks need minutes of speech. Of less, Gaussians (`app.engine.trajectory`) make more, so what is said from phones is
a mixture of both, in the shares that are best on sentences left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from app.engine.models.gaussian import load_gaussian
from app.engine.models.labels import frame_phones
from app.engine.models.model import Input, Spoken
from app.engine.models.network_features import (
    PHONE_FEATURES,
    SOUND_FEATURES,
    Hearing,
    learn_hearing,
    phone_features,
)
from app.engine.models.network_layers import PAST
from app.engine.models.network_onnx import INPUT, session, to_onnx
from app.engine.models.network_pictures import learn_pictures
from app.engine.models.network_training import Options, best_share, lessons, train, unstandardised
from app.engine.models.sound import Sound
from app.engine.modes import Modes
from app.engine.stored_arrays import StoredArrays
from app.engine.trajectory import GaussianTrajectory
from app.errors import BadPack, TrainingFailed
from app.speech import PHONES, SILENCE, Phone

Float = NDArray[np.float32]

FEATURES = {"phones": PHONE_FEATURES, "sound": SOUND_FEATURES, "both": PHONE_FEATURES + SOUND_FEATURES}
"""Ensembles, and how many features each of them reads."""
AT_REST = (0.7, 1.2)
"""Seconds from speech from which on the mouth comes to rest, and at which it is."""
AROUND = 8
"""Frames."""
GAUSSIAN = "gaussian_"
"""Of the names of the Gaussians' arrays."""
JOIN_FRAMES = 4
"""Frames within which what the frames before differ by is made up for."""


@dataclass(frozen=True)
class NetworkTrajectory:
    """Networks of one talker.

    Attributes:
        networks: ensembles by what they read (`FEATURES`), as ONNX; "phones" always, the others if there was sound.
        phones: that were seen in training, and silence.
        rest: (K,) the mouth at rest.
        fps: frames a second.
        hearing: how the recording sounds; None if there was no sound.
        gaussian: Gaussians of the same talker.
        share: of them in what is said from phones, 0 to 1.
    """

    networks: dict[str, bytes]
    phones: tuple[str, ...]
    rest: Float
    fps: float
    hearing: Hearing | None
    gaussian: GaussianTrajectory
    share: float

    name = "network"

    @property
    def inputs(self) -> frozenset[Input]:
        """What it can speak from."""
        return frozenset({"phones", "sound"} if self.hearing is not None else {"phones"})

    def predict(
        self, phones: Sequence[Phone], frames: int, *, before: Float | None = None, sound: Sound | None = None
    ) -> Float:
        """See `app.engine.models.model.TrajectoryModel`."""
        if frames <= 0:
            return np.zeros((0, len(self.rest)), np.float32)
        known = 0 if before is None else min(len(before), 2)
        rows = self._said(phones, -known, frames + known, sound)
        if before is not None and known:
            rows = continued(rows[known:], before[-known:] - rows[:known])
        return np.ascontiguousarray(rows, np.float32)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """See `app.engine.models.model.TrajectoryModel`."""
        arrays: dict[str, NDArray[Any]] = {
            "phones": np.array(self.phones), "rest": self.rest, "fps": np.array([self.fps]),
            "share": np.array([self.share]),
        }  # fmt: skip
        arrays |= {GAUSSIAN + name: array for name, array in self.gaussian.to_arrays().items()}
        arrays |= {f"network_{reads}": np.frombuffer(model, np.uint8) for reads, model in self.networks.items()}
        if self.hearing is not None:
            names = ("mean", "deviation", "quiet", "voice", "spread")
            arrays["hearing"] = np.stack([getattr(self.hearing, name) for name in names])
            arrays["hearing_limit"] = np.array([self.hearing.limit])
        return arrays

    def _said(self, phones: Sequence[Phone], first: int, count: int, sound: Sound | None) -> Float:
        """(count, K) from frame number `first` on, as if nothing had been said before."""
        read: dict[str, Float] = {}
        if phones or sound is None or self.hearing is None:
            read["phones"] = phone_features(phones, first - PAST, count + PAST, self.fps, self.phones)
            if self.hearing is not None and sound is not None and self.hearing.knows(sound, (first + count) / self.fps):
                heard = self.hearing.features(sound, first - PAST, count + PAST, self.fps)
                read["both"] = np.concatenate([read["phones"], heard], 1)
        else:
            read["sound"] = self.hearing.features(sound, first - PAST, count + PAST, self.fps)
        rows: Float = np.mean([self._run(reads, features) for reads, features in read.items()], 0)
        if "sound" not in read:
            if self.share:
                rows = rows + np.float32(self.share) * (around(self.gaussian, phones, first, count) - rows)
            rows = self.rest + awake(phones, first, count, self.fps)[:, None] * (rows - self.rest)
        return rows

    def _run(self, reads: str, features: Float) -> Float:
        rows: Float = np.asarray(self._sessions[reads].run(None, {INPUT: features})[0][PAST:], np.float32)
        return rows

    @cached_property
    def _sessions(self) -> dict[str, onnxruntime.InferenceSession]:
        """Ready to run; several threads may run one at once."""
        return {reads: session(model) for reads, model in self.networks.items()}


def around(model: GaussianTrajectory, phones: Sequence[Phone], first: int, count: int) -> Float:
    """(count, K) that Gaussians say from frame number `first` on, so that pieces are near the whole.

    They are asked for `AROUND` frames more on both sides, which is as far as what they say depends on.
    """
    start = first - AROUND
    later = [Phone(each.symbol, each.start - start / model.fps, each.end - start / model.fps) for each in phones]
    return model.predict(later, count + 2 * AROUND)[AROUND : AROUND + count]


def awake(phones: Sequence[Phone], first: int, count: int, fps: float) -> Float:
    """(count,) 1 in speech and near it, 0 in long silence, where the mouth is exactly at rest."""
    now = np.arange(first, first + count) / fps
    speech = [phone for phone in phones if phone.symbol != SILENCE]
    if not speech:
        return np.zeros(count, np.float32)
    starts, ends = (np.array([getattr(phone, side) for phone in speech], np.float64) for side in ("start", "end"))
    if phones[0].symbol != SILENCE:
        starts[0] = -np.inf
    if phones[-1].symbol != SILENCE:
        ends[-1] = np.inf
    away = np.maximum(np.maximum(starts - now[:, None], now[:, None] - ends), 0).min(1)
    gone = np.clip((away - AT_REST[0]) / (AT_REST[1] - AT_REST[0]), 0, 1)
    return np.asarray(1 - gone**2 * (3 - 2 * gone), np.float32)


def continued(rows: Float, missed: Float) -> Float:
    """Rows that begin where the frames before them ended.

    Args:
        rows: (T, K) as if nothing had been before.
        missed: (1 or 2, K) what the frames before had more than what would have been said there.

    Returns:
        (T, K): with a cubic added that begins with that difference, and its speed if that makes it less, and ends in
            `JOIN_FRAMES`; it does not overshoot (Fritsch and Carlson 1980).
    """
    span = JOIN_FRAMES + 1
    t = (np.arange(1, span, dtype=np.float32) / span)[: len(rows), None]
    start = missed[-1]
    speed = (missed[-1] - missed[0]) * span
    speed = np.where(speed * start < 0, np.clip(speed, -3 * np.abs(start), 3 * np.abs(start)), 0)  # never farther off
    joined = rows.copy()
    added: Float = (1 - t) ** 2 * ((1 + 2 * t) * start + t * speed)
    joined[: len(t)] += added
    return joined


class NetworkKind:
    """See `app.engine.models.model.SeeingKind`."""

    name = "network"
    version = 1
    hears = False
    least = 10.0
    sees = True

    def __init__(self, options: Options = Options()) -> None:  # noqa: B008 -- frozen
        self._options = options

    def fit(
        self, spoken: Sequence[Spoken], rest: Float, *, fps: float, seed: int, progress: Callable[[float], None],
        modes: Modes | None = None,
    ) -> NetworkTrajectory:  # fmt: skip
        """Every network of every ensemble, one after the other; on what is seen, if the modes are given."""
        options = self._options
        used = np.concatenate([each.coefficients[each.counted] for each in spoken]).astype(np.float64)
        standard = used.mean(0).astype(np.float32), np.maximum(used.std(0), 1e-6).astype(np.float32)
        labels = {symbol for each in spoken for symbol in frame_phones(each.phones, len(each.counted), fps)}
        trained = tuple(symbol for symbol in PHONES if symbol == SILENCE or symbol in labels)
        if trained == (SILENCE,):
            raise TrainingFailed("nothing is said in the pictures that can be learnt from")
        sounds = [each.sound for each in spoken if each.sound is not None]
        ends = [len(each.counted) / fps for each in spoken]
        hearing = learn_hearing(sounds, ends) if len(sounds) == len(spoken) else None
        kinds = FEATURES if hearing is not None else {"phones": PHONE_FEATURES}
        from app.engine.training.articulation import learn_articulation

        pictures = None if modes is None else learn_pictures(spoken, standard, modes, seed)
        articulation = learn_articulation(spoken, rest, seed=seed, progress=lambda part: progress(part / 5))
        share = best_share(articulation, spoken, standard, trained, fps, options, seed, pictures)
        networks = {}
        for place, reads in enumerate(kinds):
            given = lessons(
                spoken, standard, fps, trained, None if reads == "phones" else hearing, phones=reads != "sound"
            )
            loudness = (0, float(hearing.deviation[0])) if hearing is not None and reads == "sound" else None
            found = []
            for member in range(options.members):

                def told(part: float, done: int = place * options.members + member) -> None:
                    progress(0.25 + 0.75 * (done + part) / options.members / len(kinds))

                found.append(train(given, options, seed + member, pictures=pictures, loudness=loudness, progress=told))
            networks[reads] = to_onnx([unstandardised(each, standard) for each in found])
        progress(1.0)
        return NetworkTrajectory(
            networks, trained, np.asarray(rest, np.float32), fps, hearing, articulation.model, share
        )

    def load(self, stored: StoredArrays) -> NetworkTrajectory:
        """From `NetworkTrajectory.to_arrays`; the networks are run once."""
        phones = stored.names("phones")
        if SILENCE not in phones or not set(phones) <= set(PHONES) or len(phones) < 2:
            raise BadPack(f"{stored.where}: the phones are not ARPAbet with silence")
        rest, fps = stored.numbers("rest", (-1,)), float(stored.numbers("fps", (1,))[0])
        if not fps > 0:
            raise BadPack(f"{stored.where}: {fps} frames a second")
        hearing = None
        if "hearing" in stored.arrays:
            mean, deviation, quiet, voice, spread = stored.numbers("hearing", (5, 20))
            if not (deviation.min() > 0 and spread.min() > 0):
                raise BadPack(f"{stored.where}: the deviations of the sound are out of range")
            limit = float(stored.numbers("hearing_limit", (1,))[0])
            hearing = Hearing(mean, deviation, quiet, voice, spread, limit)
        networks = {}
        for reads in FEATURES if hearing is not None else ("phones",):
            stored_bytes = stored.arrays[f"network_{reads}"]
            if stored_bytes.dtype != np.uint8 or stored_bytes.ndim != 1:
                raise BadPack(f"{stored.where}: the network that reads {reads} is not a row of bytes")
            networks[reads] = stored_bytes.tobytes()
        of_gaussian = {
            name.removeprefix(GAUSSIAN): each for name, each in stored.arrays.items() if name.startswith(GAUSSIAN)
        }
        gaussian = load_gaussian(StoredArrays(stored.where, of_gaussian))
        share = float(stored.numbers("share", (1,))[0])
        if not 0 <= share <= 1 or gaussian.rest.shape != rest.shape or gaussian.fps != fps:
            raise BadPack(f"{stored.where}: the Gaussians do not go with the networks")
        model = NetworkTrajectory(networks, phones, rest, fps, hearing, gaussian, share)
        _try_out(model, stored.where)
        return model


def _try_out(model: NetworkTrajectory, where: str) -> None:
    """Raise `BadPack` unless every network runs and says finite coefficients of the right number."""
    try:
        for reads in model.networks:
            said = model._run(reads, np.zeros((PAST + 1, FEATURES[reads]), np.float32))
            if said.shape != (1, len(model.rest)) or not np.isfinite(said).all():
                raise ValueError(f"it says {said.shape}, finite: {np.isfinite(said).all()}")
    except Exception as error:  # onnxruntime's exceptions share no base
        raise BadPack(f"{where}: the network that reads {reads} cannot be used: {error}") from error
