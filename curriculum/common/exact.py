"""cos and sin whose digits are the same everywhere: those of libm depend on the processor."""

from decimal import Decimal, localcontext

TERMS = 100  # of the series
DIGITS = 50


def cos(angle):
    """The cosine of an angle in rad, a few turns at most."""
    return series(angle, 0)


def sin(angle):
    """The sine of an angle in rad, a few turns at most."""
    return series(angle, 1)


def series(angle, first):
    """angle^k / k! for k = first, first + 2, ..., with signs that alternate, summed."""
    with localcontext(prec=DIGITS):
        x = Decimal(float(angle))
        term = x if first else Decimal(1)
        total = term
        for k in range(first + 2, TERMS, 2):
            term = -term * x * x / (k * (k - 1))
            total += term
        return float(total)
