"""Two takes of Mary, small and short, her head swaying a little."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from app.engine.frame import from_rgb
from app.engine.training.take import Take
from app.speech import SILENCE, Phone

MARY = Path(__file__).resolve().parents[3] / "avatars" / "mary"
SIZE = 256
CUTS = (0, 285, 573)
"""Frames at which the takes begin and end: in the middle of silences; 23 s in all."""
FPS = 25


def pictures(first: int, stop: int) -> list[NDArray[np.uint8]]:
    """Whole frames, I420."""
    found = []
    with av.open(str(MARY / "recording" / "recording.mp4")) as container:
        for number, frame in enumerate(container.decode(video=0)):
            if number == stop:
                break
            if number < first:
                continue
            turn = 2 * np.pi * number / 60
            pose = np.array([[0.5, 0, 1.5 * np.sin(turn)], [0, 0.5, 0.6 * np.sin(2 * turn)]])
            blurred = cv2.GaussianBlur(frame.to_ndarray(format="rgb24"), (0, 0), 0.7)
            small = cv2.warpAffine(blurred, pose, (SIZE, SIZE), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            found.append(from_rgb(small.astype(np.uint8)))
    return found


def write_video(path: Path, shown: list[NDArray[np.uint8]]) -> None:
    """H.264, as cameras write it."""
    with av.open(str(path), "w") as output:
        stream = output.add_stream("libx264", rate=FPS, options={"crf": "10", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = shown[0].shape[1], shown[0].shape[0] * 2 // 3, "yuv420p"
        stream.codec_context.colorspace, stream.codec_context.color_range = 1, 1
        for picture in shown:
            frame = av.VideoFrame.from_ndarray(picture, format="yuv420p")
            frame.colorspace, frame.color_range = 1, 1
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))


def said(path: Path) -> list[Phone]:
    """The tier of phones of a TextGrid."""
    tier = path.read_text(encoding="utf-8").partition('name = "phones"')[2]
    found = re.findall(r'intervals \[\d+\]:\s+xmin = (\S+)\s+xmax = (\S+)\s+text = "([^"]*)"', tier)
    return [Phone(symbol.strip("012") or SILENCE, float(start), float(end)) for start, end, symbol in found]


def marys_takes(folder: Path) -> list[Take]:
    """Written into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    phones = said(MARY / "recording" / "recording.TextGrid")
    takes = []
    for number, (first, stop) in enumerate(pairwise(CUTS)):
        start, end = first / FPS, stop / FPS
        inside = tuple(
            Phone(phone.symbol, round(max(phone.start, start) - start, 4), round(min(phone.end, end) - start, 4))
            for phone in phones
            if phone.end > start and phone.start < end
        )
        video = folder / f"mary{number}.mkv"
        write_video(video, pictures(first, stop))
        takes.append(Take(f"mary{number}", video, inside))
    return takes
