"""Who is tried: a culler that is made anew for each case, as `visref run` would make it.

A culler that comes with visref lives here; another's has a process of its own, which is kept from
case to case while the culler in it is made anew; a program is run once per case, on its files.
"""

from __future__ import annotations

import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from visref.culler import Culler, Promise
from visref.plug_ins import DEFAULT_TIME_LIMIT_S
from visref.plug_ins.command import Command, CommandCuller
from visref.plug_ins.in_process import CullerGuarded
from visref.plug_ins.making import Making, check_time_limit, is_ours
from visref.plug_ins.printed import Said
from visref.plug_ins.process import CullerKept
from visref.registry import make_culler
from visref.search.case import SCENE, Case


class Suspect(ABC):
    """`name`: what records call it. `on(case)`: a culler for a case, until the block ends; the
    referee closes it. `close` when all cases are through; a suspect is a context manager that
    does."""

    name: str

    @abstractmethod
    def on(self, case: Case) -> AbstractContextManager[Culler]: ...

    @property
    def arguments(self) -> list[str]:
        """How `visref run` is told of it."""
        return ["--culler", self.name]

    def forget(self) -> None:
        """Drop what is kept from case to case: the next case is met as the first one was."""

    def close(self) -> None:
        """Free what is kept."""
        self.forget()

    def __enter__(self) -> Suspect:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def suspect_of(spec: str, making: Making | None = None) -> Suspect:
    """The culler that `visref run --culler SPEC` would judge. Raises InputError for a spec that
    names nothing, and for an option that there is not."""
    making = making or Making()
    check_time_limit(making.time_limit_s)
    if is_ours(spec):
        make_culler(spec).close()
        return Made(spec, lambda: make_culler(spec))
    if making.in_process:
        CullerGuarded(spec).close()
        return Made(spec, lambda: CullerGuarded(spec))
    return Apart(spec, making)


@dataclass(eq=False)
class Made(Suspect):
    """A culler in this process, as `make` makes it."""

    name: str
    make: Callable[[], Culler]

    @contextmanager
    def on(self, case: Case) -> Iterator[Culler]:
        yield self.make()


class Apart(Suspect):
    """A culler in a process of its own. Raises InputError for a spec that names nothing."""

    def __init__(self, spec: str, making: Making) -> None:
        self.name = spec
        say = making.say
        self._culler = CullerKept(
            spec,
            time_limit_s=making.time_limit_s,
            memory_limit=making.memory_limit,
            say=None if say is None else lambda line: say(spec, line),
        )

    @contextmanager
    def on(self, case: Case) -> Iterator[Culler]:
        yield self._culler.renewed()

    def forget(self) -> None:
        self._culler.end()


@dataclass(eq=False)
class Program(Suspect):
    """A program, run once per case on its `scene.glb` and its path."""

    command: Command
    time_limit_s: float | None = DEFAULT_TIME_LIMIT_S
    memory_limit: int | None = None
    say: Said | None = None
    name: str = field(init=False)

    def __post_init__(self) -> None:
        self.name = self.command.name

    @property
    def arguments(self) -> list[str]:
        said = ["--command", self.command.text]
        if self.command.promise is not Promise.CONSERVATIVE:
            said += ["--command-promise", self.command.promise.value]
        if (raster := self.command.raster) is not None:
            bits = "float" if raster.depth_bits is None else raster.depth_bits
            said += ["--command-raster", f"snap={raster.snap_px},depth={bits}"]
        return said

    @contextmanager
    def on(self, case: Case) -> Iterator[Culler]:
        with tempfile.TemporaryDirectory(prefix="visref-case-") as folder:
            case.write(Path(folder))
            yield CommandCuller(
                self.command,
                Path(folder) / SCENE,
                case.inputs().path,
                cull_backfaces=case.cull_backfaces,
                time_limit_s=self.time_limit_s,
                memory_limit=self.memory_limit,
                say=self.say,
            )
