"""How far the measuring of the tables is."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Told how far it is; one step is one culler's frame."""

    def begin(self, steps: int) -> None:
        """All there is to do."""

    def task(self, label: str) -> None:
        """What is under way."""

    def advance(self, steps: float) -> None:
        """Steps done, or found done already."""
