"""Recognisers by name: the ones here and those that other packages add by the entry point group ``mary.recogniser``.

Nothing is loaded before it is used.
"""

from __future__ import annotations

from app.align.recogniser import Recogniser
from app.errors import RecognitionFailed
from app.plugins import Plugins

_PLUGINS: Plugins[Recogniser] = Plugins(
    kind="recogniser",
    group="mary.recogniser",
    field="align.recogniser",
    ours={"hama": ("app.align.hama", "HamaRecogniser"), "mock": ("app.align.mock_recogniser", "MockRecogniser")},
    protocol=Recogniser,
    broken=RecognitionFailed,
)

names = _PLUGINS.names
create = _PLUGINS.create
