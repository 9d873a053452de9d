from app.tts.reading.word_list import these


def test_these() -> None:
    assert these("one two  two") == {"one", "two"}
