"""What `make test` holds a share of, and `make soak` all (docs/soak.md)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TypeVar

Item = TypeVar("Item")

WHOLE = bool(os.environ.get("VISREF_WHOLE"))


def share(items: Sequence[Item], at: int, of: int = 3) -> list[Item]:
    """One item in `of`, another share for each `at`; all of them with `VISREF_WHOLE=1`."""
    return list(items) if WHOLE else list(items[at % of :: of])


def examples(count: int, of: int = 3) -> int:
    """How many examples hypothesis makes: one in `of`, all of them with `VISREF_WHOLE=1`."""
    return count if WHOLE else -(-count // of)
