"""Plug-ins by name: ours, imported only when asked for, and those that other packages announce by entry points.

A plug-in that has settings holds a pydantic model of them, called `Options`, and is made with one of these; one
without is made with nothing. Its section of the settings is checked against that model before anything is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ValidationError

from app.errors import ConfigError, MaryError, MissingExtra, NotFound

Plugin = TypeVar("Plugin")

_NONE: Mapping[str, Any] = {}


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
        section: of the settings that holds their options by name, e.g. "speech.engines"; empty: they have none.
    """

    kind: str
    group: str
    field: str
    ours: Mapping[str, tuple[str, str]]
    protocol: Any  # type[Plugin], which a protocol is not for mypy
    broken: type[MaryError]
    section: str = ""

    def names(self) -> tuple[str, ...]:
        """Names of all that can be made, ours first."""
        return (*self.ours, *sorted(set(self._theirs()) - set(self.ours)))

    def create(self, name: str, options: Mapping[str, Any] = _NONE) -> Plugin:
        """A new one.

        Args:
            name: of the plug-in.
            options: its section of the settings.

        Raises:
            NotFound: none of this name; the advice lists the known ones.
            MissingExtra: a library that it needs is not installed.
            ConfigError: an option is unknown or wrong; names it.
            MaryError: of the kind `broken`: what is called so is none; the message says what it lacks.
        """
        made = self._made(name, options)
        if not isinstance(made, self.protocol):
            members = [each for each in {**vars(self.protocol), **self.protocol.__annotations__} if each[0] != "_"]
            lacking = ", ".join(each for each in members if not hasattr(made, each))
            raise self.broken(
                f"{name} is no {self.kind}: {type(made).__name__} lacks {lacking}",
                advice=f"Correct the entry point {name} in the group {self.group}.",
            )
        plugin: Plugin = made
        return plugin

    def _made(self, name: str, options: Mapping[str, Any]) -> Any:
        try:
            if name in self.ours:
                module, attribute = self.ours[name]
                return self._with_options(name, getattr(import_module(module), attribute), options)
            if name in (theirs := self._theirs()):
                return self._with_options(name, theirs[name].load(), options)
        except ImportError as error:
            raise MissingExtra(
                f"{self.kind} {name} needs {error.name or error}, which is not installed",
                advice=f"pip install 'mary[{name}]' or the package that {name} comes from.",
                field=self.field,
            ) from error
        raise NotFound(
            f"there is no {self.kind} {name!r}", field=self.field, advice=f"Known: {', '.join(self.names())}."
        )

    def _with_options(self, name: str, plugin: Any, options: Mapping[str, Any]) -> Any:
        model: type[BaseModel] | None = getattr(plugin, "Options", None)
        if model is None:
            if options:
                key = f"{self.section}.{name}"
                raise ConfigError(f"{key}: {name} has no options", field=key, advice=f"Leave {key} out.")
            return plugin()
        try:
            checked = model.model_validate(dict(options))
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, (self.section, name, *first["loc"])))
            known = ", ".join(model.model_fields)
            message = first["msg"].removeprefix("Value error, ")
            raise ConfigError(f"{key}: {message}", field=key, advice=f"Options of {name}: {known}.") from error
        return plugin(checked)

    def _theirs(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=self.group)}
