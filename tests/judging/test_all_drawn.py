"""Where all that is seen was drawn, the verdict is found by what is seen, and no sample is walked.

Random truths and drawn sets, made by hand: the quick verdict must be, field by field, that of the
walk over all samples, and what a count over Python's sets says.
"""

from __future__ import annotations

import tracemalloc
from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest

from tests.support.hand_made import camera
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet, Promise
from visref.engines.base import TruthEngine
from visref.judging import settle as settling
from visref.judging.absences import without_absent
from visref.judging.ages import Followed
from visref.judging.holders import DrawList, Holders, UnitsSeen
from visref.judging.joint import all_drawn, joined, judge_all_drawn
from visref.judging.judge import FrameVerdict, judge
from visref.judging.referee import Referee, Sitting
from visref.judging.settle import settle
from visref.judging.walk import SampleWalk, nothing_lost, walk_samples
from visref.scene import Alpha, Scene, Units
from visref.visibility import BlendVisibility, Doubt, FrameTruth, Ties, VisibilityBuffer

CASES, BATCHES = 100, 6
KINDS = ("objects", "objects by another name", "apart", "overlapping", "repeated", "gaps")


@dataclass
class Case:
    """A scene at one moment, truths of its views, units as lists, and which of them are drawn."""

    scene: Scene
    truths: list[FrameTruth]
    kind: str
    lists: list[list[int]]
    drawn: list[int]
    promise: Promise

    @property
    def units(self) -> Units:
        sizes = [len(one) for one in self.lists]
        triangles = np.array([t for one in self.lists for t in one], np.int32)
        kind = "object" if self.kind == "objects" else "cluster"
        return Units(np.cumsum([0, *sizes]), triangles, kind)

    @property
    def mask(self) -> np.ndarray:
        shown = {t for unit in self.drawn for t in self.lists[unit]}
        return np.isin(np.arange(self.scene.triangle_count), list(shown))

    @property
    def must_be_drawn(self) -> set[int]:
        """All that owns, or may, ties or is seen as glass."""
        found: set[int] = set()
        for truth in self.truths:
            found.update(truth.buffer.triangle[truth.buffer.triangle >= 0].tolist())
            for seen in (truth.ties, truth.doubt, truth.blend):
                found.update(seen.triangle.tolist())
        return found

    @property
    def may_be_seen(self) -> set[int]:
        return self.must_be_drawn.union(*(truth.veiled.tolist() for truth in self.truths))

    @property
    def seen(self) -> set[int]:
        """All that owns a decided sample, ties, or is seen as glass."""
        found: set[int] = set()
        for truth in self.truths:
            owner = truth.buffer.triangle.reshape(-1)[truth.decided]
            found.update(owner[owner >= 0].tolist())
            found.update(truth.ties.triangle.tolist(), truth.blend.triangle.tolist())
        return found

    def draw_list(self) -> DrawList:
        ids = np.array(self.drawn, np.int32)
        return DrawList.of_units(self.scene, self.units, ids)


def random_scene(rng: np.random.Generator) -> Scene:
    sizes = rng.integers(0, 5, rng.integers(1, 9))
    count = int(sizes.sum())
    share = rng.choice([0.0, 0.3])
    alpha = np.where(rng.random(count) < share, Alpha.BLEND, Alpha.OPAQUE).astype(np.uint8)
    gone = rng.random(len(sizes)) < rng.choice([0.0, 0.0, 0.3])
    return Scene(
        np.arange(9.0).reshape(3, 3) ** 2,
        np.tile(np.arange(3), (count, 1)),
        np.append(0, np.cumsum(sizes)),
        tuple(f"o{i}" for i in range(len(sizes))),
        alpha=alpha,
        absent=gone if gone.any() else None,
    )


def random_truth(rng: np.random.Generator, scene: Scene, view: str) -> FrameTruth:
    look = replace(camera(*rng.integers(1, 6, 2)), view=view)
    count = look.samples
    there = np.flatnonzero(scene.present)
    opaque, glass = (there[(scene.alpha[there] == Alpha.BLEND) == b] for b in (False, True))
    owner = np.full(count, -1, np.int32)
    hit = rng.random(count) < rng.choice([0.0, 0.7, 1.0])
    some = rng.permutation(opaque)[: rng.integers(1, 6)]
    if len(some):
        owner[hit] = rng.choice(some, hit.sum())

    def some_at(samples: np.ndarray, of: np.ndarray, share: float) -> list[tuple[int, int]]:
        if not len(of):
            return []
        at = samples[rng.random(len(samples)) < share]
        pairs = {(int(s), int(t)) for s in at for t in rng.choice(of, rng.integers(1, 3))}
        return sorted(p for p in pairs if owner[p[0]] != p[1])

    every = np.arange(count)
    ties = some_at(np.flatnonzero(owner >= 0), opaque, rng.choice([0.0, 0.3]))
    doubt = some_at(every, opaque, rng.choice([0.0, 0.0, 0.3]))
    sure = np.setdiff1d(every, [s for s, _ in doubt])
    blend = some_at(sure, glass, rng.choice([0.0, 0.5]))
    columns = [np.array([*zip(*pairs, strict=True)] or [[], []], np.int64) for pairs in
               (ties, doubt, blend)]  # fmt: skip
    depth = np.where(owner >= 0, rng.uniform(2.0, 9.0, count), np.inf)
    return FrameTruth(
        look,
        "hand",
        VisibilityBuffer(
            owner.reshape(look.height, look.width), depth.reshape(look.height, look.width)
        ),
        Ties(columns[0][0], columns[0][1].astype(np.int32)),
        True,
        Doubt.of(columns[1][0], columns[1][1]),
        BlendVisibility.of(
            scene, columns[2][0], columns[2][1].astype(np.int32), rng.uniform(0, 2, len(blend))
        ),
        rng.permutation(glass)[: rng.integers(0, 2)].astype(np.int32),
    )


def random_units(rng: np.random.Generator, scene: Scene, kind: str) -> list[list[int]]:
    count = scene.triangle_count
    if kind.startswith("objects"):
        bounds = scene.object_offsets.tolist()
        return [list(range(a, b)) for a, b in pairwise(bounds)]
    order = rng.permutation(count).tolist()
    cuts = sorted(rng.integers(0, count + 1, 4).tolist())
    lists = [order[a:b] for a, b in zip([0, *cuts], [*cuts, count], strict=True)]
    if kind == "gaps":
        del lists[int(rng.integers(len(lists)))]
    if kind == "overlapping":
        lists += [rng.permutation(count)[:3].tolist() for _ in range(3)]
    if kind == "repeated":
        lists = [[*one, *one[:1]] for one in lists]
    return lists


def random_case(rng: np.random.Generator) -> Case:
    scene = random_scene(rng)
    views = ("", "left", "right")[: rng.integers(1, 4)]
    truths = [random_truth(rng, scene, view) for view in views]
    kind = str(rng.choice(KINDS))
    promise = rng.choice([Promise.CONSERVATIVE, Promise.APPROXIMATE])
    case = Case(scene, truths, kind, random_units(rng, scene, kind), [], promise)
    needed = case.must_be_drawn
    share = rng.choice([0.0, 0.3, 1.0])
    drawn = [
        unit
        for unit, triangles in enumerate(case.lists)
        if needed.intersection(triangles) or rng.random() < share
    ]
    if drawn and rng.random() < 0.4:
        del drawn[int(rng.integers(len(drawn)))]
    rng.shuffle(drawn)
    case.drawn = drawn
    return case


def nobody():
    raise AssertionError("exact arithmetic was asked")


def plain(verdict: FrameVerdict) -> dict[str, object]:
    """All fields of a verdict, as values, with the types of its arrays."""
    arrays = {k: v for k, v in vars(verdict).items() if isinstance(v, np.ndarray)}
    return {
        **{k: v for k, v in vars(verdict).items() if k not in arrays},
        "misses": list(verdict.misses),
        **{k: (v.dtype, v.tolist()) for k, v in arrays.items()},
    }


def same_walk(one: SampleWalk, other: SampleWalk) -> bool:
    return all(
        np.array_equal(value, vars(other)[name]) and value.dtype == vars(other)[name].dtype
        for name, value in vars(one).items()
    )


@pytest.mark.parametrize("batch", range(BATCHES))
def test_the_quick_verdict_is_that_of_the_walk_over_all_samples(batch):
    met: Counter[str] = Counter()
    for number in range(CASES):
        case = random_case(np.random.default_rng([batch, number]))
        draws, mask, scene = case.draw_list(), case.mask, case.scene
        complete = mask[list(case.must_be_drawn)].all()
        of_view = [
            bool(mask[list(replace(case, truths=[truth]).must_be_drawn)].all())
            for truth in case.truths
        ]
        frames = tuple(
            settling.with_rulings(scene, truth, draws, settling.Rulings()) for truth in case.truths
        )
        # The long way: every sample of every view.
        walks = [walk_samples(truth, scene, mask) for truth in case.truths]
        walked = [replace(f, walked=walk) for f, walk in zip(frames, walks, strict=True)]
        long_way = judge(joined(walked), case.promise)

        where = f"case {batch} {number}"
        assert [frame.walked is None for frame in frames] == of_view, where
        assert all_drawn(frames) == complete, where
        assert draws.triangles.tolist() == mask.tolist(), where
        assert draws.triangle_count == mask.sum(), where
        for frame, walk in zip(frames, walks, strict=True):
            assert same_walk(frame.walk, walk), where
        ways = judge_all_drawn if complete else lambda these, said: judge(joined(these), said)
        quick = ways(frames, case.promise)
        assert plain(quick) == plain(long_way), where
        if complete:
            asked = [settle(scene, t, draws, exact=nobody) for t in case.truths]
            assert plain(judge_all_drawn(asked, case.promise)) == plain(long_way), where

        # By sets alone.
        may, seen = case.may_be_seen, case.seen
        there = set(np.flatnonzero(scene.present).tolist())
        hidden = [
            unit
            for unit in sorted(case.drawn)
            if there.intersection(case.lists[unit]) and not may.intersection(case.lists[unit])
        ]
        assert quick.superfluous_units.tolist() == hidden, where
        followed = Followed.of(case.units, frames, quick)
        if case.kind != "objects":
            assert followed is not None
            holding = [bool(seen.intersection(one)) for one in case.lists]
            assert followed.seen.tolist() == holding, where
        if complete:
            certain = {int(scene.object_of_triangle[t]) for t in _decided(case)}
            assert quick.counts.visible == len(certain), where
            assert not quick.misses, where
        met[case.kind] += complete
        met["complete"] += complete
        met["not"] += not complete
        met["mixed"] += any(of_view) and not complete
        met["views"] += complete and len(frames) > 1
        met["superfluous"] += complete and len(hidden) > 0
        for name in ("ties", "doubt", "blend"):
            met[name] += complete and any(len(getattr(t, name).triangle) for t in case.truths)
        met["absent"] += complete and scene.absent is not None
    # The cases are of use.
    assert min(met[kind] for kind in KINDS) >= 1
    assert min(met[name] for name in ("ties", "doubt", "blend", "absent", "mixed", "views")) >= 3
    assert met["not"] > 10
    assert met["superfluous"] > 5


def _decided(case: Case) -> set[int]:
    """Owners of decided samples and their ties, and glass."""
    found: set[int] = set()
    for truth in case.truths:
        owner = truth.buffer.triangle.reshape(-1)
        sure = set(np.flatnonzero(truth.decided).tolist())
        found.update(int(owner[s]) for s in sure if owner[s] >= 0)
        pairs = zip(truth.ties.sample.tolist(), truth.ties.triangle.tolist(), strict=True)
        found.update(t for s, t in pairs if s in sure)
        found.update(truth.blend.triangle.tolist())
    return found


def test_units_are_left_out_of_which_nothing_is_there():
    gone = 0
    for seed in range(200):
        case = random_case(np.random.default_rng([seed]))
        there = set(np.flatnonzero(case.scene.present).tolist())
        absent = [
            unit
            for unit in case.drawn
            if case.lists[unit] and not there.intersection(case.lists[unit])
        ]
        holders = Holders.of_units(case.units, case.scene)
        drawn = DrawnSet(np.array(case.drawn, np.int32))
        left, ignored = without_absent(case.scene, holders, drawn)
        assert ignored.tolist() == absent
        assert left.unit_ids.tolist() == [unit for unit in case.drawn if unit not in absent]
        gone += len(absent)
    assert gone > 20


def test_the_walk_is_left_out_only_where_nothing_may_be_lost():
    """What is not drawn, of each sort that a sample may hang on, has it walked; else it is not."""
    scene = Scene(
        np.zeros((3, 3)), np.tile(np.arange(3), (5, 1)), np.arange(6), tuple("abcde"),
        alpha=np.array([0, 0, 0, 0, Alpha.BLEND], np.uint8),
    )  # fmt: skip
    look = camera(4, 1)
    truth = FrameTruth(
        look,
        "hand",
        VisibilityBuffer(np.array([[0, 0, 1, -1]], np.int32), np.array([[1.0, 1, 1, np.inf]])),
        Ties(np.array([0]), np.array([2], np.int32)),
        True,
        Doubt.of(np.array([2]), np.array([3])),
        BlendVisibility.of(scene, np.array([3]), np.array([4], np.int32), np.ones(1)),
    )
    # Owner, what a mask may leave as owner behind a leaf, a tie, the leaf, glass.
    for kind in ("object", "cluster"):
        units = replace(scene.object_units(), kind=kind)
        for left_out in range(5):
            ids = np.setdiff1d(np.arange(5), left_out).astype(np.int32)
            draws = DrawList.of_units(scene, units, ids)
            frame = settling.with_rulings(scene, truth, draws, settling.Rulings())
            assert frame.walked is not None, left_out
        draws = DrawList.of_units(scene, units, np.arange(5, dtype=np.int32))
        frame = settling.with_rulings(scene, truth, draws, settling.Rulings())
        assert frame.walked is None


class Said(TruthEngine):
    """Says the same of every camera."""

    name = "said"
    summary = "for tests"
    exact = True
    truth: FrameTruth

    def frame(self, camera):
        return replace(self.truth, camera=camera)


class Draws(Culler):
    name = "draws"
    memory = 0

    def __init__(self, ids: np.ndarray, units: Units | None = None) -> None:
        self._ids, self._units = ids, units

    def prepare(self, scene: Scene) -> Units:
        return self._units or scene.object_units()

    def cull(self, camera) -> DrawnSet:
        return DrawnSet(self._ids)


# A scene of many triangles, most of them never looked at.
OBJECTS, EACH, SIDE = 500, 4000, 32


@pytest.fixture(scope="module")
def many() -> Scene:
    """Two million triangles."""
    count = OBJECTS * EACH
    return Scene(
        np.eye(3, dtype=np.float32),
        np.tile(np.arange(3, dtype=np.int32), (count, 1)),
        np.arange(OBJECTS + 1) * EACH,
        tuple(f"o{i}" for i in range(OBJECTS)),
    )


def peak_of_a_judged_frame(scene: Scene, culler: Culler, monkeypatch) -> int:
    """Bytes that judging one more frame takes at most, beside what was there."""
    rng = np.random.default_rng(1)
    owner = rng.integers(0, scene.triangle_count // 2, (SIDE, SIDE)).astype(np.int32)
    Said.truth = FrameTruth(
        camera(SIDE, SIDE), "said", VisibilityBuffer(owner, np.ones((SIDE, SIDE)))
    )
    peaks, frame = [], Sitting.frame

    def traced(self, number, *given):
        if number:  # what is made once is made in the first
            tracemalloc.start()
            before = tracemalloc.get_traced_memory()[0]
        frame(self, number, *given)
        if number:
            peaks.append(tracemalloc.get_traced_memory()[1] - before)
            tracemalloc.stop()

    monkeypatch.setattr(Sitting, "frame", traced)
    path = CameraPath([camera(SIDE, SIDE)] * 2)
    outcome = Referee(scene, lambda: Said(scene)).run(path, range(2), [("draws", culler)])
    assert outcome.cullers[0].totals.violations == 0
    assert outcome.cullers[0].frames[0].triangles_drawn > scene.triangle_count / 2
    (peak,) = peaks
    return peak


def clusters(scene: Scene) -> Units:
    count = scene.triangle_count
    return Units(np.arange(0, count + 1, 400), np.arange(count, dtype=np.int32), "cluster")


@pytest.mark.parametrize("finer", [False, True])
def test_judging_takes_memory_for_what_is_drawn_and_seen_and_none_by_the_triangle(
    many, finer, monkeypatch
):
    units = clusters(many) if finer else many.object_units()
    culler = Draws(np.arange(units.count, dtype=np.int32), units)
    # Some sixteen arrays of up to 8 bytes, of samples, of objects and of units that are drawn,
    # whichever live at once, and Python's own objects.
    bound = 16 * 8 * (SIDE * SIDE + OBJECTS + units.count) + (1 << 17)
    assert bound < many.triangle_count / 2
    assert peak_of_a_judged_frame(many, culler, monkeypatch) < bound


def test_the_measure_sees_an_array_of_all_triangles(many, monkeypatch):
    """So the test above can fail: here every sample is walked."""
    of = UnitsSeen.of
    monkeypatch.setattr(UnitsSeen, "of", lambda *given: replace(of(*given), all_drawn=False))
    culler = Draws(np.arange(OBJECTS, dtype=np.int32))
    assert peak_of_a_judged_frame(many, culler, monkeypatch) > many.triangle_count


def test_nothing_lost_is_told_of_the_objects_that_are_seen():
    """By hand: the walk that nobody took."""
    scene = Scene(np.zeros((3, 3)), np.tile(np.arange(3), (2, 1)), np.arange(3), ("a", "b"))
    truth = FrameTruth(
        camera(2, 1), "hand", VisibilityBuffer(np.array([[1, -1]], np.int32), np.ones((1, 2)))
    )
    draws = DrawList.of_units(scene, scene.object_units(), np.array([1], np.int32))
    frame = settling.with_rulings(scene, truth, draws, settling.Rulings())
    assert nothing_lost(frame.seen, scene).shows.tolist() == [False, True]
