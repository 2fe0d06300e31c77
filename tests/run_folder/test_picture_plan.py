"""Which frames get pictures, and that parts of a run draw all that the whole one wants."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from visref.judging.misses import Miss, Misses, MissKind
from visref.run_folder.picture_plan import PicturePlan

SPEC = "mine"


def misses(lost, kind=MissKind.CONFIRMED):
    """Of each object the samples that it lost."""
    return Misses.of(
        Miss(
            object=obj,
            kind=kind,
            samples=samples,
            owned=samples,
            sample=0,
            triangle=0,
            depth=1.0,
            margin_px=None,
            margin_depth=None,
        )
        for obj, samples in sorted(lost.items())
    )


def planned(frames, verdicts, open_=frozenset()):
    plan = PicturePlan(frames, open_)
    for frame, lost in verdicts:
        plan.add(SPEC, frame, "", misses(lost))
    return {frame for frame, _ in plan.wanted(SPEC)}


def test_first_last_and_the_worst_frame_of_the_worst_objects_are_wanted():
    # With one planned frame, of two objects: 2 and 1.
    verdicts = [
        (0, {}),
        (1, {0: 1}),
        (2, {1: 50, 0: 2}),
        (3, {2: 70}),
        (4, {2: 80, 1: 50}),
        (5, {0: 49}),
        (6, {3: 1}),
        (7, {0: 3}),
        (8, {}),
    ]
    assert planned([0], verdicts) == {1, 2, 4, 7}
    assert planned([0, 8], verdicts) == {1, 2, 4, 5, 6, 7}
    assert planned([], verdicts) == set()


def test_what_is_not_confirmed_asks_for_no_picture():
    plan = PicturePlan([0])
    assert not plan.add(SPEC, 1, "", misses({0: 9}, MissKind.TIE))
    assert not plan.add(SPEC, 2, "", misses({}))
    assert plan.wanted(SPEC) == set()
    assert plan.add(SPEC, 3, "left", misses({0: 1}))
    assert plan.wanted(SPEC) == {(3, "left")}
    assert plan.wanted("another") == set()


VERDICTS = st.lists(
    st.dictionaries(st.integers(0, 6), st.integers(1, 4), max_size=4), min_size=1, max_size=12
)


@given(VERDICTS, st.data())
def test_parts_draw_whatever_the_whole_run_wants(lost, data):
    """Also where a policy accepts some misses of open frames that a part takes for confirmed."""
    frames = range(len(lost))
    cut = data.draw(st.integers(0, len(lost)))
    open_ = frozenset(data.draw(st.sets(st.sampled_from(frames))))
    accepted = {frame for frame in open_ if data.draw(st.booleans())}
    judged = [(frame, {} if frame in accepted else lost[frame]) for frame in frames]
    whole = planned([0], judged)
    told = list(enumerate(lost))
    parts = planned([0], told[:cut], open_) | planned([0], told[cut:], open_)
    assert whole <= parts
    # And without open frames not much more: two objects, the first and the last of each part.
    closed = planned([0], judged[:cut]) | planned([0], judged[cut:])
    assert len(closed) <= 2 * (2 + 2)


def test_wanted_frames_are_as_many_as_stated_whatever_is_missed():
    chosen = np.random.default_rng(3)
    verdicts = [
        (frame, dict.fromkeys(range(300), 0) | {
            obj: int(n) for obj, n in enumerate(chosen.integers(1, 10**6, 300))
        })
        for frame in range(60)
    ]  # fmt: skip
    assert len(planned([0, 1, 2, 3], verdicts)) <= 2 * 4 + 2
