"""How messages say things: numbers with their nouns, and what was probably meant."""

from __future__ import annotations

from collections.abc import Collection
from difflib import get_close_matches


def counted(number: int, noun: str, plural: str = "") -> str:
    """`1 frame`, `2,000 frames`; `plural` where it is not the noun with an s."""
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def did_you_mean(name: str, known: Collection[str], otherwise: str | None = None) -> str:
    """What to do about an unknown name: `did you mean 'NAME'?` where one of `known` is near,
    whatever the case of its letters, else `otherwise`, by default the list of all."""
    folded: dict[str, str] = {}
    for candidate in known:
        folded.setdefault(candidate.casefold(), candidate)
    near = get_close_matches(name.casefold(), folded, n=1)
    if near:
        return f"did you mean '{folded[near[0]]}'?"
    return otherwise if otherwise is not None else f"known are {', '.join(known) or 'none'}"
