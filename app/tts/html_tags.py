"""Takes HTML's tags and character references out of a text that is not otherwise HTML. Linear in its length."""

from __future__ import annotations

import re
from html import unescape
from html.entities import html5

_BLOCKS = (
    "address|article|aside|blockquote|dd|div|dl|dt|fieldset|figcaption|figure|footer|form|h[1-6]|header|hr|li|main|nav|"
    "ol|p|pre|section|summary|table|tbody|tfoot|thead|tr|ul"
)
_INLINE = (
    "a|abbr|b|bdi|bdo|big|button|center|cite|code|del|details|dfn|em|font|i|img|ins|kbd|label|mark|q|s|samp|small|span|"
    "strike|strong|sub|sup|time|tt|u|var|wbr"
)
_CELLS = "td|th"
# A name with other words after it is no tag ("a<b and c>d"): attributes have values. Bounds keep time linear.
_ATTRIBUTES = r"""(?:[ \t\n]{1,9}[A-Za-z][\w:-]{0,40}=(?:"[^"<>]{0,500}"|'[^'<>]{0,500}'|[^\s"'<>=]{1,500})){0,20}"""
_TAG = re.compile(
    rf"</?(?:(?P<line>br)|(?P<block>{_BLOCKS})|(?P<cell>{_CELLS})|{_INLINE}){_ATTRIBUTES}[ \t\n]{{0,9}}/?>",
    re.IGNORECASE,
)
_REFERENCE = re.compile(r"&(?:[A-Za-z][A-Za-z0-9]{1,30}|#[0-9]{1,7}|#[xX][0-9A-Fa-f]{1,6});")


def strip_html(text: str) -> str:
    """The text without tags, and with ``&amp;`` and its like as what they stand for.

    Only names that HTML has are tags: ``<name>`` and ``x < y`` stay. ``<br>`` becomes the end of a line, a block the
    end of a paragraph, a table's cell a space.
    """
    if "<" in text and ">" in text:
        text = _TAG.sub(_instead, text)
    return _REFERENCE.sub(_character, text) if "&" in text else text


def _instead(found: re.Match[str]) -> str:
    return "\n" if found["line"] else "\n\n" if found["block"] else " " if found["cell"] else ""


def _character(found: re.Match[str]) -> str:
    """`unescape` would take the beginning of a name for a whole one: ``&notit;`` for ``&not`` and ``it;``."""
    return unescape(found[0]) if found[0][1] == "#" or found[0][1:] in html5 else found[0]
