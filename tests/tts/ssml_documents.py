"""Hypothesis strategies that make SSML."""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

from hypothesis import strategies as st

from app.tts.reading.say_as import KINDS
from app.tts.ssml import RATES, STRENGTHS, VOLUMES

_XML = st.characters(exclude_categories=["Cs"]).filter(
    lambda letter: letter in "\t\n" or (letter >= " " and letter not in "\ufffe\uffff")
)
TEXT = st.one_of(
    st.text(_XML, max_size=12),
    st.sampled_from(["Hello", " there. ", "$3.50", " Jan. 5th, 2026 ", ".", " ", "read", " read ", "NASA", "😀"]),
).map(escape)
BREAK = st.one_of(
    st.sampled_from(sorted(STRENGTHS)).map(lambda strength: f'<break strength="{strength}"/>'),
    st.integers(0, 900).map(lambda time: f'<break time="{time}ms"/>'),
)
MARK = st.text("abc 1", min_size=1, max_size=5).filter(str.strip).map(lambda name: f"<mark name={quoteattr(name)}/>")
PHONEME = st.tuples(st.sampled_from(["read", "lead", "New York", ":)"]), st.sampled_from(["ɹɛd", "liːd", "nuː"])).map(
    lambda pair: f'<phoneme alphabet="ipa" ph="{pair[1]}">{pair[0]}</phoneme>'
)
SUB = st.tuples(TEXT.filter(str.strip), st.text(_XML, max_size=9)).map(
    lambda pair: f"<sub alias={quoteattr('x' + pair[1])}>{pair[0]}</sub>"
)
SAID = st.sampled_from(["12", "2026-01-05", "1/2", "10:30", "5 km", "7"])
SAY_AS = st.tuples(st.sampled_from(sorted(KINDS)), SAID).map(
    lambda pair: f'<say-as interpret-as="{pair[0]}">{pair[1]}</say-as>'
)
LEAVES = st.one_of(TEXT, TEXT, BREAK, MARK, PHONEME, SUB, SAY_AS)


def _prosody(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    rate = st.sampled_from(["", *(f' rate="{rate}"' for rate in (*RATES, "80%", "+10%", "1.3"))])
    volume = st.sampled_from(["", *(f' volume="{volume}"' for volume in (*VOLUMES, "-3dB", "+6dB"))])
    return st.tuples(rate, volume, inner).map(lambda parts: f"<prosody{parts[0]}{parts[1]}>{parts[2]}</prosody>")


INLINE = st.recursive(LEAVES, lambda inner: _prosody(st.lists(inner, max_size=3).map("".join)), max_leaves=8)
SENTENCE = st.lists(INLINE, max_size=4).map(lambda parts: f"<s>{''.join(parts)}</s>")
PARAGRAPH = st.lists(st.one_of(INLINE, SENTENCE), max_size=4).map(lambda parts: f"<p>{''.join(parts)}</p>")
DOCUMENT = st.lists(st.one_of(INLINE, SENTENCE, PARAGRAPH), max_size=6).map(
    lambda parts: f'<speak version="1.1" xml:lang="en-US">{"".join(parts)}</speak>'
)
