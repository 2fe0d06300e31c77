"""Where wrong cullers, and the right ones that they start from, are put on record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from visref.culler import Culler


@dataclass(frozen=True)
class Wrong:
    """`name` as `Culler.name` has it; `kind`: the module it is in; `rule`: what it gets wrong."""

    name: str
    kind: str
    rule: str
    culler: type[Culler]

    def __str__(self) -> str:
        return self.name


RIGHT: dict[str, type[Culler]] = {}
WRONG: dict[str, Wrong] = {}


def _named(culler: type[Culler]) -> str:
    """The class's name with hyphens; its docstring becomes the summary."""
    letters = [f"-{c.lower()}" if c.isupper() else c for c in culler.__name__]
    culler.name = "".join(letters).lstrip("-")
    culler.summary = " ".join((culler.__doc__ or "").split())
    return culler.name


def right(culler: type[Culler]) -> type[Culler]:
    """Register the class below as one that passes every check."""
    RIGHT[_named(culler)] = culler
    return culler


def wrong(kind: str) -> Callable[[type[Culler]], type[Culler]]:
    """Register the class below as wrong; its docstring says the rule that it breaks."""

    def register(culler: type[Culler]) -> type[Culler]:
        name = _named(culler)
        WRONG[name] = Wrong(name, kind, culler.summary, culler)
        return culler

    return register
