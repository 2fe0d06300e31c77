"""The one door through which a folder of records is read.

A record may come from anybody, so a file is read only if it is an ordinary one that lies in the
folder itself, whatever links say, and is no larger than such a file can be; and its JSON says each
thing once, in numbers and texts that mean something.
"""

from __future__ import annotations

import json
import math
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

from visref.errors import InputError

# The samples' definitions take about 1.2 kB for each view of a frame: 200,000 of them.
MAX_JSON_BYTES = 1 << 28
# A line is a witness with the triangles along its ray, some 500 bytes each.
MAX_LINE_BYTES = 1 << 24

# A character that no name has, written as JSON writes it: NUL, or half of a surrogate pair.
_TRAP = re.compile(r"\\u(?:0000|[dD][89a-fA-F])")
_NO_TEXT = re.compile("[\0\ud800-\udfff]")
# More digits than an int64 has; longer ones take Python's integers ever more time.
_MAX_DIGITS = 20


def file_inside(folder: Path, name: str, fix: str) -> Path:
    """The file of this name in a folder. Raises InputError if there is none, if it is no ordinary
    file (a folder, a pipe, a device), or if a link leads out of the folder. Never waits."""
    file = folder / name

    def refused(problem: str) -> InputError:
        return InputError(problem, source=str(file), fix=fix)

    try:
        home, real = folder.resolve(strict=True), file.resolve(strict=True)
        kind = real.stat().st_mode
    except OSError as error:
        raise refused(f"cannot read it: {error.strerror}") from error
    except (RuntimeError, ValueError) as error:
        # A circle of links, or a name that no file can have.
        raise refused("cannot read it: there is no such file") from error
    if not real.is_relative_to(home):
        raise refused("it is a link that leaves the folder")
    if not stat.S_ISREG(kind):
        raise refused("it is no ordinary file")
    return file


def read_inside(folder: Path, name: str, fix: str, *, most: int = MAX_JSON_BYTES) -> bytes:
    """The bytes of a file in a folder. Raises InputError as `file_inside` does, and if there are
    more than `most`."""
    file = file_inside(folder, name, fix)
    try:
        with file.open("rb") as opened:
            data = opened.read(most + 1)
    except OSError as error:
        raise InputError(f"cannot read it: {error.strerror}", source=str(file), fix=fix) from error
    if len(data) > most:
        raise InputError(f"it has more than {most} bytes", source=str(file), fix=fix)
    return data


def json_inside(folder: Path, name: str, fix: str) -> Any:
    """The parsed JSON of a file in a folder. Raises InputError as `read_inside` and `strict_json`
    do."""
    return strict_json(read_inside(folder, name, fix), str(folder / name), fix)


def lines_inside(folder: Path, name: str, fix: str) -> Iterator[tuple[str, Any]]:
    """Each line of a file of JSON lines in a folder, parsed, and its place in words. Raises
    InputError as `file_inside` and `strict_json` do, and for a line without end."""
    file = file_inside(folder, name, fix)
    try:
        with file.open("rb") as opened:
            number = 0
            while data := opened.readline(MAX_LINE_BYTES + 1):
                number += 1
                place = f"line {number}"
                if len(data) > MAX_LINE_BYTES:
                    problem = f"it has more than {MAX_LINE_BYTES} bytes"
                    raise InputError(problem, source=str(file), place=place, fix=fix)
                yield place, strict_json(data, str(file), fix, place)
    except OSError as error:
        raise InputError(f"cannot read it: {error.strerror}", source=str(file), fix=fix) from error


def strict_json(data: bytes, source: str, fix: str, place: str = "") -> Any:
    """Parsed JSON. Raises InputError for what is none, and for what Python's parser lets pass:
    NaN and infinities, numbers beyond float64 or of more than 20 digits, a key that stands
    twice, NUL or half a surrogate pair in a text, lists too deep."""

    def refused(problem: str) -> InputError:
        return InputError(f"cannot read it: {problem}", source=source, place=place, fix=fix)

    try:
        text = data.decode("utf-8")
        value = json.loads(
            text,
            parse_constant=_constant,
            parse_float=_float,
            parse_int=_int,
            object_pairs_hook=_object,
        )
    except UnicodeDecodeError as error:
        raise refused("this is not UTF-8 text") from error
    except json.JSONDecodeError as error:
        where = f"column {error.colno}" if place else f"line {error.lineno} column {error.colno}"
        raise refused(f"not valid JSON: {error.msg} ({where})") from error
    except RecursionError as error:
        raise refused("its lists are too deep") from error
    except ValueError as error:
        raise refused(str(error)) from error
    if _TRAP.search(text) and not all(map(is_text, _texts(value))):
        raise refused("a text holds NUL or half a character")
    return value


def is_text(value: str) -> bool:
    """Whether a text is one that can be shown: neither NUL nor half of a surrogate pair in it."""
    return _NO_TEXT.search(value) is None


def shortened(text: str) -> str:
    """A text as an error shows it: no longer than 60 characters."""
    return text if len(text) <= 60 else f"{text[:57]}..."


def quoted(value: object) -> str:
    """A value as an error quotes it: in short, whatever it is."""
    return shortened(repr(value[:60] if isinstance(value, str) else value))


def _texts(value: Any) -> Iterator[str]:
    left = [value]
    while left:
        one = left.pop()
        if isinstance(one, str):
            yield one
        elif isinstance(one, dict):
            yield from one
            left += one.values()
        elif isinstance(one, list):
            left += one


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in value if names.count(name) > 1)
        raise ValueError(f"the key {quoted(twice)} stands twice in an object")
    return value


def _constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is no number")


def _float(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(f"{quoted(text)} is no float64")
    return value


def _int(text: str) -> int:
    if len(text) > _MAX_DIGITS:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)
