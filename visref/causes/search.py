"""Why things were missed: hypotheses tried on a culler's answers, and the best of them named.

A hypothesis says of each unit whether a culler that errs so would keep it. It explains a lost unit
that it would not keep, and is wrong about a unit that shows and was drawn, which it would not keep
either. Its score is what it explains less what it is wrong about, of all that is to be explained;
which of several is likeliest is weighed in `visref.causes.weighing`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.causes.answers import ANOTHER_VIEW, ANSWERED
from visref.causes.evidence import Answer, Answers, Evidence
from visref.causes.fitted import FEW
from visref.causes.held import HELD
from visref.causes.hidden import HIDDEN, MATERIALS, SELDOM_HIDDEN, SWEEPING
from visref.causes.homes import HOMES
from visref.causes.in_view import IN_VIEW, SELDOM
from visref.causes.lists import LISTS
from visref.causes.other import LEFT_OUT, MOVED, MOVED_IN_VIEW
from visref.causes.sights import At, Moments, Sight, Sights, by_code
from visref.causes.weighed import MOST, NAMED, Chosen, Looked, Weighed
from visref.engines.base import TruthEngine
from visref.judging.causes import CausesFound, Named, Where
from visref.judging.outcome import CullerRecord
from visref.picking import evenly_picked
from visref.scene import Int32
from visref.timeline import Timeline

Bool = NDArray[np.bool_]

# So many answers with misses are looked at by every hypothesis, and so many by those that are left.
CLOSELY, ALL = 24, 240
# Of a large scene fewer: a triangle and a sample of each answer cost about so much, and so much is
# spent, some ten seconds; but so many are looked at in any case.
SAMPLE_COST, AFFORDED, LEAST_ANSWERS = 8, 50_000_000, 3
# So many units of an answer: lost, shown and drawn, hidden and drawn, hidden and left out.
LOST, SHOWN, IDLE = 192, 256, 96
HYPOTHESES = [
    *by_code(LEFT_OUT),
    *by_code(ANOTHER_VIEW),
    *by_code(MATERIALS, depth=True),
    *by_code(MOVED_IN_VIEW),
    *by_code(MOVED, depth=True),
    *by_code(ANSWERED, answer=True),
    *by_code(HELD, answer=True),
    *by_code(IN_VIEW),
    *by_code({"bounds-too-small": HOMES}),
    *by_code(HIDDEN, depth=True),
    *by_code(FEW),
    *by_code(SWEEPING, many=True, depth=True),
    *by_code(SELDOM, odd=True),
    *by_code(SELDOM_HIDDEN, odd=True, depth=True),
]
# In place of a unit: of what is in none.
NO_UNIT, UNLISTED = -1, -2


class Search:
    """The causes of one culler's misses."""

    def __init__(self, sights: Sights, answers: Answers, record: CullerRecord) -> None:
        self._sights, self._answers, self._record = sights, answers, record

    def find(self) -> CausesFound:
        lossy = self._answers.lossy
        if not lossy:
            return CausesFound()
        most = self._affordable(CLOSELY, lossy[0])
        looked = self.look_closely(most)
        weighed = self.weighed(looked)
        chosen = self._choose(weighed) if weighed.told.lost.any() else []
        rest = [lossy[i] for i in evenly_picked(len(lossy), most * ALL // CLOSELY)]
        known = [one.answer for one in looked]
        others = [self._look(one) for one in rest if all(one is not each for each in known)]
        return self._assign(chosen, [*looked, *others])

    def look_closely(self, most: int = CLOSELY) -> list[Looked]:
        """At so many answers that lost something, which between them lose every object."""
        return [self._look(answer) for answer in _covering(self._answers.lossy, most)]

    def weighed(self, looked: Sequence[Looked]) -> Weighed:
        """Every hypothesis about these answers, and about some that lost nothing."""
        clean = [self._look(answer) for answer in self._answers.some_clean()]
        lists = by_code(LISTS(self._answers, self._record), fact=True)
        return Weighed([*HYPOTHESES, *lists], looked, clean)

    def _affordable(self, most: int, answer: Answer) -> int:
        """How many answers are looked at: fewer where triangles and samples are many."""
        moments = self._sights.moments
        samples = moments.cameras(answer.frame)[0].samples
        cost = moments.timeline.still.triangle_count + SAMPLE_COST * samples
        return int(min(most, max(LEAST_ANSWERS, AFFORDED // max(cost, 1))))

    def _look(self, answer: Answer) -> Looked:
        units = self._sights.units
        cameras = self._sights.moments.cameras(answer.frame)
        names = [c.view for c in cameras]
        views = [answer.view] if answer.view in names else names
        drawn = answer.drawn(units.count)
        sights = [self._sights.sight(answer.frame, view) for view in views]
        seen = np.any([sight.seen for sight in sights], axis=0)
        there = units.sizes > 0
        scene = sights[0].place.scene
        if scene.absent is not None:
            first = np.minimum(units.offsets[:-1], max(len(units.triangles) - 1, 0))
            there &= ~scene.absent[scene.object_of_triangle[units.triangles[first]]]
        pairs = self._lost(answer, sights, drawn)
        lost = np.zeros(units.count, np.bool_)
        lost[pairs[pairs[:, 0] != NO_UNIT, 0]] = True
        kinds = (lost, seen & drawn, drawn & ~seen & there, ~drawn & ~seen & there)
        picked = [
            ids[evenly_picked(len(ids), most)]
            for ids, most in zip(map(np.flatnonzero, kinds), (LOST, SHOWN, IDLE, IDLE), strict=True)
        ]
        ids = np.concatenate(picked).astype(np.int32)
        small = np.zeros(units.count, np.bool_)
        small[[one.unit for one in self._record.too_small]] = True
        at = tuple(At(self._sights, answer.frame, view, ids, small[ids]) for view in views)
        before = self._sights.moments.before(answer.frame, 1)
        then = None if before is None else self._answers.at(before, views[0])
        again = drawn & then if then is not None else np.zeros_like(drawn)
        return Looked(answer, pairs, at, ids, *(kind[ids] for kind in (*kinds, again)))

    def _lost(self, answer: Answer, sights: Sequence[Sight], drawn: Bool) -> Int32:
        """Of the objects missed the triangles that show and that no drawn unit holds: the units
        that hold them, each with the object, (m, 2), sorted."""
        place = sights[0].place
        owner = place.scene.object_of_triangle
        shown = np.unique(np.concatenate([sight.shown().triangles for sight in sights]))
        shown = shown[np.isin(owner[shown], answer.missed)].astype(np.int64)
        unit, at = place.members.units(shown)
        held = np.zeros(len(shown), np.bool_)
        held[at[drawn[unit]]] = True
        listed = np.zeros(len(shown), np.bool_)
        listed[at] = True
        left_out = ~held[at]
        nowhere = owner[shown[~listed]]
        pairs = np.concatenate(
            [
                np.stack([unit[left_out], owner[shown[at[left_out]]]], axis=1),
                np.stack([np.full(len(nowhere), NO_UNIT), nowhere], axis=1),
            ]
        )
        return np.unique(pairs, axis=0).astype(np.int32).reshape(-1, 2)

    def _choose(self, weighed: Weighed) -> list[Chosen]:
        open_ = weighed.told.lost.copy()
        chosen: list[Chosen] = []
        while len(chosen) < MOST and open_.any():
            likely = weighed.likely(open_, [one.hypothesis.cause for one in chosen])
            if not likely:
                break
            best, *others = likely
            chosen.append(replace(weighed.chosen(best), others=tuple(map(weighed.chosen, others))))
            open_ &= ~best.culled
        return chosen

    def _assign(self, chosen: Sequence[Chosen], looked: Sequence[Looked]) -> CausesFound:
        named: dict[Where, tuple[Named, ...]] = {}
        examined: set[Where] = set()
        for one in looked:
            every = [each for choice in chosen for each in (choice, *choice.others)]
            kept = [one.kept(each.hypothesis) for each in every]
            of_object: dict[int, list[int]] = defaultdict(list)
            place = {int(unit): i for i, unit in enumerate(one.ids)}
            for unit, obj in one.pairs.tolist():
                of_object[obj].append(UNLISTED if unit == NO_UNIT else place.get(unit, -1))
            for obj, places in of_object.items():
                where = (one.answer.frame, one.answer.view, obj)
                if UNLISTED in places:
                    examined.add(where)
                    named[where] = (Named("never-drawn", 1.0),)
                    continue
                some = [i for i in places if i >= 0]
                if not some:
                    continue
                examined.add(where)
                causes = [
                    Named(each.hypothesis.cause, each.score)
                    for each, told in zip(every, kept, strict=True)
                    if told is not None and np.mean(~told[some]) >= 0.5
                ]
                if causes:
                    named[where] = tuple(causes[:NAMED])
        return CausesFound(named, frozenset(examined))


def _covering(answers: Sequence[Answer], most: int) -> list[Answer]:
    """Answers that between them lose every object, as far as `most` goes, in order: half of them
    evenly picked, the others by what is not among those yet."""
    if len(answers) <= most:
        return list(answers)
    picked = set(evenly_picked(len(answers), most // 2).tolist())
    covered = np.zeros(max(int(one.missed[-1]) + 1 for one in answers), np.bool_)
    for i in picked:
        covered[answers[i].missed] = True
    while len(picked) < most:
        # One by one, as of a long run all together are too many to be held.
        gain = [int(np.count_nonzero(~covered[one.missed])) for one in answers]
        if not any(gain):
            break
        best = int(np.argmax(gain))
        picked.add(best)
        covered[answers[best].missed] = True
    return [answers[i] for i in sorted(picked)]


def find_causes(
    evidence: Evidence,
    records: Sequence[CullerRecord],
    timeline: Timeline,
    path: CameraPath,
    frames: Sequence[int],
    make_engine: Callable[[], TruthEngine],
) -> None:
    """Name the causes of each record's misses, in `CullerRecord.causes`.

    `path`: any; `frames`: those that were judged, in order; `make_engine`: the engine that cast
    the truth, on `timeline.still`.
    """
    if not any(one.lossy for one in evidence.answers.values()):
        return
    moments = Moments(timeline, path.relative_to(timeline.still.origin), frames, make_engine)
    try:
        for record in records:
            answers = evidence.answers.get(record.spec)
            if answers is not None and answers.lossy:
                record.causes = Search(Sights(moments, answers), answers, record).find()
    finally:
        moments.close()
