"""Why things were missed: hypotheses tried on a culler's answers, and the best of them named.

A hypothesis says of each unit whether a culler that errs so would keep it. It explains a lost unit
that it would not keep, and is wrong about a unit that shows and was drawn, which it would not keep
either. Its score is what it explains less what it is wrong about, of all that is to be explained.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.causes.answers import ANOTHER_VIEW, ANSWERED
from visref.causes.boxes import some
from visref.causes.evidence import Answer, Answers, Evidence
from visref.causes.fitted import FEW, FITS, Fit, odds, threshold
from visref.causes.hidden import HIDDEN, MATERIALS, SELDOM_HIDDEN, SWEEPING
from visref.causes.in_view import IN_VIEW, SELDOM, kept_by_depth
from visref.causes.lists import LISTS
from visref.causes.other import LEFT_OUT, MOVED, MOVED_IN_VIEW
from visref.causes.sights import At, Hypothesis, Moments, Sight, Sights, by_code
from visref.engines.base import TruthEngine
from visref.judging.causes import CODES, CausesFound, Named, Where
from visref.judging.outcome import CullerRecord
from visref.picking import evenly_picked
from visref.scene import Float64, Int32
from visref.timeline import Timeline

Bool = NDArray[np.bool_]

# So many answers with misses are looked at by every hypothesis, and so many by those that are left.
CLOSELY, ALL = 24, 240
# Of a large scene fewer: a triangle and a sample of each answer cost about so much, and so much is
# spent, some ten seconds; but so many are looked at in any case.
SAMPLE_COST, AFFORDED, LEAST_ANSWERS = 8, 50_000_000, 3
# So many units of an answer: lost, shown and drawn, hidden and drawn, hidden and left out.
LOST, SHOWN, IDLE = 192, 256, 96
# Of what a hypothesis would leave out and that shows, so much must be lost.
PRECISION = 0.8
# A cause explains so much of a culler's misses: a few of many are explained by chance.
LEAST = 0.25
# Causes of one culler.
MOST = 5
# What does not hold elsewhere counts so much beside what is explained, and results this near are
# alike.
CONTRADICTED, ALIKE = 0.25, 0.1
FEW_UNITS = 4
# Causes from this one on in their order are named only where chance would give the same in less
# than one of so many cases.
SELDOM_FROM, UNLIKELY = "odd-size-pyramid", 20
# A culler that draws more than this share of what is hidden does not ask what hides. How cautious
# it is is told by so many hidden units or more.
ASKS, CAUTIOUS = 0.9, 5
# So many causes are named that explain a miss alike.
ALIKE_NAMED = 3

HYPOTHESES = [
    *by_code(LEFT_OUT),
    *by_code(ANOTHER_VIEW),
    *by_code(MATERIALS, depth=True),
    *by_code(MOVED_IN_VIEW),
    *by_code(MOVED, depth=True),
    *by_code(ANSWERED, answer=True),
    *by_code(IN_VIEW),
    *by_code(HIDDEN, depth=True),
    *by_code(FEW),
    *by_code(SWEEPING, many=True, depth=True),
    *by_code(SELDOM, odd=True),
    *by_code(SELDOM_HIDDEN, odd=True, depth=True),
]
# Of hypotheses that fit alike, the first of these is named: the ordinary before the odd, and what
# says something of few scenes before what might be said of any.
# In place of a unit: of what is in none.
NO_UNIT, UNLISTED = -1, -2
LAST = ("never-drawn",)
ORDER = {cause: place for place, cause in enumerate(CODES)}


@dataclass(eq=False)
class Looked:
    """Some of an answer's units: `ids` (k,), and of each whether it is `lost`, rightly drawn
    (`good`), drawn and hidden (`idle`), or left out and hidden (`left`). `views`: the answer in
    each view that it is for. `pairs`: (m, 2) int32, a unit that was left out and an object that
    loses samples by it, `NO_UNIT` where what is lost is in no unit."""

    answer: Answer
    pairs: Int32
    views: tuple[At, ...]
    ids: Int32
    lost: Bool
    good: Bool
    idle: Bool
    left: Bool

    @cached_property
    def boxes(self) -> Bool:
        """(k,) bool: the right test of boxes keeps it, in some view."""
        return some(np.stack([kept_by_depth(at, at.boxes) for at in self.views]), 0)

    @cached_property
    def hidden(self) -> Bool:
        """(k,) bool: it is in the view, and hidden so that the right test of boxes finds it."""
        in_view: Bool = np.any([at.boxes.in_view for at in self.views], axis=0)
        return in_view & ~self.boxes & (self.idle | self.left)

    def kept(self, hypothesis: Hypothesis) -> Bool | None:
        """(k,) bool: kept in some view that the answer is for."""
        told = [(at, hypothesis.tell(at)) for at in self.views]
        if all(kept is None for _, kept in told):
            return None
        result = np.zeros(len(self.ids), np.bool_)
        for at, kept in told:
            result |= at.now.seen[at.ids] if kept is None else kept
        return result

    def value(self, fit: Fit) -> Float64:
        values = [fit.value(at) for at in self.views]
        return np.asarray(np.max(values, axis=0) if fit.below else np.min(values, axis=0))


class Search:
    """The causes of one culler's misses."""

    def __init__(self, sights: Sights, answers: Answers, record: CullerRecord) -> None:
        self._sights, self._answers, self._record = sights, answers, record

    def find(self) -> CausesFound:
        lossy = self._answers.lossy
        if not lossy:
            return CausesFound()
        most = self._affordable(CLOSELY, lossy[0])
        closely = _covering(lossy, most)
        looked = [self._look(answer) for answer in closely]
        clean = [self._look(answer) for answer in self._answers.some_clean()]
        some = any(one.lost.any() for one in looked)
        chosen = self._choose(looked, clean) if some else []
        rest = [lossy[i] for i in evenly_picked(len(lossy), most * ALL // CLOSELY)]
        others = [self._look(one) for one in rest if all(one is not c for c in closely)]
        return self._assign(chosen, [*looked, *others])

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
        small[[one.unit for one in self._record.too_small if one.frame <= answer.frame]] = True
        at = tuple(At(self._sights, answer.frame, view, ids, small[ids]) for view in views)
        return Looked(answer, pairs, at, ids, *(kind[ids] for kind in kinds))

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

    def _hypotheses(self) -> list[Hypothesis]:
        return [*HYPOTHESES, *by_code(LISTS(self._answers, self._record))]

    def _choose(self, looked: Sequence[Looked], clean: Sequence[Looked]) -> list[Chosen]:
        tried = [Tried(one, looked, clean) for one in self._hypotheses()]
        tried = [one for one in tried if one.says_something]
        lost = np.concatenate([one.lost for one in looked])
        open_ = lost.copy()
        chosen: list[Chosen] = []
        while len(chosen) < MOST and open_.any():
            alike = _alike([*tried, *self._fits(looked, clean, open_)], open_)
            if not alike:
                break
            best, *others = alike
            chosen.append(best.chosen(others[: ALIKE_NAMED - 1]))
            open_ &= ~best.culled
            tried = [one for one in tried if one.hypothesis.cause != best.hypothesis.cause]
        return chosen

    def _fits(
        self,
        looked: Sequence[Looked],
        clean: Sequence[Looked],
        open_: Bool,
    ) -> list[Tried]:
        lost, good = open_, np.concatenate([one.good for one in looked])
        found = []
        for fit in FITS:
            values = np.concatenate([one.value(fit) for one in looked])
            limit = threshold(values, lost, good, fit.below)
            if limit is not None:
                found.append(Tried(_fitted(fit, limit), looked, clean))
        return found

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
                    named[where] = tuple(causes)
        return CausesFound(named, frozenset(examined))


class Tried:
    """What a hypothesis says of all units that were looked at."""

    def __init__(
        self, hypothesis: Hypothesis, looked: Sequence[Looked], clean: Sequence[Looked]
    ) -> None:
        self.hypothesis = hypothesis
        self.culled, self.says_something = _culled(hypothesis, looked)
        self._lost = np.concatenate([one.lost for one in looked])
        self._good = np.concatenate([one.good for one in looked])
        self._looked, self._clean = looked, clean
        self.says_something &= bool((self.culled & self._lost).any())

    @property
    def right(self) -> int:
        return int(np.count_nonzero(self.culled & self._lost))

    @cached_property
    def wrong(self) -> float:
        """How many units that show and were drawn it would leave out, beyond those that the culler
        draws out of caution: a coarse one draws a share of what is hidden, and so it would of what
        it takes for hidden."""
        wrong = int(np.count_nonzero(self.culled & self._good))
        if not (self.hypothesis.depth or self.hypothesis.answer):
            return wrong
        hidden = np.concatenate([one.hidden for one in self._looked])
        drawn = np.concatenate([one.idle for one in self._looked])
        share = _share(drawn, hidden)
        if np.count_nonzero(hidden) < CAUTIOUS or share > ASKS:
            return wrong
        return max(0.0, wrong - self.right * min(share / (1.0 - share), 1.0))

    @property
    def _all_lost(self) -> bool:
        """Whether nothing that shows was drawn, so that chance is no question."""
        return not self._good.any() and int(np.count_nonzero(self._lost)) >= UNLIKELY

    @property
    def precise(self) -> bool:
        """Whether most of what it would leave out, and that shows, is lost. Little is seen of what
        is lost, whatever the cause: a rule about little must be right throughout."""
        few = self.hypothesis.cause in ("too-few-samples", "gap-too-narrow")
        if self.right < (1.0 if few else PRECISION) * (self.right + self.wrong):
            return False
        # Of few units many a rule picks the one that is lost by chance.
        shown = int(np.count_nonzero(self._lost | self._good))
        wrong = int(np.count_nonzero(self.culled & self._good))
        by_chance = odds(self.right, wrong, int(np.count_nonzero(self._lost)), shown)
        ordinary = not self.hypothesis.many and ORDER[self.hypothesis.cause] < ORDER[SELDOM_FROM]
        return ordinary or by_chance >= UNLIKELY or self._all_lost

    def explains(self, open_: Bool) -> float:
        """The share of all that was lost which it explains and nothing has so far, less what it is
        wrong about."""
        gain = int(np.count_nonzero(self.culled & open_)) - self.wrong
        return gain / int(np.count_nonzero(self._lost))

    def score(self, open_: Bool) -> float:
        explains = int(np.count_nonzero(self.culled & open_))
        return (explains - self.wrong) / max(int(np.count_nonzero(open_)), 1)

    def chosen(self, others: Sequence[Tried] = ()) -> Chosen:
        score = (self.right - self.wrong) / int(np.count_nonzero(self._lost))
        return Chosen(self.hypothesis, score, tuple(one.chosen() for one in others))

    @cached_property
    def contradicted(self) -> float:
        """How much of what it says elsewhere does not hold: of units that show in answers without a
        miss, 0 to 1; and of hidden units, 0 to 1 each way, as far as they tell anything: what the
        right test of boxes leaves out too, a culler that asks for less may draw, and what it keeps,
        a culler that asks for more may leave out."""
        clean, _ = _culled(self.hypothesis, self._clean)
        every = [*self._looked, *self._clean]
        culled = np.concatenate([self.culled, clean])
        none = [np.zeros(0, np.bool_)]
        good = np.concatenate([*none, *(one.good for one in self._clean)])
        idle = np.concatenate([one.idle & one.boxes for one in every])
        left = np.concatenate([one.left for one in every])
        boxes = np.concatenate([one.boxes for one in every])
        found = _share(clean, good, FEW_UNITS) + _share(culled, idle, FEW_UNITS)
        if self.hypothesis.answer:
            found += _share(~culled, left, FEW_UNITS)
        else:
            found += 0.25 * _share(~culled, left & boxes, FEW_UNITS)
        if self.hypothesis.depth:
            # Of a culler that draws whatever is hidden nobody need ask what hides.
            asks = np.concatenate([one.hidden for one in every])
            drawn = np.concatenate([one.idle for one in every])
            found += _share(drawn, asks) > ASKS
        return found


def _share(flags: Bool, of: Bool, few: int = 0) -> float:
    """How much of some holds; of a few units less is believed."""
    count = int(np.count_nonzero(of)) + few
    return np.count_nonzero(flags & of) / count if count else 0.0


def _culled(hypothesis: Hypothesis, looked: Sequence[Looked]) -> tuple[Bool, bool]:
    culled, says = [np.zeros(0, np.bool_)], False
    for one in looked:
        kept = one.kept(hypothesis)
        says |= kept is not None
        culled.append(np.zeros(len(one.ids), np.bool_) if kept is None else ~kept)
    return np.concatenate(culled), says


@dataclass(frozen=True)
class Chosen:
    """A hypothesis that explains some misses, its score, and others that explain them alike."""

    hypothesis: Hypothesis
    score: float
    others: tuple[Chosen, ...] = ()


def _alike(tried: Sequence[Tried], open_: Bool) -> list[Tried]:
    """The hypotheses that explain most and are wrong least, and of these those that are
    contradicted least by hidden units and by answers without a miss: one per cause, the
    likeliest first."""
    able = [one for one in tried if one.precise]
    able = [one for one in able if one.explains(open_) >= LEAST]
    # What says no more than that it was missed is for what nothing else explains.
    able = [one for one in able if one.hypothesis.cause not in LAST] or able
    if not able:
        return []
    worth = {id(one): one.score(open_) - CONTRADICTED * one.contradicted for one in able}
    top = max(worth.values())
    able = [one for one in able if worth[id(one)] >= top - ALIKE]
    able.sort(key=lambda one: (one.hypothesis.odd, ORDER[one.hypothesis.cause]))
    if able[0].hypothesis.odd:
        # What is seldom met fits by chance more often than in truth: it is no more than an
        # alternative.
        return []
    first = {one.hypothesis.cause: one for one in reversed(able)}
    return sorted(first.values(), key=able.index)


def _fitted(fit: Fit, limit: float) -> Hypothesis:
    def tell(at: At) -> Bool:
        values = fit.value(at)
        kept: Bool = values >= limit if fit.below else values <= limit
        return kept

    return Hypothesis(fit.cause, f"{fit.variant} {limit:.6g}", tell, odd=True)


def _covering(answers: Sequence[Answer], most: int) -> list[Answer]:
    """Answers that between them lose every object, as far as `most` goes, in order: half of them
    evenly picked, the others by what is not among those yet."""
    if len(answers) <= most:
        return list(answers)
    picked = set(evenly_picked(len(answers), most // 2).tolist())
    covered = {obj for i in picked for obj in answers[i].missed.tolist()}
    objects = [set(answer.missed.tolist()) for answer in answers]
    while len(picked) < most:
        gain = [0 if i in picked else len(one - covered) for i, one in enumerate(objects)]
        if not any(gain):
            break
        best = int(np.argmax(gain))
        picked.add(best)
        covered |= objects[best]
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
