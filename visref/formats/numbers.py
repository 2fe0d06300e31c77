"""Numbers in text, for the readers of ASCII formats."""

from __future__ import annotations

import warnings

import numpy as np

from visref.errors import InputError
from visref.scene import Float64


def read_numbers(text: bytes) -> Float64:
    """All numbers of a text in which nothing else stands: (n,) float64, each as Python reads it.

    Raises InputError that names the first word which is no number.
    """
    with warnings.catch_warnings():
        # NumPy stops at what is no number, and older versions only warn.
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, np.float64, sep=" ") if text.strip() else np.zeros(0)
        except (ValueError, DeprecationWarning):
            pass
    for word in text.split():
        try:
            float(word)
        except ValueError as error:
            shown = word[:40].decode("utf-8", "replace")
            raise InputError(f"'{shown}' is not a number", fix="export or copy it anew") from error
    raise InputError("its numbers are not separated by blanks", fix="export the file anew")
