"""Small scenes and truths written by hand, whose verdicts are known without any engine."""

from __future__ import annotations

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Promise
from visref.judging.disputes import Rulings
from visref.judging.holders import DrawList
from visref.judging.judge import judge
from visref.judging.settle import with_rulings
from visref.scene import Scene, Units
from visref.visibility import Doubt, FrameTruth, Ties, VisibilityBuffer

SHAPE = (2, 4)


def camera(width: int = SHAPE[1], height: int = SHAPE[0]) -> Camera:
    """Orthographic, looking down -Z, one world unit a pixel."""
    return Camera(
        look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)),
        width,
        height,
        near=1.0,
        far=100.0,
        ymag=height / 2,
    )


def still_path(frames: int) -> CameraPath:
    """The same camera in each frame."""
    return CameraPath([camera()] * frames)


def square(x: float, y: float, z: float, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Two triangles, counter-clockwise seen from +Z, with the lower left corner given."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64) * size
    return corners + np.array((x, y, z)), np.array([[0, 1, 2], [0, 2, 3]])


def scene_of_squares(*depths: float) -> Scene:
    """An object a square, each covering the whole picture of `camera()` at its own z."""
    return Scene.from_objects(
        [(f"square{i}", *square(-2.0, -2.0, z, 4.0)) for i, z in enumerate(depths)]
    )


def truth(
    owners: list[list[int]],
    *,
    ties: list[tuple[int, int]] = (),
    doubt: list[tuple[int, int]] = (),
    depth: float = 5.0,
) -> FrameTruth:
    """A truth from triangle ids (-1 for none); `ties` are (sample, triangle) pairs, and
    so are `doubt`: a triangle that a mask may leave as owner before the one given."""
    triangle = np.array(owners, np.int32)
    pairs = sorted(ties)
    return FrameTruth(
        camera(triangle.shape[1], triangle.shape[0]),
        "hand",
        VisibilityBuffer(triangle, np.where(triangle >= 0, depth, np.inf)),
        Ties(np.array([s for s, _ in pairs], np.int64), np.array([t for _, t in pairs], np.int32)),
        ties_complete=True,
        doubt=Doubt.of(
            np.array([s for s, _ in sorted(doubt)], np.int64),
            np.array([t for _, t in sorted(doubt)], np.int32),
        ),
    )


def soup(object_sizes: list[int]) -> Scene:
    """Objects with so many triangles each; where they lie does not matter to the judge."""
    return Scene.from_objects(
        [
            (f"o{i}", np.eye(3) + i, np.tile([[0, 1, 2]], (size, 1)))
            for i, size in enumerate(object_sizes)
        ]
    )


def triangle_units(scene: Scene) -> Units:
    """A unit a triangle."""
    count = scene.triangle_count
    return Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")


def judged(scene, frame, units, drawn, promise=Promise.CONSERVATIVE, rulings=None):
    """The verdict on units drawn, the truth taken at its word but for `rulings`."""
    return judge(settled(scene, frame, units, drawn, rulings), promise)


def settled(scene, frame, units, drawn, rulings=None):
    """Units drawn, the truth taken at its word but for `rulings`."""
    draws = DrawList.of_units(scene, units, np.array(drawn, np.int32))
    return with_rulings(scene, frame, draws, rulings or Rulings())
