"""SDP fragments: a viewer's candidates that come after its offer (RFC 8840, application/trickle-ice-sdpfrag)."""

from __future__ import annotations

from dataclasses import dataclass, field

from app.errors import NegotiationFailed


@dataclass(slots=True)
class Section:
    """What a fragment says of one section of the offer.

    Attributes:
        mid: its name.
        ufrag, password: of the ICE session the candidates belong to.
        candidates: the values of its `a=candidate` lines.
    """

    mid: str = ""
    ufrag: str = ""
    password: str = ""
    candidates: list[str] = field(default_factory=list)


def parse(fragment: str) -> tuple[Section, ...]:
    """The sections of a fragment, each with a name and credentials, those of the session where it has none itself.

    `end-of-candidates` is read over: candidates that were dropped (`.local` names) may still show up as the source of
    the viewer's checks, so the list is never taken for complete, and who does not connect is closed anyhow.

    Raises:
        NegotiationFailed: it is malformed.
    """
    session = Section()
    sections: list[Section] = []
    for line in fragment.splitlines():
        if line.startswith("m="):
            sections.append(Section())
            continue
        name, _, value = line.removeprefix("a=").partition(":")
        value = value.strip()
        if not line.startswith("a="):
            if line.strip() and line[1:2] != "=":
                raise _malformed(f"the line {line[:40]!r} is no SDP")
            continue
        here = sections[-1] if sections else session
        if name == "mid":
            here.mid = value
        elif name == "ice-ufrag":
            here.ufrag = value
        elif name == "ice-pwd":
            here.password = value
        elif name == "candidate":
            if not _is_candidate(value):
                raise _malformed(f"the candidate {value[:40]!r} is no candidate")
            here.candidates.append(value)
    if not sections or session.candidates or session.mid:
        raise _malformed("candidates must stand in a section of the offer (m=, a=mid)")
    for section in sections:
        section.ufrag = section.ufrag or session.ufrag
        section.password = section.password or session.password
        if not section.mid:
            raise _malformed("a section has no name (a=mid)")
        if not section.ufrag or not section.password:
            raise _malformed("a section has no ICE credentials (a=ice-ufrag, a=ice-pwd)")
    return tuple(sections)


def _is_candidate(value: str) -> bool:
    """`foundation component transport priority address port typ type …` (RFC 8839 section 5.1)."""
    words = value.split()
    numbers = [words[place] for place in (1, 3, 5)] if len(words) >= 8 else []
    return bool(numbers) and all(number.isascii() and number.isdecimal() for number in numbers) and words[6] == "typ"


def _malformed(detail: str) -> NegotiationFailed:
    return NegotiationFailed(
        f"the SDP fragment is malformed: {detail}",
        advice="Send a=ice-ufrag and a=ice-pwd, then m=, a=mid and a=candidate lines, as RFC 8840 describes.",
    )
