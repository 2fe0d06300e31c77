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
            for line in run.differences[told:]:
                print(line)
            told = len(run.differences)
    return _told(f"seed {seed}: {count} kills", start, run)


def going_on(count: int = GOING_ON, seed: int = SEED) -> int:
    """How many differences there are."""
    start, told = time.perf_counter(), 0
    with tempfile.TemporaryDirectory() as folder:
        run = Ends(Path(folder), seed)
        for number in range(count + 1):
            if number < count:
                run.kill(number)
            else:
                run.end_all()
            for line in run.differences[told:]:
                print(line)
            told = len(run.differences)
    return _told(f"going on, seed {seed}: {count} kills", start, run)


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
