"""A language that has a recorder: how its programs are built and run."""

from __future__ import annotations

import math
import os
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.recorders.calls import Call

ROOT = Path(__file__).parent.parent.parent.parent
RECORDERS = ROOT / "recorders"


@dataclass(frozen=True)
class Recording:
    """Calls to make in one recording; `kill` at the end ends the program as a crash does."""

    # In the folder in which the program runs.
    file: str
    calls: Sequence[Call]
    width: int = 64
    height: int = 48


@dataclass(frozen=True)
class Language:
    name: str
    # Programs that it takes; where one is missing, its tests are skipped.
    needs: tuple[str, ...]
    # Writes a program into a folder and builds it; the command that runs it. Of its recordings, the
    # program makes those whose numbers stand in the environment's ONLY, as |0|3|, or all.
    build: Callable[[Sequence[Recording], Path], list[str]]


_recordings: list[tuple[Recording, tuple[str, ...]]] = []
_commands: dict[str, list[str]] = {}
_folder = tempfile.TemporaryDirectory(prefix="visref-recorders-")


class Recordings:
    """What a test records. All that a language records is one program, which is compiled once."""

    def __init__(self, *recordings: Recording, languages: tuple[str, ...] = ()) -> None:
        """Before any test runs. `languages`: those that can make these calls; none: all."""
        assert not _commands
        self._numbers = range(len(_recordings), len(_recordings) + len(recordings))
        _recordings.extend((one, languages) for one in recordings)

    def run(self, language: Language, folder: Path, prefix: Sequence[str] = ()) -> list[str]:
        """What the program printed, a line per recording that was closed; the files are in
        `folder`."""
        if language.name not in _commands:
            mine = [
                Recording(one.file, one.calls if not some or language.name in some else ())
                for one, some in _recordings
            ]
            place = Path(_folder.name) / language.name
            place.mkdir()
            _commands[language.name] = language.build(mine, place)
        only = "".join(f"|{number}" for number in self._numbers) + "|"
        done = subprocess.run(
            [*prefix, *_commands[language.name]],
            cwd=folder,
            env={**os.environ, "ONLY": only, "OUT": str(folder)},
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
