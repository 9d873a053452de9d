import pytest

from app.tts.reading.amounts import amount, magnitude, money, sign, slashed, unit, vulgar


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("$3.50", "three dollars and fifty cents"),
        ("$1", "one dollar"),
        ("$1.01", "one dollar and one cent"),
        ("$0.99", "ninety nine cents"),
        ("$0.00", "zero dollars"),
        ("$3.5", "three point five dollars"),
        ("-$5", "minus five dollars"),
        ("$-5", "minus five dollars"),
        ("$1,234.56", "one thousand two hundred thirty four dollars and fifty six cents"),
        ("£1.2bn", "one point two billion pounds"),
        ("£0.50", "fifty pence"),
        ("€5", "five euros"),
        ("5€", "five euros"),
        ("¥500", "five hundred yen"),
        ("$5-10", "five to ten dollars"),
        ("$5-$10", "five to ten dollars"),
        ("US$5", "five U.S dollars"),
        ("$100/month", "one hundred dollars per month"),
        ("$3M", "three million dollars"),
        ("5", ""),
        ("$", ""),
    ],
)
def test_money(written: str, said: str) -> None:
    assert money(written) == (said, "")


def test_money_with_a_magnitude_behind_it() -> None:
    assert money("$3", "million") == ("three", "million dollars")
    assert magnitude("bn") == "billion"
    assert magnitude("hello") == ""


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("5km", "five kilometers"),
        ("1km", "one kilometer"),
        ("-20°C", "minus twenty degrees Celsius"),
        ("90°", "ninety degrees"),
        ("60mph", "sixty miles per hour"),
        ("3.5kg", "three point five kilograms"),
        ("50%", "fifty percent"),
        ("5-10%", "five to ten percent"),
        ("50m²", "fifty square meters"),
        ("50m2", "fifty square meters"),
        ("2.4GHz", "two point four gigahertz"),
        ("5in", "five inches"),
        ("5", ""),
        ("5xyz", ""),
    ],
)
def test_amounts(written: str, said: str) -> None:
    assert amount(written) == said


def test_units_apart() -> None:
    assert unit("in", single=False) == "inches"
    assert unit("in", single=False, apart=True) == ""
    assert unit("km", single=True, apart=True) == "kilometer"
    assert unit("m³", single=False) == "cubic meters"
    assert unit("2", single=False) == ""
    assert sign("±") == "plus or minus "


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("1/2", "one half"),
        ("3/4", "three quarters"),
        ("-2/3", "minus two thirds"),
        ("24/7", "twenty four seven"),
        ("9/11", "nine eleven"),
        ("11/24", "eleven over twenty four"),
        ("1/0", "one over zero"),
        ("1/2/3", ""),
    ],
)
def test_slashes(written: str, said: str) -> None:
    assert slashed(written) == said


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("½", "one half"),
        ("1½", "one and a half"),
        ("2¾", "two and three quarters"),
        ("2½km", "two and a half kilometers"),
        ("½km", "one half of a kilometer"),
        ("½x", ""),
        ("x", ""),
    ],
)
def test_vulgar_fractions(written: str, said: str) -> None:
    assert vulgar(written) == said
