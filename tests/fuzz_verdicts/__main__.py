"""The soak: `python -m tests.fuzz_verdicts [COUNT [MOVING [SEED]]]` compares so many still cases,
and so many in motion, prints what differs and what was seen, and exits with 1 if anything does."""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from tests.fuzz_verdicts.cases import random_case
from tests.fuzz_verdicts.compare import Compared, compare
from tests.fuzz_verdicts.moving_case import mixed_case
from tests.fuzz_verdicts.moving_compare import compare_moving

COUNT, MOVING, SEED = 2000, 500, 0


def soak(count: int = COUNT, moving: int = MOVING, seed: int = SEED) -> int:
    """How many of the cases differ."""
    still = _soak("cases", count, seed, lambda at, to: compare(random_case(at), to))
    return still + _soak(
        "cases in motion", moving, seed, lambda at, to: compare_moving(mixed_case(at), to)
    )


def _soak(name: str, count: int, seed: int, one: Callable[[int, Path], Compared]) -> int:
    if not count:
        return 0
    start, seen, differ = time.perf_counter(), Counter[str](), 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(seed, seed + count):
            result = one(number, Path(folder))
            seen += result.seen
            differ += bool(result.differences)
            for line in result.differences:
                print(f"{name}, {number}: {line}")
    seconds = time.perf_counter() - start
    print(f"seeds {seed}…{seed + count - 1}: {count} {name}, {differ} differ, {seconds:.0f} s")
    for kind, value in sorted(seen.items()):
        print(f"{kind:40} {value:>9,}")
    return differ


if __name__ == "__main__":
    sys.exit(soak(*map(int, sys.argv[1:])) > 0)
