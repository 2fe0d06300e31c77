"""What a culler promises. Light: the command line and who reads a run folder load no more."""

from __future__ import annotations

from enum import StrEnum


class Promise(StrEnum):
    """The field's four classes of visible set, and what each lets the judge convict of."""

    EXACT = "exact"
    CONSERVATIVE = "conservative"
    AGGRESSIVE = "aggressive"
    APPROXIMATE = "approximate"

    @property
    def convicts(self) -> bool:
        """Whether a confirmed miss is a violation, or only measured."""
        return self in (Promise.EXACT, Promise.CONSERVATIVE)

    @property
    def may_draw_hidden(self) -> bool:
        """Whether drawing what is hidden only costs, or breaks the promise."""
        return self in (Promise.CONSERVATIVE, Promise.APPROXIMATE)

    @property
    def statement(self) -> str:
        """What such a culler promises, in words."""
        return {
            Promise.EXACT: "draws the objects that own a sample, and no others",
            Promise.CONSERVATIVE: "draws every object that owns a sample",
            Promise.AGGRESSIVE: "draws visible objects only, and may leave some out",
            Promise.APPROXIMATE: "promises nothing; it is measured",
        }[self]
