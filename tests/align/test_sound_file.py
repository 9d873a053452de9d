import io
import tempfile
from pathlib import Path

import av
import numpy as np
import pytest

from app.align.sound_file import read_sound
from app.errors import InputError, TooLong


def encoded(format: str, codec: str, *, rate: int = 24_000, channels: int = 1, seconds: float = 1.0) -> io.BytesIO:
    """A file of a tone with peak 0.3."""
    layout = {1: "mono", 2: "stereo"}[channels]
    wave = (0.3 * np.sin(2 * np.pi * 440 * np.arange(round(seconds * rate)) / rate)).astype(np.float32)
    file = io.BytesIO()
    with av.open(file, "w", format=format) as container:
        stream = container.add_stream(codec, rate=rate, layout=layout)
        frame = av.AudioFrame.from_ndarray(np.stack([wave] * channels), format="fltp", layout=layout)
        frame.rate, frame.pts = rate, 0
        kind = stream.codec_context
        resampler = av.AudioResampler(kind.format, layout, kind.sample_rate, frame_size=kind.frame_size or None)
        for part in [*resampler.resample(frame), *resampler.resample(None)]:
            container.mux(stream.encode(part))
        container.mux(stream.encode(None))
    file.seek(0)
    return file


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("rate", [8_000, 11_025, 44_100, 96_000])
@pytest.mark.parametrize("codec", ["pcm_u8", "pcm_s16le", "pcm_s24le", "pcm_s32le", "pcm_f32le", "pcm_f64le"])
def test_wav_of_any_kind_is_read(codec: str, rate: int, channels: int) -> None:
    samples, read_rate = read_sound(encoded("wav", codec, rate=rate, channels=channels))
    assert (samples.shape, samples.dtype, read_rate) == ((rate,), np.float32, rate)
    tone = np.sin(2 * np.pi * 440 * np.arange(rate) / rate)
    assert np.corrcoef(samples, tone)[0, 1] > 0.999
    assert 0.2 < np.abs(samples).max() <= 1


@pytest.mark.parametrize(
    ("format", "codec"),
    [("flac", "flac"), ("mp3", "libmp3lame"), ("ogg", "libopus"), ("ipod", "aac"), ("aiff", "pcm_s16be")],
)
def test_other_formats_are_read(format: str, codec: str) -> None:
    samples, rate = read_sound(encoded(format, codec, rate=48_000))
    assert abs(len(samples) / rate - 1) < 0.1
    assert 0.2 < np.abs(samples).max() < 0.5


def test_a_path_is_read_and_named(tmp_path: Path) -> None:
    path = tmp_path / "tone.wav"
    path.write_bytes(encoded("wav", "pcm_s16le").read())
    assert len(read_sound(path)[0]) == 24_000
    with pytest.raises(InputError, match=r"nothing\.wav cannot be read"):
        read_sound(tmp_path / "nothing.wav")


def test_an_upload_is_read() -> None:
    with tempfile.SpooledTemporaryFile(max_size=1000) as upload:
        upload.write(encoded("wav", "pcm_s16le").read())
        upload.seek(0)
        assert len(read_sound(upload)[0]) == 24_000


def test_loud_floats_are_made_quieter_and_what_is_no_number_is_refused() -> None:
    header = bytearray(encoded("wav", "pcm_f32le", seconds=0.1).getvalue())
    start = header.index(b"data") + 8
    loud = np.full(2400, 4.0, "<f4")
    samples, _ = read_sound(io.BytesIO(bytes(header[:start]) + loud.tobytes()))
    assert samples.max() == 1
    loud[7] = np.nan
    with pytest.raises(InputError, match="no numbers"):
        read_sound(io.BytesIO(bytes(header[:start]) + loud.tobytes()))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"What is said is not sound." * 50,
        b"RIFF\x24\x00\x00\x00WAVEfmt ",
        b"\x89PNG\r\n\x1a\n" + bytes(100),
        b"ffconcat version 1.0\nfile /etc/hostname\n",
        b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile:///etc/hostname\n",
    ],
)
def test_what_is_no_sound_is_refused(content: bytes) -> None:
    with pytest.raises(InputError, match="the recording") as error:
        read_sound(io.BytesIO(content), name="the recording")
    assert error.value.field == "audio"


def test_a_playlist_opens_nothing(tmp_path: Path) -> None:
    (tmp_path / "tone.wav").write_bytes(encoded("wav", "pcm_s16le").read())
    playlist = tmp_path / "list.wav"
    playlist.write_text(f"ffconcat version 1.0\nfile {tmp_path / 'tone.wav'}\n")
    with pytest.raises(InputError):
        read_sound(playlist)


def test_no_samples_are_empty() -> None:
    whole = encoded("wav", "pcm_s16le", seconds=0.1).getvalue()
    start = whole.index(b"data") + 8
    with pytest.raises(InputError):
        read_sound(io.BytesIO(whole[: start - 4] + bytes(4)))


def test_longer_than_is_taken_is_refused() -> None:
    assert len(read_sound(encoded("wav", "pcm_s16le", seconds=1), longest=1.0)[0]) == 24_000
    with pytest.raises(TooLong, match=r"longer than 0\.9 s"):
        read_sound(encoded("wav", "pcm_s16le", seconds=1), longest=0.9)


@pytest.mark.parametrize("rate", [4_000, 192_000])
def test_rates_outside_are_refused(rate: int) -> None:
    with pytest.raises(InputError, match="samples a second"):
        read_sound(encoded("wav", "pcm_s16le", rate=rate))
