"""Pieces of Mary's recording, cut without encoding them again."""

from __future__ import annotations

import shutil
from pathlib import Path

import av

RECORDING = Path(__file__).resolve().parents[3] / "avatars" / "mary" / "recording"


def cut(folder: Path, name: str, seconds: float) -> Path:
    """The beginning of the recording, with its transcript beside it."""
    path = folder / f"{name}.mp4"
    with av.open(str(RECORDING / "recording.mp4")) as source, av.open(str(path), "w") as target:
        streams = {stream.index: target.add_stream_from_template(stream) for stream in source.streams}
        for packet in source.demux():
            if packet.dts is not None and packet.pts * packet.time_base < seconds:
                packet.stream = streams[packet.stream.index]
                target.mux(packet)
    shutil.copy(RECORDING / "recording.TextGrid", path.with_suffix(".TextGrid"))
    return path
