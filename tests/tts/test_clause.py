from app.tts.clause import LONGEST_SPOKEN, Clause, Place, cut
from app.tts.verbalise import Reading, verbalise


def test_what_is_long_when_spoken_is_cut_between_words() -> None:
    text = " ".join(["1234567"] * 20)
    clause = Clause(text, 0.3, verbalise(text), marks=(Place("last", 19), Place("end", 20)))
    parts = list(cut(clause))
    assert len(parts) > 1
    assert all(len(part.spoken) <= LONGEST_SPOKEN for part in parts)
    assert " ".join(part.text for part in parts) == text
    assert [part.pause for part in parts] == [0.0] * (len(parts) - 1) + [0.3]
    count = len(parts[-1].readings)
    assert parts[-1].marks == (Place("last", count - 1), Place("end", count))
    assert all(not part.marks for part in parts[:-1])


def test_a_word_that_is_said_in_two_ways_cuts() -> None:
    readings = tuple(Reading(word, word) for word in ("I", "read", "and", "read", "it"))
    clause = Clause("I read and read it", 0.3, readings)
    first, second = cut(clause, {1: ("read", ("R", "EH", "D"))})
    assert (first.text, dict(first.lexicon)) == ("I read and", {"read": ("R", "EH", "D")})
    assert (second.text, dict(second.lexicon)) == ("read it", {})
    (whole,) = cut(clause, {1: ("read", ("R", "EH", "D")), 3: ("read", ("R", "EH", "D"))})
    assert whole.text == clause.text
    assert list(cut(clause)) == [clause]


def test_spoken_is_what_there_is_to_say() -> None:
    assert Clause("a — b", 0.0, (Reading("a", "a"), Reading("—", ""), Reading("b", "b."))).spoken == "a b."
