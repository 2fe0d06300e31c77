"""Runs that are killed at random moments over an old run folder, and what then stands there.

Old and new are told apart byte by byte: of the old folder all files, of a new one all but
timings.parquet and the machine, the only things that differ between two runs of one input.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from tests.cli.test_cli import write_scene
from tests.support.dying import content
from visref.cli import run as _imported_before_forks  # noqa: F401
from visref.cli.main import main
from visref.run_folder.layout import MANIFEST, TIMINGS
from visref.run_folder.read import read_run

SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)
# What is judged, turn by turn, so that a new folder never equals the old one.
CULLERS = ("none", "frustum")
# One of so many runs is a command line; the others are forked once all is imported.
COMMAND_LINES = 4
# After so many kills, a run comes to its end.
KILLS_IN_A_ROW = 3
# Waiting for the disk, looking, renaming and removing the old take some 0.1 s.
END_S = 0.2

Process = subprocess.Popen[bytes] | int


def inputs(folder: Path) -> list[str]:
    """A scene of three boxes and a path of four frames, as arguments."""
    scene, path = write_scene(folder, frames=4)
    return [scene, "--path", path, "--threads", "1", "--pictures", "1"]


class Kills:
    """`folder` is empty. `seen` counts what came of it, `differences` says what should not be."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._random = random.Random(seed)
        self._given = inputs(folder)
        self._out = folder / "out" / "run"
        self._log = folder / "log"
        self.seen: Counter[str] = Counter()
        self.differences: list[str] = []
        self._known, self._seconds = [], {}
        for culler in CULLERS:
            if not self._known:
                # The first one compiles.
                self._whole_run(culler, _forked)
            took = [self._whole_run(culler, start) for start in (_command_line, _forked)]
            self._seconds[culler] = dict(zip((_command_line, _forked), took, strict=True))
            self._known.append(_comparable(self._out))

    def _whole_run(self, culler: str, start: Callable[[list[str], Path], Process]) -> float:
        began = time.perf_counter()
        status = _ended(start(self._arguments(culler), self._log))
        if status not in (0, 1):
            raise RuntimeError(f"a run that nobody killed: {status}\n{self._log.read_text()}")
        return time.perf_counter() - began

    def _arguments(self, culler: str) -> list[str]:
        return ["run", *self._given, "--culler", culler, "--out", str(self._out)]

    def kill(self, number: int) -> None:
        """Start a run over the old folder, kill it and look; each third time, the next run ends."""
        start = _forked if number % COMMAND_LINES else _command_line
        signal_ = SIGNALS[self._random.randrange(3)]
        old = content(self._out)
        which = int(_comparable(self._out) == self._known[0])
        process = start(self._arguments(CULLERS[which]), self._log)
        where = self._random.choice(("anywhere", "while it writes", "when all is written"))
        self._wait_until(where, self._seconds[CULLERS[which]][start], process)
        status = _killed(process, signal_)
        case = f"case {number}: {signal_.name} {where}, {start.__name__.strip('_')}"
        now = content(self._out)
        if now == old:
            stands = "old"
        elif self._out.is_dir() and _comparable(self._out) == self._known[which]:
            stands = "new"
        else:
            stands = "neither"
            self.differences.append(f"{case}: neither the old folder nor the new one stands")
        if stands != "neither":
            read_run(self._out)
        if status in (0, 1) and stands != "new":
            self.differences.append(f"{case}: status {status} without its verdict")
        self.seen += Counter({f"{where}: {stands} stands": 1, signal_.name: 1,
                              start.__name__.strip("_"): 1})  # fmt: skip
        self.seen["had ended"] += status in (0, 1)
        left = self._beside()
        self.seen["left something behind"] += bool(left)
        if number % KILLS_IN_A_ROW != KILLS_IN_A_ROW - 1:
            return
        self._whole_run(CULLERS[which], _forked)
        if _comparable(self._out) != self._known[which]:
            self.differences.append(f"{case}: the next run wrote another folder")
        if left := self._beside():
            self.differences.append(f"{case}: the next run left {left} behind")

    def at_once(self, count: int) -> None:
        """So many runs into one folder at one time, turn by turn of each culler."""
        logs = [self._log.with_name(f"log {number}") for number in range(count)]
        runs = [
            _forked(self._arguments(CULLERS[number % len(CULLERS)]), log)
            for number, log in enumerate(logs)
        ]
        ended = [_ended(run) for run in runs]
        for number, log in enumerate(logs):
            # None of the cullers misses anything.
            if ended[number] != 0:
                self.differences.append(
                    f"one of {count} at once: {ended[number]}, {log.read_text()}"
                )
        self.seen["at once: own verdict"] += ended.count(0)
        if _comparable(self._out) not in self._known:
            self.differences.append(f"{count} at once: none of their folders stands")
        if left := self._beside():
            self.differences.append(f"{count} at once left {left} behind")

    def _beside(self) -> list[str]:
        return sorted(path.name for path in self._out.parent.iterdir() if path != self._out)

    def _wait_until(self, where: str, seconds: float, process: Process) -> None:
        """Until a random moment of the run, of its writing, or of its end."""
        until = time.perf_counter() + seconds * self._random.uniform(0.0, 1.1)
        if where == "anywhere":
            time.sleep(max(until - time.perf_counter(), 0.0))
            return
        sought = "written" if where == "while it writes" else f"written/{MANIFEST}"
        until = time.perf_counter() + 10 * seconds
        while time.perf_counter() < until and not any(
            (path / sought).exists() for path in self._out.parent.iterdir()
        ):
            pass
        longest = seconds / 2 if where == "while it writes" else END_S
        time.sleep(self._random.uniform(0.0, longest))


def _comparable(folder: Path) -> dict[str, bytes | str]:
    found = content(folder)
    found.pop(TIMINGS, None)
    manifest = json.loads(found.get(MANIFEST, b"{}"))
    manifest.pop("machine", None)
    return {**found, MANIFEST: json.dumps(manifest)}


def _command_line(arguments: list[str], log: Path) -> Process:
    with log.open("wb") as out:
        return subprocess.Popen([sys.executable, "-m", "visref", *arguments], stdout=out,
                                stderr=out)  # fmt: skip


def _forked(arguments: list[str], log: Path) -> Process:
    """A process that starts with all imported."""
    child = os.fork()
    if child:
        return child
    status = 70
    try:
        opened = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(opened, 1)
        os.dup2(opened, 2)
        status = main(arguments)
    finally:
        os._exit(status)


def _killed(process: Process, signal_: signal.Signals) -> int:
    """Send the signal, and wait for the end."""
    os.kill(process if isinstance(process, int) else process.pid, signal_)
    return _ended(process)


def _ended(process: Process) -> int:
    if isinstance(process, int):
        return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    return process.wait()
