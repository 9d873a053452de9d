"""Takes the marks of Markdown out of a text, as language models write it. Linear in the length of the text.

Nothing that is read is lost but the addresses behind links and the fences of code: code itself is text.
"""

from __future__ import annotations

import re

_FENCE = re.compile(r"[ \t]*(?:```|~~~)")
_STARTS = re.compile(r"^[ \t]*(?:(?:#{1,6}|[-*+•]|>+)[ \t]+)+(?:\[[ xX]\][ \t]+)?", re.MULTILINE)
_HEADING = re.compile(r"^([ \t]*#{1,6}[ \t][^\n]*)\n(?!\n)", re.MULTILINE)
_LINK = re.compile(
    r"!?\[([^\[\]\n]{1,200})\](?:\((?!/)[^()\s]{1,500}(?:[ \t]\"[^\"\n]{0,200}\")?\)|\[[^\[\]\n]{0,100}\])"
)
_AUTOLINK = re.compile(r"<((?:https?://|mailto:)[^\s<>]{1,500})>")
_STARS = re.compile(r"(?<![\w*\\])\*{1,3}(?=[^\s*])|(?<=[^\s*\\])\*{1,3}(?![\w*])")
_LINES = re.compile(r"(?<!\w)_{1,3}(?=[^\W_])|(?<=[^\s_])_{1,3}(?!\w)")
_STRUCK = re.compile(r"~~+")
_TICKS = re.compile(r"(?<![^\W\d_])`+|`+(?![^\W\d_])")
_ESCAPED = re.compile(r"\\([*_`#\[\]()~>+.!|-])")
_RULE = frozenset("-*_= \t")
_BORDER = frozenset("|-:+ \t")


def strip_markdown(text: str) -> str:
    """The text without emphasis, code marks, headings, bullets, quotes, links, rules and tables' lines.

    A row of a table becomes its cells with commas between. A heading, and an item of a list or a row that begins with a
    small letter, is set apart by an empty line: without its mark it would be taken for part of one wrapped sentence.
    """
    if not any(mark in text for mark in "*_`#[<~|>=\\-+•"):
        return text
    lines: list[str] = []
    for given in text.split("\n"):
        if (line := _line(given)) is None:
            continue
        if lines and line is not given and _goes_on(line):  # a row
            lines.append("")
        lines.append(line)
    plain = "\n".join(lines)
    plain = _STARTS.sub(_start, _HEADING.sub(r"\1\n\n", plain))
    plain = _AUTOLINK.sub(r"\1", _LINK.sub(r"\1", plain))
    plain = _TICKS.sub("", _STRUCK.sub("", plain))
    plain = _LINES.sub("", _STARS.sub("", plain))
    return _ESCAPED.sub(r"\1", plain)


def _start(found: re.Match[str]) -> str:
    """What stands for the marks at the beginning of a line."""
    item = found[0].strip(" \t>")  # a quotation goes on in the next line
    return "\n" if found.start() and item and _goes_on(found.string[found.end() : found.end() + 8]) else ""


def _goes_on(text: str) -> bool:
    """Whether it begins with a small letter, as what belongs to the line before does."""
    return text[:8].lstrip("*_`~[\"'(")[:1].islower()


def _line(line: str) -> str | None:
    """A line, changed if it is a table's; empty for a rule; None for what is only drawing."""
    bare = line.strip(" \t")
    if _FENCE.match(line) or (len(bare) > 2 and set(bare) <= _RULE and len(set(bare) - {" ", "\t"}) == 1):
        return ""
    if "|" in bare and "-" in bare and set(bare) <= _BORDER:
        return None
    if len(bare) > 2 and bare[0] == bare[-1] == "|":
        return ", ".join(cell for part in bare[1:-1].split("|") if (cell := part.strip(" \t")))
    return line
