"""URLs, e-mail addresses, file names, @handles and hashtags, read the way people dictate them."""

from __future__ import annotations

import re

from app.tts.reading.letters import sayable, spelled
from app.tts.reading.numbers import cardinal, digits
from app.tts.reading.word_list import these

_ENDINGS = these(
    "com org net edu gov mil int info io ai app dev co uk us eu de fr it es nl ch at be se no dk fi pl pt ie ca au nz "
    "in jp cn ru br mx tv me biz xyz cloud tech online site shop blog news"
)
_FILES = these(
    "pdf txt md csv json xml html htm css js ts py sh exe zip gz tar jpg jpeg png gif svg mp3 mp4 wav mov avi doc "
    "docx xls xlsx ppt pptx yaml yml toml cpp rs go java jar log ini cfg sql"
)
_SAID = {
    "com": "com", "org": "org", "net": "net", "info": "info", "gov": "gov", "mil": "mil", "biz": "biz", "edu": "E.D.U",
    "jpg": "jay peg", "jpeg": "jay peg", "json": "jason", "gif": "gif", "zip": "zip", "png": "P.N.G", "wav": "wave",
    "exe": "E.X.E", "io": "I.O", "ai": "A.I", "uk": "U.K", "us": "U.S", "eu": "E.U", "de": "D.E", "it": "I.T",
    "html": "H.T.M.L", "http": "H.T.T.P", "www": "W.W.W", "api": "A.P.I", "ie": "I.E", "au": "A.U", "yaml": "yammel",
}  # fmt: skip
NAMES = {
    ".": "dot", "/": "slash", "-": "dash", "_": "underscore", "?": "question mark", "=": "equals", "&": "and",
    "#": "hash", ":": "colon", "@": "at", "+": "plus", "%": "percent", "~": "tilde", "\\": "backslash",
    "*": "star", "$": "dollar", "!": "exclamation mark",
}  # fmt: skip
_SCHEME = re.compile(r"([a-z]{2,6}):/{2,}\Z", re.IGNORECASE)
_URL = re.compile(r"(?:([a-z]{2,6})://|(?=www\.))(?:www\.)?(\S+)\Z", re.IGNORECASE)
_BARE = re.compile(r"(?:www\.)?([A-Za-z0-9.-]+)(?::[0-9]{1,5})?(?:[/?#]\S*)?\Z")
_MAIL = re.compile(r"(?:mailto:)?([A-Za-z0-9._%+-]+)@([A-Za-z0-9.-]+\.[A-Za-z]{2,})\Z")
_HANDLE = re.compile(r"@([A-Za-z0-9_][A-Za-z0-9_.]*)\Z")
_HASHTAG = re.compile(r"#([^\W\d]\w*)\Z")
_FILE = re.compile(r"(?:[\w-]+\.)+([A-Za-z0-9]{1,5})\Z")
_PATH = re.compile(r"(?:~|[A-Za-z]:|\.{1,2})?[/\\][\w.~/\\-]*\w[/\\]?\Z")
_PIECES = re.compile(r"[A-Za-z']+|[0-9]+|[^\W\d_]+|.", re.DOTALL)
_CAMEL = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\dA-Z_]+|[0-9]+")


def address(text: str) -> str:
    """A URL, e-mail address, bare domain, file name, path, handle or hashtag as words; empty if it is none.

    ``https://`` and ``www.`` are not said before an address, nor a slash at the end.
    """
    if len(text) < 2:
        return ""
    if found := _MAIL.match(text):
        return f"{_said(found[1])} at {_said(found[2])}"
    if found := _SCHEME.match(text):
        return _word(found[1])
    if found := _URL.match(text):
        return _said(found[2].rstrip("/") or found[2])
    if found := _HANDLE.match(text):
        return f"at {_said(found[1])}"
    if found := _HASHTAG.match(text):
        return f"hashtag {camel(found[1])}"
    if found := _BARE.match(text):
        host = found[1]
        ending = host.rpartition(".")[2]
        if ending in _ENDINGS and _is_host(host):
            return _said(text.removeprefix("www.").rstrip("/"))
    if (found := _FILE.match(text)) and found[1].lower() in _FILES:
        return _said(text)
    if _PATH.match(text):
        return _said(text.rstrip("/\\") or text)
    return ""


def _is_host(host: str) -> bool:
    labels = host.split(".")
    return len(labels) > 1 and all(label and label[0] != "-" != label[-1] for label in labels)


def camel(text: str) -> str:
    """``HelloWorld_2026`` as its words."""
    return " ".join(_word(part) for part in _CAMEL.findall(text))


def _said(text: str) -> str:
    """Every part and every sign of an address."""
    return " ".join(filter(None, (NAMES.get(part) or _word(part) for part in _PIECES.findall(text))))


def _word(part: str) -> str:
    if "0" <= part[0] <= "9":
        return cardinal(int(part)) if len(part) < 5 and (part[0] != "0" or part == "0") else digits(part)
    if not part[0].isalpha():
        return ""
    if part.lower() in _SAID:
        return _SAID[part.lower()]
    short = part.isascii() and part.isalpha() and 1 < len(part) < 6
    if short and ((part.isupper() and len(part) < 4) or not sayable(part)):
        return spelled(part)
    return part
