"""A program as an entrant: run once for each case, on its files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from visref.conformance.files import SCENE, WrittenCase
from visref.culler import Culler
from visref.plug_ins.command import Command, CommandCuller
from visref.plug_ins.making import DEFAULT_TIME_LIMIT_S
from visref.plug_ins.printed import Said


@dataclass(frozen=True)
class Program:
    """A program that reads a case's scene and path and writes what it draws; an `Entrant`. Its
    limits are those of `CommandCuller`. Beside the scene stand the case's other files."""

    command: Command
    time_limit_s: float | None = DEFAULT_TIME_LIMIT_S
    memory_limit: int | None = None
    say: Said | None = None

    @property
    def name(self) -> str:
        return self.command.name

    @contextmanager
    def culler(self, case: WrittenCase) -> Iterator[Culler]:
        """The program on a case; it runs when that is prepared."""
        with tempfile.TemporaryDirectory(prefix="visref-case-") as name:
            folder = Path(name)
            for file, data in case.files.items():
                (folder / file).write_bytes(data)
            yield CommandCuller(
                self.command,
                folder / SCENE,
                case.path,
                # One-sided surfaces are so in every case.
                cull_backfaces=True,
                time_limit_s=self.time_limit_s,
                memory_limit=self.memory_limit,
                say=self.say,
            )
