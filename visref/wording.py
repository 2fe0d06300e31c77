"""How messages say things: numbers with their nouns, what was probably meant, and names that bring
characters of their own."""

from __future__ import annotations

import re
import unicodedata
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


# Control characters (C0, C1), format characters (bidirectional and zero-width ones), separators of
# lines and paragraphs, halves of surrogate pairs.
_UNSEEN = ("Cc", "Cf", "Zl", "Zp", "Cs")
# Not in Unicode for ever, and forbidden in XML.
_NO_CHARACTERS = "\ufffe\uffff"
# What GitHub and Azure take for a command: `::` where a line starts, `##[` and `##vso[` anywhere.
_COMMAND = re.compile(r"^(\s*):(?=:)|#(?=#\w*\[)")


def shown(text: str) -> str:
    """A line for a terminal or a log: `legible`, and no command of a CI server."""
    return _COMMAND.sub(_defused, legible(text))


def legible(text: str) -> str:
    """Text of one line, in which what would be obeyed instead of shown, and what nobody would see,
    are the escapes of a Python string (`\\n`, `\\x1b`, `\\u202e`)."""
    if text.isprintable():
        return text
    return "".join(
        character.encode("unicode_escape").decode()
        if unicodedata.category(character) in _UNSEEN or character in _NO_CHARACTERS
        else character
        for character in text
    )


def _defused(match: re.Match[str]) -> str:
    return "\\x23" if match[0] == "#" else f"{match[1]}\\x3a"
