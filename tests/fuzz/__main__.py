"""The long fuzz: `python -m tests.fuzz` tries every target for FUZZ_SECONDS (600) in FUZZ_JOBS (2)
processes, and keeps what it finds in the corpus.

`python -m tests.fuzz TARGET FILE` reads a file of the corpus again; `python -m tests.fuzz TARGET
SECONDS` tries one target. The status is 1 where anything was found.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tests.fuzz.find import CORPUS, TARGETS, Arcs, Case, Found, find, replay, run_case
from tests.fuzz.limits import Fault, Folders
from tests.fuzz.target import Target

# What was of use and is no regression; not committed.
GROWING = Path(__file__).parents[2] / ".fuzz"
CASES_A_ROUND = 100
# Of the growing corpus: more and larger files make a round slower, not better.
POOL, POOL_BYTES = 500, 64 * 1024
# Over a turn's seconds, for starting, the slowest case and the last minimising.
GRACE_S = 120.0


def one_target(name: str, seconds: float, current: Path) -> int:
    """Try a target for so long; prints a line for each kind of fault. `current` holds the case
    that is being read, for whoever finds this process dead."""
    target, known, arcs = TARGETS[name], set[str](), Arcs()
    growing = GROWING / name
    growing.mkdir(parents=True, exist_ok=True)

    def traced(target: Target, case: Case, folders: Folders) -> tuple[Any, Fault | None]:
        current.write_bytes(case.data)
        with arcs.traced():
            outcome = run_case(target, case, folders)
        if arcs.new and len(case.data) <= POOL_BYTES:
            file = growing / (hashlib.sha256(case.data).hexdigest()[:16] + target.suffix)
            file.write_bytes(case.data)
        return outcome

    # Each turn tries others.
    seed = time.time_ns() // 1_000_000
    with tempfile.TemporaryDirectory() as root:
        folders = Folders(Path(root))
        target.warm_up(folders)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            files = sorted(growing.iterdir())[:POOL]
            found = find(
                target, folders, seed=seed, cases=CASES_A_ROUND, known=known,
                pool={file.name: file.read_bytes() for file in files}, until=until, run=traced,
            )  # fmt: skip
            seed += 1
            for kind, one in found.items():
                known.add(kind)
                _say(name, one.write(CORPUS / name, target.suffix), one)
    return int(bool(known))


def _say(name: str, file: Path, found: Found) -> None:
    shown = file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file
    print(f"{name}: {found.fault.kind}: {shown}; python -m tests.fuzz {name} {shown}", flush=True)


def _turn(name: str, seconds: float) -> int:
    """A target in a process of its own, which a reader may kill or hang for good."""
    with tempfile.TemporaryDirectory() as folder:
        current = Path(folder) / "current"
        line = [sys.executable, "-m", "tests.fuzz", name, str(seconds), str(current)]
        try:
            status = subprocess.run(line, timeout=seconds + GRACE_S).returncode
            kind = f"status {status}" if status > 1 else f"dies of signal {-status}"
        except subprocess.TimeoutExpired:
            status, kind = 2, "never ends"
        if status in (0, 1):
            return status
        data = current.read_bytes() if current.exists() else b""
        found = Found(Case(data), Fault(kind, ""))
        _say(name, found.write(CORPUS / name, TARGETS[name].suffix), found)
        return 1


def main(arguments: list[str]) -> int:
    if not arguments:
        seconds = float(os.environ.get("FUZZ_SECONDS", "600"))
        jobs = int(os.environ.get("FUZZ_JOBS", "2"))
        share = seconds * jobs / len(TARGETS)
        with ThreadPoolExecutor(jobs) as pool:
            found = sum(pool.map(lambda name: _turn(name, share), TARGETS))
        print(f"{len(TARGETS)} targets, {seconds:.0f} s in {jobs} processes: "
              f"{found or 'nothing'} found")  # fmt: skip
        return int(found > 0)
    name, what, *current = arguments
    if current:
        return one_target(name, float(what), Path(current[0]))
    if not Path(what).is_file():
        return _turn(name, float(what))
    with tempfile.TemporaryDirectory() as root:
        folders = Folders(Path(root))
        TARGETS[name].warm_up(folders)
        fault = replay(TARGETS[name], Path(what).resolve(), folders)
    print((fault and f"{fault.kind}\n{fault.detail}") or "it is read or refused as it should be")
    return int(fault is not None)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
