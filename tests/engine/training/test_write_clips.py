from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace
from numpy.typing import NDArray

from app.engine.training.write_clips import BT709, write_idle, write_loop


@pytest.fixture
def pictures() -> NDArray[np.uint8]:
    """Sixty pictures 64x48 of a drifting pattern with noise."""
    y, x = np.mgrid[:72, :64]
    drift = np.arange(60)[:, None, None]
    waves = 120 + 50 * np.sin((x + drift) / 6) + 30 * np.cos((y - drift) / 5)
    noise = np.random.default_rng(0).integers(-4, 5, waves.shape)
    return np.clip(waves + noise, 16, 235).astype(np.uint8)


def decoded(path: Path) -> NDArray[np.uint8]:
    with av.open(str(path)) as container:
        return np.stack([frame.to_ndarray() for frame in container.decode(video=0)])


def test_the_loop_is_lossless(pictures: NDArray[np.uint8], tmp_path: Path) -> None:
    write_loop(tmp_path / "loop.mkv", pictures, 25)
    np.testing.assert_array_equal(decoded(tmp_path / "loop.mkv"), pictures)


def test_the_idle_clip_looks_the_same(pictures: NDArray[np.uint8], tmp_path: Path) -> None:
    write_idle(tmp_path / "idle.mp4", pictures, 25)
    shown = decoded(tmp_path / "idle.mp4")
    assert shown.shape == pictures.shape
    assert 10 * np.log10(255**2 / ((shown.astype(float) - pictures) ** 2).mean()) > 38


@pytest.mark.parametrize("name", ["loop.mkv", "idle.mp4"])
@pytest.mark.parametrize("fps", [25.0, 30000 / 1001])
def test_clips_are_tagged_bt709_limited_range_and_keep_time(
    pictures: NDArray[np.uint8], tmp_path: Path, name: str, fps: float
) -> None:
    {"loop.mkv": write_loop, "idle.mp4": write_idle}[name](tmp_path / name, pictures, fps)
    with av.open(str(tmp_path / name)) as container:
        stream = container.streams.video[0]
        frames = list(container.decode(stream))
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.codec_context.color_primaries == BT709
        assert stream.codec_context.color_trc == BT709
        assert stream.average_rate == Fraction(fps).limit_denominator(1001)
    assert all(frame.colorspace == Colorspace.ITU709 for frame in frames)
    assert all(frame.color_range == ColorRange.MPEG for frame in frames)
    times = [frame.time for frame in frames]
    np.testing.assert_allclose(times, np.arange(60) / fps, atol=2e-3)


def test_the_idle_clip_can_be_appended_to_itself(pictures: NDArray[np.uint8], tmp_path: Path) -> None:
    write_idle(tmp_path / "idle.mp4", pictures, 25)
    content = (tmp_path / "idle.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"moof") < content.index(b"mdat")
    assert b"mvex" in content
    with av.open(str(tmp_path / "idle.mp4")) as container:
        packets = [packet for packet in container.demux(video=0) if packet.size]
    assert [number for number, packet in enumerate(packets) if packet.is_keyframe] == [0, 25, 50]
    assert all(packet.pts == packet.dts for packet in packets)  # no frames out of order
