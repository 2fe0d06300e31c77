"""Wall time without the compiler's: what a frame took, whichever kernels were compiled in it.

Kernels are compiled, or loaded from a cache, when they are first called, which may be in any
frame and in any thread. Numba announces both by the events of its compiler lock.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from numba.core import event

_LOCK = "numba:compiler_lock"


class Stopwatch(event.Listener):  # type: ignore[misc]
    """Measures a `with` block; `ms` is its wall time in milliseconds so far, without that in
    which some thread was at the compiler's lock. `clock` gives seconds."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._guard = threading.Lock()
        self._seconds, self._since = 0.0, 0.0
        self._compiling, self._runs = 0, False

    def __enter__(self) -> Stopwatch:
        event.register(_LOCK, self)
        self._runs, self._since = True, self._clock()
        return self

    def __exit__(self, *_: object) -> None:
        with self._guard:
            self._add()
            self._runs = False
        event.unregister(_LOCK, self)

    @property
    def ms(self) -> float:
        with self._guard:
            self._add()
        return self._seconds * 1e3

    def on_start(self, _: Any) -> None:
        with self._guard:
            self._add()
            self._compiling += 1

    def on_end(self, _: Any) -> None:
        with self._guard:
            self._add()
            # A thread may have been at the lock before this watch was started.
            self._compiling = max(self._compiling - 1, 0)

    def _add(self) -> None:
        """Count the time since the last event, where it counts."""
        now = self._clock()
        if self._runs and not self._compiling:
            self._seconds += now - self._since
        self._since = now
