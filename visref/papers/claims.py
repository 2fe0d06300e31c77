"""A paper's claim, and how far ours bears it out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from visref.papers.estimates import Estimate
from visref.papers.published import Derived, Number, Printed


class Sense(StrEnum):
    """Which side of a line the claim is on."""

    AT_LEAST = "at least"
    AT_MOST = "at most"


class Grade(StrEnum):
    """How a claim turned out here."""

    HOLDS = "holds"
    IN_DIRECTION = "holds in direction"
    FAILS = "does not hold"
    OPEN = "open"
    UNMEASURED = "not measured"


@dataclass(frozen=True)
class Claim:
    """What the paper says of its method, as one figure on one side of a line.

    `statement`: in words. `sense`: whether the figure is to be at least or at most the line.
    `ours`: the figure here, None where it was not measured. `published`: the figure that the paper
    prints, None where it claims an order and no more. `even`: the figure where the order turns over
    (1 for a quotient), None where the claim has none, or `published` is all of it. `ties`: whether
    a figure that is even bears out an order: that something is never more, say. `unit`, `digits`:
    as of a `Row`. `told`: what else was measured, in a few words.

    Raises TypeError for a published figure without a source, ValueError where the published figure
    is on the wrong side of `even`, or there is neither.
    """

    statement: str
    sense: Sense
    ours: Estimate | None
    published: Number | None = None
    even: float | None = 1.0
    ties: bool = False
    unit: str = ""
    digits: int = 2
    told: str = ""

    def __post_init__(self) -> None:
        if self.published is not None and not isinstance(self.published, (Printed, Derived)):
            raise TypeError(f"{self.published!r} has no source: what is published is a Printed")
        if self.ours is not None and not isinstance(self.ours, Estimate):
            raise TypeError(
                f"{self.ours!r} is no estimate: say `single` where no frames stand behind"
            )
        if self.even is None and self.published is None:
            raise ValueError(f"nothing to be judged by: {self.statement}")
        if (
            self.even is not None
            and self.published is not None
            and self._signed(self.even) > self._signed(self.published.amount)
        ):
            raise ValueError(f"the published figure is on the wrong side: {self.statement}")

    @property
    def interval(self) -> tuple[float, float] | None:
        """The ends of our figure's interval, None without frames behind it."""
        return None if self.ours is None else self.ours.interval

    @property
    def order(self) -> bool | None:
        """Whether the whole interval is on the right side of `even` (True), on the wrong one
        (False), or on both (None); None also where there is no such line or no figure."""
        if self.ours is None or self.even is None:
            return None
        low, high = self._ends()
        even = self._signed(self.even)
        if low > even or (self.ties and low >= even):
            return True
        return False if high < even or (high <= even and not self.ties) else None

    @property
    def grade(self) -> Grade:
        """*Holds*: the whole interval reaches or passes the published figure, or, where there is
        none, is on the right side of `even`. *In direction*: it stays short of that figure, and is
        on the right side of `even`. *Open*: it straddles the line that decides."""
        if self.ours is None:
            return Grade.UNMEASURED
        order = self.order
        if self.published is not None:
            low, high = self._ends()
            line = self._signed(self.published.amount)
            if low >= line:
                return Grade.HOLDS
            if high >= line:
                return Grade.OPEN
            if self.even is None:
                return Grade.FAILS
            return {True: Grade.IN_DIRECTION, False: Grade.FAILS, None: Grade.OPEN}[order]
        return {True: Grade.HOLDS, False: Grade.FAILS, None: Grade.OPEN}[order]

    def _signed(self, value: float) -> float:
        """Greater is better."""
        return value if self.sense is Sense.AT_LEAST else -value

    def _ends(self) -> tuple[float, float]:
        assert self.ours is not None
        low, high = self.ours.interval or (self.ours.value, self.ours.value)
        return (low, high) if self.sense is Sense.AT_LEAST else (-high, -low)
