"""Recognisers by name: the ones here and those that other packages add by the entry point group ``mary.recogniser``."""

from __future__ import annotations

from app.align.recogniser import Recogniser
from app.errors import RecognitionFailed
from app.plugins import Plugins

GROUP = "mary.recogniser"

_PLUGINS = Plugins(
    "recogniser",
    GROUP,
    "align.recogniser",
    {"hama": ("app.align.hama", "HamaRecogniser"), "mock": ("app.align.mock_recogniser", "MockRecogniser")},
)

names = _PLUGINS.names


def create(name: str) -> Recogniser:
    """A new recogniser; nothing is loaded before it is used.

    Raises:
        NotFound: no recogniser of this name; the advice lists the known ones.
        MissingExtra: the recogniser's library is not installed.
        RecognitionFailed: the entry point does not make a recogniser.
    """
    recogniser = _PLUGINS.make(name)
    if not isinstance(recogniser, Recogniser):
        raise RecognitionFailed(
            f"{name} is no recogniser: {type(recogniser).__name__} lacks name, warm_up or hear",
            advice=f"Correct the entry point {name} in the group {GROUP}.",
        )
    return recogniser
