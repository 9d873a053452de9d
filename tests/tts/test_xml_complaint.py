import pytest

from app.errors import InputError
from app.tts.ssml import parse


@pytest.mark.parametrize(
    ("document", "message", "advice"),
    [
        ("Hi", "line 1, column 1: no element begins here", "<speak>Hello.</speak>"),
        ("<speak><p>Hi", "line 1, column 13: the document ends, but p has not ended", "Write </p>."),
        ("<speak>\n<p>Hi</s></speak>", "line 2, column 8: another element than p ends", "Write </p> before."),
        ("<speak>a &euro; b</speak>", "line 1, column 10: the entity is not known", "&amp;"),
        ("<speak>a</speak> b", "line 1, column 18: something follows the end of speak", "one <speak>"),
        ("<speak>AT&T</speak>", "line 1, column 12: this is not well-formed XML", "Write & as &amp;"),
        ("<speak>1 < 2</speak>", "line 1, column 11: this is not well-formed XML", "< as &lt;"),
    ],
)
def test_what_is_not_well_formed_is_told_in_plain_words(document: str, message: str, advice: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(document)
    assert message in caught.value.message
    assert advice in caught.value.advice
