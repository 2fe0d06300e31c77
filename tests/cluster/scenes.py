"""Cullers that end the process that asks them, made where a worker is; and how often that was."""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.merging.scenes import Forgets, cullers


class Ends(Forgets):
    """Ends its process in the fourth frame, as often as there are marks. A mark goes with each."""

    marks: Path

    def draw(self, camera):
        if camera.eye[0] == 3.0:
            for mark in sorted(self.marks.iterdir()):
                mark.unlink()
                os.kill(os.getpid(), signal.SIGKILL)
        return super().draw(camera)


@dataclass(frozen=True)
class Making:
    """Makes the cullers of a kind."""

    kind: str

    @contextmanager
    def __call__(self):
        yield cullers(self.kind)


@dataclass(frozen=True)
class MakingEnds:
    """Makes one that forgets, and one that ends its process."""

    marks: Path

    @contextmanager
    def __call__(self):
        ends = Ends()
        ends.marks = self.marks
        yield [("forgets", Forgets()), ("ends", ends)]


def mark(folder: Path, times: int) -> Path:
    folder.mkdir()
    for number in range(times):
        (folder / f"{number:02}").touch()
    return folder
