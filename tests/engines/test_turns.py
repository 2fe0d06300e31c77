"""Threads share a loop by a counter: each turn is taken once, whoever takes it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from visref.compiled import njit
from visref.engines.turns import take

TURNS, STEP, THREADS = 200_000, 3, 4


@njit()
def _take_all(counter, step, count, by_turn):  # type: ignore[no-untyped-def]
    taken = 0
    while True:
        turn = take(counter, step)
        if turn >= step * count:
            return taken
        # Whoever has the same turn writes here too.
        by_turn[turn] += 1
        taken += 1


def test_each_turn_is_taken_once() -> None:
    counter, by_turn = np.zeros(1, np.int64), np.zeros(STEP * TURNS, np.int64)
    with ThreadPoolExecutor(THREADS) as pool:
        taken = list(pool.map(lambda _: _take_all(counter, STEP, TURNS, by_turn), range(THREADS)))
    assert sum(taken) == TURNS
    assert by_turn.reshape(TURNS, STEP).sum(axis=0).tolist() == [TURNS, 0, 0]
    assert by_turn.max() == 1
    assert int(counter[0]) == STEP * (TURNS + THREADS)
