"""HTML as text that is either known to be markup or escaped: names of clips come from outside."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

JPEG_QUALITY = 88


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def text(value: object) -> Markup:
    """Anything as HTML: escaped unless it is markup."""
    return value if isinstance(value, Markup) else Markup(html.escape(str(value)))


def element(name: str, *content: object, kind: str = "") -> Markup:
    """An element with its content, escaped unless it is markup.

    Args:
        name: of the element.
        content: put together.
        kind: its class.
    """
    opened = f'<{name} class="{html.escape(kind)}">' if kind else f"<{name}>"
    return Markup(f"{opened}{''.join(text(each) for each in content)}</{name}>")


def section(title: str, *content: object) -> Markup:
    """A part of the page."""
    return element("section", element("h2", title), *content)


def paragraph(*content: object) -> Markup:
    """A paragraph."""
    return element("p", *content)


def table(head: Sequence[object], rows: Iterable[Sequence[object]], *, kind: str = "") -> Markup:
    """A table that scrolls by itself where the page is too narrow for it."""
    first = element("tr", *(element("th", each) for each in head))
    others = (element("tr", *(element("td", each) for each in row)) for row in rows)
    inner = Markup(element("thead", first) + element("tbody", *others))
    return element("div", element("table", inner, kind=kind), kind="scroll")


def listing(facts: Iterable[tuple[object, object]]) -> Markup:
    """Names and values."""
    return element("dl", *(Markup(element("dt", name) + element("dd", value)) for name, value in facts))


def image(uri: str, alt: str, *, kind: str = "") -> Markup:
    """A picture."""
    return Markup(f'<img src="{html.escape(uri)}" alt="{html.escape(alt)}" class="{html.escape(kind)}">')


def figure(picture: Markup, *caption: object, kind: str = "") -> Markup:
    """A picture with what is written under it."""
    return element("figure", picture, element("figcaption", *caption), kind=kind)


def plot(png: bytes, alt: str, *, long: bool = False) -> Markup:
    """A plot; a long one scrolls by itself where the page is too narrow for it."""
    return element("div", image(data_uri(png, "image/png"), alt, kind="long plot" if long else "plot"), kind="scroll")


def data_uri(content: bytes, media_type: str) -> str:
    """A file as an address that holds it."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode('ascii')}"


def jpeg_uri(rgb: NDArray[np.uint8]) -> str:
    """A picture (H, W, 3) as an address that holds it."""
    _, encoded = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data_uri(encoded.tobytes(), "image/jpeg")
