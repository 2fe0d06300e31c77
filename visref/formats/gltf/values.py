"""A value of a glTF file's JSON, and where it stands."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn, overload

from visref.errors import InputError


class Json:
    """A value of the file and its place; a wrong type is an InputError that names the place."""

    __slots__ = ("place", "value")

    def __init__(self, value: Any, place: str) -> None:
        self.value = value
        self.place = place

    def fail(self, problem: str, fix: str = "export the file anew") -> NoReturn:
        raise InputError(problem, place=self.place, fix=fix)

    def get(self, name: str) -> Json | None:
        """A member of this object, or None where it is absent."""
        if not isinstance(self.value, dict):
            self.fail("this is not a JSON object")
        if name not in self.value:
            return None
        return Json(self.value[name], f"{self.place}.{name}" if self.place else name)

    def extension(self, name: str) -> Json | None:
        """An extension of this object, or None where it has none of that name."""
        extensions = self.get("extensions")
        return None if extensions is None else extensions.get(name)

    def __getitem__(self, name: str) -> Json:
        member = self.get(name)
        if member is None:
            self.fail(f"'{name}' is missing")
        return member

    def names(self) -> list[str]:
        """The names of this object's members."""
        if not isinstance(self.value, dict):
            self.fail("this is not a JSON object")
        return list(self.value)

    def items(self) -> Items:
        if not isinstance(self.value, list):
            self.fail("this is not a list")
        return Items(self.value, self.place)

    def integer(self, low: int = 0, high: int = 2**53) -> int:
        value = self.value
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int):
            self.fail(f"{reprlib.repr(value)} is not an integer")
        if not low <= value <= high:
            self.fail(f"{value} is outside {low}…{high}")
        return value

    def number(self) -> float:
        if isinstance(self.value, bool) or not isinstance(self.value, (int, float)):
            self.fail(f"{reprlib.repr(self.value)} is not a number")
        try:
            number = float(self.value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.fail("the number is too large")
        return number

    def numbers(self, count: int) -> list[float]:
        if not isinstance(self.value, list) or len(self.value) != count:
            self.fail(f"this is not a list of {count} numbers")
        if all(type(v) in (float, int) and abs(v) < 1e300 for v in self.value):
            return self.value  # The million-node case: no place is made that nobody will read.
        return [item.number() for item in self.items()]

    def text(self) -> str:
        if not isinstance(self.value, str):
            self.fail(f"{reprlib.repr(self.value)} is not a string")
        return self.value

    def flag(self) -> bool:
        if not isinstance(self.value, bool):
            self.fail(f"{reprlib.repr(self.value)} is not true or false")
        return self.value


class Items(Sequence[Json]):
    """The elements of a list of the file, `values`, each with its place once it is asked for: of a
    million most are only looked at."""

    __slots__ = ("place", "values")

    def __init__(self, values: list[Any], place: str) -> None:
        self.values = values
        self.place = place

    def __len__(self) -> int:
        return len(self.values)

    @overload
    def __getitem__(self, index: int) -> Json: ...
    @overload
    def __getitem__(self, index: slice) -> list[Json]: ...
    def __getitem__(self, index: int | slice) -> Json | list[Json]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self.values)))]
        return Json(self.values[index], f"{self.place}[{index}]")

    def __iter__(self) -> Iterator[Json]:
        for index, value in enumerate(self.values):
            yield Json(value, f"{self.place}[{index}]")
