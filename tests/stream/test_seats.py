from __future__ import annotations

import pytest

from app.errors import OverCapacity
from app.stream.seats import Seats


def test_seats_are_taken_and_given_back() -> None:
    seats = Seats(2, "viewers of this stream")
    with seats.one(), seats.one():
        with pytest.raises(OverCapacity, match="there are 2 viewers of this stream"):
            seats.check()
        with pytest.raises(OverCapacity), seats.one():
            pass
        assert seats.taken == 2
    seats.check()
    assert seats.taken == 0


def test_a_seat_is_given_back_after_an_error() -> None:
    seats = Seats(1, "viewers")
    with pytest.raises(KeyError), seats.one():
        raise KeyError
    assert seats.taken == 0
