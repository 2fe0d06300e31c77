"""What a culler lost of each object, over the verdicts of a run: gone through once, a verdict's
misses at a time, so that it does not matter how many there are of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from visref.judging.misses import Miss, Misses, MissKind
from visref.scene import Int64


class HasMisses(Protocol):
    """The misses of a verdict."""

    @property
    def misses(self) -> Misses: ...


class Judged(Protocol):
    """A verdict on one drawn set, in one frame."""

    @property
    def frame(self) -> int: ...
    @property
    def verdict(self) -> HasMisses: ...


@dataclass(frozen=True, eq=False)
class Losses:
    """Confirmed misses by object, (k,) int64 each, the most lost first: `object`; `samples` lost
    over all frames; `frames`, each counted once, in however many views; and the worst miss, the
    first of equals: the samples that it loses, `most`, its verdict's place, `row`, and its own
    `place` there."""

    object: Int64
    samples: Int64
    frames: Int64
    most: Int64
    row: Int64
    place: Int64

    @classmethod
    def of(cls, rows: Iterable[Judged], but: Set[int] = frozenset()) -> Losses:
        """Of verdicts in the order of the path, but for those of some frames; in each an object is
        missed once."""
        # By object: samples, most samples, frames, the last of them, and the worst miss's place.
        table = np.zeros((6, 0), np.int64)
        for number, row in enumerate(rows):
            misses = row.verdict.misses
            if row.frame in but:
                continue
            at = np.flatnonzero(misses.are(MissKind.CONFIRMED)) if misses else ()
            if not len(at):
                continue
            columns = misses.columns
            objects, lost = columns.object[at].astype(np.int64), columns.samples[at]
            table = _grown(table, int(objects.max()) + 1)
            samples, most, frames, last, at_row, place = table
            samples[objects] += lost
            frames[objects] += last[objects] != row.frame
            last[objects] = row.frame
            worse = lost > most[objects]
            most[objects[worse]], place[objects[worse]] = lost[worse], at[worse]
            at_row[objects[worse]] = number
        lossy = np.flatnonzero(table[2])
        lossy = lossy[np.lexsort((lossy, -table[0, lossy]))]
        samples, most, frames, _, at_row, place = table[:, lossy]
        return cls(lossy, samples, frames, most, at_row, place)

    def worst(self, rows: Sequence[Judged], most: int | None = None) -> Iterator[tuple[int, Miss]]:
        """The frame and the worst miss of each object, or of so many."""
        row, place = self.row[:most], self.place[:most]
        found: dict[int, tuple[int, Miss]] = {}
        for number in np.unique(row).tolist():
            mine = np.flatnonzero(row == number)
            picked = rows[number].verdict.misses.picked(place[mine])
            found |= {
                at: (rows[number].frame, miss)
                for at, miss in zip(mine.tolist(), picked, strict=True)
            }
        return (found[at] for at in range(len(row)))


def _grown(table: Int64, objects: int) -> Int64:
    """The table, with a column for at least so many objects. Nothing lost is worse than -1."""
    more = objects - table.shape[1]
    if more <= 0:
        return table
    fresh = np.array([0, -1, 0, -1, -1, -1])
    return np.concatenate([table, np.repeat(fresh[:, None], more, axis=1)], axis=1)


def first_frames(rows: Iterable[Judged], kind: MissKind) -> dict[int, int]:
    """By object that has a miss of a kind, ascending, the first frame in which it has."""
    first: dict[int, int] = {}
    for row in rows:
        misses = row.verdict.misses
        if misses:
            for obj in misses.columns.object[misses.are(kind)].tolist():
                first.setdefault(obj, row.frame)
    return dict(sorted(first.items()))


Place = tuple[int, int]


def worst_places(rows: Iterable[Judged], most: int) -> list[Place]:
    """The misses that lose most, of whatever kind, by their verdict's place and their own there: at
    most so many, by samples, and of equals by frame, then by object."""
    # Samples (less than 0), frame, object, and the two places.
    kept = np.zeros((5, 0), np.int64)
    for number, row in enumerate(rows):
        misses = row.verdict.misses
        if not misses:
            continue
        columns, count = misses.columns, len(misses)
        mine = np.stack(
            [
                -columns.samples,
                np.full(count, row.frame),
                columns.object.astype(np.int64),
                np.full(count, number),
                np.arange(count),
            ]
        )
        kept = np.concatenate([kept, mine], axis=1)
        kept = kept[:, np.lexsort(kept[::-1])[:most]]
    return [(row, place) for row, place in kept[3:].T.tolist()]
