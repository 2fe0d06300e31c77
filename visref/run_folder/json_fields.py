"""Reading parsed JSON by field, each of the kind it must be: what is not is one clear error that
names the file and the place in it."""

from __future__ import annotations

import math
import re
import struct
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from visref.errors import InputError
from visref.run_folder.inside import quoted, shortened

# As `float.hex` writes a float64, and no exponent that one does not have.
_EXPONENT = r"(\+([0-9]{1,3}|10[01][0-9]|102[0-3])|-([0-9]{1,3}|10[0-6][0-9]|107[0-4]))"
_HEXADECIMAL = re.compile(rf"-?(0x[01]\.?[0-9a-f]{{0,13}}p{_EXPONENT}|inf)")

MOST = (1 << 63) - 1
# How deep a value may be that is kept as it is; ours are two deep.
_DEPTH = 16


class Fields:
    """A JSON object that is read field by field. Every method raises InputError where the field is
    missing or of another kind."""

    def __init__(self, value: object, source: str, fix: str, place: str = "") -> None:
        self._source, self._fix, self._place = source, fix, place
        if not isinstance(value, dict):
            raise self.error("this is no JSON object")
        self._value: Mapping[str, Any] = value

    def error(self, problem: str, name: str = "") -> InputError:
        """An error at the field `name`, or at the object itself."""
        return InputError(problem, source=self._source, place=self._at(name), fix=self._fix)

    def has(self, name: str) -> bool:
        return name in self._value

    def text(
        self, name: str, *, among: tuple[str, ...] = (), like: re.Pattern[str] | None = None
    ) -> str:
        """Any text, or one of those `among` which it must be, or `like` which it must look."""
        value = self._get(name)
        if not isinstance(value, str):
            raise self.error("it is no text", name)
        if among and value not in among:
            raise self.error(f"it is {quoted(value)}, not one of {', '.join(among)}", name)
        if like is not None and not like.fullmatch(value):
            raise self.error(f"it is {quoted(value)}, no name of ours", name)
        return value

    def whole(self, name: str, *, least: int = 0, most: int = MOST) -> int:
        """A whole number from `least` to `most`, by default what an int64 holds."""
        value = self._get(name)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.error(f"it is no whole number of {least} or more", name)
        if value > most:
            raise self.error(f"it is more than {most}", name)
        return value

    def number(self, name: str) -> float:
        """A finite number."""
        value = self._get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error("it is no number", name)
        if not abs(value) <= sys.float_info.max:
            raise self.error("it is not finite", name)
        return float(value)

    def hexadecimal(self, name: str, *, finite: bool = False) -> float:
        """A float64 as `float.hex` writes it; infinities too, unless it must be `finite`."""
        return self._float(self._get(name), name, finite)

    def hexadecimal_vector(self, name: str) -> tuple[float, float, float]:
        """Three of them, all finite."""
        return self._vector(self._list(name), name)

    def hexadecimal_corners(self, name: str) -> None:
        """The corners of a triangle, three vectors, each number a float32."""
        corners = self._list(name)
        if len(corners) != 3:
            raise self.error("it does not hold three corners", name)
        for index, corner in enumerate(corners):
            place = f"{name}[{index}]"
            if not isinstance(corner, list):
                raise self.error("it is no list", place)
            for value in self._vector(corner, place):
                if not _is_float32(value):
                    raise self.error("it is no float32", place)

    def flag(self, name: str) -> bool:
        value = self._get(name)
        if not isinstance(value, bool):
            raise self.error("it is neither true nor false", name)
        return value

    def is_null(self, name: str) -> bool:
        """Whether the field is there and null."""
        return self._get(name) is None

    def inner(self, name: str) -> Fields:
        """A JSON object in a field."""
        return Fields(self._get(name), self._source, self._fix, self._at(name))

    def items(self) -> Iterator[tuple[str, Fields]]:
        """The JSON objects in all fields, by name."""
        for name in self._value:
            yield name, self.inner(name)

    def each(self, name: str, *, most: int | None = None) -> list[Fields]:
        """The JSON objects in a list, at `most` so many."""
        if most is not None and len(self._list(name)) > most:
            raise self.error(f"it holds more than {most}", name)
        return [
            Fields(value, self._source, self._fix, f"{self._at(name)}[{index}]")
            for index, value in enumerate(self._list(name))
        ]

    def text_list(self, name: str) -> tuple[str, ...]:
        """A list of texts."""
        values = self._list(name)
        if not all(isinstance(value, str) for value in values):
            raise self.error("it holds what is no text", name)
        return tuple(values)

    def whole_list(self, name: str, *, most: int | None = None) -> tuple[int, ...]:
        """A list of whole numbers of 0 or more, at `most` so many."""
        values = self._list(name)
        if most is not None and len(values) > most:
            raise self.error(f"it holds more than {most}", name)
        if not all(_is_whole(value) for value in values):
            raise self.error("it holds what is no whole number of 0 or more", name)
        return tuple(values)

    def texts(self) -> dict[str, str]:
        """All fields, each a text."""
        return {name: self.text(name) for name in self._value}

    def free(self, name: str) -> dict[str, Any]:
        """A JSON object in a field whose own fields may be anything, if they are not too deep."""
        level: list[Any] = [self.inner(name).plain()]
        for _ in range(_DEPTH):
            level = [
                inner
                for one in level
                if isinstance(one, (dict, list))
                for inner in (one.values() if isinstance(one, dict) else one)
            ]
        if level:
            raise self.error(f"it is more than {_DEPTH} lists deep", name)
        return self.inner(name).plain()

    def plain(self) -> dict[str, Any]:
        """All fields, of whatever kind."""
        return dict(self._value)

    def _vector(self, values: list[Any], name: str) -> tuple[float, float, float]:
        if len(values) != 3:
            raise self.error("it does not hold three numbers", name)
        x, y, z = (self._float(value, name, finite=True) for value in values)
        return x, y, z

    def _float(self, value: object, name: str, finite: bool) -> float:
        if not isinstance(value, str) or not _HEXADECIMAL.fullmatch(value):
            raise self.error(f"{quoted(value)} is no hexadecimal float", name)
        number = float.fromhex(value)
        if finite and math.isinf(number):
            raise self.error("it is not finite", name)
        return number

    def _list(self, name: str) -> list[Any]:
        value = self._get(name)
        if not isinstance(value, list):
            raise self.error("it is no list", name)
        return value

    def _get(self, name: str) -> Any:
        if name not in self._value:
            raise self.error("it is missing", name)
        return self._value[name]

    def _at(self, name: str) -> str:
        name = shortened(name)
        return f"{self._place}.{name}" if self._place and name else self._place or name


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST


def _is_float32(value: float) -> bool:
    try:
        return bool(struct.unpack("<f", struct.pack("<f", value))[0] == value)
    except OverflowError:
        return False
