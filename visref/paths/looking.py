"""What the cameras of a path see, so that a path can be trusted before a culler is judged on it.

What is said is what can be known. *Visible* and *hits* are the truth engine's; *from behind* is the
share of the hits that meet the back of a triangle, by its winding: little where one looks at
solids from outside, much within or behind them (and for sheets it says nothing). The eye is *in* an
object that is closed, encloses a positive volume, and winds about it: its winding number there, the
sum of its triangles' solid angles over 4 pi (Van Oosterom and Strackee 1983), is a whole number but
for rounding, so that half of one tells. An open object has no inside. From the frame before, the
eye came *through* an object where the straight line between meets a triangle of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from visref.camera import Camera
from visref.engines.base import TruthEngine
from visref.inputs import Inputs
from visref.judging.winding import from_behind, volume_signs
from visref.paths.clearance import distance_to_triangles
from visref.scene import Float64, Int32, Scene
from visref.visibility import objects_seen


@dataclass(frozen=True)
class Look:
    """What one view of one frame sees.

    `visible`: objects that own a sample or are seen as glass. `samples`, `hits`, `from_behind`:
    samples in all, those that something owns, and those of them that it owns with its back.
    `nearest`: the least view depth of a hit, inf where nothing is hit. `clearance`: how far the
    nearest triangle is from the eye, in whatever direction, inf where there is none. `inside`: ids
    of the closed objects that the eye is in. `through`: the id of an object between this eye and
    that of the frame before, None where the way is free, after a cut and in the first frame.
    """

    frame: int
    view: str
    visible: int
    samples: int
    hits: int
    from_behind: int
    nearest: float
    clearance: float
    inside: tuple[int, ...]
    through: int | None


def looks(inputs: Inputs) -> Iterator[Look]:
    """What each view of each picked frame sees, in the path's order."""
    engine = inputs.make_engine()
    try:
        yield from _looks(inputs, engine)
    finally:
        engine.close()


def _looks(inputs: Inputs, engine: TruthEngine) -> Iterator[Look]:
    posed: Scene = engine.scene
    solids = _Solids(posed)
    before: dict[str, Float64] = {}
    for number in inputs.frames:
        scene = inputs.timeline.at(number)
        if scene is not posed:
            engine.pose(scene)
            posed, solids = scene, _Solids(scene)
        eyes = {}
        for camera in inputs.path.views(number):
            eyes[camera.view] = camera.eye
            start = None if camera.cut else before.get(camera.view)
            yield _look(number, camera, scene, solids, engine, start)
        before = eyes


def _look(
    number: int,
    camera: Camera,
    scene: Scene,
    solids: _Solids,
    engine: TruthEngine,
    before: Float64 | None,
) -> Look:
    truth = engine.frame(camera)
    owner = truth.buffer.triangle.reshape(-1)
    hit = np.flatnonzero(owner >= 0)
    behind = from_behind(scene, camera, hit, owner[hit])
    through = None
    if before is not None and not np.array_equal(before, camera.eye):
        met, triangle = distance_to_triangles(scene, before, camera.eye, 0.0)
        through = int(scene.object_of_triangle[triangle]) if met == 0.0 else None
    return Look(
        frame=number,
        view=camera.view,
        visible=int(np.count_nonzero(objects_seen(truth, scene).visible)),
        samples=camera.samples,
        hits=len(hit),
        from_behind=int(np.count_nonzero(behind)),
        nearest=float(truth.buffer.depth.min(initial=math.inf)),
        clearance=distance_to_triangles(scene, camera.eye, camera.eye)[0],
        inside=solids.around(camera.eye),
        through=through,
    )


class _Solids:
    """The closed objects of a scene, and which of them a point is in."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._closed: dict[int, bool] = {}

    def around(self, point: Float64) -> tuple[int, ...]:
        """Ids of the closed objects of positive volume that a point, (3,) float64 in the scene's
        own space, is in."""
        boxes = self._scene.object_bounds
        holds = np.all((boxes[:, 0] < point) & (point < boxes[:, 1]), axis=1)
        found = []
        for index in np.flatnonzero(holds).tolist():
            if index not in self._closed:
                sign = volume_signs(self._scene, np.array([index], np.int32))
                self._closed[index] = bool(sign[0] > 0)
            if self._closed[index] and winding_number(self._scene, index, point) > 0.5:
                found.append(index)
        return tuple(found)


def winding_number(scene: Scene, index: int, point: Float64) -> float:
    """How often an object's triangles wind about a point, (3,) float64 in the scene's own space."""
    start, end = scene.object_offsets[index : index + 2]
    triangles: Int32 = scene.triangles[start:end]
    a, b, c = np.moveaxis(scene.vertices[triangles].astype(np.float64) - point, 1, 0)
    lengths = [np.linalg.norm(corner, axis=1) for corner in (a, b, c)]
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    under = (
        lengths[0] * lengths[1] * lengths[2]
        + np.einsum("ij,ij->i", a, b) * lengths[2]
        + np.einsum("ij,ij->i", b, c) * lengths[0]
        + np.einsum("ij,ij->i", c, a) * lengths[1]
    )
    return float(np.sum(2.0 * np.arctan2(volume, under)) / (4.0 * math.pi))
