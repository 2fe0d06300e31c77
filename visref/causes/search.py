"""Why things were missed: hypotheses tried on a culler's answers, and the best of them named.

A hypothesis says of each unit whether a culler that errs so would keep it. It explains a lost unit
that it would not keep, and is wrong about a unit that shows and was drawn, which it would not keep
either. Its score is what it explains less what it is wrong about, of all that is to be explained.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath
from visref.causes.evidence import Answer, Answers, Evidence
from visref.causes.fitted import FEW, FITS, Fit, threshold
from visref.causes.hidden import HIDDEN, MATERIALS
from visref.causes.in_view import IN_VIEW, SELDOM, kept_by_depth
from visref.causes.lists import LISTS
from visref.causes.named import CODES, CausesFound, Named, Where
from visref.causes.other import ANSWERED, LEFT_OUT, MOVED
from visref.causes.sights import At, Hypothesis, Moments, Sights, by_code
from visref.engines.base import TruthEngine
from visref.judging.outcome import CullerRecord
from visref.picking import evenly_picked
from visref.scene import Float64, Int32
from visref.timeline import Timeline

Bool = NDArray[np.bool_]

# So many answers with misses are looked at by every hypothesis, and so many by those that are left.
CLOSELY, ALL = 24, 256
# So many units of an answer: lost, shown and drawn, hidden and drawn, hidden and left out.
LOST, SHOWN, IDLE = 192, 256, 96
# Of what a hypothesis would leave out and that shows, so much must be lost.
PRECISION = 0.8
# Causes of one culler, and of one miss.
MOST = 5
# Scores this near are alike, and so much that does not hold of hidden units is no difference.
ALIKE, CONTRADICTED = 0.03, 0.1

HYPOTHESES = [
    *by_code(LEFT_OUT, whole=False),
    *by_code(MATERIALS, whole=True),
    *by_code(MOVED, whole=True),
    *by_code(ANSWERED, whole=True),
    *by_code(IN_VIEW, whole=False),
    *by_code(HIDDEN, whole=True),
    *by_code(FEW, whole=False),
    *by_code(SELDOM, whole=False, odd=True),
]
# Of hypotheses that fit alike, the first of these is named: the ordinary before the odd, and what
# says something of few scenes before what might be said of any.
ORDER = {cause: place for place, cause in enumerate(CODES)}


def _keeps_all(at: At) -> Bool:
    return np.ones(len(at.ids), np.bool_)


def _in_view(at: At) -> Bool:
    return at.boxes.in_view


def _unhidden(at: At) -> Bool:
    return kept_by_depth(at, at.boxes) | ~at.boxes.in_view


def _shows(at: At) -> Bool:
    return at.now.seen[at.ids]


# What a culler may test rightly besides: nothing, the view, what hides, both, or samples.
BASES = [
    Hypothesis("", "nothing", _keeps_all),
    Hypothesis("", "view", _in_view),
    Hypothesis("", "hidden", _unhidden),
    Hypothesis("", "boxes", lambda at: kept_by_depth(at, at.boxes)),
    Hypothesis("", "samples", _shows),
]
OUTSIDE = 1


@dataclass(eq=False)
class Looked:
    """Some of an answer's units: `ids` (k,), and of each whether it is `lost`, rightly drawn
    (`good`), drawn and hidden (`idle`), or left out and hidden (`left`). `views`: the answer in
    each view that it is for."""

    answer: Answer
    views: tuple[At, ...]
    ids: Int32
    lost: Bool
    good: Bool
    idle: Bool
    left: Bool

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
        closely = _covering(lossy, CLOSELY)
        looked = [self._look(answer) for answer in closely]
        clean = [self._look(answer) for answer in self._answers.some_clean()]
        chosen = self._choose(looked, clean)
        rest = [lossy[i] for i in evenly_picked(len(lossy), ALL)]
        others = [self._look(one) for one in rest if all(one is not c for c in closely)]
        return self._assign(chosen, [*looked, *others])

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
        lost = np.zeros(units.count, np.bool_)
        lost[answer.lost[:, 0]] = True
        kinds = (lost, seen & drawn, drawn & ~seen & there, ~drawn & ~seen & there)
        picked = [
            ids[evenly_picked(len(ids), most)]
            for ids, most in zip(map(np.flatnonzero, kinds), (LOST, SHOWN, IDLE, IDLE), strict=True)
        ]
        ids = np.concatenate(picked).astype(np.int32)
        small = np.zeros(units.count, np.bool_)
        small[[one.unit for one in self._record.too_small if one.frame <= answer.frame]] = True
        at = tuple(At(self._sights, answer.frame, view, ids, small[ids]) for view in views)
        return Looked(answer, at, ids, *(kind[ids] for kind in kinds))

    def _hypotheses(self) -> list[Hypothesis]:
        return [*HYPOTHESES, *by_code(LISTS(self._answers, self._record), whole=False)]

    def _choose(self, looked: Sequence[Looked], clean: Sequence[Looked]) -> list[Chosen]:
        bases = [_culled(base, looked)[0] for base in BASES]
        tried = [Tried(one, looked, clean, bases) for one in self._hypotheses()]
        tried = [one for one in tried if one.says_something]
        lost = np.concatenate([one.lost for one in looked])
        open_ = lost.copy()
        chosen: list[Chosen] = []
        while len(chosen) < MOST and open_.any():
            best = _best([*tried, *self._fits(looked, clean, bases, open_)], open_)
            if best is None:
                break
            chosen.append(best.chosen(open_))
            open_ &= ~best.culled
            tried = [one for one in tried if one.hypothesis.cause != best.hypothesis.cause]
        return chosen

    def _fits(
        self,
        looked: Sequence[Looked],
        clean: Sequence[Looked],
        bases: Sequence[Bool],
        open_: Bool,
    ) -> list[Tried]:
        lost, good = open_, np.concatenate([one.good for one in looked])
        found = []
        for fit in FITS:
            values = np.concatenate([one.value(fit) for one in looked])
            limit = threshold(values, lost, good, fit.below)
            if limit is not None:
                found.append(Tried(_fitted(fit, limit), looked, clean, bases))
        return found

    def _assign(self, chosen: Sequence[Chosen], looked: Sequence[Looked]) -> CausesFound:
        named: dict[Where, tuple[Named, ...]] = {}
        examined: set[Where] = set()
        for one in looked:
            kept = [one.kept(choice.hypothesis) for choice in chosen]
            of_object: dict[int, list[int]] = defaultdict(list)
            place = {int(unit): i for i, unit in enumerate(one.ids)}
            for unit, obj in one.answer.lost.tolist():
                of_object[obj].append(place.get(unit, -1))
            for obj, places in of_object.items():
                where = (one.answer.frame, one.answer.view, obj)
                some = [i for i in places if i >= 0]
                if not some:
                    continue
                examined.add(where)
                causes = [
                    Named(choice.hypothesis.cause, choice.score)
                    for choice, told in zip(chosen, kept, strict=True)
                    if told is not None and np.mean(~told[some]) >= 0.5
                ]
                if causes:
                    named[where] = tuple(causes)
        return CausesFound(named, frozenset(examined))


class Tried:
    """What a hypothesis says of all units that were looked at."""

    def __init__(
        self,
        hypothesis: Hypothesis,
        looked: Sequence[Looked],
        clean: Sequence[Looked],
        bases: Sequence[Bool],
    ) -> None:
        self.hypothesis = hypothesis
        self.culled, self.says_something = _culled(hypothesis, looked)
        self._lost = np.concatenate([one.lost for one in looked])
        self._good = np.concatenate([one.good for one in looked])
        self._hypothesis, self._clean = hypothesis, clean
        idle = np.concatenate([one.idle for one in looked])
        left = np.concatenate([one.left for one in looked])
        # A right test beside a wrong one leaves out more, and a test of depth may be without one of
        # the view; what fits best is believed.
        if hypothesis.whole:
            answers = [self.culled, self.culled & ~bases[OUTSIDE]]
        else:
            answers = [self.culled | base for base in bases]
        self._hidden = min(_share(one, idle) + _share(~one, left) for one in answers)
        self.says_something &= bool((self.culled & self._lost).any())

    @property
    def right(self) -> int:
        return int(np.count_nonzero(self.culled & self._lost))

    @property
    def wrong(self) -> int:
        return int(np.count_nonzero(self.culled & self._good))

    def score(self, open_: Bool) -> float:
        explains = int(np.count_nonzero(self.culled & open_))
        return (explains - self.wrong) / max(int(np.count_nonzero(open_)), 1)

    def chosen(self, open_: Bool) -> Chosen:
        return Chosen(
            self.hypothesis, (self.right - self.wrong) / int(np.count_nonzero(self._lost))
        )

    @property
    def contradicted(self) -> float:
        """How much of what it says of hidden units does not hold, 0 to 2, and of units that show in
        answers without a miss, 0 to 1."""
        if not hasattr(self, "_clean_wrong"):
            culled, _ = _culled(self._hypothesis, self._clean)
            good = np.concatenate([np.zeros(0, np.bool_), *(one.good for one in self._clean)])
            self._clean_wrong = _share(culled, good)
        return self._hidden + self._clean_wrong


def _share(flags: Bool, of: Bool) -> float:
    count = int(np.count_nonzero(of))
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
    hypothesis: Hypothesis
    score: float


def _best(tried: Sequence[Tried], open_: Bool) -> Tried | None:
    """The hypothesis that explains most and is wrong least; of those alike, the one that is
    contradicted least by hidden units and answers without a miss, then the first."""
    able = [
        (one.score(open_), one) for one in tried if one.right >= PRECISION * (one.right + one.wrong)
    ]
    able = [(score, one) for score, one in able if score > 0.0]
    if not able:
        return None
    top = max(score for score, _ in able)
    alike = [one for score, one in able if score >= top - ALIKE * top]
    least = min(one.contradicted for one in alike)
    alike = [one for one in alike if one.contradicted <= least + CONTRADICTED]
    return min(alike, key=lambda one: (one.hypothesis.odd, ORDER[one.hypothesis.cause]))


def _fitted(fit: Fit, limit: float) -> Hypothesis:
    def tell(at: At) -> Bool:
        values = fit.value(at)
        kept: Bool = values >= limit if fit.below else values <= limit
        return kept

    return Hypothesis(fit.cause, f"{fit.variant} {limit:.6g}", tell, whole=False)


def _covering(answers: Sequence[Answer], most: int) -> list[Answer]:
    """Answers that between them lose every object, as far as `most` goes, in order: half of them
    evenly picked, the others by what is not among those yet."""
    if len(answers) <= most:
        return list(answers)
    picked = set(evenly_picked(len(answers), most // 2).tolist())
    covered = {obj for i in picked for obj in answers[i].lost[:, 1].tolist()}
    objects = [set(answer.lost[:, 1].tolist()) for answer in answers]
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
                record.causes = Search(Sights(moments, answers.units), answers, record).find()
    finally:
        moments.close()
