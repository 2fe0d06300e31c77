"""Runs that are killed on their way (SIGKILL, at random moments) and go on.

A run is killed, and the same command given again, until it comes to its end: its folder then has to
be that of the other, byte by byte (but for timings.parquet and the machine), with nothing beside
it. Each frame is a part here, so that there is something to go on with.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import time
from collections import Counter
from pathlib import Path

import numpy as np

from tests.cli.test_cli import write_scene
from tests.kills.kills import _ended, _forked
from tests.support.same_bytes import differing
from visref import kept
from visref.beside import PARTS as KEPT
from visref.beside import PREFIX
from visref.cli import check as _imported_before_forks  # noqa: F401
from visref.culler import Culler, DrawnSet

FRAMES = 8
# Of what is beside a run folder: one per part that is kept.
PARTS = f"{PREFIX}*/{KEPT}/*"
WENT_ON = re.compile("Goes on after ([0-9]+) of")


class Counts(Culler):
    """Leaves something out each third time that it is asked: it remembers all of them."""

    asked = 0

    def cull(self, camera):
        self.asked += 1
        return DrawnSet(np.array([0, 2] if self.asked % 3 == 0 else [0, 1, 2], np.int32))


def inputs(folder: Path) -> list[str]:
    """A scene of three boxes and a path along them, as arguments."""
    scene, path = write_scene(folder, frames=FRAMES)
    said = json.loads(Path(path).read_text())
    for number in range(FRAMES):
        pose = np.eye(4)
        pose[:3, 3] = 0.7 * number - 2.0, 0.0, 10.0
        said["frames"][number] = {"world_from_camera": pose.tolist()}
    Path(path).write_text(json.dumps(said))
    return [scene, "--path", path, "--threads", "1", "--pictures", "1"]


class Ends:
    """`folder` is empty. `seen` counts what came of it, `differences` says what should not be."""

    def __init__(self, folder: Path, seed: int) -> None:
        kept.PART_S = 0.0
        self._random = random.Random(seed)
        self._log = folder / "log"
        given = inputs(folder)
        drawn = folder / "drawn.jsonl"
        sets = [[0, 2] if number in (2, 3, 6) else [0, 1, 2] for number in range(FRAMES)]
        lines = [{"frame": frame, "visible": ids} for frame, ids in enumerate(sets)]
        drawn.write_text("".join(json.dumps(line) + "\n" for line in lines))
        run = ["run", *given, "--culler", "none", "--culler", "tests.kills.going_on:Counts"]
        check = ["check", *given, "--visible", str(drawn)]
        self._commands = [
            [*command, "--workers", workers, "--out"]
            for command in (check, run)
            for workers in ("1", "2")
        ]
        self.seen: Counter[str] = Counter()
        self.differences: list[str] = []
        self._whole: list[Path] = []
        self._seconds: list[float] = []
        for number, command in enumerate(self._commands):
            (folder / f"{number}").mkdir()
            self._whole.append(folder / f"whole-{number}")
            began = time.perf_counter()
            self._end([*command, str(self._whole[-1])])
            self._seconds.append(time.perf_counter() - began)
        self._outs = [folder / f"{number}" / "run" for number in range(len(self._commands))]

    def _end(self, arguments: list[str]) -> None:
        status = _ended(_forked(arguments, self._log))
        if status not in (0, 1):
            raise RuntimeError(f"a run that nobody killed: {status}\n{self._log.read_text()}")

    def kill(self, number: int) -> None:
        """Give a command, and kill it; each third time it then comes to its end."""
        which = number % len(self._commands)
        process = _forked(self._arguments(which), self._log)
        assert isinstance(process, int)
        self._wait(which, process)
        os.kill(process, signal.SIGKILL)
        killed = _ended(process) < 0
        self.seen["killed" if killed else "had ended"] += 1
        self._count()
        if not killed or self._random.randrange(3) == 0:
            self.end(which)

    def _wait(self, which: int, process: int) -> None:
        """Until a random moment: so long after so many more parts are kept."""
        parts = self._outs[which].parent
        before = len(list(parts.glob(PARTS)))
        wanted = before + self._random.randrange(FRAMES - before) if before < FRAMES else before
        while os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
            if len(list(parts.glob(PARTS))) >= wanted:
                break
            time.sleep(0.001)
        time.sleep(self._random.uniform(0.0, 2.0) * self._seconds[which] / FRAMES)

    def end(self, which: int) -> None:
        """Have a command come to its end, and compare."""
        out = self._outs[which]
        if os.listdir(out.parent) != [out.name]:
            # Who is killed when the folder is in its place leaves parts beside it, until then.
            self._end(self._arguments(which))
            self._count()
        case = f"{self._commands[which][0]}, command {which}"
        if other := differing(self._whole[which], out):
            self.differences.append(f"{case}: {other}")
        if left := sorted(path.name for path in out.parent.iterdir() if path != out):
            self.differences.append(f"{case}: {left} is left behind")
        shutil.rmtree(out)

    def end_all(self) -> None:
        """Have all that were killed come to their end."""
        for which, out in enumerate(self._outs):
            if os.listdir(out.parent):
                self.end(which)

    def _arguments(self, which: int) -> list[str]:
        return [*self._commands[which], str(self._outs[which])]

    def _count(self) -> None:
        found = WENT_ON.search(self._log.read_text(errors="replace"))
        self.seen["went on" if found else "began"] += 1
