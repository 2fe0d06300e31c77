"""What a run says beside its verdicts: of its cullers, its policy, and who cast the truth.

`Facts` are what verdicts do not hold; those of a run's parts, put together, are the whole run's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from visref.camera_path import CameraPath
from visref.engines.base import TruthEngine
from visref.findings import Code, Finding
from visref.judging.asking import Failure
from visref.judging.culler_findings import culler_findings
from visref.judging.limits import LOOKED_AT, hidden_by_limits, known_to_be_wrong
from visref.judging.names import Names
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Accepting
from visref.judging.rounding import FORGIVEN_PX
from visref.judging.stale import policy_findings
from visref.judging.winding import inside_out
from visref.picking import evenly_picked
from visref.scene import Scene


@dataclass(frozen=True)
class Caster:
    """The engine that cast a truth: its name, whether it is exact (None where a file does not say),
    and whether it took the scene to coordinates of its own without a rounding that it does not
    account for."""

    name: str
    exact: bool | None
    rebase_exact: bool = True

    @classmethod
    def of(cls, engine: TruthEngine) -> Caster:
        return cls(engine.name, bool(engine.exact), bool(getattr(engine, "rebase_exact", True)))


@dataclass
class Moved:
    """By how many `pixels` rounding moved what is seen in a frame at most, and a triangle that is
    so moved, with its object's name. `wanted`: the cullers for whose sake it was cast; none where
    that was for the truth's own."""

    frame: int
    pixels: float = 0.0
    triangle: int = -1
    owner: str = ""
    wanted: list[str] = field(default_factory=list)

    def grow(self, pixels: float, triangle: int, scene: Scene) -> None:
        """Take in a view."""
        if (pixels, triangle) > (self.pixels, self.triangle):
            self.pixels, self.triangle = pixels, triangle
            self.owner = scene.owner_name(triangle) if triangle >= 0 else ""

    def want(self, culler: str) -> None:
        """A culler's verdict rests on the cast."""
        if culler not in self.wanted:
            self.wanted.append(culler)


@dataclass(eq=False)
class Facts:
    """What a run found beside its verdicts. `caster`: who cast in it, None where nobody did;
    `recorded`: who cast the truth on file that it went by, None without one. `examined`: what
    is said of the engine and the scene; `moved`: one per frame that was cast."""

    caster: Caster | None = None
    recorded: Caster | None = None
    examined: list[Finding] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    moved: list[Moved] = field(default_factory=list)


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
    facts: Facts,
    accepting: Accepting,
    numbers: Sequence[int],
    names: Names,
    *,
    whole: bool = True,
) -> None:
    """Add what all frames together give to say. `numbers`: of the path's frames. A part that is not
    the `whole` run does not ask whether a waiver is stale."""
    outcome.findings += [*facts.examined, *(failure.finding for failure in facts.failures)]
    if whole:
        outcome.findings += policy_findings(accepting, outcome.cullers, numbers)
    else:
        outcome.findings += accepting.policy.remarks
    for record in outcome.cullers:
        outcome.findings += culler_findings(record, names)
    caster = facts.recorded or facts.caster
    if caster is not None and not caster.exact:
        text = f"the truth was cast by '{caster.name}'"
        outcome.findings.append(Finding(Code.ENGINE_BLIND_SPOTS, text))
    pixels, frame, _, owner = max(
        ((one.pixels, -one.frame, one.triangle, one.owner) for one in facts.moved),
        default=(0.0, 0, -1, ""),
    )
    if pixels > FORGIVEN_PX:
        text = f"by {pixels:.3g} pixels at most"
        outcome.findings.append(Finding(Code.VERTICES_ROUNDED, text, "", -frame, owner))
    if facts.caster is not None and not facts.caster.rebase_exact:
        outcome.findings.append(Finding(Code.REBASE_INEXACT, "the scene spans too far"))
