"""Looking for faults: hypothesis makes cases of a target and minimises those that fail."""

from __future__ import annotations

import gc
import math
import random
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType, MappingProxyType
from typing import Any

import hypothesis
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st
from hypothesis.database import InMemoryExampleDatabase

from tests.fuzz import folders as run_folders
from tests.fuzz import inputs, poses, recordings, scenes
from tests.fuzz.draws import Draws
from tests.fuzz.limits import Fault, Folders
from tests.fuzz.target import Target

_ALL = (
    *scenes.TARGETS,
    *inputs.TARGETS,
    *poses.TARGETS,
    *recordings.TARGETS,
    *run_folders.TARGETS,
)
TARGETS = {target.name: target for target in _ALL}
# Bytes that a case's choices are read from; a case that needs more is passed over.
CHOICES = 8192
CORPUS = Path(__file__).parent / "corpus"

# In a corpus, of a file that must be read as a good one is: `same-as-SEED--WHAT.glb`.
_SAME_AS = re.compile(r"same-as-(.+?)--")


@dataclass(frozen=True)
class Case:
    """`same_as`: the name of the good file that says the same, None of a spoilt one."""

    data: bytes = field(repr=False)
    same_as: str | None = None


@dataclass(frozen=True)
class Found:
    case: Case
    fault: Fault

    def write(self, folder: Path, suffix: str) -> Path:
        """Into a corpus, under a name that says what was found; a person may give it a better."""
        same = f"same-as-{self.case.same_as}--" if self.case.same_as else ""
        words = re.sub(r"\W+", "-", self.fault.kind, flags=re.ASCII).strip("-")[:80]
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"{same}{words}{suffix}"
        file.write_bytes(self.case.data)
        return file


def run_case(target: Target, case: Case, folders: Folders) -> tuple[Any, Fault | None]:
    """What the target reads of a case, None where it refuses it, and what is wrong with that."""
    with _collecting_later():
        value, fault = target.run(case.data, folders)
        if fault is None and case.same_as is not None:
            expected, fault = target.run(target.seeds()[case.same_as], folders)
            if fault is None and value != expected:
                fault = Fault("reads the same otherwise", f"{value!r:.500}\nnot\n{expected!r:.500}")
    return value, fault


@contextmanager
def _collecting_later() -> Iterator[None]:
    """Garbage is collected between cases. In one that nests to the end of the stack, those whom
    Python tells of a collection, of which hypothesis is one, break down, and that depends on when
    it collects."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


Run = Callable[[Target, Case, Folders], tuple[Any, Fault | None]]


def replay(target: Target, file: Path, folders: Folders) -> Fault | None:
    """What is wrong with a file of a corpus."""
    same = _SAME_AS.match(file.name)
    return run_case(target, Case(file.read_bytes(), same[1] if same else None), folders)[1]


def case_of(target: Target, pool: Mapping[str, bytes]) -> st.SearchStrategy[Case]:
    """Cases made of the target's good files, and of those of `pool`, good or not."""
    good = target.seeds()
    every = [*good.items(), *pool.items()]

    @st.composite
    def make(draw: Callable[[Any], Any]) -> Case:
        draws = Draws(draw)
        name, data = draws.pick(every)
        if target.rewrite and name in good and draws.one_in(6):
            return Case(target.rewrite(data, draws), name)
        for _ in range(1 + draws.below(3)):
            data = target.spoil(data, draws)
        return Case(data)

    return make()


def find(
    target: Target,
    folders: Folders,
    *,
    seed: int,
    cases: int,
    known: Set[str] = frozenset(),
    pool: Mapping[str, bytes] = MappingProxyType({}),
    until: float = math.inf,
    shrink_s: float = 20.0,
    run: Run = run_case,
) -> dict[str, Found]:
    """The faults among so many cases, by kind, of each the smallest case that hypothesis finds.

    Kinds in `known` are no news. Nothing is tried once the clock (`time.monotonic`) is past
    `until`; minimising takes `shrink_s` seconds at most, for each kind. `run` tries a case.
    """
    found: dict[str, Found] = {}
    memory: dict[Case, Fault | None] = {}
    stop, wanted = [until], [""]

    @hypothesis.settings(
        deadline=None,
        database=InMemoryExampleDatabase(),
        # Cases are made below: left to itself, hypothesis makes half of them twice.
        phases=(Phase.reuse, Phase.shrink),
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
        print_blob=False,
    )
    @hypothesis.given(case_of(target, pool))
    def check(case: Case) -> None:
        if case not in memory:
            if time.monotonic() > stop[0]:
                return
            memory[case] = run(target, case, folders)[1]
        fault = memory[case]
        if fault is None or fault.kind in known:
            return
        old = found.get(fault.kind)
        if old is None or len(case.data) < len(old.case.data):
            found[fault.kind] = Found(case, fault)
        # Minimising keeps to one kind.
        if not wanted[0] and old is None:
            wanted[0] = fault.kind
        assert fault.kind != wanted[0], fault.kind

    source = random.Random(seed)
    for _ in range(cases):
        if time.monotonic() > until:
            break
        stop[0], wanted[0] = until, ""
        try:
            check.hypothesis.fuzz_one_input(source.randbytes(CHOICES))
        except AssertionError:
            stop[0] = time.monotonic() + shrink_s
            with suppress(AssertionError, hypothesis.errors.HypothesisException):
                check()
    return found


class Arcs:
    """Which steps from line to line in visref's readers were ever made: what makes a new one is
    worth being spoilt further."""

    _READERS = re.compile(
        r"visref/(formats|recordings|run_folder|report|masks|camera_path|files|memory)"
    )

    def __init__(self) -> None:
        self._known: set[tuple[CodeType, int, int]] = set()
        self._ours: dict[CodeType, bool] = {}
        self.new = 0

    @contextmanager
    def traced(self) -> Iterator[None]:
        self.new = 0
        sys.settrace(self._call)
        try:
            yield
        finally:
            sys.settrace(None)

    def _call(self, frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        if code not in self._ours:
            self._ours[code] = bool(self._READERS.search(code.co_filename))
        if not self._ours[code]:
            return None
        last = [0]

        def line(frame: FrameType, event: str, argument: Any) -> Any:
            if event == "line":
                arc = (code, last[0], frame.f_lineno)
                if arc not in self._known:
                    self._known.add(arc)
                    self.new += 1
                last[0] = frame.f_lineno
            return line

        return line
