"""The kills: `python -m tests.kills [COUNT [SEED [AT_ONCE]]]` kills so many runs at random moments,
starts so many others at once, all into one folder, prints what was lost or left behind and what was
seen, and exits with 1 if anything was. `python -m tests.kills going-on [COUNT [SEED]]` kills so
many that then go on, and prints what was otherwise than after a run that nobody killed."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from tests.kills.going_on import Ends
from tests.kills.kills import Kills

COUNT, SEED, AT_ONCE = 200, 0, 30
GOING_ON = 30
# A run may have ended when the kill comes: so many tries for each that had not, at most.
MOST_TRIES = 20


def kills(count: int = COUNT, seed: int = SEED, at_once: int = AT_ONCE) -> int:
    """How many differences there are."""
    start, told = time.perf_counter(), 0
    with tempfile.TemporaryDirectory() as folder:
        run = Kills(Path(folder), seed)
        for number in range(count + 1):
            if number < count:
                run.kill(number)
            else:
                run.at_once(at_once)
            told = _tell(run, told)
    return _told(f"seed {seed}: {count} kills", start, run)


def going_on(count: int = GOING_ON, seed: int = SEED) -> int:
    """How many differences there are, once so many runs were killed on their way."""
    start, told, number = time.perf_counter(), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        run = Ends(Path(folder), seed)
        while run.seen["killed"] < count:
            if number == MOST_TRIES * count:
                run.differences.append(f"most runs had ended: {number} tries")
                break
            run.kill(number)
            number += 1
            told = _tell(run, told)
        run.end_all()
        _tell(run, told)
    return _told(f"going on, seed {seed}: {count} kills", start, run)


def _tell(run: Kills | Ends, told: int) -> int:
    """Print the differences that were not told yet; returns how many there are."""
    for line in run.differences[told:]:
        print(line)
    return len(run.differences)


def _told(what: str, start: float, run: Kills | Ends) -> int:
    seconds = time.perf_counter() - start
    print(f"{what}, {len(run.differences)} differences, {seconds:.0f} s")
    for name, value in sorted(run.seen.items()):
        print(f"{name:40} {value:>4,}")
    return len(run.differences)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if arguments[:1] == ["going-on"]:
        sys.exit(going_on(*map(int, arguments[1:])) > 0)
    sys.exit(kills(*map(int, arguments)) > 0)
