"""What is called by name in a verdict, without the scene that it is of."""

from __future__ import annotations

from typing import Protocol


class ById(Protocol):
    """A text for each id."""

    def __getitem__(self, index: int, /) -> str: ...


class Names(Protocol):
    """What reports call a scene's objects: the scene itself, or what records keep of it."""

    @property
    def names(self) -> ById: ...

    @property
    def paths(self) -> ById: ...

    def owner_name(self, triangle: int) -> str:
        """The name of the object that a triangle belongs to."""
        ...
