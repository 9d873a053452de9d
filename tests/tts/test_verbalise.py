import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.tts.text import clean
from app.tts.verbalise import verbalise


def said(text: str) -> str:
    return " ".join(reading.spoken for reading in verbalise(clean(text).text) if reading.spoken)


@pytest.mark.parametrize(
    ("written", "spoken"),
    [
        # dates and times
        ("Meet me on Jan. 5th at 10:30 pm.", "Meet me on January fifth at ten thirty P.M."),
        ("Born May 5, 1990, in Rome", "Born May fifth, nineteen ninety, in Rome"),
        ("5 January 2026", "the fifth of January twenty twenty six"),
        ("the 5 January", "the fifth of January"),
        ("the 5th of May", "the fifth of May"),
        ("Mon. 5 Jan. 2026", "Monday the fifth of January twenty twenty six"),
        ("on 2026-11-24.", "on November twenty fourth, twenty twenty six."),
        ("11/24/2026?", "November twenty fourth, twenty twenty six?"),
        ("in 1999, 2005 and 1066", "in nineteen ninety nine, two thousand five and ten sixty six"),
        ("the 1990s, the '80s", "the nineteen nineties, the eighties"),
        ("at 14:05, 7:00 or 7 o'clock", "at fourteen oh five, seven o'clock or seven o'clock"),
        ("7pm, 10 a.m. or 3 p.m. today", "seven P.M, ten A.M or three P.M today"),
        ("at 3 p.m.", "at three P.M."),
        ("I may go", "I may go"),
        # money, units, numbers
        ("$3.50, $3 million and €5", "three dollars and fifty cents, three million dollars and five euros"),
        ("£1.2bn (or $0.99)", "one point two billion pounds (or ninety nine cents)"),
        ("5 USD, 100 €", "five dollars, one hundred euros"),
        ("EUR 5, USD 1 and GBP 2 million", "five euros, one dollar and two million pounds"),
        ("5 km at 20 °C", "five kilometers at twenty degrees Celsius"),
        ("60 mph and 3kg", "sixty miles per hour and three kilograms"),
        ("1 km", "one kilometer"),
        ("5 million km", "five million kilometers"),
        ("5 in the box", "five in the box"),
        ("-5 degrees, ±3, ~10, +4", "minus five degrees, plus or minus three, about ten, plus four"),
        ("50% of 1,234.5", "fifty percent of one thousand two hundred thirty four point five"),
        ("3/4, 1½ and 3 1/2 cups", "three quarters, one and a half and three and a half cups"),
        ("1½ km, ½ mile", "one and a half kilometers, one half mile"),
        ("pages 3–5, 5-10%", "pages three to five, five to ten percent"),
        ("3 x 4, 3 * 4, 3 - 2", "three by four, three times four, three minus two"),
        ("2026 people came", "two thousand twenty six people came"),
        ("the 1st, 22nd and 100th", "the first, twenty second and one hundredth"),
        ("1234567812345678", " ".join(["one", "two", "three", "four", "five", "six", "seven", "eight"] * 2)),
        ("3.2e-5, -1e6.", "three point two times ten to the minus five, minus one times ten to the six."),
        ("1.000.000 euros, €1.000.000,50", "one million euros, one million euros and fifty cents"),
        ("10'000 km, -1'234'567.5", "ten thousand kilometers, minus one million two hundred thirty four thousand five "
         "hundred sixty seven point five"),
        ("v1.200.300, 10.100.100.101", "version one point two hundred point three hundred, ten dot one hundred dot one "
         "hundred dot one hundred one"),
        ("$5M–$10M, $500K-$1M", "five million to ten million dollars, five hundred thousand to one million dollars"),
        ("$5-10M, €5–€10, $1-$2 million", "five to ten million dollars, five to ten euros, one to two million dollars"),
        ("20%–30% of the 2nd–3rd", "twenty to thirty percent of the second to third"),
        ("10am–5pm. 9-5pm.", "ten A.M to five P.M. nine to five P.M."),
        ("2026/11/24, 3-5-1999", "November twenty fourth, twenty twenty six, March fifth, nineteen ninety nine"),
        # headings
        ("II. Main", "two. Main"),
        ("IV) main, V. Main", "four) main, V Main"),
        # telephones
        ("Call 555-123-4567.", "Call five five five, one two three, four five six seven."),
        ("(555) 123-4567", "five five five, one two three, four five six seven"),
        ("555 123 4567 now", "five five five, one two three, four five six seven now"),
        ("+44 20 7946 0958", "plus four four, two zero, seven nine four six, zero nine five eight"),
        ("call 911 now", "call nine one one now"),
        ("rows 5 6 7", "rows five six seven"),
        # addresses
        ("See https://www.example.org/a.", "See example dot org slash a."),
        ("http:// or (https://).", "H.T.T.P or (H.T.T.P.S)."),
        ("mail jane.doe@example.org, please", "mail jane dot doe at example dot org, please"),
        ("#HelloWorld by @jane_doe", "hashtag Hello World by at jane underscore doe"),
        # letters and names
        ("NASA and the FBI", "Nasa and the F.B.I"),
        ("CDs, APIs and the AI's role", "C D's, A.P I's and the A-I's role"),
        ("The U.S. Army in the U.S.", "The U.S Army in the U.S."),
        ("J. R. R. Tolkien", "J R R Tolkien"),
        ("STOP THE CAR NOW", "stop the car now"),
        ("I said STOP", "I said Stop"),
        ("Chapter IV of Henry VIII in World War II", "Chapter four of Henry the eighth in World War two"),
        ("World War I, but I think so", "World War one, but I think so"),
        ("vitamin C, plan B, I, a", "vitamin C, plan B, I, a"),
        ("Dr. Smith of Elm Dr.", "Doctor Smith of Elm Drive."),
        ("St. Paul on Main St. today", "Saint Paul on Main Street today"),
        ("Mr. and Mrs. Jones vs. Ms. Lee", "Mister and Missus Jones versus Miz Lee"),
        ("e.g. this, i.e. that, etc.", "for example this, that is that, et cetera."),
        ("No. 5 and fig. 3", "number five and figure three"),
        ("No. I will not.", "No. I will not."),
        ("R&D for C++ and C#", "R and D for C plus plus and C sharp"),
        ("COVID-19 on F-16", "Covid nineteen on F sixteen"),
        # punctuation and marks
        ("\"Hello,\" she said (softly).", "Hello, she said (softly)."),
        ("'Tis the dogs' toy", "Tis the dogs' toy"),
        ("Wait... what?! — Yes", "Wait... what?! — Yes"),
        ("**Bold** and `code`", "Bold and code"),
        ("and/or, w/o", "and or, without"),
        ("a | b", "a b"),
        ("[1] x{2}", "one x two"),
        ("end.Next", "end. Next"),
    ],
)  # fmt: skip
def test_readings(written: str, spoken: str) -> None:
    assert said(written) == spoken


def test_every_written_word_has_its_spoken_ones() -> None:
    readings = verbalise("On Jan. 5th it cost $3 million, not 5 USD.")
    assert [(reading.text, reading.spoken) for reading in readings if not reading.as_written] == [
        ("Jan.", "January"),
        ("5th", "fifth"),
        ("$3", "three"),
        ("million,", "million dollars,"),
        ("5", "five"),
        ("USD.", "dollars."),
    ]
    assert [reading.text for reading in readings if reading.as_written] == ["On", "it", "cost", "not"]


def test_words_with_a_pronunciation_of_their_own_are_left_alone() -> None:
    assert [reading.spoken for reading in verbalise("NASA's FBI, (4K) $5!", own={"fbi", "4k", "$5"})] == [
        "Nasa's",
        "FBI,",
        "(4K)",
        "$5!",
    ]


LETTERS_ONLY = re.compile(r"[^\d_$€£%&@#+=<>/\\{}\[\]|*^~\"]*")
BITS = [
    "5", "12", "1,000", ".5", "3.50", "$", "€", "%", "½", "²", "°C", " km", "/", "-", "—", ":", "30", " pm",
    " a.m.", "Jan. ", "May ", "5th", "2026", "St. ", "Dr. ", "NASA", "CDs", "IV", " I ", "www.", "example.com", "@",
    "#", "(", ")", '"', "'", "s", "x", "X", "+", "*", "_", "&", " ", "  ", "USD", " million", "é", "你", "\u0301",
    "٣", "①", "\n", "|", "\\", ".", "...", "555", "-1234", "A", "b.", "~", "=", "<", ">", "^", "[", "]", "!", "'s",
    "1e-", "e", "'000", ".000", "2nd-", "am-", "%-", "II. ", "://",
]  # fmt: skip
MESS = st.lists(st.sampled_from(BITS), max_size=40).map("".join)


@settings(deadline=None)
@given(st.one_of(MESS, st.text(max_size=80)))
def test_any_text_is_read_as_plain_words(raw: str) -> None:
    for text in (raw, clean(raw).text):
        readings = verbalise(text)
        assert " ".join(reading.text for reading in readings).split() == text.split()
    for reading in readings:
        assert LETTERS_ONLY.fullmatch(reading.spoken), reading
        assert any(map(str.isalnum, reading.spoken)) or not any(map(str.isalnum, reading.text)), reading


@pytest.mark.parametrize("bit", [*BITS, "a.", "1,", "1-", "1/", "A.", "+1 ", "(1", "$1-", "a@", "x/", "5 "])
def test_long_words_and_lines_are_read_in_good_time(bit: str) -> None:
    for text in ((bit * 4000)[:20_000], (bit * 200)[:199] + "\x00", " ".join([(bit * 200)[:200]] * 50)):
        verbalise(text)
