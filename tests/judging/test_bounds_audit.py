"""The boxes that a culler tests, held against what they stand for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.judging.bounds import BoundsAudit, RealBounds
from visref.judging.referee import Referee
from visref.judging.status import Exit
from visref.scene import Scene, Units
from visref.timeline import Timeline


def scene(origin=(0.0, 0.0, 0.0)) -> Scene:
    """A square of 8 by 8 and a small one beside it, before an orthographic eye."""
    square = np.array([(0, 0, 0), (8, 0, 0), (8, 8, 0), (0, 8, 0)], float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    made = Scene.from_objects([("large", square, faces), ("small", square / 8 - 3.0, faces)])
    return replace(made, origin=np.array(origin))


def camera(origin=(0.0, 0.0, 0.0)) -> Camera:
    pose = np.eye(4)
    pose[:3, 3] = np.array([4.0, 4.0, 5.0]) + origin
    return Camera(pose, 16, 16, 1.0, 100.0, ymag=8.0)


class Says(Culler):
    """Draws everything, and says that it tested these boxes."""

    name = "says"

    def __init__(self, boxes) -> None:
        self.boxes = boxes

    def prepare(self, scene):
        self.count = scene.object_count
        return scene.object_units()

    def update(self, scene):
        pass

    def cull(self, camera):
        return DrawnSet(np.arange(self.count, dtype=np.int32))

    def bounds(self):
        return self.boxes


def judged(boxes, frames=1, origin=(0.0, 0.0, 0.0), engine="exact"):
    made, path = scene(origin), CameraPath([camera(origin)] * frames)
    referee = Referee(made, lambda: make_engine(engine, made))
    outcome = referee.run(path, range(frames), [("says", Says(boxes))])
    found = [finding for finding in outcome.findings if finding.code == "BOUNDS_TOO_SMALL"]
    return outcome, outcome.cullers[0], found


def right_boxes(origin=(0.0, 0.0, 0.0)) -> np.ndarray:
    made = scene(origin)
    return made.object_bounds + made.origin


@pytest.mark.parametrize("engine", ["exact", "embree"])
def test_a_box_that_leaves_something_out_is_told_with_what_is_seen_of_it(engine):
    boxes = right_boxes()
    boxes[0, 1, 0] = 5.0  # of 8: three of eight columns, 8 rows
    outcome, record, found = judged(boxes, frames=3, engine=engine)
    assert outcome.exit is Exit.NO_VIOLATION  # nothing is missed yet
    (one,) = record.too_small
    assert (one.unit, one.frames, one.outside) == (0, 3, 3.0)
    assert one.samples == 3 * (3 * 8)
    (finding,) = found
    assert (finding.culler, finding.object) == ("says", "large")
    assert "leaves out up to 3 of it, in 3 frames" in finding.message
    assert "72 samples of what it leaves out can be seen" in finding.message


def test_right_boxes_larger_ones_and_rounded_ones_are_right():
    for boxes in (right_boxes(), right_boxes() + np.array([-1.0, 1.0])[None, :, None]):
        assert judged(boxes)[1].too_small == []
    far = (1e7 + 0.3, -3e6 - 0.2, 5e6 + 0.3)
    rounded = right_boxes(far).astype(np.float32).astype(np.float64)
    assert (np.abs(rounded - right_boxes(far)) > 0.1).any()
    assert judged(rounded, origin=far)[1].too_small == []
    # By more than float32 rounds there, it is told.
    too_far = right_boxes(far)
    too_far[0, 0, 0] += 20.0
    assert [one.unit for one in judged(too_far, origin=far)[1].too_small] == [0]


def test_a_box_that_is_not_finite_is_none_and_no_boxes_are_no_claim():
    boxes = right_boxes()
    boxes[0] = np.array([np.inf, -np.inf])[:, None]
    assert judged(boxes)[1].too_small == []
    assert judged(None)[1].too_small == []


@pytest.mark.parametrize(
    "boxes", [np.zeros((1, 2, 3)), np.full((2, 2, 3), np.nan), [["a"]], np.zeros((2, 6))]
)
def test_what_are_no_boxes_is_the_culler_s_fault(boxes):
    outcome, record, _ = judged(boxes)
    assert record.failed
    (fault,) = [finding for finding in outcome.findings if finding.code == "CULLER_FAILED"]
    assert "bounds()" in fault.message


def test_a_box_of_the_rest_pose_is_found_in_the_frame_in_which_its_object_leaves_it():
    away = np.eye(4)
    away[0, 3] = 2.0
    frames = [camera(), Frame((camera(),), world_from_object={"small": away})]
    timeline = Timeline(scene(), CameraPath(frames))
    still = timeline.still
    referee = Referee(still, lambda: make_engine("exact", still), timeline=timeline)
    outcome = referee.run(CameraPath(frames), range(2), [("says", Says(right_boxes()))])
    (one,) = outcome.cullers[0].too_small
    assert (one.unit, one.frames, one.frame, one.outside) == (1, 1, 1, 2.0)


@pytest.mark.parametrize("perspective", [True, False])
def test_what_is_seen_of_units_that_overlap_is_counted_sample_by_sample(perspective):
    """Held against a loop over samples and units, where triangles are in several units (one twice
    in its own), tie with each other, and hide one another."""
    random = np.random.default_rng(5)
    square = np.array([(0, 0, 0), (8, 0, 0), (8, 8, 0), (0, 8, 0)], float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    objects = [("large", square, faces), ("same", square, faces[:, ::-1])]
    for number in range(6):
        moved = square * random.uniform(0.1, 0.5) + [*random.uniform(0, 6, 2), number / 8 - 0.25]
        objects.append((f"{number}", moved, faces))
    made = Scene.from_objects(objects)
    seen_by = camera()
    if perspective:
        seen_by = Camera(seen_by.world_from_camera, 16, 16, 1.0, 100.0, yfov=1.2)
    truth = make_engine("exact", made).frame(seen_by)
    assert len(truth.ties.sample) > 20
    lists = [random.integers(0, made.triangle_count, size) for size in (1, 3, 5, 8, 0, 16)]
    lists.append(np.repeat(lists[1], 2))
    triangles = np.concatenate(lists).astype(np.int32)
    units = Units(np.cumsum([0, *map(len, lists)]), triangles)
    boxes = made.bounds_of(units)
    boxes[:, 1] -= 0.4 * np.nan_to_num(boxes[:, 1] - boxes[:, 0], nan=0.0)

    expected = {}
    buffer = truth.buffer
    for unit, mine in enumerate(map(set, lists)):
        for sample in range(seen_by.samples):
            sees = {int(buffer.triangle.reshape(-1)[sample])}
            sees |= set(truth.ties.triangle[truth.ties.sample == sample].tolist())
            if not sees & mine:
                continue
            y, x = divmod(sample, 16)
            # Both cameras look along -z, from 5 above the plane z = 0.
            depth = float(buffer.depth.reshape(-1)[sample])
            half = depth * np.tan(0.6) if perspective else 8.0
            aside = np.array([(2 * x + 1) / 16 - 1, 1 - (2 * y + 1) / 16]) * half
            point = np.array([4.0 + aside[0], 4.0 + aside[1], 5.0 - depth])
            outside = (point < boxes[unit, 0] - 1e-6) | (point > boxes[unit, 1] + 1e-6)
            expected[unit] = expected.get(unit, 0) + bool(outside.any())
    audit = BoundsAudit()
    audit.look(0, made, units, boxes, [truth, truth])
    found = {unit: one.samples for unit, one in audit.found.items() if one.samples}
    assert found == {unit: 2 * count for unit, count in expected.items() if count}
    assert len(found) > 3


def test_bounds_from_moment_to_moment_are_those_of_each_moment():
    """Of units that overlap, some of them empty, while objects move, come and go."""
    rng = np.random.default_rng(4)
    objects = [
        (f"o{i}", rng.normal(size=(6, 3)), rng.integers(0, 6, (int(rng.integers(1, 5)), 3)))
        for i in range(6)
    ]
    rest = replace(Scene.from_objects(objects), origin=np.array((1.0, 2.0, 3.0)))
    pose = np.eye(4)

    def frame(number: int) -> Frame:
        pose[:3, 3] = rng.normal(size=3)
        world = (
            {"o1": pose.copy(), "o4": pose @ np.diag((2.0, 3.0, 1.0, 1.0))} if number % 3 else {}
        )
        return Frame((camera(),), world_from_object=world, absent=("o2",) if number % 2 else ())

    path = CameraPath([frame(number) for number in range(9)])
    timeline = Timeline(rest, path)
    count = rest.triangle_count
    parts = [rng.integers(0, count, int(rng.integers(0, 4))) for _ in range(8)]
    units = Units(np.cumsum([0, *map(len, parts)]), np.concatenate(parts).astype(np.int32), "part")
    for made in (units, rest.object_units()):
        real = RealBounds(made)
        moments = [timeline.at(number) for number in (0, 1, 2, 3, 3, 7, 0)]
        found = [real.of(moment).copy() for moment in moments]
        assert len({one.tobytes() for one in found}) > 3
        for moment, bounds in zip(moments, found, strict=True):
            assert bounds.tolist() == (moment.bounds_of(made) + moment.origin).tolist()
