"""Misses as columns: what they say one by one, what they lose over frames, and that a run holds
none of them in memory."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass, replace

import numpy as np

from visref.judging.judge import Counts, FrameVerdict
from visref.judging.losses import Losses, first_frames, worst_places
from visref.judging.misses import KINDS, Miss, Misses, MissKind
from visref.run_folder.aside import Aside


@dataclass
class Row:
    frame: int
    verdict: FrameVerdict


def random_rows(seed: int, frames: int = 12, objects: int = 9) -> list[Row]:
    """Verdicts of two views a frame, with some misses each."""
    rng = np.random.default_rng(seed)
    rows = []
    for number in range(frames):
        for view in ("left", "right"):
            some = rng.choice(objects, int(rng.integers(0, objects)), replace=False)
            misses = [
                Miss(
                    int(obj),
                    KINDS[rng.integers(len(KINDS))],
                    int(rng.integers(0, 4)),
                    9,
                    int(rng.integers(0, 64)),
                    int(obj),
                    2.5,
                    margin_px=None if rng.random() < 0.5 else float(rng.random()),
                    margin_depth=np.inf if rng.random() < 0.5 else None,
                    partly=bool(rng.random() < 0.5),
                    view=view,
                    width=8,
                    age=None if rng.random() < 0.5 else int(rng.integers(0, 5)),
                )
                for obj in some
            ]
            rows.append(Row(number, FrameVerdict(Counts(), Misses.of(misses))))
    return rows


def test_misses_come_back_as_they_were_put_in():
    for row in random_rows(1):
        one_by_one = list(row.verdict.misses)
        again = Misses.of(one_by_one)
        assert again == row.verdict.misses
        assert len(again) == len(one_by_one)
        assert [again[i] for i in range(len(again))] == one_by_one
        assert again[1:] == one_by_one[1:]
        assert again.kind_names() == [one.kind.value for one in one_by_one]
        assert again.view_names() == [one.view for one in one_by_one]


def test_losses_are_those_of_an_object_by_object_count():
    for seed in range(20):
        rows = random_rows(seed)
        total: dict[int, int] = {}
        frames: dict[int, set[int]] = {}
        worst: dict[int, tuple[int, Miss]] = {}
        for row in rows:
            for miss in row.verdict.misses:
                if miss.kind is MissKind.CONFIRMED:
                    total[miss.object] = total.get(miss.object, 0) + miss.samples
                    frames.setdefault(miss.object, set()).add(row.frame)
                    if miss.object not in worst or miss.samples > worst[miss.object][1].samples:
                        worst[miss.object] = row.frame, miss
        order = sorted(total, key=lambda obj: (-total[obj], obj))
        losses = Losses.of(rows)
        assert losses.object.tolist() == order
        assert losses.samples.tolist() == [total[obj] for obj in order]
        assert losses.frames.tolist() == [len(frames[obj]) for obj in order]
        assert list(losses.worst(rows)) == [worst[obj] for obj in order]
        assert list(losses.worst(rows, 2)) == [worst[obj] for obj in order[:2]]


def test_the_worst_places_are_the_first_of_all_in_order():
    for seed in range(20):
        rows = random_rows(seed)
        every = [
            ((-miss.samples, row.frame, miss.object, number, place), (number, place))
            for number, row in enumerate(rows)
            for place, miss in enumerate(row.verdict.misses)
        ]
        wanted = [where for _, where in sorted(every)]
        for most in (1, 7, 1000):
            assert worst_places(rows, most) == wanted[:most]


def test_the_first_frame_of_a_kind_is_the_first_in_which_it_is_missed():
    for seed in range(10):
        rows = random_rows(seed)
        for kind in KINDS:
            first: dict[int, int] = {}
            for row in rows:
                for miss in row.verdict.misses:
                    if miss.kind is kind:
                        first.setdefault(miss.object, row.frame)
            assert first_frames(rows, kind) == dict(sorted(first.items()))


def many_misses(count: int) -> Misses:
    (one,) = Misses.of([Miss(0, MissKind.CONFIRMED, 3, 9, 0, 0, 1.0)])
    columns = Misses.of([one]).columns
    repeated = type(columns)(*(np.repeat(column, count) for column in columns))
    return Misses(repeated._replace(object=np.arange(count, dtype=np.int32)))


def test_what_is_put_aside_is_the_same_and_takes_no_memory():
    """Of 20 frames no more than of 2, but for some kilobytes each: a frame's misses take 1.4 MB."""
    misses = many_misses(20_000)
    verdict = FrameVerdict(Counts(), misses, np.arange(20_000, dtype=np.int32))

    def held(frames: int) -> int:
        aside = Aside()
        # Until it is more than is held in memory.
        for _ in range(4):
            aside(verdict)
        tracemalloc.start()
        kept = [aside(verdict) for _ in range(frames)]
        size, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        for one in (kept[0], kept[-1]):
            assert len(one.superfluous_units) == 0
            assert one.counts == verdict.counts
            for column, wanted in zip(one.misses.columns, misses.columns, strict=True):
                assert column.dtype == wanted.dtype
                assert np.array_equal(column, wanted, equal_nan=column.dtype.kind == "f")
        return size

    assert held(20) - held(2) < 18 * 8192
    assert replace(verdict).misses is misses
