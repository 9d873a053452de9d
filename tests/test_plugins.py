from __future__ import annotations

from dataclasses import replace
from typing import Protocol, runtime_checkable

import pytest
from pydantic import BaseModel, ConfigDict

from app.errors import ConfigError, MissingExtra, NotFound
from app.plugins import Plugins


@runtime_checkable
class Kettle(Protocol):
    lid: str

    def append(self, what: object) -> None: ...


SHELF: Plugins[Kettle] = Plugins(
    kind="kettle",
    group="mary.no-such-group",
    field="kitchen",
    ours={
        "kettle": ("types", "SimpleNamespace"),
        "list": ("builtins", "list"),
        "lost": ("no_such", "Kettle"),
        "pan": (__name__, "Pan"),
    },
    protocol=Kettle,
    broken=ConfigError,
)


class Pan:
    lid = "flat"

    def append(self, what: object) -> None: ...


def test_one_of_ours_is_made_anew_each_time() -> None:
    assert SHELF.create("pan").lid == "flat"
    assert SHELF.create("pan") is not SHELF.create("pan")


@pytest.mark.parametrize(("name", "lacks"), [("list", "list lacks lid"), ("kettle", "lacks append, lid")])
def test_one_that_is_something_else_is_told_what_it_lacks(name: str, lacks: str) -> None:
    with pytest.raises(ConfigError, match=lacks) as caught:
        SHELF.create(name)
    assert "mary.no-such-group" in caught.value.advice


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(NotFound, match="no kettle 'pot'") as caught:
        SHELF.create("pot")
    assert (caught.value.field, caught.value.advice) == ("kitchen", "Known: kettle, list, lost, pan.")


def test_a_missing_library_is_named() -> None:
    with pytest.raises(MissingExtra, match="kettle lost needs no_such"):
        SHELF.create("lost")


class Stove:
    lid = "iron"

    class Options(BaseModel):
        model_config = ConfigDict(extra="forbid")
        heat: float = 1.0

    def __init__(self, options: Options) -> None:
        self.heat = options.heat

    def append(self, what: object) -> None: ...


HEATED: Plugins[Kettle] = replace(
    SHELF, section="kitchen.kettles", ours={"stove": (__name__, "Stove"), "pan": (__name__, "Pan")}
)


def test_options_are_checked_and_handed_over() -> None:
    assert HEATED.create("stove").heat == 1.0  # type: ignore[attr-defined]
    assert HEATED.create("stove", {"heat": 3}).heat == 3.0  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "options", "field"),
    [
        ("stove", {"heat": "red"}, "kitchen.kettles.stove.heat"),
        ("stove", {"cold": 1}, "kitchen.kettles.stove.cold"),
        ("pan", {"heat": 1}, "kitchen.kettles.pan"),
    ],
)
def test_wrong_options_name_their_key(name: str, options: dict[str, object], field: str) -> None:
    with pytest.raises(ConfigError, match=field) as caught:
        HEATED.create(name, options)
    assert caught.value.field == field
