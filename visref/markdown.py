"""Text from outside in Markdown: shown as it is, and never obeyed."""

from __future__ import annotations

import re

from visref.wording import legible

_SPECIAL = re.compile(r"([\\`*_{}\[\]<>|#&~$])")


def plain(text: str) -> str:
    """Text that Markdown and HTML leave alone."""
    return _SPECIAL.sub(r"\\\1", legible(" ".join(text.split())))


def code(text: str) -> str:
    """Text as code, between more backticks than it has together; not for the cell of a table,
    which a bar ends in code too."""
    text = legible(text)
    most = max(map(len, re.findall("`+", text)), default=0)
    fence, space = "`" * (most + 1), " " if most else ""
    return f"{fence}{space}{text}{space}{fence}"
