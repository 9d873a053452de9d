"""Quality of the picture against the recording: closed and open test, reconstruction, sharpness, lip closure."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from app.engine.avatar import Avatar, load_avatar
from app.engine.background import STILL
from app.engine.frame import empty
from app.engine.mmm import Conversion
from app.engine.modes import draw_crop
from app.engine.pack import FPS
from app.engine.training.em_pca import em_pca
from app.engine.training.train import Learnt, learn
from app.engine.training.workspace import Workspace
from app.engine.trajectory import Coefficients
from app.speech import SILENCE, Phone
from app.tts.narrate import narrate
from app.tts.registry import create
from bench.lips import inner_gap, lip_width
from bench.recorded import (
    ACTIVE,
    FOLDER,
    Recorded,
    crop_luma,
    crop_rgb,
    gradient_energy,
    in_box,
    psnr,
    recording,
    speech_frames,
    ssim,
)  # fmt: skip
from bench.report import Report

FOLDS = ((0, 5), (1, 6), (2, 7), (3, 8), (4, 9))
"""Sentences left out together in the open test; each sentence is left out once."""

CLOSURES = (
    "My mother baked a big pumpkin pie.",
    "Maybe Bob will bring up the problem in February.",
    "People from Boston spoke about the map for a while, Pam.",
    "A number of simple examples may help them remember.",
)


def run() -> list[Report]:
    """Closed and open test, reconstruction, closure."""
    source = recording()
    wanted = source.luma
    speaking = speech_frames(source)
    return [_speech(source, wanted, speaking), _reconstruction(source, wanted, speaking), _closure(source)]


def render_still(avatar: Avatar, coefficients: Coefficients) -> np.ndarray:
    """(T, h, w) luma of the crops rendered at the recording's rest pose."""
    manifest = avatar.manifest
    picture = empty(manifest.width, manifest.height)
    shown = []
    for row in coefficients:
        avatar.render(row, STILL, picture)
        shown.append(crop_luma(picture))
    return np.stack(shown)


def relearn(source: Recorded, folder: Path, leave_out: Collection[int] = ()) -> Learnt:
    """Learn the recording, some of its sentences left out, keeping finished steps in the folder."""
    return learn([source.take], Workspace(folder), leave_out=leave_out)


def _drawn(source: Recorded, learnt: Learnt, coefficients: Coefficients) -> np.ndarray:
    corpus = learnt.corpus
    return in_box(source.still, corpus.crop, draw_crop(learnt.appearance.modes, coefficients).luma, corpus.mask)


def _speech(source: Recorded, wanted: np.ndarray, speaking: np.ndarray) -> Report:
    report = Report("speech", "Rendered speech against the recorded frames (speech frames, active box, luma)")
    avatar = load_avatar(FOLDER)
    count = len(wanted)
    closed = render_still(avatar, avatar.trajectory(source.phones, count))
    opened = np.empty_like(wanted)
    spans = source.spans()
    with tempfile.TemporaryDirectory() as folder:
        for fold in FOLDS:
            learnt = relearn(source, Path(folder), fold)
            coefficients = learnt.articulation.model.predict(source.phones, count)
            for frame in (frame for sentence in fold for frame in spans[sentence]):
                opened[frame] = _drawn(source, learnt, coefficients[frame])
    rest = learn_rest(source, wanted)
    neutral = np.broadcast_to(rest, wanted.shape)
    report.add("closed test, PSNR", psnr(closed, wanted)[speaking].mean(), "dB", ">= 33")
    report.add("open test, PSNR", psnr(opened, wanted)[speaking].mean(), "dB", ">= 30.5", "sentences left out by twos")
    report.add("neutral mouth, PSNR", psnr(neutral, wanted)[speaking].mean(), "dB", note="baseline")
    report.add(
        "per-phone mean pictures, PSNR",
        psnr(_phone_means(source, wanted), wanted)[speaking].mean(),
        "dB",
        note="baseline",
    )
    report.add(
        "20 principal components, PSNR",
        psnr(_components(wanted), wanted)[speaking].mean(),
        "dB",
        note="true coefficients",
    )
    for name, shown in (("closed test", closed), ("open test", opened)):
        report.add(f"{name}, SSIM", ssim(shown[speaking], wanted[speaking]), "")
    widest = _widest(wanted, rest)
    report.add(
        "closed test, inner gradient energy",
        gradient_energy(closed[widest]) / gradient_energy(wanted[widest]),
        "of the recording",
    )
    report.add(
        "open test, inner gradient energy",
        gradient_energy(opened[widest]) / gradient_energy(wanted[widest]),
        "of the recording",
    )
    return report


def _reconstruction(source: Recorded, wanted: np.ndarray, speaking: np.ndarray) -> Report:
    report = Report("reconstruction", "Analysed frames drawn again (speech frames, active box, luma)")
    with tempfile.TemporaryDirectory() as folder:
        learnt = relearn(source, Path(folder))
    appearance = learnt.appearance
    convert = Conversion(appearance.morphable, appearance.modes)
    frames = np.flatnonzero(speaking)[::5]
    widest = np.flatnonzero(_widest(wanted, learn_rest(source, wanted)))[::3]

    def fast(numbers: np.ndarray) -> np.ndarray:
        return np.stack([_drawn(source, learnt, appearance.coefficients[n]) for n in numbers])

    def reference(numbers: np.ndarray) -> np.ndarray:
        morphs = (appearance.morphable.synthesise(*convert(appearance.coefficients[n])) for n in numbers)
        corpus = learnt.corpus
        return np.stack([in_box(source.still, corpus.crop, morph.luma, corpus.mask) for morph in morphs])

    quick, literal = psnr(fast(frames), wanted[frames]).mean(), psnr(reference(frames), wanted[frames]).mean()
    report.add("fast, PSNR", quick, "dB")
    report.add("reference, PSNR", literal, "dB")
    report.add("fast minus reference", quick - literal, "dB", ">= -0.3")
    energy = gradient_energy(fast(widest)), gradient_energy(reference(widest)), gradient_energy(wanted[widest])
    report.add("inner gradient energy, fast / reference", energy[0] / energy[1], "", ">= 0.9", "widest 20 % of frames")
    report.add("inner gradient energy, fast / recording", energy[0] / energy[2], "")
    report.add("inner gradient energy, reference / recording", energy[1] / energy[2], "")
    return report


def _closure(source: Recorded) -> Report:
    report = Report("closure", "Lip closure on /m b p/: inner-lip gap of rendered frames, of its maximum")
    avatar = load_avatar(FOLDER)
    picture = empty(avatar.manifest.width, avatar.manifest.height)

    def gaps(phones: tuple[Phone, ...], frames: int) -> np.ndarray:
        found = []
        for row in avatar.trajectory(phones, frames):
            avatar.render(row, STILL, picture)
            found.append(inner_gap(crop_rgb(picture)))
        return np.array(found)

    truth = np.array([inner_gap(rgb) for rgb in source.rgb])
    with np.load(FOLDER / "recording" / "weights.npz") as stored:
        controls = np.column_stack([stored["weights"], np.ones(len(truth))])
    fitted = controls @ np.linalg.lstsq(controls, truth, rcond=None)[0]
    explained = 1 - ((truth - fitted) ** 2).sum() / ((truth - truth.mean()) ** 2).sum()
    report.add(
        "gap explained by the ground-truth controls", explained, "R2", note="that the gap measures what it should"
    )
    shown = gaps(source.phones, len(truth))
    report.add(
        "gap of rendered and recorded frames", float(np.corrcoef(shown, truth)[0, 1]), "correlation", note="closed test"
    )
    wide = truth.max()
    engine = create("hibari")
    collected = list(_closed_shares(source.phones, shown, wide, avatar.pack.trajectory.lead))
    for text in CLOSURES:
        for speech in narrate(engine, text):
            frames = int(np.ceil(speech.duration * avatar.manifest.fps))
            collected += _closed_shares(speech.phones, gaps(speech.phones, frames), wide, avatar.pack.trajectory.lead)
    long = [gap for lasts, gap in collected if lasts >= 0.06]
    report.add(
        "closed, of those lasting 60 ms or more",
        100 * np.mean(np.array(long) <= 0.1),
        "%",
        ">= 95",
        f"{len(long)} phones, recording and new text",
    )
    report.add(
        "closed, of all", 100 * np.mean([gap <= 0.1 for _, gap in collected]), "%", note=f"{len(collected)} phones"
    )
    _shapes(report, avatar, source)
    rest = learn_rest(source, source.luma)
    silent = _deep_silence(source)
    moved = np.abs(render_still(avatar, avatar.trajectory(source.phones, len(truth))[silent]) - rest)
    report.add(
        "movement in silence", float(moved[:, ACTIVE[0], ACTIVE[1]].mean()), "levels", note="0.3 s and more from speech"
    )
    return report


def _shapes(report: Report, avatar: Avatar, source: Recorded) -> None:
    """Rounding on /uw ow w/ and teeth on /f v/: rendered beside recorded, in the middle of each phone."""
    picture = empty(avatar.manifest.width, avatar.manifest.height)
    spoken = avatar.trajectory(source.phones, len(source.luma))
    recorded = source.rgb
    lead = avatar.pack.trajectory.lead
    for name, symbols, measure in (
        ("lip width on /uw ow w/, of the width at rest", ("UW", "OW", "W"), lip_width),
        ("rows of teeth on /f v/", ("F", "V"), inner_gap),
    ):
        frames = [
            round(((phone.start + phone.end) / 2 - lead) * FPS) for phone in source.phones if phone.symbol in symbols
        ]
        unit = measure(recorded[0]) if measure is lip_width else 1
        shown = []
        for frame in frames:
            avatar.render(spoken[frame], STILL, picture)
            shown.append(measure(crop_rgb(picture)))
        true = np.mean([measure(recorded[frame]) for frame in frames]) / unit
        report.add(name, np.mean(shown) / unit, "", note=f"recorded {true:.3g}")


def _closed_shares(
    phones: tuple[Phone, ...], gap: np.ndarray, wide: float, lead: float
) -> Iterator[tuple[float, float]]:
    """(seconds, smallest gap in the frames that show it, as a share of the widest) of every /m b p/.

    A frame shows a phone if its middle lies in it, the lips being ahead of the sound by `lead` seconds; the nearest
    frame stands for a phone that holds no such middle.
    """
    times = np.arange(len(gap)) / FPS + lead
    for phone in phones:
        if phone.symbol in ("M", "B", "P"):
            shown = (times >= phone.start) & (times < phone.end)
            if not shown.any():
                shown[np.abs(times - (phone.start + phone.end) / 2).argmin()] = True
            yield phone.end - phone.start, gap[shown].min() / wide


def learn_rest(source: Recorded, wanted: np.ndarray) -> np.ndarray:
    """(h, w) mean recorded luma of deep silence."""
    rest: np.ndarray = wanted[_deep_silence(source)].mean(0)
    return rest


def _deep_silence(source: Recorded) -> np.ndarray:
    times = np.arange(len(source.luma)) / FPS
    near = np.zeros(len(times), bool)
    for phone in source.phones:
        if phone.symbol != SILENCE:
            near |= (times > phone.start - 0.3) & (times < phone.end + 0.3)
    return np.flatnonzero(~near)


def _widest(wanted: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(T,) the fifth of the frames that differ most from rest inside the mouth."""
    far = np.abs(wanted - rest)[:, 60:100, 60:118].mean((1, 2))
    chosen: np.ndarray = far >= np.percentile(far, 80)
    return chosen


def _phone_means(source: Recorded, wanted: np.ndarray) -> np.ndarray:
    label = np.empty(len(wanted), object)
    for frame in range(len(wanted)):
        time = min((frame + 0.5) / FPS, source.phones[-1].end - 1e-3)
        label[frame] = next(p.symbol for p in source.phones if p.start <= time < p.end)
    means = {symbol: wanted[label == symbol].mean(0) for symbol in set(label)}
    return np.stack([means[symbol] for symbol in label])


def _components(wanted: np.ndarray) -> np.ndarray:
    flat = wanted.reshape(len(wanted), -1)
    components = em_pca(lambda: iter([flat]), 20)
    restored: np.ndarray = components.restore(components.project(lambda: iter([flat]))).reshape(wanted.shape)
    return restored
