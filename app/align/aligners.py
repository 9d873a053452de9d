"""The aligners of a service, each made when it is first needed and then kept: a process of its own takes 0.2 GB."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from app.align import registry
from app.align.aligner import Aligner


class Aligners:
    """Aligners by name. Safe from any thread; to be closed.

    Args:
        options: of each, by name (`align.aligners`).
    """

    def __init__(self, options: Mapping[str, Mapping[str, Any]] | None = None) -> None:
        self._options = options or {}
        self._lock = threading.Lock()
        self._made: dict[str, Aligner] = {}

    def get(self, name: str) -> Aligner:
        """The aligner of this name; raises as `app.align.registry.create` does."""
        with self._lock:
            if name not in self._made:
                self._made[name] = registry.create(name, self._options.get(name, {}))
            return self._made[name]

    def close(self) -> None:
        """End what works in a process of its own; an alignment in work fails. They can be used again afterwards."""
        with self._lock:
            made = list(self._made.values())
        for aligner in made:
            close: Callable[[], None] | None = getattr(aligner, "close", None)
            if close is not None:
                close()
