"""Numbers in words, and words as numbers: lengths, times, shares and amounts of work.

The pages have a twin of `length` and `per_cent`, in JavaScript.
"""

from decimal import Decimal, InvalidOperation

LENGTHS = {"m": 0, "cm": -2, "mm": -3, "µm": -6, "nm": -9, "pm": -12}  # powers of 10, in m
TIMES = {"s": 0, "ms": -3, "µs": -6}  # in s
MICRO = "u", "\N{GREEK SMALL LETTER MU}"  # letters that are typed for µ


def in_digits(x, many):
    """The number x, rounded to so many digits."""
    return float(f"{x:.{many}g}")


def length(x, digits=2):
    """Metres x in digits and a unit, 0.384 as "38 cm"; below a picometre "< 1 pm"."""
    if x < 1e-12:
        return "< 1 pm"
    x = in_digits(x, digits)
    for unit, power in LENGTHS.items():
        size = in_digits(float(Decimal(x).scaleb(-power)), digits)
        if size >= 1.0:
            return f"{size:g} {unit}"
    return f"{1e12 * x:g} pm"


def tolerance(x):
    """A tolerance of x m as one would say it: 0.001 is "1 mm"."""
    return length(x, 6)


def milliseconds(dt):
    """A time dt in s, three digits of it: 0.04 is "40 ms"."""
    return f"{in_digits(1e3 * dt, 3):g} ms"


def per_cent(share):
    """A share in per cent, two digits."""
    return f"{in_digits(100.0 * share, 2):g} %"


def amount(x, digits=3):
    """A number of so many digits, with its thousands apart: 149,000 or 0.331."""
    x = in_digits(x, digits)
    return f"{x:,.0f}" if x >= 10.0 ** (digits - 1) else f"{x:g}"


def sentence(clause):
    """A clause as a sentence."""
    return f"{clause[0].upper()}{clause[1:]}."


def parsed(text, units):
    """The number in a text such as 0.5mm or 2 cm, whose unit is one of `units` or missing.

    Raises ValueError if there is none.
    """
    for letter in MICRO:
        text = text.replace(letter, "µ")
    digits = text.rstrip(" " + "".join(units))
    unit = text.removeprefix(digits).strip()
    try:
        power = units[unit] if unit else 0
        return float(Decimal(digits).scaleb(power))
    except (KeyError, InvalidOperation, OverflowError):
        raise ValueError(text) from None
