"""A recording is of the path along which it was made, whatever float32 rounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.path_frame import Frame
from visref.recordings.along import check_along

FAR = (4_208_411.0, 1_120_733.0, -4_645_519.0)


def camera(eye=(3.0, 4.0, 5.0), view="", **changes):
    values = {"width": 64, "height": 48, "near": 0.1, "far": 100.0, "yfov": 1.0, **changes}
    return Camera(look_at(eye, (eye[0], eye[1] + 1.0, eye[2] - 3.0)), view=view, **values)


def frame(**changes):
    values = {
        "time_s": 1.5,
        "world_from_object": {"door": np.diag([2.0, 2.0, 2.0, 1.0])},
        "absent": ("lamp",),
        **changes,
    }
    return Frame((camera(view="left"), camera((4.0, 4.0, 5.0), view="right")), **values)


PATH = CameraPath([frame(), Frame((camera(FAR, shift_x_px=0.25),))])


def as_float32(one):
    pose = one.world_from_camera.astype(np.float32).astype(np.float64)
    return replace(one, world_from_camera=pose, yfov=float(np.float32(one.yfov)))


def with_cameras(change):
    return CameraPath([replace(f, cameras=tuple(map(change, f.cameras))) for f in PATH.frames])


def test_the_path_itself_and_what_float32_makes_of_it_are_along_it():
    check_along(PATH, PATH)
    check_along(with_cameras(as_float32), PATH)
    # Frames may be left out, views come in any order, and nothing be said of objects.
    bare = frame(time_s=None, world_from_object={}, absent=())
    check_along(CameraPath([replace(bare, cameras=bare.cameras[::-1])]), PATH)
    check_along(CameraPath([PATH.frames[1]], numbers=[1]), PATH)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda one: replace(one, width=65), "the image's size of the camera of view 'left'"),
        (lambda one: replace(one, yfov=None, ymag=1.0), "the projection"),
        (lambda one: replace(one, yfov=1.001), "the field of view"),
        (lambda one: replace(one, shift_y_px=0.5), "the lens shift"),
        (
            lambda one: replace(one, world_from_camera=look_at((3, 4, 5), (0, 0, 0))),
            "the direction",
        ),
        (lambda one: replace(one, view="up"), "its views are 'up', 'right', and the path's 'left'"),
    ],
)
def test_another_camera_is_told_with_its_frame(changed, said):
    first = frame()
    other = replace(first, cameras=(changed(first.cameras[0]), first.cameras[1]))
    with pytest.raises(InputError) as caught:
        check_along(CameraPath([other]), PATH)
    assert str(caught.value).startswith("frame 0: it was not recorded along the path: ")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time_s": 2.0}, "its time is 2 s"),
        ({"absent": ("lamp", "chair")}, "'chair' is absent"),
        ({"world_from_object": {"door": np.eye(4)}}, "'door' stands elsewhere"),
    ],
)
def test_what_is_said_of_objects_must_be_the_path_s(changes, said):
    with pytest.raises(InputError, match=said):
        check_along(CameraPath([frame(**changes)]), PATH)


def test_a_frame_that_the_path_lacks_is_told():
    with pytest.raises(InputError, match=r"frame 7: .* the path has frames 0…1"):
        check_along(CameraPath([PATH.frames[0]], numbers=[7]), PATH)
