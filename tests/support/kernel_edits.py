"""Compiled loops with a fault put in: a module's source, edited and compiled again."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numba


def edited(module: ModuleType, *changes: tuple[str, str]) -> Any:
    """The module with each change made to its text; every one has to apply. Its own loops are
    compiled anew when they are first called, and nothing of them is kept."""
    return _edited(module, changes)


@cache
def _edited(module: ModuleType, changes: tuple[tuple[str, str], ...]) -> Any:
    assert module.__file__ is not None
    text = Path(module.__file__).read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, f"{module.__name__} no longer says {old!r}"
        text = text.replace(old, new)
    made = ModuleType(module.__name__ + "_edited")
    text = text.replace("from visref.compiled import njit", "njit = numba.njit")
    vars(made)["numba"] = numba
    exec(compile(text, f"{module.__file__} (edited)", "exec"), vars(made))
    return made
