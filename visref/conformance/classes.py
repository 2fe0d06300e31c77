"""What a case asks of an engine beyond still, opaque, two-sided objects before one camera.

Each class is read off the case itself. An engine says which of them it is made for; the others'
cases are not run, and not passed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.recordings.names import shown_name
from visref.scene import Scene, Units
from visref.wording import did_you_mean


@dataclass(frozen=True)
class _Class:
    """`about`: what is in a case of this class. `holds`: whether this, of a scene as it is read
    from its file, its path, and its clusters if it has any."""

    about: str
    holds: Callable[[Scene, CameraPath, Units | None], bool]


def _resizes(path: CameraPath) -> bool:
    sizes: dict[str, set[tuple[int, int]]] = {}
    for frame in path.frames:
        for camera in frame.cameras:
            sizes.setdefault(camera.view, set()).add((camera.width, camera.height))
    return any(len(of_view) > 1 for of_view in sizes.values())


def _any_camera(path: CameraPath, holds: Callable[[Camera], bool]) -> bool:
    return any(holds(camera) for frame in path.frames for camera in frame.cameras)


_CLASSES = {
    "animated": _Class(
        "the file's own animation changes the shape of objects; frames say the time",
        lambda scene, path, units: any(frame.time_s is not None for frame in path.frames),
    ),
    "blending": _Class(
        "blended surfaces, which are seen and hide nothing",
        lambda scene, path, units: scene.has_blend,
    ),
    "clip-plane": _Class(
        "a view with a clip plane, as of a mirror",
        lambda scene, path, units: _any_camera(path, lambda c: c.clip_plane is not None),
    ),
    "clusters": _Class(
        "units finer than objects: a units file says which triangles are one cluster",
        lambda scene, path, units: units is not None,
    ),
    "far-origin": _Class(
        "coordinates so far from zero that float32 does not resolve the scene",
        lambda scene, path, units: bool(scene.origin.any()),
    ),
    "infinite-far": _Class(
        "a view without a far plane",
        lambda scene, path, units: _any_camera(path, lambda c: math.isinf(c.far)),
    ),
    "instancing": _Class(
        "instanced draws (EXT_mesh_gpu_instancing)",
        lambda scene, path, units: bool(scene.groups),
    ),
    "lens-shift": _Class(
        "an off-centre frustum",
        lambda scene, path, units: _any_camera(path, lambda c: bool(c.shift_x_px or c.shift_y_px)),
    ),
    "masks": _Class(
        "alpha-masked surfaces, whose holes show what is behind",
        lambda scene, path, units: scene.has_mask,
    ),
    "moving": _Class(
        "frames that move objects by matrices, or in which objects come and go",
        lambda scene, path, units: any(
            bool(frame.world_from_object or frame.absent or frame.levels) for frame in path.frames
        ),
    ),
    "one-sided": _Class(
        "surfaces that are culled from behind and hide nothing there",
        lambda scene, path, units: scene.has_one_sided,
    ),
    "orthographic": _Class(
        "orthographic views",
        lambda scene, path, units: _any_camera(path, lambda c: not c.is_perspective),
    ),
    "resizing": _Class(
        "a view whose size changes from frame to frame",
        lambda scene, path, units: _resizes(path),
    ),
    "views": _Class(
        "frames with several views",
        lambda scene, path, units: any(len(frame.cameras) > 1 for frame in path.frames),
    ),
}

# What each class is about, by name.
CLASSES = {name: one.about for name, one in _CLASSES.items()}


def classes_of(scene: Scene, path: CameraPath, units: Units | None) -> tuple[str, ...]:
    """The classes of a case, in the alphabet's order. `scene`: as it is read from its file, with
    one-sided surfaces; `units`: the case's clusters."""
    return tuple(name for name, one in _CLASSES.items() if one.holds(scene, path, units))


def checked_classes(names: Iterable[str], source: str) -> frozenset[str]:
    """The names, if all are classes. Raises InputError for one that is none."""
    result = []
    for name in names:
        if name not in CLASSES:
            raise InputError(
                f"there is no class {shown_name(name)}",
                source=source,
                fix=did_you_mean(name[:200], CLASSES),
            )
        result.append(name)
    return frozenset(result)
