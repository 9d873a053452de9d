from __future__ import annotations

import io
import struct
import wave

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.answer import Answer
from app.errors import SpeechFailed
from app.tts.received_sound import received_sound

RATE = 24_000


def tone(rate: int = RATE, hz: float = 300.0, seconds: float = 0.5) -> NDArray[np.float32]:
    return (0.5 * np.sin(2 * np.pi * hz * np.arange(round(seconds * rate)) / rate)).astype(np.float32)


def wav(samples: NDArray[np.float32], rate: int = RATE, channels: int = 1) -> bytes:
    file = io.BytesIO()
    with wave.open(file, "wb") as writer:
        writer.setnchannels(channels)
        writer.setsampwidth(2)
        writer.setframerate(rate)
        writer.writeframes((np.repeat(samples, channels) * 32767).astype("<i2").tobytes())
    return file.getvalue()


def float_wav(samples: NDArray[np.float32], rate: int = RATE) -> bytes:
    data = samples.astype("<f4").tobytes()
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 3, 1, rate, rate * 4, 4, 32)
    body = b"WAVE" + form + struct.pack("<4sI", b"data", len(data)) + data
    return struct.pack("<4sI", b"RIFF", len(body)) + body


def encoded(samples: NDArray[np.float32], form: str, codec: str, rate: int = RATE) -> bytes:
    file = io.BytesIO()
    with av.open(file, "w", format=form) as container:
        stream = container.add_stream(codec, rate=rate, layout="mono")
        frame = av.AudioFrame.from_ndarray((samples * 32767).astype("<i2")[None], format="s16", layout="mono")
        frame.sample_rate = rate
        resampler = av.AudioResampler(stream.format, "mono", rate, frame_size=stream.frame_size or 1024)
        for part in (*resampler.resample(frame), *resampler.resample(None)):
            container.mux(stream.encode(part))
        container.mux(stream.encode(None))
    return file.getvalue()


def heard(body: bytes, kind: str = "audio/wav", *, rate: int = RATE, pcm: bool = False) -> NDArray[np.float32]:
    return received_sound(Answer(body, kind), "parrot", rate, pcm=pcm)


def power(samples: NDArray[np.float32], rate: int, low: float, high: float) -> float:
    """dB of the sound between two frequencies."""
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples)))) ** 2
    frequencies = np.fft.rfftfreq(len(samples), 1 / rate)
    return float(10 * np.log10(spectrum[(frequencies >= low) & (frequencies < high)].sum() + 1e-12))


def test_wav_as_it_is() -> None:
    samples = heard(wav(tone()))
    assert samples.dtype == np.float32
    np.testing.assert_allclose(samples, tone(), atol=1e-4)


def test_stereo_is_mixed() -> None:
    samples = heard(wav(tone(), channels=2))
    np.testing.assert_allclose(samples / samples.max(), tone() / tone().max(), atol=1e-3)


@pytest.mark.parametrize("hz", [300.0, 1000.0, 3300.0])
def test_8_khz_is_brought_to_24_without_mirror_images(hz: float) -> None:
    samples = heard(wav(tone(8_000, hz, 1.0), 8_000))
    assert len(samples) == RATE
    inside = slice(RATE // 10, -RATE // 10)
    np.testing.assert_allclose(samples[inside], tone(RATE, hz, 1.0)[inside], atol=0.01)
    assert power(samples[inside], RATE, 4_100, 12_001) < power(samples[inside], RATE, hz - 50, hz + 50) - 60


@pytest.mark.parametrize(("own", "wanted"), [(44_100, 24_000), (16_000, 24_000), (24_000, 48_000)])
def test_other_rates(own: int, wanted: int) -> None:
    samples = heard(wav(tone(own), own), rate=wanted)
    assert len(samples) == pytest.approx(0.5 * wanted, abs=2)
    np.testing.assert_allclose(samples[1000:-1000], tone(wanted)[1000 : len(samples) - 1000], atol=0.01)


@pytest.mark.parametrize("length", [0, 0xFFFFFFFF, 0x7FFFFFFF, 0x7FFFFFFF - 36])
def test_wav_that_was_sent_before_its_length_was_known(length: int) -> None:
    body = bytearray(wav(tone()))
    struct.pack_into("<I", body, 4, min(length + 36, 0xFFFFFFFF))
    struct.pack_into("<I", body, 40, length)
    np.testing.assert_allclose(heard(bytes(body)), tone(), atol=1e-4)


def test_wav_of_ffmpeg_into_a_pipe() -> None:
    class Pipe(io.RawIOBase):
        def __init__(self) -> None:
            self.data = b""

        def writable(self) -> bool:
            return True

        def write(self, part) -> int:
            self.data += bytes(part)
            return len(part)

    pipe = Pipe()
    with av.open(pipe, "w", format="wav") as container:
        stream = container.add_stream("pcm_s16le", rate=RATE, layout="mono")
        frame = av.AudioFrame.from_ndarray((tone() * 32767).astype("<i2")[None], format="s16", layout="mono")
        frame.sample_rate = RATE
        container.mux(stream.encode(frame))
    assert struct.unpack_from("<I", pipe.data, 4) == (0xFFFFFFFF,)
    np.testing.assert_allclose(heard(pipe.data), tone(), atol=1e-4)


@pytest.mark.parametrize("kind", ["audio/pcm", "", "application/octet-stream"])
def test_samples_without_a_header(kind: str) -> None:
    body = (tone() * 32767).astype("<i2").tobytes()
    np.testing.assert_allclose(heard(body, kind, pcm=True), tone(), atol=1e-4)


def test_samples_without_a_header_of_the_rate_that_their_kind_names() -> None:
    body = (tone(16_000) * 32767).astype("<i2").tobytes()
    assert len(heard(body, "audio/pcm;rate=16000;channels=1", pcm=True)) == RATE // 2


def test_samples_that_begin_like_json() -> None:
    body = b"{\x01" + (tone() * 32767).astype("<i2").tobytes()
    assert len(heard(body, "", pcm=True)) == len(body) // 2


@pytest.mark.parametrize(("form", "codec"), [("mp3", "libmp3lame"), ("flac", "flac"), ("ogg", "libopus")])
@pytest.mark.parametrize("pcm", [False, True])
def test_compressed(form: str, codec: str, pcm: bool) -> None:
    kind = {"mp3": "audio/mpeg", "flac": "audio/flac", "ogg": "audio/ogg"}[form]
    samples = heard(encoded(tone(seconds=1.0), form, codec), kind, pcm=pcm)
    assert len(samples) == pytest.approx(RATE, rel=0.1)
    assert power(samples, RATE, 250, 350) > power(samples, RATE, 400, 12_001) + 20


@pytest.mark.parametrize(
    ("body", "kind", "said"),
    [
        (b"", "audio/wav", "sent an empty answer"),
        (b'{"error": {"message": "no such voice"}}', "application/json", "sent JSON instead of sound: “no such voice”"),
        (b'{"error": "no such voice"}', "audio/wav", "sent JSON instead of sound: “no such voice”"),
        (b"<!DOCTYPE html><title>Log in</title>", "text/html", "sent a web page instead of sound: “Log in”"),
        (b"<!DOCTYPE html><title>Log in</title>", "", "sent a web page instead of sound: “Log in”"),
        (b"ok", "text/plain", "sent text instead of sound: “ok”"),
        (b"\x00\x01garbage" * 50, "audio/wav", "cannot be read as sound"),
        (b"RIFF\x00\x00", "audio/wav", "cannot be read as sound"),
        (wav(tone())[:44], "audio/wav", "it is cut off"),
        (wav(tone())[:5_000], "audio/wav", "sent 4,956 of 24,000 bytes of sound: it is cut off"),
        (wav(tone()[:0]), "audio/wav", "no sound|empty|cannot be read"),
        (wav(np.zeros(RATE, np.float32)), "audio/wav", r"made no sound: its server sent 1\.0 s of silence"),
        (encoded(np.zeros(RATE, np.float32), "mp3", "libmp3lame"), "audio/mpeg", "made no sound"),
        (float_wav(np.full(RATE, np.nan, np.float32)), "audio/wav", "samples that are no numbers"),
        (float_wav(np.full(RATE, np.inf, np.float32)), "audio/wav", "samples that are no numbers"),
        (wav(tone(4_000), 4_000), "audio/wav", "4,000 samples a second"),
    ],
)
def test_what_is_no_sound(body: bytes, kind: str, said: str) -> None:
    with pytest.raises(SpeechFailed, match=f"speech engine parrot.*({said})") as caught:
        heard(body, kind)
    assert caught.value.advice


@pytest.mark.parametrize(
    ("body", "kind", "said"),
    [
        (b"\x01\x02\x03", "audio/pcm", "half a sample"),
        (bytes(48_000), "audio/pcm", "made no sound"),
        (b"\x01\x02" * 100, "audio/pcm; rate=400", "400 samples a second"),
        (b"\x01\x02" * 8_000 * 301, "audio/pcm; rate=8000", "more than 300 s"),
        (b'{"error": "no"}', "audio/pcm", "JSON instead of sound"),
    ],
)
def test_what_is_no_sound_without_a_header(body: bytes, kind: str, said: str) -> None:
    with pytest.raises(SpeechFailed, match=f"speech engine parrot.*{said}"):
        heard(body, kind, pcm=True)


def test_loud_floats_are_brought_into_range() -> None:
    samples = heard(float_wav(tone() * 8))
    assert np.abs(samples).max() <= 1.0
    np.testing.assert_allclose(samples, tone() * 2, atol=1e-3)


@given(st.binary(max_size=300), st.sampled_from(["", "audio/wav", "audio/pcm"]), st.booleans(), st.booleans())
def test_any_bytes_are_sound_or_refused(body: bytes, kind: str, pcm: bool, headed: bool) -> None:
    try:
        samples = heard((wav(tone())[:44] if headed else b"") + body, kind, pcm=pcm)
    except SpeechFailed:
        return
    assert samples.ndim == 1
    assert len(samples)
    assert np.isfinite(samples).all()
    assert np.abs(samples).max() <= 1.0
