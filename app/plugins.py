"""Plug-ins by name: ours, imported only when asked for, and those that other packages announce by entry points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from app.errors import MissingExtra, NotFound


@dataclass(frozen=True)
class Plugins:
    """The plug-ins of one kind.

    Attributes:
        kind: what one is called in messages, e.g. "speech engine".
        group: of the entry points that other packages announce theirs in.
        field: of a request or the settings that names one.
        ours: name to (module, class).
    """

    kind: str
    group: str
    field: str
    ours: Mapping[str, tuple[str, str]]

    def names(self) -> tuple[str, ...]:
        """Names of all that can be made, ours first."""
        return (*self.ours, *sorted(set(self._theirs()) - set(self.ours)))

    def make(self, name: str) -> Any:
        """A new one, called without arguments; the caller checks that it is what it should be.

        Raises:
            NotFound: none of this name; the advice lists the known ones.
            MissingExtra: a library that it needs is not installed.
        """
        try:
            if name in self.ours:
                module, attribute = self.ours[name]
                return getattr(import_module(module), attribute)()
            if name in (theirs := self._theirs()):
                return theirs[name].load()()
        except ImportError as error:
            raise MissingExtra(
                f"{self.kind} {name} needs {error.name or error}, which is not installed",
                advice=f"pip install 'mary[{name}]' or the package that {name} comes from.",
                field=self.field,
            ) from error
        raise NotFound(
            f"there is no {self.kind} {name!r}", field=self.field, advice=f"Known: {', '.join(self.names())}."
        )

    def _theirs(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=self.group)}
