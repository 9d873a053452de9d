from __future__ import annotations

import gc
from fractions import Fraction
from itertools import pairwise
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from patterns import AAC_FRAME, FPS, HEIGHT, OPUS_FRAME, SAMPLE_RATE, WIDTH, beeps, picture, read_index

from app.stream.encoder import AacEncoder, OpusEncoder, VideoEncoder
from app.stream.nal import unit_type, units
from app.stream.packet import Packet

BT709, LIMITED = 1, 1


def decoded(packets: list[Packet]) -> list[Any]:
    decoder: Any = av.CodecContext.create("h264", "r")
    frames = [frame for packet in packets for frame in decoder.decode(packet.to_av())]
    return frames + list(decoder.decode(None))


def indices(packets: list[Packet]) -> list[int]:
    return [read_index(frame.to_ndarray(format="gray")) for frame in decoded(packets)]


def live(**options: Any) -> VideoEncoder:
    return VideoEncoder(WIDTH, HEIGHT, FPS, **options)


def test_live_gives_one_packet_a_picture_and_it_decodes() -> None:
    encoder = live()
    packets = []
    for index in range(30):
        (packet,) = encoder.encode(picture(index), index)
        packets.append(packet)
    assert indices(packets) == list(range(30))
    assert [packet.pts for packet in packets] == list(range(30))
    assert all(packet.dts == packet.pts and packet.duration == 1 for packet in packets)
    assert packets[0].time_base == Fraction(1, FPS)
    assert encoder.flush() == []


def test_live_is_constrained_baseline() -> None:
    sps = units(live().extradata)[0]
    assert sps[1] == 66  # profile_idc
    assert sps[2] & 0x40  # constraint_set1


def test_every_key_frame_carries_the_headers() -> None:
    encoder = live(keyframe_seconds=0.4)
    packets = [packet for index in range(25) for packet in encoder.encode(picture(index), index)]
    assert [packet.pts for packet in packets if packet.keyframe] == [0, 10, 20]
    header = units(encoder.extradata)
    assert [unit_type(unit) for unit in header] == [7, 8]
    for packet in packets:
        found = [unit for unit in units(packet.data) if unit_type(unit) in (7, 8)]
        assert found == (header if packet.keyframe else [])
    late = [packet for packet in packets if packet.pts >= 20]
    assert indices(late) == list(range(20, 25))


def test_key_frames_follow_the_clock_not_the_count() -> None:
    encoder = live(keyframe_seconds=1.0)
    packets = [packet for index in range(0, 60, 2) for packet in encoder.encode(picture(index), index)]
    assert [packet.pts for packet in packets if packet.keyframe] == [0, 26, 52]


def test_gaps_keep_their_times_and_long_ones_end_in_a_key_frame() -> None:
    encoder = live()
    times = [0, 1, 3, 4, 7, 8, 500]
    packets = [packet for index in times for packet in encoder.encode(picture(index), index)]
    assert [packet.pts for packet in packets] == times
    assert indices(packets) == times
    assert [packet.pts for packet in packets if packet.keyframe] == [0, 7, 500]


def test_key_frame_on_demand() -> None:
    encoder = live()
    packets = [packet for index in range(5) for packet in encoder.encode(picture(index), index, keyframe=index == 3)]
    assert [packet.pts for packet in packets if packet.keyframe] == [0, 3]
    assert indices(packets[3:]) == [3, 4]


def test_requests_are_coalesced_to_two_a_second() -> None:
    encoder = live(keyframe_seconds=100)
    packets = []
    for index in range(50):
        encoder.request_keyframe()
        packets += encoder.encode(picture(index), index)
    assert [packet.pts for packet in packets if packet.keyframe] == [0, 12, 24, 36, 48]


def test_a_request_waits_for_its_turn() -> None:
    encoder = live(keyframe_seconds=100)
    packets = encoder.encode(picture(0), 0)
    encoder.request_keyframe()
    for index in range(1, 40):
        packets += encoder.encode(picture(index), index)
    assert [packet.pts for packet in packets if packet.keyframe] == [0, 12]


@pytest.mark.parametrize("kind", [True, False])
def test_the_picture_may_be_overwritten(kind: bool) -> None:
    encoder = live(live=kind)
    buffer = picture(0)
    packets = []
    for index in range(20):
        buffer[:] = picture(index)
        packets += encoder.encode(buffer, index)
        buffer[:] = 77
    assert indices(packets + encoder.flush()) == list(range(20))


def test_the_rate_is_capped() -> None:
    encoder = VideoEncoder(256, 256, FPS, crf=10, max_kbps=500)
    noise = np.random.default_rng(1)
    size = 0
    for index in range(100):
        grain = noise.integers(16, 235, (48, 32), dtype=np.uint8)
        (packet,) = encoder.encode(np.kron(grain, np.ones((8, 8), np.uint8)), index)
        size += len(packet.data)
    assert size * 8 / 4 < 500_000 * 1.3  # four seconds and a buffer of one


def test_files_have_b_frames_and_come_out_whole() -> None:
    encoder = live(live=False, preset="medium", crf=16)
    packets = [packet for index in range(40) for packet in encoder.encode(picture(index), index)]
    assert len(packets) < 40
    packets += encoder.flush()
    assert indices(packets) == list(range(40))
    assert any(packet.pts != packet.dts for packet in packets)
    assert units(encoder.extradata)[0][1] == 100  # high profile
    assert [packet.dts for packet in packets] == sorted(packet.dts for packet in packets)


def _i420(colour: NDArray[np.float64]) -> NDArray[np.uint8]:
    """BT.709 limited range of one RGB colour (0..255), as ITU-R BT.709-6 section 3 has it."""
    red, green, blue = colour / 255
    luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    whole = np.empty((HEIGHT * 3 // 2, WIDTH), np.uint8)
    whole[:HEIGHT] = round(16 + 219 * luma)
    chroma = whole[HEIGHT:].reshape(2, -1)
    chroma[0] = round(128 + 224 * (blue - luma) / 1.8556)
    chroma[1] = round(128 + 224 * (red - luma) / 1.5748)
    return whole


@pytest.mark.parametrize("kind", [True, False])
@pytest.mark.parametrize("colour", [(200, 140, 120), (30, 60, 200), (128, 128, 128), (20, 160, 60)])
def test_colour_survives_and_is_tagged(kind: bool, colour: tuple[int, int, int]) -> None:
    encoder = live(live=kind, crf=16)
    packets = encoder.encode(_i420(np.array(colour, float)), 0) + encoder.flush()
    (frame,) = decoded(packets)
    tags = (frame.color_primaries, frame.color_trc, frame.colorspace, frame.color_range)
    assert tags == (BT709, BT709, BT709, LIMITED)
    planes = frame.to_ndarray(format="yuv420p")
    luma = (planes[:HEIGHT].mean() - 16) / 219
    blue, red = (planes[HEIGHT:].reshape(2, -1).mean(axis=1) - 128) / 224
    shown = np.array([luma + 1.5748 * red, luma - 0.1873 * blue - 0.4681 * red, luma + 1.8556 * blue]) * 255
    assert np.abs(shown - colour).max() <= 2


def test_bad_pictures_are_refused() -> None:
    encoder = live()
    with pytest.raises(ValueError, match="uint8"):
        encoder.encode(np.zeros((HEIGHT, WIDTH), np.uint8), 0)
    with pytest.raises(ValueError, match="uint8"):
        encoder.encode(picture(0).astype(np.float32), 0)  # type: ignore[arg-type]
    encoder.encode(picture(5), 5)
    with pytest.raises(ValueError, match="greater"):
        encoder.encode(picture(5), 5)
    with pytest.raises(ValueError, match="even"):
        VideoEncoder(127, 128, 25)


def _played(encoder: OpusEncoder | AacEncoder, packets: list[Packet], samples: int) -> NDArray[np.float32]:
    """What a player plays from time 0 on."""
    decoder: Any = av.CodecContext.create("libopus" if encoder.kind == "opus" else "aac", "r")
    decoder.sample_rate, decoder.layout = SAMPLE_RATE, "mono"
    if encoder.kind == "aac":
        decoder.extradata = encoder.extradata
    played = np.zeros(samples + 4 * AAC_FRAME, np.float32)
    for packet in packets:
        for frame in decoder.decode(packet.to_av()):
            sound = frame.to_ndarray().astype(np.float32).reshape(-1)
            if frame.format.name.startswith("s16"):
                sound /= 32768
            for place, value in enumerate(sound, start=packet.pts):
                if 0 <= place < len(played):
                    played[place] = value
    return played[:samples]


@pytest.mark.parametrize("kind", [OpusEncoder, AacEncoder])
@pytest.mark.parametrize("block", [OPUS_FRAME, 700])
def test_sound_is_played_when_it_was_spoken(kind: type[OpusEncoder] | type[AacEncoder], block: int) -> None:
    encoder = kind()
    samples = 60 * block
    wanted = beeps(0, samples)
    packets = [
        packet for first in range(0, samples, block) for packet in encoder.encode(wanted[first : first + block], first)
    ]
    packets += encoder.flush()
    assert packets[0].pts < 0  # the coder's priming
    assert [packet.pts - packets[0].pts for packet in packets] == [encoder.frame * n for n in range(len(packets))]
    assert all(packet.keyframe and packet.dts == packet.pts for packet in packets)
    played = _played(encoder, packets, samples)
    delays = range(-40, 41)
    inner = wanted[3000 : samples - 3000]
    matches = [float(inner @ played[3000 + delay : samples - 3000 + delay]) for delay in delays]
    assert abs(delays[int(np.argmax(matches))]) <= 2
    level = np.sqrt((played**2).mean() / (wanted**2).mean())
    assert 0.9 < level < 1.1


@pytest.mark.parametrize("kind", [OpusEncoder, AacEncoder])
def test_missing_sound_is_silence(kind: type[OpusEncoder] | type[AacEncoder]) -> None:
    encoder = kind()
    tone = beeps(0, 4800)
    packets = encoder.encode(tone, 0) + encoder.encode(tone[:480], 5000) + encoder.encode(tone, 48_000)
    packets += encoder.flush()
    times = [packet.pts for packet in packets]
    assert all(later - earlier >= encoder.frame for earlier, later in pairwise(times))
    assert max(times) < 48_000 + 4800 + 2 * encoder.frame
    assert any(time > 47_000 - encoder.frame for time in times)


@pytest.mark.parametrize("kind", [OpusEncoder, AacEncoder])
def test_bad_sound_is_refused(kind: type[OpusEncoder] | type[AacEncoder]) -> None:
    encoder = kind()
    with pytest.raises(ValueError, match="one-dimensional"):
        encoder.encode(np.zeros((2, 10), np.float32), 0)
    encoder.encode(beeps(0, 480), 0)
    with pytest.raises(ValueError, match="overlap"):
        encoder.encode(beeps(0, 480), 100)


def test_headers_of_the_sound() -> None:
    assert OpusEncoder().extradata.startswith(b"OpusHead")
    assert AacEncoder().extradata[:2] == bytes([0x11, 0x88])  # AAC-LC, 48 kHz, one channel


def test_a_closed_encoder_frees_its_codec_without_the_garbage_collector() -> None:
    def codecs() -> int:
        return sum(isinstance(each, av.CodecContext) for each in gc.get_objects())

    gc.collect()
    gc.disable()
    try:
        before = codecs()
        encoders = (VideoEncoder(64, 64, 25), OpusEncoder(), AacEncoder())
        assert codecs() == before + 3
        for encoder in encoders:
            encoder.close()
        assert codecs() == before
    finally:
        gc.enable()
