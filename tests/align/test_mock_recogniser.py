import numpy as np

from app.align.mock_recogniser import MockRecogniser
from app.align.recogniser import RATE, Recogniser, phones
from app.speech import SILENCE


def test_the_mouth_opens_and_closes_while_there_is_sound() -> None:
    recogniser = MockRecogniser()
    assert isinstance(recogniser, Recogniser)
    recogniser.warm_up()
    sound = np.zeros(RATE, np.float32)
    sound[RATE // 2 :] = 0.5 * np.sin(np.arange(RATE // 2))
    heard = recogniser.hear(sound)
    assert [each.symbol for each in heard] == ["AA", "M", "AA", "M", "AA"]
    assert heard[0].at >= 0.5
    assert heard == recogniser.hear(sound)
    assert [phone.symbol for phone in phones(heard, sound)][:2] == [SILENCE, "AA"]


def test_silence_is_silence() -> None:
    assert MockRecogniser().hear(np.zeros(RATE, np.float32)) == []
    assert MockRecogniser().hear(np.zeros(0, np.float32)) == []
