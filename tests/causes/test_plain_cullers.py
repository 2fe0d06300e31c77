"""Plain cullers, each with one mistake, get its cause first; a right one gets none, and nor does
one that drops things at random."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest

from tests.causes.cases import nearest_hits
from visref.camera_path import CameraPath, Frame
from visref.causes.evidence import Evidence
from visref.causes.search import find_causes
from visref.conformance.building import Case, box, camera, case
from visref.conformance.moving import moved
from visref.culler import Culler, DrawnSet
from visref.engines.exact import ExactEngine
from visref.judging.referee import Referee
from visref.timeline import Timeline


@cache
def town(moving=False) -> Case:
    """Fifty-four blocks in rows of nine, near ones in front of far ones, and a walk past them."""
    rng = np.random.default_rng(4)
    objects = []
    for row in range(6):
        for place in range(9):
            low = np.array([2.2 * place - 10.0, -1.5, -3.5 - 2.2 * row])
            low += rng.uniform(-0.5, 0.5, 3) * (1.0, 0.2, 0.6)
            objects.append(
                (f"b{row}{place}", box(low, low + rng.uniform((0.4, 0.4, 0.3), (1.6, 2.6, 0.9))))
            )
    views = [
        camera(
            (1.1 * k - 3.3, 0.2, 0.0),
            (1.1 * k - 3.6 + 0.3 * (k % 3), 0.1, -5.0),
            width=60,
            height=40,
        )
        for k in range(7)
    ]
    built = case(objects, views)
    if not moving:
        return built
    frames = [
        Frame(
            (view,), world_from_object={name: moved(x=1.4 * (k + 1)) for name, _ in objects[2::5]}
        )
        for k, view in enumerate(views)
    ]
    return Case(built.scene, CameraPath(frames))


DEPTHS: dict[tuple[bytes, bytes], np.ndarray] = {}


class Right(Culler):
    """Every box against the sides of the view, near and far, then its least depth against the
    farthest of the rectangle around it, a pixel larger each way, of all depths."""

    name = "right"
    moves = True

    def prepare(self, scene):
        self.scene, self.boxes, self.count = scene, scene.object_bounds, 0
        return scene.object_units()

    def update(self, scene):
        self.scene, self.boxes = scene, scene.object_bounds

    def cull(self, view):
        self.count += 1
        return DrawnSet(np.array(self.answer(view), np.int32))

    def answer(self, view):
        corners = np.stack(
            [np.stack([self.boxes[:, (i >> a) & 1, a] for a in range(3)], 1) for i in range(8)], 1
        )
        pixels, depth = view.pixel_of(corners.reshape(-1, 3))
        pixels, depth = pixels.reshape(-1, 8, 2), depth.reshape(-1, 8)
        return [i for i in range(len(corners)) if self.keeps(view, corners[i], pixels[i], depth[i])]

    def keeps(self, view, corners, pixels, depth):
        return self.in_view(view, corners, pixels, depth) and (
            depth.min() <= view.near or self.passes(view, pixels, depth)
        )

    def in_view(self, view, corners, pixels, depth):
        if depth.min() <= view.near:
            return depth.max() >= view.near
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        return bool((high >= -1).all() and low[0] <= view.width and low[1] <= view.height)

    def depths(self, view):
        key = self.scene.vertices.tobytes(), view.world_from_camera.tobytes()
        if key not in DEPTHS:
            DEPTHS[key] = nearest_hits(self.scene, view)[0]
        return DEPTHS[key]

    def passes(self, view, pixels, depth):
        image = self.depths(view)
        low = np.clip(np.floor(pixels.min(axis=0)).astype(int), 0, None)
        high = np.ceil(pixels.max(axis=0)).astype(int) + 1
        return image[low[1] : high[1], low[0] : high[0]].max(initial=-1.0) >= depth.min() - 1e-9


class OneFrameLate(Right):
    """one-frame-late"""

    before = None

    def answer(self, view):
        now = super().answer(view)
        then, self.before = self.before, now
        return now if then is None else then


class CentreOnly(Right):
    """centre-only"""

    def in_view(self, view, corners, pixels, depth):
        (at,), (far,) = view.pixel_of(corners.mean(axis=0)[None])
        return far > view.near and (np.abs(at - (29.5, 19.5)) <= (30.0, 20.0)).all()


class NearestOfTheRectangle(Right):
    """nearest-of-region"""

    def passes(self, view, pixels, depth):
        image = self.depths(view)
        low = np.clip(np.floor(pixels.min(axis=0)).astype(int), 0, None)
        high = np.ceil(pixels.max(axis=0)).astype(int) + 1
        part = image[low[1] : high[1], low[0] : high[0]]
        return part.min(initial=np.inf) >= depth.min() - 1e-9


class QuarterOfTheResolution(Right):
    """coarse-depth-1/4"""

    def passes(self, view, pixels, depth):
        image = self.depths(view)[::4, ::4]
        low = np.clip(np.floor(pixels.min(axis=0)).astype(int), 0, None) // 4
        high = np.ceil(pixels.max(axis=0)).astype(int) // 4 + 1
        return image[low[1] : high[1], low[0] : high[0]].max(initial=-1.0) >= depth.min() - 1e-9


class NextOne(Right):
    """ids-shifted"""

    def answer(self, view):
        return [i + 1 for i in super().answer(view) if i + 1 < len(self.boxes)]


class RestPose(Right):
    """rest-pose"""

    def update(self, scene):
        self.scene = scene


class DropsAtRandom(Right):
    def __init__(self, seed, share=0.15):
        self.rng, self.share = np.random.default_rng(seed), share

    def answer(self, view):
        return [i for i in super().answer(view) if self.rng.random() >= self.share]


def judged(culler, built):
    """The record of a culler, its causes named."""
    timeline = Timeline(built.scene, built.path)
    evidence = Evidence()

    def engine():
        return ExactEngine(timeline.still)

    referee = Referee(built.scene, engine, timeline=timeline)
    numbers = built.path.numbers
    outcome = referee.run(built.path, numbers, [("one", culler)], [evidence])
    find_causes(evidence, outcome.cullers, timeline, built.path, numbers, engine)
    (record,) = outcome.cullers
    assert not record.failed
    return record


def first_named(record):
    """How many misses have each cause first, "" for none."""
    told = Counter()
    for frame in record.frames:
        for miss in frame.verdict.misses:
            found = record.causes.of(frame.frame, miss.view, miss.object)
            told[found[0].cause if found else ""] += 1
    return told


def test_right_culler_misses_nothing_and_gets_no_cause():
    record = judged(Right(), town())
    assert not record.totals.missed
    assert not record.causes.named
    assert record.causes.grouped() == []


@pytest.mark.parametrize(
    "culler",
    [OneFrameLate, CentreOnly, NearestOfTheRectangle, QuarterOfTheResolution, NextOne],
    ids=lambda c: c.__doc__,
)
def test_one_mistake_is_named_first(culler):
    told = first_named(judged(culler(), town()))
    assert told.total() >= 4
    assert told[culler.__doc__] >= 0.8 * told.total(), told


def test_box_of_the_rest_pose_is_named_where_things_move():
    told = first_named(judged(RestPose(), town(moving=True)))
    assert told.total() >= 4
    assert told["rest-pose"] >= 0.8 * told.total(), told


@pytest.mark.parametrize("seed", range(4))
def test_what_is_dropped_at_random_gets_no_cause(seed):
    record = judged(DropsAtRandom(seed), town())
    assert sum(len(frame.verdict.misses) for frame in record.frames) >= 10
    assert not record.causes.named, record.causes.grouped()


def few() -> Case:
    """Four things in a row, over and over in one frame after another."""
    objects = [
        (f"o{i}", box((2.0 * i - 4.0, -0.5, -8.0), (2.0 * i - 2.8, 0.6, -7.0))) for i in range(4)
    ]
    return case(objects, [camera((0.1 * k, 0.0, 0.0)) for k in range(3)])


@pytest.mark.parametrize("seed", range(4))
def test_of_a_handful_dropped_at_random_nothing_is_named_either(seed):
    record = judged(DropsAtRandom(seed, 0.4), few())
    assert not record.causes.named, record.causes.grouped()


def test_groups_count_misses_objects_and_what_was_looked_at():
    record = judged(OneFrameLate(), town())
    (first, *_) = record.causes.grouped()
    misses = [
        (frame.frame, miss.object) for frame in record.frames for miss in frame.verdict.misses
    ]
    own = [
        (frame, obj)
        for frame, obj in misses
        if [one.cause for one in record.causes.of(frame, "", obj)][:1] == ["one-frame-late"]
    ]
    assert first["cause"] == "one-frame-late"
    assert first["text"] == "answered one frame late"
    assert first["misses"] == len(own)
    assert first["objects"] == len({obj for _, obj in own})
    assert first["examined"] == len(misses)
    assert 0.0 < first["score"] <= 1.0
