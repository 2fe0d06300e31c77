"""What a paper printed: the only thing that can stand as published.

A published constant is an object that says where it is printed. Which document, its module says;
`tests/papers/test_printed_numbers.py` finds each number in a list of those that the document
prints, made from the document alone. What follows from printed numbers by arithmetic is `Derived`,
and is shown as such.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

MOST_WORDS = 100


def _placed(where: str, words: str) -> None:
    if not where.strip() or not words.strip() or len(words) > MOST_WORDS:
        raise ValueError(
            f"a printed constant needs its place and a few words: {where!r}, {words!r}"
        )


@dataclass(frozen=True)
class Printed:
    """A number that the document prints.

    `value`: as it stands there, so 13 for "13 %". `where`: table, figure, section or page. `words`:
    the labels of its row and column, or the few words around it. `times`, `per`: what turns it into
    the unit in which it is compared (`per=100` makes a share of 1 of per cent). Raises ValueError
    for what is no finite number or has no place.
    """

    value: float
    where: str
    words: str
    times: float = 1.0
    per: float = 1.0

    def __post_init__(self) -> None:
        if isinstance(self.value, bool) or not math.isfinite(self.value):
            raise ValueError(f"{self.value!r} is no number that anybody prints")
        _placed(self.where, self.words)

    @property
    def amount(self) -> float:
        """The number in the unit in which it is compared."""
        return self.value * self.times / self.per


class _Operation(Enum):
    RATIO = "/"
    PRODUCT = "×"
    MORE = "1 +"


@dataclass(frozen=True)
class Derived:
    """What arithmetic makes of printed numbers; made by `ratio_of`, `product_of` and `one_more`."""

    operation: _Operation
    operands: tuple[Printed | Derived, ...]

    def __post_init__(self) -> None:
        if not all(isinstance(one, (Printed, Derived)) for one in self.operands):
            raise TypeError("published numbers are derived from printed ones alone")

    @property
    def amount(self) -> float:
        """The number in the unit in which it is compared."""
        first, *others = (one.amount for one in self.operands)
        match self.operation:
            case _Operation.RATIO:
                return first / others[0]
            case _Operation.PRODUCT:
                return first * others[0]
            case _Operation.MORE:
                return 1.0 + first


def ratio_of(over: Printed | Derived, under: Printed | Derived) -> Derived:
    """One printed number over another."""
    return Derived(_Operation.RATIO, (over, under))


def product_of(one: Printed | Derived, other: Printed | Derived) -> Derived:
    """One printed number times another, as seconds a frame and frames a second of two methods."""
    return Derived(_Operation.PRODUCT, (one, other))


def one_more(share: Printed | Derived) -> Derived:
    """1 + a printed share: "12 % faster" as a ratio."""
    return Derived(_Operation.MORE, (share,))


@dataclass(frozen=True)
class PrintedRange:
    """From one printed number to another."""

    low: Printed
    high: Printed

    def __post_init__(self) -> None:
        if not isinstance(self.low, Printed) or not isinstance(self.high, Printed):
            raise TypeError("a printed range has printed ends")
        if not self.low.amount < self.high.amount:
            raise ValueError(f"a range from {self.low.amount} to {self.high.amount}")


@dataclass(frozen=True)
class PrintedWords:
    """What the document says without a number. Raises ValueError where the words hold one: that
    would be a `Printed`."""

    text: str
    where: str

    def __post_init__(self) -> None:
        _placed(self.where, self.text)
        if any(letter.isdigit() for letter in self.text):
            raise ValueError(f"a number in words: {self.text!r}")


Number = Printed | Derived
Published = Printed | Derived | PrintedRange | PrintedWords


def checked(published: object) -> None:
    """Raises TypeError for what is neither None nor printed: nobody types a published number in."""
    if published is not None and not isinstance(published, Published):
        raise TypeError(f"{published!r} has no source: what is published is a Printed")


def printed_numbers(published: object) -> Iterator[Printed]:
    """The printed numbers behind a published constant, or in what holds such constants: tuples,
    lists and dictionaries, however deep."""
    if isinstance(published, Printed):
        yield published
    elif isinstance(published, Derived):
        for operand in published.operands:
            yield from printed_numbers(operand)
    elif isinstance(published, PrintedRange):
        yield from (published.low, published.high)
    elif isinstance(published, dict):
        yield from printed_numbers(list(published.values()))
    elif isinstance(published, (tuple, list)):
        for one in published:
            yield from printed_numbers(one)
