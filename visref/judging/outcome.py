"""What a run found, as plain values: a row a culler and frame, findings, sums and the worst.

`visref.judging.referee` fills these, `visref.run_folder.write` writes them down, and reports are
made from the files.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Set
from dataclasses import dataclass, field

import numpy as np

from visref.camera import ALL_VIEWS as ALL_VIEWS
from visref.culler import Promise, QueryStats, RasterTolerance
from visref.findings import Finding, fails_run
from visref.judging.bounds import BoundsTooSmall
from visref.judging.causes import CausesFound
from visref.judging.judge import Counts, FrameVerdict
from visref.judging.losses import Losses
from visref.judging.misses import Miss, Misses, MissKind
from visref.judging.names import Names
from visref.judging.policy import Policy
from visref.judging.status import (
    MAX_UNDECIDED,
    CullerOutcome,
    Exit,
    Status,
    run_status,
    status_of,
)
from visref.scene import Int64


@dataclass(frozen=True, eq=False)
class FrameRecord:
    """One culler's drawn set in one frame: the verdict, the cost, and whether the picture held
    (`image_pixels_differ`: pixels, None if it was not asked). `view`: the view that the set is
    for, or `ALL_VIEWS`; `width`: its image's, in samples."""

    frame: int
    view: str
    width: int
    verdict: FrameVerdict
    stats: QueryStats
    triangles_drawn: int
    corrections: int = 0
    image_pixels_differ: int | None = None


@dataclass
class CullerRecord:
    """One culler's run. `spec` is its name with options, unique within a run; `raster` the
    tolerance that its rasteriser declares (the loosest of its frames), None without one.
    `too_small`: the units whose boxes did not hold them. `ignored`: by
    unit, the first frame in which it was drawn and not there. `max_undecided`: the share of the
    owned samples above which it is inconclusive. `unsteady`: it answered otherwise when it was
    asked again. `misaligned`: it fits another input, and nothing is concluded from it, as the user
    chose. `causes`: why it missed what it missed, where that was asked (`visref.causes`)."""

    spec: str
    promise: Promise
    unit_kind: str = "object"
    unit_count: int = 0
    frames: list[FrameRecord] = field(default_factory=list)
    failed: bool = False
    raster: RasterTolerance | None = None
    too_small: list[BoundsTooSmall] = field(default_factory=list)
    ignored: dict[int, int] = field(default_factory=dict)
    max_undecided: float = MAX_UNDECIDED
    unsteady: bool = False
    misaligned: bool = False
    causes: CausesFound = field(default_factory=CausesFound)

    def judged_whole(self, frames: Set[int]) -> bool:
        """Whether it was judged in all these frames, and broke down in none."""
        return not self.failed and frames <= {row.frame for row in self.frames}

    @property
    def totals(self) -> Counts:
        return sum((record.verdict.counts for record in self.frames), Counts())

    @property
    def excused_samples(self) -> int:
        """Samples lost within the rasteriser's tolerance, of a tied one once for each object."""
        return sum(
            int(misses.columns.samples[misses.are(MissKind.WITHIN_RASTER)].sum())
            for misses in self._misses()
        )

    def _misses(self) -> Iterator[Misses]:
        return (row.verdict.misses for row in self.frames if row.verdict.misses)

    @property
    def exit(self) -> Exit:
        return self.status.exit

    @property
    def status(self) -> Status:
        outcome = CullerOutcome(
            self.totals,
            len(self.frames),
            self.failed,
            self.promise,
            self.unsteady,
            self.misaligned,
        )
        return status_of(outcome, max_undecided=self.max_undecided)

    def ages(self) -> dict[int, int]:
        """How many misses that lose samples there are of each age, in frames; those without one are
        in none."""
        ages: Counter[int] = Counter()
        for misses in self._misses():
            age = misses.columns.age
            told = age[(age >= 0) & ~misses.are(MissKind.TIE)]
            ages.update(dict(zip(*(one.tolist() for one in _counted(told)), strict=True)))
        return dict(sorted(ages.items()))

    def losses(self, most: int | None = None) -> list[tuple[int, int, Miss]]:
        """Confirmed misses by object: (samples lost over all frames, frame, worst miss),
        the most lost first; of all objects, or of so many."""
        losses = Losses.of(self.frames)
        worst = losses.worst(self.frames, most)
        samples = losses.samples[:most].tolist()
        return [(total, *one) for total, one in zip(samples, worst, strict=True)]


def _counted(values: Int64) -> tuple[Int64, Int64]:
    """Each value once, and how often it is there."""
    each, counts = np.unique(values, return_counts=True)
    return each, counts


@dataclass
class RunOutcome:
    """A whole run. `policy`: what its user accepts, which its records have been through."""

    cullers: list[CullerRecord]
    findings: list[Finding] = field(default_factory=list)
    policy: Policy = field(default_factory=Policy)

    @property
    def status(self) -> Status:
        severity_of = self.policy.severity_of
        fails = any(fails_run(one.code, severity_of(one.code)) for one in self.findings)
        return run_status((culler.status for culler in self.cullers), fails=fails)

    @property
    def exit(self) -> Exit:
        return self.status.exit


def witness_json(scene: Names, frame: int, miss: Miss) -> dict[str, object]:
    """A miss's witness as it stands in `verdict.json`, the objects table and reports."""
    return {
        "frame": frame,
        "view": miss.view,
        "x": miss.sample % miss.width,
        "y": miss.sample // miss.width,
        "object": miss.object,
        "object_name": scene.names[miss.object],
        "triangle": miss.triangle,
        "depth": miss.depth,
        "kind": miss.kind.value,
        "pixels": miss.samples,
        "owned": miss.owned,
        "margin_px": _finite(miss.margin_px),
        "margin_depth": _finite(miss.margin_depth),
        "partly": miss.partly,
    }


def raster_json(record: CullerRecord) -> dict[str, object] | None:
    """What a culler's rasteriser declares and what that excused, as in `verdict.json`."""
    if record.raster is None:
        return None
    return {
        **vars(record.raster),
        "objects": record.totals.within_raster_tolerance,
        "samples": record.excused_samples,
    }


def _finite(margin: float | None) -> float | None:
    """JSON has no infinity: a margin that nothing limits is null, like one not computed."""
    return margin if margin is not None and math.isfinite(margin) else None


def finding_json(finding: Finding) -> dict[str, object]:
    """A finding as records have it, but for its severity, which is the policy's."""
    return {
        "code": finding.code.value,
        "message": finding.message,
        "culler": finding.culler,
        "frame": finding.frame,
        "object": finding.object,
    }


def verdict_json(outcome: RunOutcome, scene: Names) -> dict[str, object]:
    """The content of `verdict.json`."""
    cullers: dict[str, object] = {}
    for record in outcome.cullers:
        losses = record.losses(1)
        worst = witness_json(scene, *losses[0][1:]) if losses else None
        cullers[record.spec] = {
            "status": record.status.value,
            "promise": record.promise.value,
            "frames": len({row.frame for row in record.frames}),
            "unit_kind": record.unit_kind,
            **vars(record.totals),
            "ages": {str(age): count for age, count in record.ages().items()},
            "causes": record.causes.grouped(),
            "worst": worst,
            "raster": raster_json(record),
        }
    return {
        "status": outcome.status.value,
        "exit_status": int(outcome.exit),
        "cullers": cullers,
        "findings": [
            {
                **finding_json(finding),
                "severity": outcome.policy.severity_of(finding.code).value,
            }
            for finding in outcome.findings
        ],
    }
