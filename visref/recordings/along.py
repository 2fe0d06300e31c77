"""Whether a recording was made along a given path: its cameras and what it says of objects are the
path's, but for the rounding of an engine that holds float32."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.path_frame import Frame
from visref.recordings.names import shown_name
from visref.scene import Float64

# How far, relative to its length, a vector of a recorded camera may be from the path's. An engine
# holds 24 bits, and loses a few of them where it composes matrices; 8 are left for that. It decides
# which path a recording is of, and no verdict.
_SAME = 2.0**-16
# The same for a shift of the lens, in pixels.
_SAME_PX = 2.0**-8


def check_along(recorded: CameraPath, path: CameraPath) -> None:
    """Raise InputError, which names the frame, unless each recorded frame is that of the same
    number of `path`; both in world coordinates, or relative to the same point. A recording may
    leave out frames, and what a frame says of objects."""
    for number in recorded.numbers:
        problem = f"the path has frames {path.numbers[0]}…{path.numbers[-1]}"
        if path.has(number):
            problem = _differs(recorded.frame(number), path.frame(number))
        if problem:
            raise InputError(
                f"it was not recorded along the path: {problem}",
                place=f"frame {number}",
                fix="look through the path's cameras, and write down those",
            )


def _differs(recorded: Frame, frame: Frame) -> str:
    """How a recorded frame is another than the path's, in words; empty where it is not."""
    views = [camera.view for camera in frame.cameras]
    found = {camera.view: camera for camera in recorded.cameras}
    if sorted(found) != sorted(views):
        return f"its views are {_listed(list(found))}, and the path's {_listed(views)}"
    for camera in frame.cameras:
        if difference := _other_camera(found[camera.view], camera):
            of = f" of view {shown_name(camera.view)}" if camera.view else ""
            return f"{difference} of the camera{of} is another"
    if more := sorted(set(recorded.absent) - set(frame.absent)):
        return f"{shown_name(more[0])} is absent"
    for name, matrix in recorded.world_from_object.items():
        right = frame.world_from_object.get(name)
        if right is not None and not _near(matrix, right, max(1.0, float(np.abs(right).max()))):
            return f"{shown_name(name)} stands elsewhere"
    time_s, right_s = recorded.time_s, frame.time_s
    if time_s is None or right_s is None:
        return ""
    same = math.isclose(time_s, right_s, rel_tol=_SAME, abs_tol=_SAME)
    return "" if same else f"its time is {time_s:g} s"


def _other_camera(recorded: Camera, camera: Camera) -> str:
    """What of a recorded camera is not the path's; empty where nothing is."""
    if (recorded.width, recorded.height) != (camera.width, camera.height):
        return "the image's size"
    if recorded.is_perspective != camera.is_perspective:
        return "the projection"
    if not _near(recorded.eye, camera.eye, max(1.0, float(np.abs(camera.eye).max()))):
        return "the position"
    if not _near(recorded.world_from_camera[:3, :3], camera.world_from_camera[:3, :3], 1.0):
        return "the direction"
    step = camera.half_pixel
    if not math.isclose(recorded.half_pixel, step, rel_tol=_SAME):
        return "the field of view"
    shifts = (recorded.shift_x_px - camera.shift_x_px, recorded.shift_y_px - camera.shift_y_px)
    return "the lens shift" if max(map(abs, shifts)) > _SAME_PX else ""


def _near(found: Float64, right: Float64, scale: float) -> bool:
    return bool(np.abs(found - right).max() <= _SAME * scale)


def _listed(views: Sequence[str]) -> str:
    return ", ".join(map(shown_name, views))
