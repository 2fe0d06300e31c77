"""The soak: `python -m tests.fuzz_verdicts [COUNT [SEED]]` compares so many cases, prints what
differs and what was seen, and exits with 1 if anything differs."""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.fuzz_verdicts.cases import random_case
from tests.fuzz_verdicts.compare import compare

COUNT, SEED = 2000, 0


def soak(count: int = COUNT, seed: int = SEED) -> int:
    """How many of the cases differ."""
    start, seen, differ = time.perf_counter(), Counter[str](), 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(seed, seed + count):
            result = compare(random_case(number), Path(folder))
            seen += result.seen
            differ += bool(result.differences)
            for line in result.differences:
                print(f"case {number}: {line}")
    seconds = time.perf_counter() - start
    print(f"seeds {seed}…{seed + count - 1}: {count} cases, {differ} differ, {seconds:.0f} s")
    for name, value in sorted(seen.items()):
        print(f"{name:32} {value:>9,}")
    return differ


if __name__ == "__main__":
    sys.exit(soak(*map(int, sys.argv[1:])) > 0)
