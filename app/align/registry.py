"""Aligners by name: the ones here and those that other packages add by the entry point group ``mary.align``."""

from __future__ import annotations

from app.align.aligner import Aligner
from app.errors import AlignmentFailed
from app.plugins import Plugins

GROUP = "mary.align"

_PLUGINS = Plugins(
    "aligner",
    GROUP,
    "aligner",
    {"pocketsphinx": ("app.align.pocketsphinx", "PocketSphinxAligner"), "mock": ("app.align.mock", "MockAligner")},
)

names = _PLUGINS.names


def create(name: str) -> Aligner:
    """A new aligner; nothing is loaded before it is used.

    Raises:
        NotFound: no aligner of this name; the advice lists the known ones.
        MissingExtra: the aligner's library is not installed.
        AlignmentFailed: the entry point does not make an aligner.
    """
    aligner = _PLUGINS.make(name)
    if not isinstance(aligner, Aligner):
        raise AlignmentFailed(
            f"{name} is no aligner: {type(aligner).__name__} lacks name or align",
            advice=f"Correct the entry point {name} in the group {GROUP}.",
        )
    return aligner
