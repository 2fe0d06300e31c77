"""Reading parsed JSON by field, each of the kind it must be: what is not is one clear error that
names the file and the place in it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from visref.errors import InputError

_HEXADECIMAL = re.compile(r"-?(0x[01]\.?[0-9a-f]{0,13}p[+-][0-9]{1,4}|inf)")


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

    def text(self, name: str, *, among: tuple[str, ...] = ()) -> str:
        """Any text, or one of those `among` which it must be."""
        value = self._get(name)
        if not isinstance(value, str):
            raise self.error("it is no text", name)
        if among and value not in among:
            raise self.error(f"it is {value!r}, not one of {', '.join(among)}", name)
        return value

    def whole(self, name: str, *, least: int = 0) -> int:
        """A whole number of `least` or more."""
        value = self._get(name)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.error(f"it is no whole number of {least} or more", name)
        return value

    def number(self, name: str) -> float:
        """A finite number."""
        value = self._get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error("it is no number", name)
        if not math.isfinite(value):
            raise self.error("it is not finite", name)
        return float(value)

    def hexadecimal(self, name: str) -> float:
        """A float64 as `float.hex` writes it; infinities too."""
        return self._float(self._get(name), name)

    def hexadecimal_vector(self, name: str) -> tuple[float, float, float]:
        """Three of them."""
        values = self._list(name)
        if len(values) != 3:
            raise self.error("it does not hold three numbers", name)
        x, y, z = (self._float(value, name) for value in values)
        return x, y, z

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

    def each(self, name: str) -> list[Fields]:
        """The JSON objects in a list."""
        return [
            Fields(value, self._source, self._fix, f"{self._at(name)}[{index}]")
            for index, value in enumerate(self._list(name))
        ]

    def texts(self) -> dict[str, str]:
        """All fields, each a text."""
        return {name: self.text(name) for name in self._value}

    def plain(self) -> dict[str, Any]:
        """All fields, of whatever kind."""
        return dict(self._value)

    def _float(self, value: object, name: str) -> float:
        if not isinstance(value, str) or not _HEXADECIMAL.fullmatch(value):
            raise self.error(f"{value!r} is no hexadecimal float", name)
        try:
            return float.fromhex(value)
        except OverflowError as error:
            raise self.error(f"{value!r} is no float64", name) from error

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
        return f"{self._place}.{name}" if self._place and name else self._place or name
