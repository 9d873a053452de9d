"""A recording of nobody: an ellipse of a mouth that opens and closes with its phones."""

from __future__ import annotations

import json
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from app.speech import Phone

FPS = 25
WIDTH, HEIGHT = 96, 80
CROP = (16, 16, 64, 48)
LOOP_SHIFTS = ((0.0, 0.0), (1.0, 0.0), (2.0, -1.0), (0.5, 0.75))
"""Where each loop frame's pixels are in the still."""

OPENING = {"AA": 1.0, "EH": 0.6, "M": 0.0, "P": 0.0, "SIL": 0.05}
SENTENCES = (
    ("mama", (("SIL", 0.4), ("M", 0.12), ("AA", 0.2), ("M", 0.08), ("AA", 0.2), ("SIL", 0.24))),
    ("papa", (("SIL", 0.24), ("P", 0.1), ("AA", 0.22), ("P", 0.1), ("EH", 0.18), ("SIL", 0.24))),
    ("mehmeh", (("SIL", 0.24), ("M", 0.1), ("EH", 0.16), ("M", 0.1), ("EH", 0.2), ("SIL", 0.4))),
)


def timed() -> tuple[list[Phone], list[dict[str, object]]]:
    phones: list[Phone] = []
    transcript: list[dict[str, object]] = []
    now = 0.0
    for text, spoken in SENTENCES:
        start = now + spoken[0][1]
        for symbol, length in spoken:
            if phones and phones[-1].symbol == symbol == "SIL":
                phones[-1] = Phone(symbol, phones[-1].start, now + length)
            else:
                phones.append(Phone(symbol, now, now + length))
            now += length
        transcript.append({"text": text, "start": round(start, 4), "end": round(now - spoken[-1][1], 4)})
    return [Phone(p.symbol, round(p.start, 4), round(p.end, 4)) for p in phones], transcript


def openings(phones: list[Phone]) -> NDArray[np.float64]:
    """How far the mouth is open in every frame, 0 to 1; the lips are 50 ms ahead of the sound."""
    fine = 8  # steps a frame
    times = np.arange(round(phones[-1].end * FPS) * fine) / (FPS * fine) + 0.05
    target = np.array([OPENING[next((p.symbol for p in phones if t < p.end), "SIL")] for t in times])
    window = np.hanning(2 * fine + 1)
    smooth = np.convolve(np.pad(target, fine, mode="edge"), window / window.sum(), mode="valid")
    return smooth[::fine]


def picture(opening: float, shift: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.uint8]:
    """The whole frame, RGB: skin with a soft pattern, lips, and the dark with a row of teeth between them."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    x, y = x + shift[0], y + shift[1]
    pattern = 10 * np.sin(x / 3.1) * np.cos(y / 2.7) + 6 * np.sin(x / 1.9 + y / 2.3)
    skin = np.stack([190 + pattern, 140 + pattern, 115 + pattern], -1)
    across, down = (x - 48) / 18, (y - 40) / (3 + 9 * opening)
    lips = np.clip((1.0 - (across**2 + down**2)) * 4 + 0.5, 0, 1)[..., None]
    inner_down = (y - 40) / (0.4 + 9 * opening)
    inside = np.clip((0.8 - ((x - 48) / 16) ** 2 - inner_down**2) * 3 + 0.5, 0, 1)[..., None] * min(1, opening * 4)
    teeth = np.clip(2 - np.abs(y - 40 + 6 * opening), 0, 1)[..., None]
    mouth = np.array([50, 15, 15]) * (1 - teeth) + np.array([225, 220, 205]) * teeth
    drawn = skin * (1 - lips) + np.array([170, 70, 75]) * lips
    drawn = drawn * (1 - inside) + mouth * inside
    return np.rint(np.clip(drawn, 0, 255)).astype(np.uint8)


def crop_of(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    x, y, width, height = CROP
    return rgb[y : y + height, x : x + width]


def write_png(path: Path, rgb: NDArray[np.uint8]) -> None:
    assert cv2.imwrite(str(path), np.ascontiguousarray(rgb[..., ::-1]))


def write_lossless(path: Path, frames: list[NDArray[np.uint8]]) -> None:
    with av.open(str(path), "w") as output:
        stream = output.add_stream("ffv1", rate=FPS)
        stream.height, stream.width, stream.pix_fmt = frames[0].shape[0], frames[0].shape[1], "bgr0"
        for rgb in frames:
            output.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format="bgr0")))
        output.mux(stream.encode(None))


def write_recording(folder: Path) -> Path:
    random = np.random.default_rng(0)
    phones, transcript = timed()
    (folder / "recording" / "mouth").mkdir(parents=True)
    (folder / "idle").mkdir()
    for number, opening in enumerate(openings(phones)):
        noisy = crop_of(picture(float(opening))) + random.normal(0, 1, (CROP[3], CROP[2], 3))
        write_png(
            folder / "recording" / "mouth" / f"{number:05d}.png", np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        )
    write_png(folder / "recording" / "still.png", picture(OPENING["SIL"]))
    x, y, w, h = CROP
    box = {"x": x, "y": y, "w": w, "h": h, "fps": FPS, "frame": [WIDTH, HEIGHT]}
    (folder / "recording" / "box.json").write_text(json.dumps(box))
    (folder / "recording" / "phones.json").write_text(json.dumps([[p.symbol, p.start, p.end] for p in phones]))
    (folder / "recording" / "transcript.json").write_text(json.dumps(transcript))
    write_lossless(folder / "idle" / "frames.mkv", [picture(OPENING["SIL"], shift) for shift in LOOP_SHIFTS])
    warp = np.broadcast_to(
        np.array(LOOP_SHIFTS, np.float32)[:, None, None], (len(LOOP_SHIFTS), HEIGHT // 4, WIDTH // 4, 2)
    )
    np.savez(folder / "idle" / "warp.npz", warp=warp, step=4)
    identity = {
        "id": "nobody", "title": "Nobody", "voice": "mock", "licence": "CC0-1.0", "provenance": "drawn by a test",
        "consent": {"subject": "nobody", "statement": "an ellipse"},
    }  # fmt: skip
    (folder / "avatar.json").write_text(json.dumps(identity))
    return folder
