"""Money, percentages, units, ranges and fractions: numbers that stand for so much of something."""

from __future__ import annotations

import re

from app.tts.reading.numbers import PLAIN, cardinal, fraction, number, one

CURRENCIES: dict[str, tuple[str, str, str, str]] = {
    "$": ("dollar", "dollars", "cent", "cents"),
    "€": ("euro", "euros", "cent", "cents"),
    "£": ("pound", "pounds", "penny", "pence"),
    "¥": ("yen", "yen", "", ""),
    "₹": ("rupee", "rupees", "paisa", "paise"),
    "₩": ("won", "won", "", ""),
}
CODES: dict[str, str] = {"USD": "$", "EUR": "€", "GBP": "£", "JPY": "¥", "INR": "₹", "KRW": "₩"}
_COUNTRIES = {
    "US": "U.S",
    "A": "Australian",
    "AU": "Australian",
    "C": "Canadian",
    "CA": "Canadian",
    "NZ": "New Zealand",
}
_MAGNITUDES = {
    "k": "thousand", "thousand": "thousand", "m": "million", "mn": "million", "million": "million", "bn": "billion",
    "b": "billion", "billion": "billion", "trillion": "trillion", "tn": "trillion", "hundred": "hundred",
}  # fmt: skip
_PER = {
    "s": "second", "sec": "second", "min": "minute", "h": "hour", "hr": "hour", "day": "day", "week": "week",
    "wk": "week", "month": "month", "mo": "month", "year": "year", "yr": "year", "person": "person", "unit": "unit",
    "kg": "kilogram", "lb": "pound", "km": "kilometer", "l": "liter", "L": "liter", "m": "meter", "m²": "square meter",
    "kWh": "kilowatt hour", "hour": "hour", "minute": "minute", "second": "second", "gal": "gallon",
}  # fmt: skip

UNITS: dict[str, tuple[str, str]] = {
    "km": ("kilometer", "kilometers"), "m": ("meter", "meters"), "cm": ("centimeter", "centimeters"),
    "mm": ("millimeter", "millimeters"), "µm": ("micrometer", "micrometers"), "nm": ("nanometer", "nanometers"),
    "mi": ("mile", "miles"), "ft": ("foot", "feet"), "yd": ("yard", "yards"), "in": ("inch", "inches"),
    "kg": ("kilogram", "kilograms"), "g": ("gram", "grams"), "mg": ("milligram", "milligrams"),
    "µg": ("microgram", "micrograms"), "lb": ("pound", "pounds"), "lbs": ("pound", "pounds"),
    "oz": ("ounce", "ounces"), "t": ("ton", "tons"),
    "l": ("liter", "liters"), "L": ("liter", "liters"), "ml": ("milliliter", "milliliters"),
    "mL": ("milliliter", "milliliters"), "cl": ("centiliter", "centiliters"), "gal": ("gallon", "gallons"),
    "km/h": ("kilometer per hour", "kilometers per hour"), "kmh": ("kilometer per hour", "kilometers per hour"),
    "kph": ("kilometer per hour", "kilometers per hour"), "mph": ("mile per hour", "miles per hour"),
    "m/s": ("meter per second", "meters per second"), "kn": ("knot", "knots"),
    "Hz": ("hertz", "hertz"), "kHz": ("kilohertz", "kilohertz"), "MHz": ("megahertz", "megahertz"),
    "GHz": ("gigahertz", "gigahertz"),
    "W": ("watt", "watts"), "kW": ("kilowatt", "kilowatts"), "MW": ("megawatt", "megawatts"),
    "GW": ("gigawatt", "gigawatts"), "kWh": ("kilowatt hour", "kilowatt hours"),
    "MWh": ("megawatt hour", "megawatt hours"), "V": ("volt", "volts"), "kV": ("kilovolt", "kilovolts"),
    "mV": ("millivolt", "millivolts"), "A": ("amp", "amps"), "mA": ("milliamp", "milliamps"),
    "mAh": ("milliamp hour", "milliamp hours"), "J": ("joule", "joules"), "kJ": ("kilojoule", "kilojoules"),
    "cal": ("calorie", "calories"), "kcal": ("kilocalorie", "kilocalories"), "N": ("newton", "newtons"),
    "Pa": ("pascal", "pascals"), "kPa": ("kilopascal", "kilopascals"), "hPa": ("hectopascal", "hectopascals"),
    "bar": ("bar", "bars"), "psi": ("pound per square inch", "pounds per square inch"),
    "dB": ("decibel", "decibels"), "rpm": ("revolution per minute", "revolutions per minute"),
    "fps": ("frame per second", "frames per second"),
    "ms": ("millisecond", "milliseconds"), "µs": ("microsecond", "microseconds"), "ns": ("nanosecond", "nanoseconds"),
    "s": ("second", "seconds"), "sec": ("second", "seconds"), "min": ("minute", "minutes"), "h": ("hour", "hours"),
    "hr": ("hour", "hours"), "hrs": ("hour", "hours"), "yr": ("year", "years"), "yrs": ("year", "years"),
    "KB": ("kilobyte", "kilobytes"), "kB": ("kilobyte", "kilobytes"), "MB": ("megabyte", "megabytes"),
    "GB": ("gigabyte", "gigabytes"), "TB": ("terabyte", "terabytes"), "PB": ("petabyte", "petabytes"),
    "kbps": ("kilobit per second", "kilobits per second"), "Mbps": ("megabit per second", "megabits per second"),
    "Mbit/s": ("megabit per second", "megabits per second"), "Gbps": ("gigabit per second", "gigabits per second"),
    "Gbit/s": ("gigabit per second", "gigabits per second"),
    "px": ("pixel", "pixels"), "MP": ("megapixel", "megapixels"),
    "ha": ("hectare", "hectares"),
    "°C": ("degree Celsius", "degrees Celsius"), "°F": ("degree Fahrenheit", "degrees Fahrenheit"),
    "°": ("degree", "degrees"), "%": ("percent", "percent"), "¢": ("cent", "cents"),
    "°K": ("kelvin", "kelvins"),
}  # fmt: skip
_ONLY_TOUCHING = frozenset(["in", "A", "t", "N", "bar", "J", "MP"])  # "5 in the box": a word if a space is before it

_UNIT = "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
_SIGN = r"[-+±~]?"
_AMOUNT = re.compile(
    rf"({_SIGN})({PLAIN})(?:(?:-|\.\.\.)({_SIGN})({PLAIN}))?({_UNIT})([²³]|\^?[23])?(?:/([A-Za-z²]+))?\Z"
)
_MONEY = re.compile(
    rf"([-+~±]?)(US|AU?|CA?|NZ)?([$€£¥₹₩])(-?)({PLAIN})(k|K|mn|M|m|bn|B|b|tn)?"
    rf"(?:[-—]\2?\3?({PLAIN})(k|K|mn|M|m|bn|B|b|tn)?)?(?:/([A-Za-z²]+))?\Z"
)
_AFTER = re.compile(rf"({_SIGN})({PLAIN})(?:[-—]({PLAIN}))?(k|K|mn|M|m|bn|B|b|tn)?([$€£¥₹₩])\Z")
_FRACTION = re.compile(rf"({_SIGN})([0-9]{{1,4}})/([0-9]{{1,4}})\Z")
_SIGNS = {"": "", "-": "minus ", "+": "plus ", "±": "plus or minus ", "~": "about "}
_VULGAR = {"½": (1, 2), "¼": (1, 4), "¾": (3, 4)}
_WITH_VULGAR = re.compile(r"([0-9]*)([½¼¾])(.*)\Z", re.DOTALL)
_PLAYED = {"24/7": "twenty four seven", "9/11": "nine eleven", "50/50": "fifty fifty", "20/20": "twenty twenty"}


def sign(text: str) -> str:
    """``-`` as ``minus`` with a space behind it; nothing for no sign."""
    return _SIGNS.get(text, "")


def magnitude(text: str) -> str:
    """``million`` and its like, as words or letters; empty for others."""
    return _MAGNITUDES.get(text.lower(), "") if len(text) < 9 else ""


def money(text: str, following: str = "") -> tuple[str, str]:
    """An amount of money in one written word: ``$3.50``, ``£1.2bn``, ``5€``, ``$5-10``, ``$5M-$10M``, ``$9/month``.

    Args:
        following: the next written word if it is a magnitude ("million"), else empty.

    Returns:
        what is said for this word, and for the next one if it is a magnitude; both empty if this is no money.
    """
    per = few = ""
    if found := _MONEY.match(text):
        minus, country, symbol, low = found[1] or found[4], found[2], found[3], found[5]
        high, size, per = found[7], found[8] if found[7] else found[6], found[9]
        few = magnitude(found[6] or "") if high else ""  # of the lower one
    elif found := _AFTER.match(text):
        minus, country, symbol, low, high, size = found[1], None, found[5], found[2], found[3], found[4]
    else:
        return "", ""
    single, many, small, smalls = CURRENCIES[symbol]
    if country:
        single, many = (f"{_COUNTRIES[country]} {name}" for name in (single, many))
    said = sign(minus)
    if per:
        per = f" per {_PER.get(per, per)}"
    if following:
        return f"{said}{_span(low, high)}", f"{magnitude(following)} {many}"
    if size:
        return f"{said}{_span(low, high, few)} {magnitude(size)} {many}{per or ''}", ""
    if high:
        return f"{said}{_span(low, high, few)} {many}{per or ''}", ""
    units, _, cents = low.partition(".")
    if len(cents) != 2 or not small:
        return f"{said}{number(low)} {single if one(low) else many}{per or ''}", ""
    coins = f"{cardinal(int(cents))} {small if int(cents) == 1 else smalls}" if int(cents) else ""
    notes = f"{number(units)} {single if one(units) else many}" if units and (units != "0" or not coins) else ""
    return said + " and ".join(filter(None, (notes, coins))) + (per or ""), ""


def _span(low: str, high: str | None, few: str = "") -> str:
    """``five million to ten``; `few`: the magnitude of the lower number, if it is written."""
    return f"{number(low)}{' ' * bool(few)}{few} to {number(high)}" if high else number(low)


def amount(text: str) -> str:
    """A number with a unit or a percent sign in one word: ``5km``, ``-20°C``, ``5-10%``, ``50m²``; empty if none."""
    found = _AMOUNT.match(text)
    if not found:
        return ""
    low, high, name = found[2], found[4], found[5]
    said = sign(found[1]) + number(low)
    if high:
        said += f" to {sign(found[3])}{number(high)}"
    return f"{said} {unit(name + (found[6] or ''), single=one(low) and not high)}" + (
        f" per {_PER.get(found[7], found[7])}" if found[7] else ""
    )


def unit(text: str, *, single: bool, apart: bool = False) -> str:
    """The name of a unit, squared or cubed if it says so; empty if it is none.

    Args:
        single: for one of it.
        apart: a space stands between the number and it, so that words like "in" are words.
    """
    if len(text) > 8 or (apart and text in _ONLY_TOUCHING):
        return ""
    power = {"²": "square ", "2": "square ", "³": "cubic ", "3": "cubic "}.get(text[-1:], "")
    names = UNITS.get(text[:-1].rstrip("^") if power else text)
    return power + names[0 if single else 1] if names else ""


def slashed(text: str) -> str:
    """``3/4`` as ``three quarters``, ``24/7`` as it is called, ``11/24`` as ``eleven over twenty four``."""
    found = _FRACTION.match(text)
    if not found:
        return ""
    above, below = int(found[2]), int(found[3])
    if text in _PLAYED:
        return _PLAYED[text]
    if below >= 2 and (below <= 10 or below in (12, 16, 20, 32, 64, 100, 1000)) and above < 20:
        return sign(found[1]) + fraction(above, below)
    return f"{sign(found[1])}{cardinal(above)} over {cardinal(below)}"


def vulgar(text: str) -> str:
    """A number with one of ½ ¼ ¾ and perhaps a unit: ``1½``, ``½``, ``2½km``; empty if it is none."""
    found = _WITH_VULGAR.match(text)
    if not found:
        return ""
    part = fraction(*_VULGAR[found[2]])
    counted = ""
    if found[3] and not (counted := unit(found[3], single=not found[1])):
        return ""
    if found[1]:
        part = f"{number(found[1])} and {part.replace('one ', 'a ')}"
    elif counted:
        part, counted = (part, counted) if found[3] == "%" else (f"{part} of", f"a {counted}")
    return f"{part} {counted}".rstrip()
