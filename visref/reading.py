"""Bytes and JSON from files, with an InputError for whatever is wrong with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError

Bytes = NDArray[np.uint8]


def map_file(path: Path) -> Bytes:
    """A file's bytes, mapped: what nobody looks at is not read.

    Raises InputError, without the file's name, if it is missing, empty or unreadable.
    """
    try:
        if path.is_dir():
            raise InputError("this is a folder, not a file", mend="give the file itself")
        if path.stat().st_size == 0:
            raise InputError("the file is empty", mend="give a complete file")
        return np.memmap(path, np.uint8, mode="r")
    except OSError as error:
        raise InputError(
            f"cannot read the file: {error.strerror}", mend="check its name and permissions"
        ) from error


def parse_json(data: bytes) -> Any:
    """Parsed JSON. Raises InputError with line and column.

    NaN and infinities pass, as Python's parser lets them: whoever reads the number knows its
    place and refuses it there.
    """
    mend = "mend the syntax there, or write the file anew"
    try:
        return json.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(
            "this is not UTF-8 text", mend="check that it is the right file"
        ) from error
    except json.JSONDecodeError as error:
        place = f"line {error.lineno} column {error.colno}"
        raise InputError(f"not valid JSON: {error.msg}", place=place, mend=mend) from error
    except (RecursionError, ValueError) as error:
        problem = "not valid JSON: lists too deep, or a number too long"
        raise InputError(problem, mend=mend) from error
