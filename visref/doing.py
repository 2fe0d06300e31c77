"""What takes its time just now, for whoever shows it.

A step that may take seconds is a `with doing("reading city.glb")` block; nothing else depends on
it. Whoever wants to see the steps of this process calls `watched_by`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

# Tells how much of a step is done, counted from its start.
Reach = Callable[[float], None]
# Of a step's name and its total (None: nobody knows), what shows it while its block lasts.
Watcher = Callable[[str, float | None], AbstractContextManager[Reach]]

# The watcher and its process: copies of a process show nothing.
_watching: tuple[Watcher, int] | None = None


@contextmanager
def doing(what: str, total: float | None = None) -> Iterator[Reach]:
    """A step while its block lasts; call what it yields with how much of `total` is done."""
    if _watching is None or _watching[1] != os.getpid():
        yield lambda done: None
        return
    with _watching[0](what, total) as reach:
        yield reach


@contextmanager
def watched_by(watcher: Watcher) -> Iterator[None]:
    """Show this process's steps to `watcher` while the block lasts."""
    global _watching
    before, _watching = _watching, (watcher, os.getpid())
    try:
        yield
    finally:
        _watching = before
