"""Orbits and turntables: a camera that circles, and a thing that turns before one that stands.

Both show the same pictures. On an orbit nothing in the scene moves; on a turntable it is the
objects that do, which is another thing to a culler.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visref.camera import look_at
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.paths.lens import Lens, check_frames
from visref.recordings.names import Names
from visref.scene import Float64, Scene

# Near, over the distance to the centre, where it is not given: 24-bit depth buffers still tell
# the thousandth part of the distance apart there.
NEAR_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Circle:
    """A horizontal circle about a vertical axis (world +Y): `centre`, (3,) float64 in world space,
    what is looked at; the camera's distance from it, and its elevation above it in radians."""

    centre: Float64
    distance: float
    elevation: float

    def __post_init__(self) -> None:
        if not abs(self.elevation) < math.pi / 2:
            raise InputError(
                f"an elevation of {math.degrees(self.elevation):g} degrees looks along the axis",
                fix="give less than 90 degrees",
            )
        if not 0.0 < self.distance < math.inf:
            raise InputError(f"the distance is {self.distance:g}", fix="give a positive length")

    def pose(self, angle: float) -> Float64:
        """`world_from_camera`, (4, 4) float64, after an angle (radians, counter-clockwise seen
        from above, 0 towards +Z)."""
        level = math.cos(self.elevation) * self.distance
        height = math.sin(self.elevation) * self.distance
        aside = np.array((math.sin(angle) * level, height, math.cos(angle) * level))
        return look_at(self.centre + aside, self.centre)


def circle_around(
    bounds: Float64, lens: Lens, *, elevation: float, distance: float | None = None
) -> Circle:
    """A circle about a box, (2, 3) float64 in world space; from the default distance all of it is
    in view. Raises InputError where the box is empty."""
    low, high = bounds
    if not np.isfinite(bounds).all() or np.array_equal(low, high):
        raise InputError("there is nothing to circle around", fix="name something with triangles")
    radius = float(np.linalg.norm(high - low)) / 2
    # The cone of view touches the sphere around the box.
    fitting = radius / math.sin(lens.half_angle)
    return Circle((low + high) / 2, fitting if distance is None else distance, elevation)


def orbit(circle: Circle, lens: Lens, frames: int, times: Sequence[float | None]) -> CameraPath:
    """One turn of the camera. `times`: each frame's `time_s`. Raises InputError for no frames."""
    check_frames(frames)
    near = circle.distance * NEAR_SHARE
    return CameraPath(
        Frame((lens.camera(circle.pose(2 * math.pi * k / frames), near),), times[k])
        for k in range(frames)
    )


def turntable(
    circle: Circle, lens: Lens, frames: int, scene: Scene, turned: Sequence[str]
) -> CameraPath:
    """One turn of what is named, objects or groups of a scene that stands still, about the circle's
    axis: clockwise seen from above, so that the pictures are those of an orbit. Raises InputError
    for a name that means nothing, or several things."""
    check_frames(frames)
    meanings = Names(scene).resolved(dict.fromkeys(turned, ""), scene.source)
    camera = lens.camera(circle.pose(0.0), circle.distance * NEAR_SHARE)
    made = []
    for k in range(frames):
        turn = _about(circle.centre, -2 * math.pi * k / frames)
        poses = {
            name: turn if _is_group(scene, name, ids) else turn @ _rest(scene, ids[0])
            for name, ids in meanings.items()
        }
        made.append(Frame((camera,), world_from_object=poses))
    return CameraPath(made)


def everything(scene: Scene) -> list[str]:
    """Names for all objects that have triangles, each for one object alone."""
    names, result = Names(scene), []
    sizes = np.diff(scene.object_offsets)
    for index in np.flatnonzero(sizes).tolist():
        written = (scene.names[index], scene.paths[index], f"/{scene.paths[index]}")
        plain = [name for name in written if names.meanings(name) == [(index,)]]
        if not plain:
            raise InputError(
                f"object {index} has no name of its own", source=scene.source, fix="name it"
            )
        result.append(plain[0])
    return result


def bounds_of(scene: Scene, name: str) -> Float64:
    """(2, 3) float64, the box of an object or a group in world space; (+inf, -inf) if nothing of
    it is there. Raises InputError for a name that means nothing, or several things."""
    (ids,) = Names(scene).resolved({name: ""}, scene.source).values()
    boxes = scene.object_bounds[list(ids)] + scene.origin
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _is_group(scene: Scene, name: str, ids: tuple[int, ...]) -> bool:
    """As `visref.timeline` decides whether a matrix is a place, or turns what is in its place."""
    return (
        len(ids) != 1
        or name.startswith("group:")
        or any(group.objects == ids for group in scene.groups if group.levels)
    )


def _rest(scene: Scene, index: int) -> Float64:
    """What a turn is multiplied with, (4, 4) float64: world_from_object at rest. Objects of a scene
    without a rig are in world space, and so are skinned vertices."""
    rig = scene.rig
    if rig is None or (rig.motion is not None and rig.motion.skinned[index]):
        return np.eye(4)
    return np.array(rig.worlds[index])


def _about(centre: Float64, angle: float) -> Float64:
    """A rotation about the vertical axis through a point, (4, 4) float64."""
    result = np.eye(4)
    cos, sin = math.cos(angle), math.sin(angle)
    result[0, 0], result[0, 2], result[2, 0], result[2, 2] = cos, sin, -sin, cos
    result[:3, 3] = centre - result[:3, :3] @ centre
    return result
