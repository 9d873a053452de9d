from pathlib import Path

import pytest

from app.align.transcript import Transcript, read_transcript
from app.errors import InputError
from app.speech import Phone, Word

ALIGN = "0 21500 sil\n21500 26250 bin\n26250 32500 blue\n32500 33000 sp\n33000 74500 sil\n"
VTT = """WEBVTT - a page

NOTE
nobody reads this

STYLE
::cue { color: red }

1
00:01.000 --> 00:02.500 align:start
<v Anna>Fish &amp; <i>chips</i>,
please.</v>

00:00:02.500 --> 01:00:04.000
<00:00:02.600><c>now</c>

"""
SRT = "1\n00:00:01,000 --> 00:00:02,500\nFish & chips,\nplease.\n\n2\n00:00:02,500 --> 01:00:04,000\nnow\n"


def grid(**tiers: list[tuple[float, float, str]]) -> str:
    """A TextGrid in the short form."""
    lines = ['"ooTextFile"', '"TextGrid"', "0", "2", "<exists>", str(len(tiers))]
    for name, intervals in tiers.items():
        lines += ['"IntervalTier"', f'"{name.replace("__", " - ")}"', "0", "2", str(len(intervals))]
        for start, end, label in intervals:
            lines += [str(start), str(end), f'"{label}"']
    return "\n".join(lines)


WORDS = [(0.0, 0.5, ""), (0.5, 1.0, "blue"), (1.0, 1.6, "fire"), (1.6, 2.0, "")]


def file(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_plain_text(tmp_path: Path) -> None:
    path = file(tmp_path, "a.TXT", "\ufeffHello there.\r\nMore.\n")
    assert read_transcript(path) == Transcript("Hello there.\nMore.")


def test_grid(tmp_path: Path) -> None:
    assert read_transcript(file(tmp_path, "a.align", ALIGN)) == Transcript(
        "bin blue", (Word("bin", 0.86, 1.05), Word("blue", 1.05, 1.3))
    )


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.vtt", VTT),
        ("a.srt", SRT),
        ("a.vtt", VTT.replace("\n", "\r\n")),
        ("a.vtt", "\ufeff" + VTT),
        ("a.srt", SRT.replace("\n\n", "\n \n")),
    ],
)
def test_captions(tmp_path: Path, name: str, text: str) -> None:
    transcript = read_transcript(file(tmp_path, name, text))
    assert transcript.text == "Fish & chips, please. now"
    assert transcript.captions == (Word("Fish & chips, please.", 1.0, 2.5), Word("now", 2.5, 3604.0))
    assert transcript.words is None


ROLLING = """WEBVTT
Kind: captions

00:00:01.000 --> 00:00:03.000 align:start position:0%
~
hello<00:00:01.400><c> my</c><00:00:01.700><c> friends</c>

00:00:03.000 --> 00:00:03.010 align:start position:0%
hello my friends
~

00:00:03.010 --> 00:00:05.000 align:start position:0%
hello my friends
and<00:00:03.400><c> welcome</c>

00:00:05.000 --> 00:00:05.010 align:start position:0%
and welcome
~

00:00:05.010 --> 00:00:07.000 align:start position:0%
and welcome
back
""".replace("~", " ")


def test_rolling_captions_are_said_once(tmp_path: Path) -> None:
    transcript = read_transcript(file(tmp_path, "a.vtt", ROLLING))
    assert transcript.text == "hello my friends and welcome back"
    assert transcript.captions == (
        Word("hello my friends", 1.0, 3.0),
        Word("and welcome", 3.01, 5.0),
        Word("back", 5.01, 7.0),
    )


def test_what_is_said_twice_in_captions_stays(tmp_path: Path) -> None:
    said = ["no", "no", "yes", "well", "well", "no"]
    cues = [f"00:{at:02}.000 --> 00:{at + 1:02}.000\n{text}\n" for at, text in enumerate(said)]
    assert read_transcript(file(tmp_path, "a.vtt", "WEBVTT\n\n" + "\n".join(cues))).text == " ".join(said)


@pytest.mark.parametrize("labels", ["B L UW1 F AY1 ER0", "b l uw f ay er", "b l uː f aj ɚ"])
@pytest.mark.parametrize("speaker", ["", "anna__"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_textgrid(tmp_path: Path, labels: str, speaker: str, encoding: str) -> None:
    edges = [0.5, 0.6, 0.7, 1.0, 1.1, 1.4, 1.6]
    phones = [(0.0, 0.3, ""), (0.3, 0.5, "sil")]
    phones += [(a, b, label) for a, b, label in zip(edges, edges[1:], labels.split(), strict=False)]
    phones += [(1.6, 2.0, "sp")]
    text = grid(**{f"{speaker}words": WORDS, f"{speaker}phones": phones})
    transcript = read_transcript(file(tmp_path, "a.TextGrid", text.encode(encoding)))
    assert transcript.text == "blue fire"
    assert transcript.words == (Word("blue", 0.5, 1.0), Word("fire", 1.0, 1.6))
    symbols = ["B", "L", "UW", "F", "AY", "ER"]
    assert transcript.phones == (
        Phone("SIL", 0.0, 0.5),
        *(Phone(symbol, a, b) for symbol, a, b in zip(symbols, edges, edges[1:], strict=False)),
        Phone("SIL", 1.6, 2.0),
    )
    alignment = transcript.alignment(1.9)
    assert alignment.phones == (*transcript.phones[:-1], Phone("SIL", 1.6, 1.9))
    assert alignment.words == transcript.words
    assert alignment.confidence == 1.0


def test_a_textgrid_of_sentences(tmp_path: Path) -> None:
    text = grid(sentence=[(0, 1, "Blue fire."), (1, 1.2, ""), (1.2, 2, "More.")])
    assert read_transcript(file(tmp_path, "a.textgrid", text)) == Transcript("Blue fire. More.")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.pdf", "x", "no kind of transcript"),
        ("a.txt", " \n…", "no words"),
        ("a.txt", b"caf\xe9", "not UTF-8 at byte 3"),
        ("a.txt", b"a\0b", "zero bytes"),
        ("a.txt", b"a" * 20_000_001, "20 MB"),
        ("a.align", "0 100 bin\n100 blue\n", "line 2"),
        ("a.align", "0 100 bin\n50 200 blue\n", "line 2: times go backwards"),
        ("a.align", "0 100 sil\n", "no words"),
        ("a.vtt", "WEBVTT\n\n00:01 --> 00:02\nhello\n", "no time of a caption"),
        ("a.TextGrid", "hello", "TextGrid"),
        ("a.TextGrid", grid(one=WORDS, two=WORDS), "words"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, content: str | bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_transcript(file(tmp_path, name, content))
    assert caught.value.message.startswith(f"{name}: ")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.txt: No such file"):
        read_transcript(tmp_path / "a.txt")


def test_no_phones_no_alignment(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no phone times"):
        read_transcript(file(tmp_path, "a.align", ALIGN)).alignment(3.0)
    late = Transcript("blue", (), (Phone("SIL", 0.0, 5.0), Phone("B", 5.0, 6.0)))
    with pytest.raises(InputError, match="no phone within"):
        late.alignment(3.0)
