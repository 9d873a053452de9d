"""Speech to a finished file, as fast as the cores can (Fu 2011, section 4.2.2: the pool without deadlines)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.config import Settings
from app.engine.frame import Picture
from app.engine.pool import FrameJob, OrderedPool
from app.errors import NothingToSay
from app.speech import Speech
from app.stream.clock import FPS
from app.stream.encoder import AacEncoder, VideoEncoder
from app.stream.mux import Mp4File
from app.stream.pieces import pieces

if TYPE_CHECKING:
    from app.engine.avatar import Avatar


def render_file(
    avatar: Avatar,
    speeches: Iterable[Speech],
    settings: Settings,
    path: Path,
    pool: OrderedPool,
    *,
    loop_frame: Callable[[int], int] | None = None,
    on_frame: Callable[[int], None] = lambda _frames: None,
) -> int:
    """Write an MP4 (H.264, AAC 48 kHz) of the avatar speaking; blocks.

    Speech is taken piece by piece while the pieces before are drawn. The file is written beside its place and then
    moved there; on an error or an interruption nothing is left.

    Args:
        avatar: who speaks.
        speeches: they follow each other without a gap.
        settings: its `render` section.
        path: of the file.
        pool: draws the frames.
        loop_frame: the background of each frame; by default the loop runs from its start. `lambda _: 0` keeps still.
        on_frame: called on a worker with the number of frames encoded so far.

    Returns:
        Frames written.

    Raises:
        NothingToSay: there is no speech.
        OSError: the file cannot be written.
    """
    manifest = avatar.manifest
    background = loop_frame or (lambda frame: frame % manifest.loop_frames)
    frames = 0

    def draw(job: FrameJob) -> Picture:
        picture = np.empty((manifest.height * 3 // 2, manifest.width), np.uint8)
        avatar.render(job.payload, background(job.index), picture)
        return picture

    with (
        closing(
            VideoEncoder(
                manifest.width, manifest.height, FPS, preset=settings.render.preset, crf=settings.render.crf, live=False
            )
        ) as video,
        closing(AacEncoder()) as audio,
        Mp4File(path, video, audio) as file,
    ):

        def encode(job: FrameJob, picture: Picture) -> None:
            for packet in video.encode(picture, job.index):
                file.add(packet)
            on_frame(job.index + 1)

        lane = pool.open(draw, encode)
        try:
            for piece in pieces(avatar, speeches):
                if piece is None:
                    continue
                lane.submit(FrameJob(n, 0.0, row) for n, row in enumerate(piece.coefficients, frames))
                frames += len(piece.coefficients)
                for packet in audio.encode(piece.samples, piece.sample):
                    file.add(packet)
            if not frames:
                raise NothingToSay("there is no speech to render", field="text")
            lane.finish()
            lane.wait()
            for packet in [*video.flush(), *audio.flush()]:
                file.add(packet)
        finally:
            lane.close()
            with suppress(Exception):  # what failed is being raised already
                lane.wait()  # then nothing writes to the file any more
    return frames
