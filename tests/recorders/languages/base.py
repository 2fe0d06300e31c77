"""A language that has a recorder: how its programs are built and run."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.recorders.calls import Call

ROOT = Path(__file__).parent.parent.parent.parent
RECORDERS = ROOT / "recorders"


@dataclass(frozen=True)
class Recording:
    """Calls to make in one recording; `kill` at the end ends the program as a crash does."""

    file: Path
    calls: Sequence[Call]
    width: int = 64
    height: int = 48


@dataclass(frozen=True)
class Language:
    name: str
    # Programs that it takes; where one is missing, its tests are skipped.
    needs: tuple[str, ...]
    # Writes a program into a folder and builds it; the command that runs it.
    build: Callable[[Sequence[Recording], Path], list[str]]

    def run(
        self, recordings: Sequence[Recording], folder: Path, prefix: Sequence[str] = ()
    ) -> list[str]:
        """What the program printed, a line per recording that was closed."""
        folder.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(
            [*prefix, *self.build(recordings, folder)],
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=120,
        )
        return [line for line in done.stdout.splitlines() if line.startswith(("ok", "problem: "))]


def compiled(command: Sequence[str | Path], folder: Path) -> None:
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True)
    # A warning is an error here: strangers compile this with their flags.
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr


def real(value: float, infinite: str, nan: str) -> str:
    if math.isnan(value):
        return nan
    return repr(float(value)) if math.isfinite(value) else ("-" if value < 0 else "") + infinite
