"""Plug-ins by name: ours, imported only when asked for, and those that other packages announce by entry points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from app.errors import MaryError, MissingExtra, NotFound

Plugin = TypeVar("Plugin")


@dataclass(frozen=True)
class Plugins(Generic[Plugin]):
    """The plug-ins of one kind.

    Attributes:
        kind: what one is called in messages, e.g. "speech engine".
        group: of the entry points that other packages announce theirs in.
        field: of a request or the settings that names one.
        ours: name to (module, class).
        protocol: what each of them must be.
        broken: the error that one of them is something else.
    """

    kind: str
    group: str
    field: str
    ours: Mapping[str, tuple[str, str]]
    protocol: Any  # type[Plugin], which a protocol is not for mypy
    broken: type[MaryError]

    def names(self) -> tuple[str, ...]:
        """Names of all that can be made, ours first."""
        return (*self.ours, *sorted(set(self._theirs()) - set(self.ours)))

    def create(self, name: str) -> Plugin:
        """A new one, called without arguments.

        Raises:
            NotFound: none of this name; the advice lists the known ones.
            MissingExtra: a library that it needs is not installed.
            MaryError: of the kind `broken`: what is called so is none; the message says what it lacks.
        """
        made = self._made(name)
        if not isinstance(made, self.protocol):
            members = [each for each in {**vars(self.protocol), **self.protocol.__annotations__} if each[0] != "_"]
            lacking = ", ".join(each for each in members if not hasattr(made, each))
            raise self.broken(
                f"{name} is no {self.kind}: {type(made).__name__} lacks {lacking}",
                advice=f"Correct the entry point {name} in the group {self.group}.",
            )
        plugin: Plugin = made
        return plugin

    def _made(self, name: str) -> Any:
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
