"""Small choices, drawn by hypothesis so that it can minimise what they made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, TypeVar

from hypothesis import strategies as st

Value = TypeVar("Value")


@cache
def _numbers(count: int) -> st.SearchStrategy[int]:
    return st.integers(0, count - 1)


class Draws:
    """Choices of a case. Hypothesis minimises towards 0, so the harmless choice comes first."""

    def __init__(self, draw: Callable[[st.SearchStrategy[Any]], Any]) -> None:
        self._draw = draw

    def below(self, count: int) -> int:
        """A whole number from 0 to `count` - 1."""
        return self._draw(_numbers(count)) if count > 1 else 0

    def one_in(self, count: int) -> bool:
        return self.below(count) == count - 1

    def pick(self, values: Sequence[Value]) -> Value:
        return values[self.below(len(values))]

    def span(self, length: int) -> slice:
        """A part of something so long: short ones are as likely as long ones."""
        start = self.below(length + 1)
        reach = self.pick((1, 2, 4, 16, 64, length))
        return slice(start, min(length, start + reach))

    def shuffled(self, values: Sequence[Value]) -> list[Value]:
        waiting = list(values)
        return [waiting.pop(self.below(len(waiting))) for _ in values]
