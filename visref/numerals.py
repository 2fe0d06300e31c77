"""Numbers as people and programs write them in text: ASCII digits, and nothing that only Python
reads.

Python's own `int` and `float` take `1_0` for ten, digits of every script, and blanks around; then
a file means one thing here and another, or nothing, in the engine that wrote it.
"""

from __future__ import annotations

import re
from typing import Any

_WHOLE = re.compile(r"[+-]?[0-9]{1,18}", re.ASCII)
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,9})?", re.ASCII)
# As the C library prints what is no number.
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE | re.ASCII)


def whole_number(text: str) -> int:
    """A whole number of 18 digits at most, with a sign or without. Raises ValueError."""
    if not _WHOLE.fullmatch(text):
        raise ValueError(f"{text[:40]!r} is not a whole number")
    return int(text)


def decimal_number(text: str, *, finite: bool = True) -> float:
    """A decimal number, with an exponent or without; unless `finite`, NaN and the infinities
    too. Raises ValueError, and for what is too large for float64 where it is to be finite."""
    known = _DECIMAL.fullmatch(text) or (not finite and _NOT_FINITE.fullmatch(text))
    value = float(text) if known and len(text) <= 4096 else float("nan")
    if not known or len(text) > 4096 or (finite and abs(value) == float("inf")):
        raise ValueError(f"{text[:40]!r} is not a number")
    return value


def as_whole(value: Any) -> Any:
    """A whole number that was written as 3.0, as some languages do, as what it is: an int. Any
    other value as it is."""
    return int(value) if isinstance(value, float) and value.is_integer() else value
