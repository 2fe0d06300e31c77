"""A stopwatch counts wall time, and none of the compiler's."""

from __future__ import annotations

import numba
import pytest
from numba.core import event

from visref.stopwatch import Stopwatch

LOCK = "numba:compiler_lock"


class Clock:
    """Seconds by hand."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_time_in_which_anything_is_compiled_does_not_count():
    clock = Clock()
    with Stopwatch(clock) as watch:
        clock.now += 1.0
        event.start_event(LOCK)
        clock.now += 10.0
        event.start_event(LOCK)  # another thread waits
        clock.now += 10.0
        event.end_event(LOCK)
        clock.now += 10.0
        event.end_event(LOCK)
        clock.now += 2.0
        assert watch.ms == pytest.approx(3000.0)
    clock.now += 50.0
    assert watch.ms == pytest.approx(3000.0)


def test_a_kernel_compiled_within_costs_no_time_and_its_run_does():
    clock = Clock()

    def compiled():
        # The compiler reads this as a constant: its evaluation takes an hour of the clock.
        clock.now += 3600.0
        return 1

    @numba.njit
    def kernel(x):
        return x + 1

    class Slow(event.Listener):
        def on_start(self, _):
            pass

        def on_end(self, _):
            compiled()

    with Stopwatch(clock) as watch:
        # Called before the watch hears that compiling has ended.
        slow = Slow()
        event._registered[LOCK].insert(0, slow)
        try:
            kernel(1)
        finally:
            event.unregister(LOCK, slow)
        assert clock.now > 3600.0, "nothing was compiled"
        clock.now += 1.0
        kernel(1)
    assert watch.ms == pytest.approx(1000.0)


def test_watches_within_each_other_each_count():
    clock = Clock()
    with Stopwatch(clock) as outer:
        clock.now += 1.0
        with Stopwatch(clock) as inner:
            event.start_event(LOCK)
            clock.now += 5.0
            event.end_event(LOCK)
            clock.now += 2.0
        with pytest.raises(KeyError), Stopwatch(clock) as broken:
            clock.now += 4.0
            raise KeyError
    assert (outer.ms, inner.ms, broken.ms) == pytest.approx((7000.0, 2000.0, 4000.0))
    assert event._registered[LOCK] == []
