from __future__ import annotations

import re
from http import HTTPStatus

import pytest

from app import errors
from app.api import problems
from app.errors import MaryError

ALL = [each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, MaryError)]


@pytest.mark.parametrize("kind", ALL)
def test_every_error_is_in_the_tree_of_the_docstring(kind: type[MaryError]) -> None:
    assert re.search(rf"\b{kind.__name__}\b", errors.__doc__ or "")


@pytest.mark.parametrize("kind", ALL)
def test_every_error_has_an_http_status_and_a_title(kind: type[MaryError]) -> None:
    assert HTTPStatus(kind.status) >= 400
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", kind.slug)
    assert kind.title


def test_slugs_are_unique() -> None:
    slugs = [kind.slug for kind in ALL]
    assert len(slugs) == len(set(slugs))


NOT_ANSWERED = (errors.ConfigError, errors.TrainingFailed, errors.TrainingStopped)
"""Errors of the command line alone."""


@pytest.mark.parametrize("kind", [kind for kind in ALL if kind not in NOT_ANSWERED])
def test_every_error_that_can_be_answered_is_explained(kind: type[MaryError]) -> None:
    assert kind.slug in problems.EXPLANATIONS


def test_message_advice_and_field_are_kept() -> None:
    error = errors.NotFound("no voice 'x'", advice="Take y.", field="voice")
    assert (str(error), error.message, error.advice, error.field) == (
        "no voice 'x'",
        "no voice 'x'",
        "Take y.",
        "voice",
    )
