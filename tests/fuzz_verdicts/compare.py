"""A case through visref, from its files to the exit status, beside the brute force."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz_verdicts import brute
from tests.fuzz_verdicts.case import Case
from tests.fuzz_verdicts.files import write
from visref.culler import Culler, DrawnSet, Promise
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.engines.open3d import Open3DEngine
from visref.formats.loading import load_path, load_scene
from visref.judging.asking import Job
from visref.judging.outcome import RunOutcome
from visref.judging.referee import JudgedFrame, Referee
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.recordings.visible_sets import Replay, read_visible_sets
from visref.scene import Scene, Units
from visref.visibility import FrameTruth, ObjectVisibility, mask_states

ENGINES = {"exact": ExactEngine, "embree": EmbreeEngine, "open3d": Open3DEngine}
COUNTS = (
    *("visible", "missed", "partly_missed", "confirmed", "ties", "missed_pixels"),
    *("owned_samples", "undecided_samples", "drawn", "missed_units", "superfluous"),
    *("superfluous_confirmed", "violations", "within_raster_tolerance"),
)
WORDS = {SOLID: brute.SOLID, HOLE: brute.HOLE, BETWEEN: brute.BETWEEN}


@dataclass
class Compared:
    """`differences`: a line each. `seen`: how much of what was compared."""

    differences: list[str] = field(default_factory=list)
    seen: Counter[str] = field(default_factory=Counter)


class Drawn(Culler):
    """Draws what the case says, one set of unit ids after another."""

    name = "drawn"

    def __init__(
        self, lists: list[list[int]], promise: str, drawn: list[list[int]], *, joint: bool = False
    ) -> None:
        self.promise, self.joint = Promise(promise), joint
        self._units = Units(
            np.cumsum([0, *(len(unit) for unit in lists)]),
            np.array([i for unit in lists for i in unit], np.int32),
            "cell",
        )
        self._coming = iter(drawn)

    def prepare(self, scene: Scene) -> Units:
        return self._units

    def update(self, scene: Scene) -> None:
        """What is drawn is said, whatever moves."""

    def cull(self, camera: Any) -> DrawnSet:
        return DrawnSet(np.array(next(self._coming), np.int32))

    def cull_joint(self, cameras: Any) -> DrawnSet:
        return self.cull(cameras)


class Kept:
    """A run's listener that keeps truths as they were cast, and what they were settled to."""

    def __init__(self) -> None:
        self.cast: list[tuple[int, FrameTruth]] = []
        self.judged: list[JudgedFrame] = []

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        self.cast.append((frame, truth.copy()))

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        self.judged.append(judged)

    def on_frame_done(self, frame: int) -> None:
        pass


def compare(case: Case, folder: Path, engines: Sequence[str] = tuple(ENGINES)) -> Compared:
    """Judge the case with each engine and by brute force."""
    result = Compared()
    scene_file, path_file, sets_file = write(case, folder)
    scene = load_scene(scene_file, cull_backfaces=case.cull_backfaces)
    path = load_path(path_file).relative_to(scene.origin)
    triangles = case.triangles
    if scene.object_of_triangle.tolist() != [t.object for t in triangles]:
        result.differences.append("reading: other triangles")
        return result
    # The cases' numbers are all float32 numbers about an origin.
    if scene.moved is not None:
        result.differences.append("reading: a vertex moved")
    frames = []
    for number, camera in enumerate(case.frames):
        view = brute.View(triangles, camera)
        states = States(view, scene, path.cameras[number], result)
        frames.append([brute.Sample(view, at, states) for at in range(len(view.grid))])
    expected = [
        brute.judge(samples, triangles, case.unit_lists, drawn, case.promise)
        for samples, drawn in zip(frames, case.drawn, strict=True)
    ]
    for name in engines:
        kept = Kept()
        if case.units is None:
            every = range(len(path))
            sets = read_visible_sets(sets_file, scene, every, path)
            culler: Culler = Replay(sets, path, Promise(case.promise))
        else:
            culler = Drawn(case.unit_lists, case.promise, case.drawn)
        # One thread: so small an image is sooner cast than handed round.
        referee = Referee(scene, lambda name=name: ENGINES[name](scene, threads=1), threads=1)
        outcome = referee.run(path, range(len(path)), [("fuzz", culler)], [kept])
        if outcome.cullers[0].failed:
            result.differences.append(f"{name}: failed: {outcome.findings}")
            continue
        for number, (samples, wanted, drawn) in enumerate(
            zip(frames, expected, case.drawn, strict=True)
        ):
            judged, where = kept.judged[number], f"{name} frame {number}"
            if name == "exact":
                result.differences += exact_differs(where, [samples], judged, wanted)
            else:
                shown = {i for unit in drawn for i in case.unit_lists[unit]}
                cast = [kept.cast[number][1]]
                result.differences += clears_only(where, [samples], cast, judged, wanted, shown)
            result.seen[f"lost in {name}"] += len(lost_samples(judged))
        if name == "exact":
            result.differences += status_differs(outcome, expected, case.promise)
            result.seen[f"cases: status {outcome.cullers[0].status.value}"] += 1
    result.seen.update(f"cases: {kind}" for kind in case.kinds)
    for samples, (counts, _, _) in zip(frames, expected, strict=True):
        result.seen.update({name: counts[name] for name in COUNTS})
        result.seen["frames"] += 1
        result.seen["samples"] += len(samples)
        result.seen["tied samples"] += sum(len(s.tied) > 1 for s in samples)
        result.seen["samples with glass"] += sum(bool(s.glass) for s in samples)
        result.seen["samples in doubt"] += sum(bool(s.doubt) for s in samples)
    return result


class States:
    """What a mask says, by the brute force; where that lies on a border that float64 cannot
    see, what visref says, which must be one of the two answers there."""

    def __init__(self, view: brute.View, scene: Scene, camera: Any, result: Compared) -> None:
        self.view, self.scene, self.camera, self.result = view, scene, camera, result

    def __call__(self, sample: int, triangle: int) -> str:
        may = self.view.mask(sample, triangle)
        self.result.seen["mask lookups"] += 1
        if len(may) == 1:
            answer = next(iter(may))
        else:
            self.result.seen["mask lookups on a border"] += 1
            answer = brute.SOLID if brute.SOLID in may else brute.HOLE
        if int(self.scene.alpha[triangle]) != 1:
            # The reader took it for opaque, so it must be solid all over.
            said = brute.SOLID
        else:
            at = np.array([sample]), np.array([triangle])
            said = WORDS[int(mask_states(self.scene, self.camera, *at)[0])]
        if said not in may:
            self.result.differences.append(
                f"mask: sample {sample}, triangle {triangle}: {said}, not {may}"
            )
        return answer if len(may) == 1 else said


def lost_samples(judged: JudgedFrame) -> set[int]:
    """Of all views of a drawn set, numbered through in their order."""
    found, start = set(), 0
    for settled in judged.settled:
        found |= {start + at for at in settled.walk.lost_samples.tolist()}
        start += settled.truth.buffer.triangle.size
    return found


def exact_differs(
    where: str, views: list[list[brute.Sample]], judged: JudgedFrame, wanted: tuple[Any, ...]
) -> list[str]:
    """An exact engine's verdict: all that it holds."""
    found = []
    for samples, settled in zip(views, judged.settled, strict=True):
        found += _owners(f"{where} {settled.truth.camera.view}", samples, settled.truth)
    return found + _counts(where, judged, wanted)


def _owners(where: str, samples: list[brute.Sample], truth: FrameTruth) -> list[str]:
    """Owners and ties, what is in doubt, and glass, sample by sample."""
    found = []
    owner = truth.buffer.triangle.reshape(-1)
    doubt_at = truth.doubt.at()
    for at, s in enumerate(samples):
        tied = truth.ties.triangle[truth.ties.sample == at].tolist()
        here = sorted([*([int(owner[at])] if owner[at] >= 0 else []), *tied])
        if here != sorted(s.tied):
            found.append(f"{where}: sample {at}: owners {here}, not {sorted(s.tied)}")
        doubt = sorted(truth.doubt.triangle[doubt_at == at].tolist())
        if doubt != sorted(s.doubt):
            found.append(f"{where}: sample {at}: in doubt {doubt}, not {sorted(s.doubt)}")
        glass = sorted(truth.blend.triangle[truth.blend.sample == at].tolist())
        if glass != sorted(s.glass):
            found.append(f"{where}: sample {at}: glass {glass}, not {sorted(s.glass)}")
    return found


def _counts(where: str, judged: JudgedFrame, wanted: tuple[Any, ...]) -> list[str]:
    counts, lost, loses = wanted
    said = judged.record.verdict.counts
    found = [
        f"{where}: {name} {getattr(said, name)}, not {counts[name]}"
        for name in COUNTS
        if getattr(said, name) != counts[name]
    ]
    here = lost_samples(judged)
    if here != lost:
        found.append(f"{where}: lost samples {here ^ lost}")
    convicted = {m.object for m in judged.record.verdict.misses if m.kind == "confirmed"}
    if convicted != loses:
        found.append(f"{where}: convicted {convicted}, not {loses}")
    return found


def clears_only(
    where: str,
    views: list[list[brute.Sample]],
    casts: list[FrameTruth],
    judged: JudgedFrame,
    wanted: tuple[Any, ...],
    drawn: set[int],
) -> list[str]:
    """A ray engine's verdict: whatever it says is lost is lost, and what it does not say is what
    it took for drawn, or for nothing."""
    counts, lost, loses = wanted
    here = lost_samples(judged)
    found = [f"{where}: sample {at} is not lost" for at in sorted(here - lost)]
    start = 0
    for samples, cast in zip(views, casts, strict=True):
        owner, doubt_at = cast.buffer.triangle.reshape(-1), cast.doubt.at()
        for at in range(len(samples)):
            if start + at not in lost - here:
                continue
            may = {int(owner[at]), *cast.doubt.triangle[doubt_at == at].tolist()}
            if owner[at] >= 0 and not may & drawn:
                found.append(f"{where}: sample {start + at} was seen to be lost, and let go")
        start += len(samples)
    misses = judged.record.verdict.misses
    convicted = {m.object for m in misses if m.kind == "confirmed"}
    found += [f"{where}: object {o} loses nothing" for o in sorted(convicted - loses)]
    superfluous = judged.record.verdict.counts.superfluous_confirmed
    if superfluous > counts["superfluous_confirmed"]:
        found.append(f"{where}: {superfluous} hidden, not {counts['superfluous_confirmed']}")
    return found


def status_differs(outcome: RunOutcome, expected: list[Any], promise: str) -> list[str]:
    totals: Counter[str] = Counter()
    for counts, _, _ in expected:
        totals.update(counts)
    wanted = brute.status(totals, promise)
    said = outcome.cullers[0].status.value, int(outcome.exit)
    return [] if said == wanted else [f"status {said}, not {wanted}"]
