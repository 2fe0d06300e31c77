"""Numbers in text, for the readers of ASCII formats: one grammar, `visref.numerals`, for whole
arrays at once."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.numerals import decimal_number, whole_number
from visref.scene import Float64

_BLANKS = b" \t\n\v\f\r"
_IS_BLANK = np.zeros(256, np.bool_)
_IS_BLANK[list(_BLANKS)] = True
_OF_NUMBERS = _IS_BLANK.copy()
# With the letters of nan, inf and infinity.
_OF_NUMBERS[list(b"+-.0123456789eEnaifptyNAIFPTY")] = True


def parsed(text: bytes, dtype: type) -> NDArray[Any] | None:
    """All numbers of a text, (n,) float64 or int64 as `dtype` says, separated by blanks; None
    where anything else stands in it, or a number is none by `visref.numerals`."""
    raw = np.frombuffer(text, np.uint8)
    blank = _IS_BLANK[raw]
    words = int(np.count_nonzero(blank[:-1] & ~blank[1:])) + int(len(raw) > 0 and not blank[0])
    if not words:
        return np.zeros(0, dtype)
    if not _OF_NUMBERS[raw].all():
        return None
    with warnings.catch_warnings():
        # NumPy stops at what is no number, and older versions only warn.
        warnings.simplefilter("error", DeprecationWarning)
        try:
            values: NDArray[Any] = np.fromstring(text, dtype, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    # NumPy takes "1-2" for two numbers.
    return values if len(values) == words else None


def is_number(word: bytes, dtype: type) -> bool:
    """Whether a word is a number of that kind."""
    try:
        text = word.decode("ascii")
        if dtype is np.int64:
            whole_number(text)
        else:
            decimal_number(text, finite=False)
    except ValueError:
        return False
    return True


def read_numbers(text: bytes) -> Float64:
    """All numbers of a text in which nothing else stands: (n,) float64.

    Raises InputError that names the first word which is no number.
    """
    values = parsed(text, np.float64)
    if values is not None:
        return values
    for word in text.split():
        if not is_number(word, np.float64):
            shown = ascii(word[:40].decode("latin-1"))
            raise InputError(f"{shown} is not a number", fix="export or copy it anew")
    raise InputError("its numbers are not separated by blanks", fix="export the file anew")
