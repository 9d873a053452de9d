"""The samples that the selection renderer shows: mouths of the recording, kept in a pack as `models/selection.npz`.

Pictures lie in it as an H.264 clip, for neighbours in the recording differ little; the numbers of each are beside it.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from app.engine.models.model_file import read_file, save_file
from app.engine.stored_arrays import MOST_BYTES, StoredArrays
from app.errors import BadPack

Float = NDArray[np.float32]

NAME, VERSION = "selection", 1
AGAIN = "Train the avatar again: mary train … --models selection"


@dataclass(frozen=True)
class SampleLibrary:
    """Mouths of one recording, in the order in which they were recorded.

    Attributes:
        width, height: of the crop.
        pictures: (S, P) uint8 crops, planes flattened, stitched into the picture at rest: outside of the mouth mask
            they are the pack's still.
        rows: (S, K) mode coefficients of each, the passage's own mouth at rest moved to the common one. No two alike.
        follows: (S,) whether each was recorded right after the one before it.
        lips: (K, E): differences of mode coefficients times these are differences of eigen-lips, to first order, in
            units of their spread in the recording.
        window: first and last row, first and last column (last ones excluded) that are compared where samples join.
    """

    width: int
    height: int
    pictures: NDArray[np.uint8]
    rows: Float
    follows: NDArray[np.bool_]
    lips: Float
    window: tuple[int, int, int, int]

    def __len__(self) -> int:
        return len(self.rows)


def save_library(path: Path, library: SampleLibrary, clip: bytes, *, modes: str) -> None:
    """Write a library.

    Args:
        path: of the file; its folder is made.
        library: whose numbers are stored.
        clip: its pictures, encoded.
        modes: SHA-256 of the pack's `model.npz`.
    """
    arrays: dict[str, NDArray[Any]] = {
        "clip": np.frombuffer(clip, np.uint8),
        "size": np.array([library.width, library.height]),
        "rows": library.rows,
        "follows": library.follows.astype(np.uint8),
        "lips": library.lips,
        "window": np.array(library.window),
    }
    save_file(path, NAME, VERSION, arrays, modes=modes)


def load_library(path: Path, *, modes: str, count: int, size: tuple[int, int]) -> SampleLibrary:
    """Read a library.

    Args:
        path: of the file.
        modes: SHA-256 of the pack's `model.npz`.
        count: K of the pack's modes.
        size: (width, height) of the pack's crop.

    Raises:
        BadPack: it is damaged, of another version, or of another pack.
    """
    stored = read_file(path, NAME, VERSION, modes=modes, advice=AGAIN)
    try:
        return _library(stored, count, size)
    except KeyError as error:
        raise BadPack(f"{path} lacks {error}", advice=AGAIN) from error


def _library(stored: StoredArrays, count: int, size: tuple[int, int]) -> SampleLibrary:
    width, height = (int(side) for side in stored.numbers("size", (2,)))
    if (width, height) != size:
        raise BadPack(
            f"{stored.where}: samples are {width}x{height}, the pack's crop {size[0]}x{size[1]}", advice=AGAIN
        )
    rows = stored.numbers("rows", (-1, count))
    follows = stored.numbers("follows", (len(rows),)) > 0
    lips = stored.numbers("lips", (count, -1))
    top, bottom, left, right = (int(edge) for edge in stored.numbers("window", (4,)))
    if not (0 <= top < bottom <= height and 0 <= left < right <= width):
        raise BadPack(f"{stored.where}: the window {top, bottom, left, right} is none of {width}x{height}")
    if not len(rows) or follows[0] or len(np.unique(rows, axis=0)) != len(rows):
        raise BadPack(f"{stored.where} has no samples, or two of the same coefficients", advice=AGAIN)
    clip = stored.arrays["clip"]
    if clip.dtype != np.uint8 or clip.ndim != 1:
        raise BadPack(f"{stored.where}: clip holds {clip.dtype} of shape {clip.shape}, expected bytes")
    pictures = _decoded(clip.tobytes(), len(rows), width, height, stored.where)
    return SampleLibrary(width, height, pictures, rows, follows, lips, (top, bottom, left, right))


def _decoded(clip: bytes, count: int, width: int, height: int, where: str) -> NDArray[np.uint8]:
    """(count, P) the pictures of a clip."""
    shape = (count, width * height * 3 // 2)
    if shape[0] * shape[1] > MOST_BYTES:
        raise BadPack(f"{where}: the samples unpack to {shape[0] * shape[1]} bytes, more than {MOST_BYTES}")
    pictures = np.empty(shape, np.uint8)
    found = 0
    try:
        with av.open(io.BytesIO(clip), "r", format="matroska") as container:
            stream = container.streams.video[0]
            stream.thread_count = 1
            for frame in container.decode(stream):
                if found == count or (frame.format.name, frame.width, frame.height) != ("yuv420p", width, height):
                    raise BadPack(f"{where}: the clip has more pictures than samples, or others", advice=AGAIN)
                pictures[found] = frame.to_ndarray().reshape(-1)
                found += 1
    except (OSError, IndexError, av.FFmpegError) as error:
        raise BadPack(f"{where}: the clip cannot be decoded: {error}", advice=AGAIN) from error
    if found != count:
        raise BadPack(f"{where}: the clip has {found} pictures, expected {count}", advice=AGAIN)
    return pictures
