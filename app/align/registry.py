"""Aligners by name: the ones here and those that other packages add by the entry point group ``mary.align``."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from app.align.aligner import Aligner
from app.errors import AlignmentFailed, MissingExtra, NotFound

GROUP = "mary.align"

_OURS = {"pocketsphinx": ("app.align.pocketsphinx", "PocketSphinxAligner"), "mock": ("app.align.mock", "MockAligner")}


def names() -> tuple[str, ...]:
    """Names of all aligners that can be created, ours first."""
    return (*_OURS, *sorted(set(_theirs()) - set(_OURS)))


def create(name: str) -> Aligner:
    """A new aligner; nothing is loaded before it is used.

    Raises:
        NotFound: no aligner of this name; the advice lists the known ones.
        MissingExtra: the aligner's library is not installed.
        AlignmentFailed: the entry point does not make an aligner.
    """
    try:
        if name in _OURS:
            module, attribute = _OURS[name]
            factory: Any = getattr(import_module(module), attribute)
        elif name in (theirs := _theirs()):
            factory = theirs[name].load()
        else:
            raise NotFound(f"there is no aligner {name!r}", field="aligner", advice=f"Known: {', '.join(names())}.")
        aligner = factory()
    except ImportError as error:
        raise MissingExtra(
            f"aligner {name} needs {error.name or error}, which is not installed",
            advice=f"pip install the package that {name} comes from.",
            field="aligner",
        ) from error
    if not isinstance(aligner, Aligner):
        raise AlignmentFailed(
            f"{name} is no aligner: {type(aligner).__name__} lacks name or align",
            advice=f"Correct the entry point {name} in the group {GROUP}.",
        )
    return aligner


def _theirs() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP)}
