"""The clips of a corpus: which videos there are, and which transcript belongs to each."""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.align.transcript import decoded
from app.errors import InputError

VIDEO_SUFFIXES = (
    ".mp4", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".m4v", ".ts", ".mts", ".wmv", ".3gp",
)  # fmt: skip
TRANSCRIPT_SUFFIXES = (".textgrid", ".align", ".vtt", ".srt", ".txt")  # those that know more about times first
LIST_SUFFIXES = (".txt", ".tsv", ".csv")
_SEPARATOR = re.compile(r"[\t|]")


@dataclass(frozen=True, slots=True)
class Clip:
    """A video of somebody who speaks, and what they say.

    Attributes:
        name: unique in its corpus: the path from the folder that all videos have in common, "/" between folders,
            without the suffix (with it if two videos would have the same name otherwise).
        video: the file.
        transcript: the file that says what is said; None if none was found.
        text: what is said, if the transcript is a list with a line for each clip; None: the transcript is all its own.
    """

    name: str
    video: Path
    transcript: Path | None
    text: str | None = None


def find_clips(inputs: Sequence[Path], transcripts: Sequence[Path] = ()) -> list[Clip]:
    """The videos among files and folders, each with its transcript.

    Without `transcripts` it is the file beside the video with the same name and another suffix; of several the first
    kind of `TRANSCRIPT_SUFFIXES`. With them, names are compared as well, and where files in different folders have the
    same name, the one that shares most folders with the video is it (so that trees of the same shape fit together).
    One file for one video belongs to it whatever its name. A text file with a line `name<TAB>text` or `name|text` for
    each clip is a list of transcripts; of further columns the last counts, as in LJSpeech's metadata.

    Args:
        inputs: videos, or folders that are searched with all folders inside; hidden files are passed over there.
        transcripts: files or folders.

    Returns:
        in the order of `inputs`, those of a folder sorted; each video once. A video without a transcript is among them.

    Raises:
        InputError: no video, a path that is missing or cannot be read, several transcripts of one kind for a video, or
            transcripts of which none belongs to any video.
    """
    videos = list(dict.fromkeys(path for each in inputs for path in _found(each, VIDEO_SUFFIXES, "video")))
    if not videos:
        searched = ", ".join(map(str, inputs)) or "nothing given"
        raise InputError(f"no video in {searched}", advice=f"Known: {' '.join(VIDEO_SUFFIXES)}.")
    names = _names(videos)
    if not transcripts:
        beside: dict[Path, _Folder] = {}
        return [Clip(names[video], video, _beside(video, beside)) for video in videos]
    files = list(dict.fromkeys(path for each in transcripts for path in _found(each, _KNOWN, "transcript")))
    if strange := next((path for path in files if path.suffix.lower() not in _KNOWN), None):
        raise InputError(f"{strange.name}: no kind of transcript", advice=f"Known: {', '.join(_KNOWN)}.")
    lists = {path: lines for path in files if (lines := _lines(path, names))}
    clips = _listed(names, lines=lists)
    if not clips and len(files) == len(videos) == 1 and files[0].suffix.lower() in TRANSCRIPT_SUFFIXES:
        return [Clip(names[videos[0]], videos[0], files[0])]
    rest = [path for path in files if path not in lists and path.suffix.lower() in TRANSCRIPT_SUFFIXES]
    matched = _matched([video for video in videos if video not in clips], rest)
    if not clips and not any(matched.values()):
        named = ", ".join(path.name for path in files[:3]) or ", ".join(map(str, transcripts))
        raise InputError(
            f"none of the transcripts belongs to a video: {named}{', …' if len(files) > 3 else ''}",
            advice="Name each as its video is named, or give one text file with a line “name|text” for each video.",
        )
    return [clips.get(video) or Clip(names[video], video, matched[video]) for video in videos]


# --- files ------------------------------------------------------------------------------------------------------------


def _found(path: Path, suffixes: Sequence[str], kind: str) -> list[Path]:
    """A file itself, whatever it is called, or the files of these suffixes in a folder and those inside, sorted."""
    try:
        if path.is_dir():
            return sorted(each for each in _walked(path) if each.suffix.lower() in suffixes)
        if path.is_file():
            return [Path(os.path.abspath(path))]  # noqa: PTH100 - links keep their own names
        reason = "neither a file nor a folder" if path.exists() else "not there"
    except OSError as error:
        raise InputError(f"{error.filename or path} cannot be read: {error.strerror}") from error
    raise InputError(f"{kind} {path} is {reason}")


def _walked(folder: Path) -> Iterable[Path]:
    def fail(error: OSError) -> None:
        raise error

    for inside, folders, files in os.walk(os.path.abspath(folder), onerror=fail):  # noqa: PTH100
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            if not name.startswith(".") and (path := Path(inside, name)).is_file():  # not what waits for a writer
                yield path


def _names(videos: Sequence[Path]) -> dict[Path, str]:
    common = Path(os.path.commonpath([video.parent for video in videos]))
    whole = {video: video.relative_to(common).as_posix() for video in videos}
    short = {video: video.relative_to(common).with_suffix("").as_posix() for video in videos}
    taken = Counter([*short.values(), *whole.values()])
    return {video: short[video] if taken[short[video]] == 1 else whole[video] for video in videos}


# --- a transcript for each video --------------------------------------------------------------------------------------

_KNOWN = tuple(dict.fromkeys((*TRANSCRIPT_SUFFIXES, *LIST_SUFFIXES)))
_Folder = Mapping[str, Sequence[Path]]  # transcripts by the stem of their names


def _beside(video: Path, folders: dict[Path, _Folder]) -> Path | None:
    folder = video.parent
    if folder not in folders:
        try:
            inside = [path for path in folder.iterdir() if path.suffix.lower() in TRANSCRIPT_SUFFIXES]
            folders[folder] = _by_stem(path for path in sorted(inside) if path.is_file())
        except OSError as error:
            raise InputError(f"{folder} cannot be read: {error.strerror}") from error
    return _best(video, folders[folder].get(video.stem, ()))


def _matched(videos: Sequence[Path], files: Sequence[Path]) -> dict[Path, Path | None]:
    """For each video the transcript of its name that is nearest.

    A transcript that is nearer to another video of the same name is not taken: it is what that one says.
    """
    named = _by_stem(files)
    nearest: dict[Path, int] = defaultdict(int)
    for video in videos:
        for path in named.get(video.stem, ()):
            nearest[path] = max(nearest[path], _shared(video, path))
    matched: dict[Path, Path | None] = {}
    for video in videos:
        choice = [path for path in named.get(video.stem, ()) if _shared(video, path) == nearest[path]]
        most = max((nearest[path] for path in choice), default=0)
        matched[video] = _best(video, [path for path in choice if nearest[path] == most])
    return matched


def _by_stem(files: Iterable[Path]) -> _Folder:
    named: dict[str, list[Path]] = defaultdict(list)
    for path in files:
        named[path.stem].append(path)
    return named


def _best(video: Path, choice: Sequence[Path]) -> Path | None:
    """The first of the kinds that are there; it must be the only one of its kind."""
    if not choice:
        return None
    rank = min(TRANSCRIPT_SUFFIXES.index(path.suffix.lower()) for path in choice)
    best = [path for path in choice if TRANSCRIPT_SUFFIXES.index(path.suffix.lower()) == rank]
    if len(best) > 1:
        raise InputError(
            f"{video} has several transcripts: {', '.join(map(str, best))}", advice="Remove or rename all but one."
        )
    return best[0]


def _shared(video: Path, transcript: Path) -> int:
    """How many folders above both have the same name."""
    return len(set(video.parent.parts) & set(transcript.parent.parts))


# --- a list of transcripts --------------------------------------------------------------------------------------------


def _lines(path: Path, names: Mapping[Path, str]) -> dict[str, str]:
    """Text by name, if the file is a list for several videos or names the one there is; else nothing.

    Raises:
        InputError: it is a list in which a line has no name or two lines have the same.
    """
    if path.suffix.lower() not in LIST_SUFFIXES or any(path.stem == video.stem for video in names):
        return {}
    try:
        lines = decoded(path.read_bytes()).split("\n")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    except InputError as error:
        raise InputError(f"{path.name}: {error.message}", advice=error.advice) from error
    rows = [
        (number, [column.strip() for column in _SEPARATOR.split(line)])
        for number, line in enumerate(lines, 1)
        if line.strip()
    ]
    known = {name for video, name in names.items() for name in _called(video, name)}
    if not any(len(columns) > 1 and columns[0] in known for _, columns in rows):
        return {}
    listed: dict[str, str] = {}
    for number, (name, *columns) in rows:
        if not columns:
            raise InputError(
                f"{path.name}: line {number}: expected “name|text”, found “{name[:40]}”",
                advice="Put the name of the video, a TAB or |, and what is said on each line.",
            )
        said = next((column for column in reversed(columns) if column), "")
        if listed.setdefault(name, said) != said:
            raise InputError(f"{path.name}: line {number}: there is another line for {name}")
    return listed


def _called(video: Path, name: str) -> tuple[str, ...]:
    """What a list may call a video, the surest first."""
    return (name, video.name, video.stem)


def _listed(names: Mapping[Path, str], *, lines: Mapping[Path, Mapping[str, str]]) -> dict[Path, Clip]:
    """The clips that lists name.

    Raises:
        InputError: a list names several videos at once, or several lists name one.
    """
    clips: dict[Path, Clip] = {}
    by: dict[tuple[Path, str], Path] = {}
    for video, name in names.items():
        for path, listed in lines.items():
            called = next((each for each in _called(video, name) if each in listed), None)
            if called is None:
                continue
            other = by.setdefault((path, called), video)
            if other.parent != video.parent:
                raise InputError(
                    f"{path.name}: {called} is the name of both {other} and {video}",
                    advice=f"Call them {names[other]} and {name} in the list.",
                )
            if video in clips and clips[video].text != listed[called]:
                raise InputError(f"{video} is in several lists: {clips[video].transcript} and {path}")
            clips[video] = Clip(name, video, path, listed[called])
    return clips
