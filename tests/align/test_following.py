import pytest

from app.align.dictionary import Dictionary
from app.align.following import Follower, Place

TEXT = "The quick brown fox jumps over the lazy dog and runs away through the dark green forest"


def follower(text: str = TEXT) -> Follower:
    return Follower(Dictionary().read(text))


def numbers(places: list[Place]) -> list[tuple[int, ...]]:
    return [place.numbers for place in places]


def one_by_one(following: Follower, heard: list[str], ahead: int = 2) -> list[tuple[int, ...]]:
    """Places when each phone is settled as soon as `ahead` more have been heard."""
    result = []
    for at in range(len(heard)):
        result.append(following.follow(heard[at : at + ahead + 1], 1)[0].numbers)
    return result


def test_what_is_heard_right_goes_through_the_text() -> None:
    following = follower()
    assert one_by_one(following, following.symbols) == [(n,) for n in range(len(following.symbols))]
    assert not following.lost


def test_phones_heard_wrong_take_those_of_the_text() -> None:
    following = follower()
    heard = list(following.symbols)
    heard[4], heard[11], heard[20] = "T", "AH", "V"
    assert one_by_one(following, heard) == [(n,) for n in range(len(heard))]


def test_a_phone_that_was_not_heard_is_shown_with_its_neighbour_and_one_too_many_with_none() -> None:
    following = follower()
    heard = list(following.symbols)
    del heard[10]
    heard.insert(20, "HH")
    result = one_by_one(following, heard)
    flat = [n for place in result for n in place]
    assert flat == list(range(len(following.symbols)))
    assert result[20] == ()


def test_what_is_not_settled_comes_again() -> None:
    following = follower()
    first = following.follow(following.symbols[:6], 2)
    again = following.follow(following.symbols[2:6], 4)
    assert numbers(first)[2:] == numbers(again) == [(2,), (3,), (4,), (5,)]


def test_another_text_is_given_up_and_found_again() -> None:
    following = follower()
    other = follower("Seven sheep ate my yellow umbrella before Easter").symbols
    result = one_by_one(following, other)
    assert following.lost
    assert all(place == () for place in result[-8:])
    back = following.symbols[12:40]
    found = one_by_one(following, back, ahead=4)
    assert not following.lost
    assert found[-10:] == [(n,) for n in range(30, 40)]


def test_a_word_that_is_left_out_does_not_lose_the_text() -> None:
    following = follower()
    heard = following.symbols[:9] + following.symbols[13:]
    result = one_by_one(following, heard)
    assert result[-10:] == [(n,) for n in range(len(following.symbols) - 10, len(following.symbols))]
    assert all(len(place) <= 3 for place in result)


def test_without_a_text_there_are_no_places() -> None:
    assert numbers(follower("").follow(["M", "AA"], 2)) == [(), ()]


def test_behind_the_end_of_the_text_it_is_lost() -> None:
    following = follower("hello")
    one_by_one(following, following.symbols)
    one_by_one(following, ["S", "K", "IY", "T", "S", "AW", "K", "SH"])
    assert following.lost


@pytest.mark.parametrize("heard", [[], ["M"]])
def test_few_phones_do_no_harm(heard: list[str]) -> None:
    assert len(follower().follow(heard, len(heard))) == len(heard)
