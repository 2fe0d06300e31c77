"""What hangs on all answers of a culler together: a list that is full, what is never drawn."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.causes.evidence import Answers
from visref.causes.sights import At, Tell, Told
from visref.judging.outcome import CullerRecord

Bool = NDArray[np.bool_]

# A unit is called never drawn if it was left out in so many answers.
OFTEN = 4
# So many answers are looked at for whether they differ.
MANY = 24
# An answer of nothing says something where so many units show.
MUCH = 8


def _round(number: int) -> bool:
    """Whether a list is likely to be as long: a power of two, or one digit and zeros."""
    return number >= 50 and (number & (number - 1) == 0 or len(str(number).rstrip("0")) == 1)


def LISTS(answers: Answers, record: CullerRecord) -> dict[str, dict[str, Tell]]:
    """The hypotheses about one culler."""
    count = answers.units.count
    every = answers.every
    drawn = np.zeros(count, np.int64)
    most = 0
    for answer in every:
        one = answer.drawn(count)
        drawn += one
        size = int(np.count_nonzero(one))
        most = max(most, size)
    sizes = [int(np.count_nonzero(one.drawn(count))) for one in answers.lossy]
    fewest = min(sizes, default=0)
    differ = len({one.drawn(count).tobytes() for one in answers.lossy[:MANY]}) >= OFTEN
    missed: Counter[int] = Counter()
    for answer in answers.lossy:
        missed.update(answer.missed.tolist())
    often = [obj for obj, times in missed.items() if times >= OFTEN]
    never = drawn == 0
    all_empty = len(every) >= OFTEN and not drawn.any()

    def full(at: At) -> Told:
        # Every answer that lost something is as long as the longest, and that is a round number,
        # or several that are not the same are as long.
        if fewest < most or not (_round(most) or (len(sizes) >= OFTEN and differ)):
            return None
        return _drawn_now(at)

    def _drawn_now(at: At) -> Told:
        now = answers.at(at.frame, at.view)
        return None if now is None else now[at.ids]

    def never_drawn(at: At) -> Told:
        return ~(never[at.ids] & np.isin(at.objects(), often)) if never.any() else None

    def nothing(at: At) -> Told:
        """Nothing at all was drawn where much shows, or ever."""
        now = answers.at(at.frame, at.view)
        if now is None or now.any():
            return None
        if not all_empty and np.count_nonzero(at.now.seen) < MUCH:
            return None
        return ~(at.now.seen[at.ids] | at.boxes.in_view)

    def absent_level(at: At) -> Told:
        """Of a thing of several levels one that is absent was named, and the one that is there
        was not. Where all levels are named at once, their choice is not what is wrong."""
        scene, now = at.scene, _drawn_now(at)
        level_of = {
            obj: (number, place)
            for number, group in enumerate(scene.groups)
            for place, level in enumerate(group.levels)
            for obj in level
        }
        if not level_of or not record.ignored or now is None:
            return None
        ignored = replace(at, ids=np.array(list(record.ignored), np.int32)).objects()
        named: dict[int, dict[int, set[int]]] = {}
        for obj, frame in zip(ignored.tolist(), record.ignored.values(), strict=True):
            if obj in level_of and frame <= at.frame:
                number, place = level_of[obj]
                named.setdefault(number, {}).setdefault(frame, set()).add(place)
        wrong = {number for number, at_once in named.items() if len(at_once[min(at_once)]) == 1}
        groups = [level_of.get(int(obj), (-1, 0))[0] for obj in at.objects()]
        return now | ~np.isin(groups, list(wrong))

    return {
        "absent-lod": {"": absent_level},
        "nothing-drawn": {"": nothing},
        "never-drawn": {"": never_drawn},
        "list-full": {"": full},
    }
