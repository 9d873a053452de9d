"""Aligners by name: the ones here and those that other packages add by the entry point group ``mary.align``.

Nothing is loaded before it is used.
"""

from __future__ import annotations

from app.align.aligner import Aligner
from app.errors import AlignmentFailed
from app.plugins import Plugins

_PLUGINS: Plugins[Aligner] = Plugins(
    kind="aligner",
    group="mary.align",
    field="aligner",
    ours={
        "pocketsphinx": ("app.align.pocketsphinx", "PocketSphinxAligner"),
        "textgrid": ("app.align.textgrid_folder", "TextGridAligner"),
        "xmlrpc": ("app.align.xmlrpc", "XmlRpcAligner"),
        "mock": ("app.align.mock", "MockAligner"),
    },
    protocol=Aligner,
    broken=AlignmentFailed,
    section="align.aligners",
)

names = _PLUGINS.names
create = _PLUGINS.create
