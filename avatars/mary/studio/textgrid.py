"""Writes Praat's TextGrid files, in the long form."""

from __future__ import annotations

from collections.abc import Sequence

Interval = tuple[str, float, float]
"""Label, start and end in seconds."""


def textgrid(tiers: dict[str, Sequence[Interval]], end: float) -> str:
    """The file's text; gaps between intervals become empty ones, as the format asks for."""
    lines = [
        'File type = "ooTextFile"',
        'Object class = "TextGrid"',
        "",
        "xmin = 0",
        f"xmax = {end!r}",
        "tiers? <exists>",
    ]
    lines += [f"size = {len(tiers)}", "item []:"]
    for number, (name, intervals) in enumerate(tiers.items(), 1):
        whole = gapless(intervals, end)
        lines += [f"    item [{number}]:", '        class = "IntervalTier"', f"        name = {_quoted(name)}"]
        lines += ["        xmin = 0", f"        xmax = {end!r}", f"        intervals: size = {len(whole)}"]
        for at, (label, first, last) in enumerate(whole, 1):
            lines += [f"        intervals [{at}]:", f"            xmin = {first!r}", f"            xmax = {last!r}"]
            lines.append(f"            text = {_quoted(label)}")
    return "\n".join(lines) + "\n"


def gapless(intervals: Sequence[Interval], end: float) -> list[Interval]:
    """The intervals with empty ones between, before and after them."""
    whole: list[Interval] = []
    at = 0.0
    for label, first, last in intervals:
        if first > at:
            whole.append(("", at, first))
        whole.append((label, first, last))
        at = last
    return [*whole, ("", at, end)] if end > at else whole


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'
