"""Two eyes in place of one: the views `left` and `right`."""

from __future__ import annotations

import math
from dataclasses import replace

from visref.camera import Camera
from visref.camera_path import Frame
from visref.errors import InputError

VIEWS = ("left", "right")


def stereo_frame(frame: Frame, distance: float, screen: float | None = None) -> Frame:
    """A frame with two eyes, `distance` apart along the camera's right, in place of its only one.

    Both look the same way. `screen`: the view depth at which the two images coincide, reached by
    shifting the lenses (off-axis frusta, as head-mounted displays have them); None shifts nothing.
    Raises InputError where the frame has several views, or the lens is orthographic and shifted.
    """
    if len(frame.cameras) != 1:
        raise InputError("it has several views", fix="give a path with a view per frame")
    if not 0.0 < distance < math.inf:
        raise InputError(f"--eyes is {distance:g}", fix="give the distance between the eyes")
    (camera,) = frame.cameras
    if screen is not None and not camera.is_perspective:
        raise InputError("an orthographic image has no depth to converge at", fix="omit --screen")
    if screen is not None and not 0.0 < screen < math.inf:
        raise InputError(f"--screen is {screen:g}", fix="give a view depth")
    return replace(
        frame,
        cameras=tuple(
            _eye(camera, view, side * distance / 2, screen)
            for view, side in zip(VIEWS, (-1.0, 1.0), strict=True)
        ),
    )


def _eye(camera: Camera, view: str, aside: float, screen: float | None) -> Camera:
    pose = camera.world_from_camera.copy()
    pose[:3, 3] += aside * pose[:3, 0]
    shift = camera.shift_x_px
    if screen is not None:
        assert camera.yfov is not None
        # A pixel is 2 s wide at depth 1, so what lies `aside` away at the screen's depth is so
        # many of them away; the image moves by as much the other way.
        shift -= aside / (screen * 2 * math.tan(camera.yfov / 2) / camera.height)
    return replace(camera, world_from_camera=pose, shift_x_px=shift, view=view)
