from __future__ import annotations

import pytest

from app.errors import MissingExtra, NotFound
from app.plugins import Plugins

SHELF = Plugins(
    "kettle", "mary.no-such-group", "kitchen", {"list": ("builtins", "list"), "lost": ("no_such", "Kettle")}
)


def test_one_of_ours_is_made_anew_each_time() -> None:
    assert SHELF.make("list") == []
    assert SHELF.make("list") is not SHELF.make("list")


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(NotFound, match="no kettle 'pot'") as caught:
        SHELF.make("pot")
    assert (caught.value.field, caught.value.advice) == ("kitchen", "Known: list, lost.")


def test_a_missing_library_is_named() -> None:
    with pytest.raises(MissingExtra, match="kettle lost needs no_such"):
        SHELF.make("lost")
