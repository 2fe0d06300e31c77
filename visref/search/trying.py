"""How trials are tried, in any process, and what becomes of one.

Each generated scene is a case of its own. Of views of one scene several follow each other in one
run, each begun with a cut, so that the scene is prepared and the culler made once for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.conformance.classes import classes_of
from visref.errors import InputError
from visref.inputs import open_scene
from visref.judging.status import Status
from visref.plug_ins import Making
from visref.plug_ins.command import Command
from visref.promise import Promise
from visref.search.case import Case
from visref.search.generated import PLAIN, GeneratedScenes
from visref.search.judging import Kind, Verdict, Violation, verdict_of
from visref.search.novelty import Feature, Watching, count_class
from visref.search.stream import Source
from visref.search.suspects import Program, Suspect, suspect_of
from visref.search.views import FRAMES, ViewsOf

# Views of one scene that are judged in one run.
_TOGETHER = 8


@dataclass(frozen=True)
class Asked:
    """What is searched: who is tried, and on what. Either `culler`, a spec, or `command`. `scene`:
    whose views are tried, "" for generated scenes; `can`: the classes of cases that the culler is
    for, None for all."""

    culler: str = ""
    command: Command | None = None
    scene: str = ""
    making: Making = field(default_factory=Making)
    engine: str = ""
    cull_backfaces: bool = False
    lenient: bool = False
    can: frozenset[str] | None = None
    seed: int = 0

    @property
    def name(self) -> str:
        """What records call the culler."""
        return self.command.name if self.command is not None else self.culler

    def suspect(self) -> Suspect:
        """Who is tried, for this process. Raises InputError for a spec that names nothing."""
        if self.command is not None:
            making = self.making
            return Program(
                self.command, making.time_limit_s, making.memory_limit, _say(making, self.name)
            )
        return suspect_of(self.culler, self.making)

    def source(self, *, moves: bool) -> Source[Any]:
        """Where trials come from. Raises InputError for anything wrong with the scene."""
        if not self.scene:
            return GeneratedScenes(moves and self._can("moving"))
        scene, path, _ = open_scene(
            self.scene,
            cull_backfaces=self.cull_backfaces,
            lenient=self.lenient,
            max_memory=self.making.memory_limit,
        )
        animated = moves and scene.rig is not None and scene.rig.motion is not None
        if path is not None:
            lens = path.frames[0].cameras[0]
        else:
            low, high = scene.core_bounds
            size = max(float(max(high - low)), 1e-6)
            lens = Camera(look_at((0, 0, 0), (0, 0, -1)), 160, 120, near=1e-3 * size, yfov=1.0)
        return ViewsOf(scene, lens, self.seed, True, self.cull_backfaces, animated)

    def _can(self, name: str) -> bool:
        return self.can is None or name in self.can

    def allows(self, case: Case) -> bool:
        """Whether the culler is for such cases."""
        return self.can is None or set(classes_of(case.scene, case.path, None)) <= self.can


def _say(making: Making, name: str) -> Any:
    say = making.say
    return None if say is None else lambda line: say(name, line)


@dataclass(frozen=True)
class Outcome:
    """What became of a trial. `features`: what it showed; `violations`: by frames of its own path;
    `failed`: how the culler broke down; `skipped`: why it was not judged (no case can be made of
    it, or the culler is not for such); `promise`: the culler's; `looked_into`: whether the causes
    of its misses were looked for."""

    trial: int
    features: tuple[Feature, ...] = ()
    violations: tuple[Violation, ...] = ()
    status: Status = Status.INCONCLUSIVE
    failed: str = ""
    skipped: str = ""
    promise: Promise = Promise.CONSERVATIVE
    looked_into: bool = False

    @property
    def misses(self) -> bool:
        """Whether anything was left out, so that there are causes to look for."""
        return any(one.kind is not Kind.SUPERFLUOUS for one in self.violations)


@dataclass(eq=False)
class Trier:
    """Tries trials in this process."""

    asked: Asked
    suspect: Suspect
    source: Source[Any]

    @classmethod
    def of(cls, asked: Asked, *, moves: bool) -> Trier:
        """With a culler of its own. Raises InputError for anything wrong with what is asked."""
        return cls(asked, asked.suspect(), asked.source(moves=moves))

    @property
    def together(self) -> int:
        """How many trials are tried in one run."""
        return _TOGETHER if isinstance(self.source, ViewsOf) else 1

    def try_all(self, trials: Sequence[tuple[int, Any]]) -> list[Outcome]:
        """The outcomes of some trials, given by number and genome in JSON values: the same for the
        same ones."""
        return self._tried(trials, explained=False)

    def _tried(self, trials: Sequence[tuple[int, Any]], *, explained: bool) -> list[Outcome]:
        numbers = [trial for trial, _ in trials]
        genomes = [self.source.read(value) for _, value in trials]
        try:
            if isinstance(self.source, ViewsOf):
                return self._views(self.source, numbers, genomes, explained)
            return [
                self._case(trial, genome, explained)
                for trial, genome in zip(numbers, genomes, strict=True)
            ]
        except InputError as error:
            return [Outcome(trial, skipped=str(error)) for trial in numbers]

    def explained(self, trials: Sequence[tuple[int, Any]], outcome: Outcome) -> Outcome:
        """The outcome of the last of some trials with the causes of its misses: the same trials are
        judged again. Whose answers hang on anything else shows no cause."""
        known = list(map(_bare, outcome.violations))
        # By itself first: to name the causes of a whole run takes longer.
        for some in [trials[-1:], trials][: len(trials)]:
            (*_, again) = self._tried(some, explained=True)
            if list(map(_bare, again.violations)) == known:
                return again
        return replace(outcome, looked_into=True)

    @property
    def engine(self) -> str:
        """The truth engine's name."""
        if self.asked.engine:
            return self.asked.engine
        # Small scenes are cast exactly, so that no miss stays unseen.
        return "embree" if self.asked.scene else "exact"

    def _case(self, trial: int, genome: Any, explained: bool) -> Outcome:
        try:
            case = self.source.case(genome)
        except InputError as error:
            return Outcome(trial, skipped=str(error))
        if not self.asked.allows(case):
            return Outcome(trial, skipped="it is not for such scenes")
        (outcome,) = self._judged(case, [trial], len(case.path), explained)
        return outcome

    def _views(
        self, source: ViewsOf, numbers: list[int], genomes: list[Any], explained: bool
    ) -> list[Outcome]:
        frames = [frame for genome in genomes for frame in source.frames(genome)]
        case = source.on(CameraPath(frames, "views"))
        if not self.asked.allows(case):
            return [Outcome(trial, skipped="it is not for such scenes") for trial in numbers]
        outcomes = self._judged(case, numbers, FRAMES, explained)
        if len(numbers) > 1 and any(one.failed for one in outcomes):
            # One of them broke the culler down.
            pairs = zip(numbers, genomes, strict=True)
            return [self._views(source, [n], [genome], explained)[0] for n, genome in pairs]
        return outcomes

    def _judged(
        self, case: Case, numbers: list[int], frames: int, explained: bool
    ) -> list[Outcome]:
        """The outcomes of trials whose frames, so many each, follow each other in a case."""
        timeline = case.inputs(self.engine).timeline
        watching = Watching(timeline.at, lambda frame: frame // frames, self.source.called(case))
        try:
            verdict = verdict_of(
                case,
                self.suspect,
                engine=self.engine,
                listeners=[watching],
                explained=(lambda _: True) if explained else None,
            )
        except InputError as error:
            return [Outcome(trial, skipped=str(error)) for trial in numbers]
        return [
            replace(self._outcome(verdict, watching, number, at, frames), looked_into=explained)
            for at, number in enumerate(numbers)
        ]

    def _outcome(
        self, verdict: Verdict, watching: Watching, number: int, at: int, frames: int
    ) -> Outcome:
        first = at * frames
        own = tuple(
            replace(one, frame=one.frame - first)
            for one in verdict.violations
            if first <= one.frame < first + frames
        )
        features = {
            *watching.features.get(at, ()),
            # A larger or smaller loss is worth keeping, and a cause that is new.
            *(f"violation: {one.kind}: {count_class(one.samples)}" for one in own),
            *(f"violation: {one.kind}: {one.cause}" for one in own if one.cause),
        }
        status = verdict.status
        if not verdict.failed:
            status = Status.VIOLATION if own else Status.NO_VIOLATION_FOUND
            if not watching.visible[at]:
                status = Status.INCONCLUSIVE
            elif not verdict.promise.convicts and verdict.promise.may_draw_hidden:
                status = Status.MEASURED
        return Outcome(
            number, tuple(sorted(features)), own, status, verdict.failed, "", verdict.promise
        )


def _bare(violation: Violation) -> Violation:
    """A violation without its causes, that equals itself (what is hidden has no depth, NaN)."""
    hidden = violation.kind is Kind.SUPERFLUOUS
    return replace(violation, cause="", others=(), depth=0.0 if hidden else violation.depth)


def moves_of(suspect: Suspect) -> bool:
    """Whether a culler can judge scenes in which things move. Raises NothingToJudge where it cannot
    be made here."""
    case = GeneratedScenes(moves=False).case(PLAIN)
    with suspect.on(case) as culler:
        try:
            return culler.moves
        finally:
            culler.close()
