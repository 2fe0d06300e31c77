"""What near and far hide is said, and the few samples that tell it are the path's own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.hand_made import square
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.findings import Code, Severity
from visref.judging.limits import LONGER_SIDE, LOOKED_AT, hidden_by_limits, sparse, unlimited
from visref.judging.referee import Referee
from visref.scene import Scene

POSE = look_at((3.0, -2.0, 11.0), (0.5, 0.25, -1.0))
LENS = [{"yfov": 0.8}, {"ymag": 3.0}]


def view(width=96, height=72, near=0.1, far=math.inf, **more):
    lens = more or {"yfov": 0.8}
    return Camera(look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)), width, height, near, far, **lens)


def walls(*rows):
    """A wall per (left, right, z), six units high; the camera of `view` stands at z = 10."""
    objects = []
    for i, (left, right, z) in enumerate(rows):
        corners, faces = square(0.0, 0.0, 0.0)
        corners = corners * (right - left, 60.0, 1.0) + (left, -30.0, z)
        objects.append((f"wall{i}", corners, faces))
    return Scene.from_objects(objects)


@pytest.mark.parametrize("lens", LENS)
@pytest.mark.parametrize("shift", [(0.0, 0.0), (7.25, -31.5)])
@pytest.mark.parametrize("size", [(1280, 960), (64, 48), (65, 63), (1, 1), (3000, 7), (5, 700)])
def test_the_few_samples_are_every_kth_of_the_cameras_own(size, shift, lens):
    camera = Camera(
        POSE, *size, near=0.5, far=9.0, shift_x_px=shift[0], shift_y_px=shift[1], **lens
    )
    few = sparse(camera)
    assert max(few.width, few.height) <= LONGER_SIDE
    assert (few.near, few.far) == (camera.near, camera.far)
    k = math.ceil(max(size) / LONGER_SIDE)
    for axis in (0, 1):
        steps = (camera.right_step, camera.up_step)[axis]
        offsets = (camera.column_a, camera.row_b)[axis][:, None] * steps
        picked = (few.column_a, few.row_b)[axis][:, None] * (few.right_step, few.up_step)[axis]
        distance = np.abs(offsets[:, None] - picked[None, :1]).max(axis=2)[:, 0]
        first = int(distance.argmin())
        assert len(picked) == math.ceil(size[axis] / k)
        # Left out on both borders alike, and less than a step of it.
        left_out = size[axis] - ((len(picked) - 1) * k + 1)
        assert first == left_out // 2 < k
        # Some ten roundings each, through a tangent of up to three.
        error = np.abs(offsets[first::k][: len(picked)] - picked).max()
        assert error <= 64 * 2.0**-52 * np.abs(offsets).max()


@pytest.mark.parametrize("lens", LENS)
def test_without_limits_nothing_of_the_scene_is_left_out(lens):
    scene = walls((-5, 5, 9.999), (-50, 50, -1e3))
    camera = replace(view(**lens), near=3.0, far=4.0)
    free = unlimited(camera, scene.bounds)
    assert free.far == math.inf
    owner = make_engine("exact", scene).frame(free).buffer.triangle
    assert set(scene.object_of_triangle[np.unique(owner)]) == {0}


def test_an_orthographic_camera_without_limits_meets_what_lies_behind_it():
    scene = walls((-50, 50, 500.0))
    free = unlimited(view(ymag=3.0), scene.bounds)
    assert (make_engine("exact", scene).frame(free).buffer.triangle >= 0).all()
    assert unlimited(view(), scene.bounds) is None


@pytest.mark.parametrize("engine", ["embree", "exact"])
@pytest.mark.parametrize("lens", LENS)
@pytest.mark.parametrize(
    ("right", "code"),
    [(-1.0, None), (1.0, "FAR_HIDES")],
    ids=["less than half", "more than half"],
)
def test_far_that_hides_more_than_half_is_a_warning(engine, lens, right, code):
    # The far wall fills the view from the left up to `right`, the near one the rest.
    scene = walls((-400, right, -1.0), (right, 400, 1.0))
    camera = replace(view(**lens), far=10.0)
    found = hidden_by_limits(make_engine(engine, scene), scene, [[camera]])
    assert [f.code for f in found] == ([code] if code else [])
    if code:
        assert found[0].rule.severity is Severity.WARNING
        assert found[0].message.startswith("far = 10 hides ")
        assert found[0].message.endswith(" % of what the cameras meet, in 1 frame")


@pytest.mark.parametrize("lens", LENS)
def test_near_that_hides_more_than_half_is_a_warning(lens):
    scene = walls((-400, 400, 5.0), (-400, 400, -20.0))
    camera = replace(view(**lens), near=6.0)
    (finding,) = hidden_by_limits(make_engine("exact", scene), scene, [[camera]])
    assert finding.code is Code.NEAR_HIDES
    assert finding.message == "near = 6 hides 100 % of what the cameras meet, in 1 frame"
    assert not hidden_by_limits(make_engine("exact", scene), scene, [[replace(camera, near=4.0)]])


def test_the_share_is_of_all_frames_together_and_their_limits_are_named():
    scene = walls((-400, 400, 0.0))
    limits = [[replace(view(), far=far)] for far in (1.0, 2.0, 100.0)]
    (finding,) = hidden_by_limits(make_engine("exact", scene), scene, limits)
    assert finding.message == "far = 1 to 100 hides 66 % of what the cameras meet, in 3 frames"
    assert not hidden_by_limits(make_engine("exact", scene), scene, limits[1:])


def test_an_empty_view_hides_nothing():
    scene = walls((-400, 400, 30.0))
    assert not hidden_by_limits(make_engine("exact", scene), scene, [[view(far=1.0)]])


class Everything(Culler):
    name = "everything"

    def cull(self, camera):
        return DrawnSet(np.arange(2, dtype=np.int32))


class Counting:
    """An engine that counts what it casts, one view at a time or several."""

    def __new__(cls, scene):
        engine = make_engine("embree", scene)
        engine.sizes = []
        cast_together = engine._alike

        def counted(cameras):
            engine.sizes += [camera.samples for camera in cameras]
            return cast_together(cameras)

        engine._alike = counted
        return engine


@pytest.mark.parametrize("cullers", [(), (("everything", Everything()),)])
def test_a_run_says_what_far_hides_and_its_verdict_is_the_same(cullers):
    scene = walls((-400, 400, 0.0), (-400, -2.5, 9.5))
    path = CameraPath(tuple(view(far=1.0) for _ in range(24)))
    runs = []
    for examine in (False, True):
        engine = Counting(scene)
        referee = Referee(scene, lambda engine=engine: engine, examine=examine)
        runs.append(referee.run(path, range(24), cullers))
        few = [size for size in engine.sizes if size < view().samples]
        assert len(few) == (LOOKED_AT if examine else 0)
        assert len(engine.sizes) == 24 + len(few)
    plain, examined = runs
    assert [f.code for f in examined.findings if f not in plain.findings] == ["FAR_HIDES"]
    assert "in 10 frames" in examined.findings[0].message
    assert [r.totals for r in plain.cullers] == [r.totals for r in examined.cullers]
    assert plain.exit is examined.exit
