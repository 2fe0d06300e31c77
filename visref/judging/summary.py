"""What a run says beside its verdicts: of its cullers, its policy, and who cast the truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from visref.camera_path import CameraPath
from visref.engines.base import TruthEngine
from visref.findings import Code, Finding
from visref.judging.culler_findings import culler_findings
from visref.judging.limits import LOOKED_AT, hidden_by_limits, known_to_be_wrong
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Accepting
from visref.judging.rounding import FORGIVEN_PX
from visref.judging.stale import policy_findings
from visref.judging.winding import inside_out
from visref.picking import evenly_picked
from visref.recordings.truth_file import RecordedTruth
from visref.scene import Scene


@dataclass(frozen=True)
class Caster:
    """The engine that cast in a run: its name, whether it is exact, and whether it took the scene
    to coordinates of its own without a rounding that it does not account for."""

    name: str
    exact: bool
    rebase_exact: bool

    @classmethod
    def of(cls, engine: TruthEngine) -> Caster:
        return cls(engine.name, bool(engine.exact), bool(getattr(engine, "rebase_exact", True)))


@dataclass
class Moved:
    """By how many `pixels` rounding moved what is seen in a frame at most, and the triangle.
    `wanted`: the cullers for whose sake it was cast; none where that was for the truth's own."""

    frame: int
    pixels: float = 0.0
    triangle: int = -1
    wanted: list[str] = field(default_factory=list)

    def grow(self, pixels: float, triangle: int) -> None:
        """Take in a view."""
        self.pixels, self.triangle = max((self.pixels, self.triangle), (pixels, triangle))

    def want(self, culler: str) -> None:
        """A culler's verdict rests on the cast."""
        if culler not in self.wanted:
            self.wanted.append(culler)


def examined(
    engine: TruthEngine, scene: Scene, path: CameraPath, frames: Sequence[int], threads: int | None
) -> list[Finding]:
    """Whether near, far or the winding hide most of a scene, and whether the engine errs where it
    is known what is seen: in some of the frames. `engine` is posed as in the last one."""
    picked = [path.views(frames[i]) for i in evenly_picked(len(frames), LOOKED_AT)]
    return [
        *hidden_by_limits(engine, scene, picked),
        *known_to_be_wrong(engine, scene, picked),
        *inside_out(type(engine), scene, picked, threads=threads),
    ]


def conclude(
    outcome: RunOutcome,
    accepting: Accepting,
    path: CameraPath,
    scene: Scene,
    caster: RecordedTruth | Caster | None,
    rebased: bool,
    moved: Iterable[Moved],
) -> None:
    """Add what all frames together give to say. `caster`: who cast the truth; `rebased`: whether
    who cast in this run took the scene exactly."""
    outcome.findings.extend(policy_findings(accepting, outcome.cullers, path.numbers))
    for record in outcome.cullers:
        outcome.findings.extend(culler_findings(record, scene))
    if caster is not None and not caster.exact:
        name = caster.engine if isinstance(caster, RecordedTruth) else caster.name
        outcome.findings.append(Finding(Code.ENGINE_BLIND_SPOTS, f"the truth was cast by '{name}'"))
    pixels, frame, triangle = max(
        ((one.pixels, -one.frame, one.triangle) for one in moved), default=(0.0, 0, -1)
    )
    if pixels > FORGIVEN_PX:
        owner = scene.names[scene.object_of_triangle[triangle]]
        outcome.findings.append(
            Finding(Code.VERTICES_ROUNDED, f"by {pixels:.3g} pixels at most", "", -frame, owner)
        )
    if not rebased:
        outcome.findings.append(Finding(Code.REBASE_INEXACT, "the scene spans too far"))
