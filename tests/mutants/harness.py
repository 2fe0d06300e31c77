"""One harness for the mutants and the contracts of every culler.

A module (or a folder of modules) per method has a `Suite`: the ids of its own mutants, the
`Method`s that it is tried as, small scenes of its own, and the contracts that say what it
promises to save. A mutant is one broken step, a class put before the method's own:

    @mutant("U1", of=(FIVE, ONE), caught_by="stacks_of_sheets")
    class DepthMaskLeftOn:
        "Query boxes write their depth, and hide the boxes asked after them."

        def query_state(self, state):
            return super().query_state(state)._replace(depth_write=True)

Which oracle catches it:

- `caught_by` names a check of `visref.conformance` or a scene of the suite's own: the verdict
  convicts it there (unsafe, U).
- `contract` names a contract of the suite: the picture stays right and the promised saving is
  lost (wasteful, W).
- `equivalent` says why a mutant changes nothing that can be observed, `not_here` why a method has
  no such step.

`tests/mutants/test_mutants.py` finds every suite in this folder and holds that each mutant is
caught, that the sound method passes the same, and that each culler that is registered has every
mutant accounted for.
"""

from __future__ import annotations

import copy
import importlib
import pkgutil
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.conformance import Check, case, conformance_checks, exact_truths, judge_on
from visref.conformance.scenes import Case, SceneMaker
from visref.culler import Culler, QueryStats
from visref.effects.images import ImageVerdict
from visref.scene import Scene
from visref.visibility import FrameTruth


@dataclass(frozen=True)
class Method:
    """A sound method as mutants are made of it: its class and the options it runs with."""

    name: str
    culler: type[Culler]
    options: dict[str, Any]
    suite: Suite = field(repr=False)

    def make(self, *where: Any) -> Culler:
        """The culler; an effect is made for a scene and what it shows there."""
        return self.culler(*where, **self.options)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Mutant:
    """A broken culler, the sound method it comes from, and what catches it."""

    id: str
    about: str
    method: Method
    culler: type[Culler]
    caught_by: str
    contract: str
    options: dict[str, Any]

    @property
    def suite(self) -> Suite:
        return self.method.suite

    @property
    def sound(self) -> Method:
        """The method with the mutant's options."""
        return Method(self.method.name, self.method.culler, self.options, self.suite)

    def make(self, *where: Any) -> Culler:
        return self.culler(*where, **self.options)

    def __str__(self) -> str:
        return f"{self.id}-{self.culler.__name__}-{self.method.name}"


@dataclass(frozen=True)
class Event:
    """One step that a method told its observer of: a copy of its data, and of the culler's
    attributes that the suite `keeps`."""

    step: str
    data: dict[str, Any]


@dataclass(eq=False)
class Trace:
    """One frame of a method, as its observer saw it. While a contract reads it, the culler is
    open and as the frame left it. `before` is the frame before, of the same run."""

    culler: Any
    scene: Scene
    camera: Camera
    options: Mapping[str, Any]
    before: Trace | None
    events: list[Event] = field(default_factory=list)
    drawn: list[int] = field(default_factory=list)
    stats: QueryStats = field(default_factory=QueryStats)

    def of(self, step: str) -> list[dict[str, Any]]:
        return [event.data for event in self.events if event.step == step]


Contract = Callable[[Trace], Iterator[str]]
Step = Callable[[type], type]


class Suite:
    """All that one module of mutants registers.

    `ids`: its own mutants, U unsafe and W wasteful, with what each gets wrong. `watched`: names of
    checks on whose scenes contracts are read, `cameras` those of a path that are used. `keeps`:
    attributes of the culler that each event copies. `says`: what a conviction's first line holds.
    `checks`: those of the conformance suite, or what judges an effect.
    """

    def __init__(
        self,
        ids: Mapping[str, str],
        *,
        watched: Iterable[str] = (),
        cameras: Callable[[CameraPath], Iterable[Camera]] = iter,
        keeps: Iterable[str] = (),
        says: Iterable[str] = ("MISSED_OBJECT", "witness: pixel"),
        checks: Iterable[Check] | None = None,
    ) -> None:
        self.ids, self.says = dict(ids), tuple(says)
        self.watched, self.cameras, self.keeps = tuple(watched), cameras, tuple(keeps)
        known = conformance_checks() if checks is None else checks
        self.checks = {check.name: check for check in known}
        self.own: dict[str, SceneMaker] = {}
        self.methods: list[Method] = []
        self.mutants: list[Mutant] = []
        self.breakers: list[Mutant] = []
        self.keepers: list[Method] = []
        self.contracts: dict[str, Contract] = {}
        self.equivalent: dict[tuple[str, str], str] = {}
        self.not_here: dict[tuple[str, str], str] = {}

    def method(self, name: str, culler: type[Culler], **options: Any) -> Method:
        """A way to run a method, for which all mutants are to be accounted for."""
        made = Method(name, culler, options, self)
        self.methods.append(made)
        return made

    def contract(self, check: Contract) -> Contract:
        """Register a checker: it reads a frame and yields a line for each departure."""
        self.contracts[check.__name__] = check
        return check

    def kept_by(self, *methods: Method, **options: Any) -> None:
        """Hold that these sound methods, with some options more, keep every contract."""
        self.keepers += [Method(m.name, m.culler, {**m.options, **options}, self) for m in methods]

    def scene(self, claim: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        """Register a small scene of the suite's own, built from a random generator."""

        def register(build: Callable[..., Any]) -> Callable[..., Any]:
            made = SceneMaker(build.__name__, claim, "", build)
            self.own[made.name] = made
            self.checks[made.name] = Check(made.name, claim, "", partial(_judge_on, made))
            return build

        return register

    def watched_scenes(self) -> Iterator[tuple[Scene, list[Camera]]]:
        """Where contracts are read."""
        for name in self.watched:
            made = _built(self.own[name], 0)[0] if name in self.own else Case(*case(name))
            yield made.scene, list(self.cameras(made.path))

    def reasons(self) -> dict[tuple[str, str], str]:
        """Per mutant's id and method's name why it is not tried."""
        return self.equivalent | self.not_here


@cache
def _built(made: SceneMaker, seed: int) -> tuple[Case, tuple[FrameTruth, ...]]:
    """A scene with its exact truth, cast once for however many cullers."""
    found = made.build(np.random.default_rng([seed, zlib.crc32(made.name.encode())]))
    return found, exact_truths(found)


def _judge_on(made: SceneMaker, make: Callable[[], Culler], seed: int) -> tuple[Any, int]:
    return judge_on(make, *_built(made, seed))


def image_check(
    name: str,
    judge: Callable[[Any], ImageVerdict],
    count: Callable[[ImageVerdict], int] = lambda verdict: verdict.lost + verdict.extra,
) -> Check:
    """A check of an effect: `judge` gets what makes it and gives the image protocol's verdict."""

    def run(make: Any, seed: int) -> tuple[tuple[str, ...], int]:
        verdict = judge(make)
        line = f"{verdict.status}: {verdict.lost} samples lost, {verdict.extra} extra"
        return () if verdict.status == "no_violation_found" else (line,), count(verdict)

    return Check(name, "shows what the truth shows", "", run)


def mutant(
    id: str,
    *,
    of: Iterable[Method],
    caught_by: str = "",
    contract: str = "",
    **options: Any,
) -> Step:
    """Register the class below as a mutant of these methods. `options` change the method's."""
    if bool(caught_by) == bool(contract):
        raise ValueError("a mutant is caught by the verdict or by a contract")

    def register(step: type) -> type:
        for method in of:
            made = _broken(id, step, method, caught_by, contract, options)
            method.suite.mutants.append(made)
        return step

    return register


def breaks(contract: str, *, of: Iterable[Method]) -> Step:
    """Register the class below as what a contract sees, whatever picture it draws."""

    def register(step: type) -> type:
        for method in of:
            method.suite.breakers.append(_broken("contract", step, method, "", contract, {}))
        return step

    return register


def _broken(
    id: str, step: type, method: Method, caught_by: str, contract: str, options: dict[str, Any]
) -> Mutant:
    culler = type(step.__name__, (step, method.culler), {"__doc__": step.__doc__})
    about = " ".join((step.__doc__ or "").split())
    values = {**method.options, **options}
    return Mutant(id, about, method, culler, caught_by, contract, values)


def not_here(ids: str, of: Iterable[Method], reason: str) -> None:
    """Say why these methods have no such step."""
    for id, method in product(ids.split(), of):
        method.suite.not_here[id, method.name] = reason


def equivalent(ids: str, of: Iterable[Method], reason: str) -> None:
    """Say why these mutants of these methods change nothing that can be observed."""
    for id, method in product(ids.split(), of):
        method.suite.equivalent[id, method.name] = reason


# Finding the suites, and what they leave open.


def suites() -> dict[str, Suite]:
    """Every suite of this folder, by the module that makes it."""
    package = importlib.import_module("tests.mutants")
    found: dict[int, tuple[str, Suite]] = {}
    for module in pkgutil.walk_packages(package.__path__, "tests.mutants."):
        if module.name.rpartition(".")[2].startswith("test_"):
            continue
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, Suite):
                found.setdefault(id(value), (module.name, value))
    return dict(found.values())


def mutant_named(name: str) -> Mutant:
    """The mutant that prints so, wherever it is."""
    every = [mutant for suite in suites().values() for mutant in suite.mutants]
    (found,) = [mutant for mutant in every if str(mutant) == name]
    return found


def unaccounted(
    made: Iterable[Suite], registered: Mapping[str, type[Culler]], common: Iterable[str]
) -> list[str]:
    """A line for each registered culler that no suite tries, and for each mutant of a suite's
    method that is neither tried nor excused."""
    made = list(made)
    tried = {method.culler for suite in made for method in suite.methods}
    lines = [f"no mutants of {name}" for name, culler in registered.items() if culler not in tried]
    common = list(common)
    for suite in made:
        known = {(m.id, m.method.name) for m in suite.mutants} | set(suite.reasons())
        for method in suite.methods:
            wanted = [*common, *suite.ids] if issubclass(method.culler, Culler) else suite.ids
            lines += [f"{id} of {method}" for id in wanted if (id, method.name) not in known]
    return lines


# Watching.


def watch(subject: Method | Mutant, scene: Scene, cameras: Iterable[Camera]) -> Iterator[Trace]:
    """Run a method, or a mutant of it, over the cameras: a trace per frame."""
    culler: Any = subject.make()
    keeps = subject.suite.keeps
    trace: Trace | None = None

    def observer(step: str, data: Mapping[str, Any]) -> None:
        if trace is not None:
            kept = {name: getattr(culler, name) for name in keeps}
            trace.events.append(Event(step, copy.deepcopy({**data, **kept})))

    culler.prepare(scene)
    culler.observer = observer
    try:
        for camera in cameras:
            if trace is not None:
                trace.before = None  # two frames are enough
            trace = Trace(culler, scene, camera, subject.options, trace)
            answer = culler.cull(camera)
            trace.drawn, trace.stats = answer.unit_ids.tolist(), answer.stats
            yield trace
    finally:
        culler.close()


def broken(suite: Suite, trace: Trace) -> dict[str, list[str]]:
    """The contracts that a frame departs from, and how."""
    found = {name: list(check(trace)) for name, check in suite.contracts.items()}
    return {name: lines for name, lines in found.items() if lines}


def departures(
    subject: Method | Mutant, where: Iterable[tuple[Scene, Iterable[Camera]]] | None = None
) -> dict[str, list[str]]:
    """The same over all frames of some scenes, by default of those that its suite watches."""
    suite = subject.suite
    found: dict[str, list[str]] = {}
    for scene, cameras in suite.watched_scenes() if where is None else where:
        for frame, trace in enumerate(watch(subject, scene, cameras)):
            for name, lines in broken(suite, trace).items():
                found.setdefault(name, []).extend(f"frame {frame}: {line}" for line in lines)
    return found
