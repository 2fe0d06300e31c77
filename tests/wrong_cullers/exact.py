"""What promises to draw nothing hidden: one right answer, and several that are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.wrong_cullers import registry
from tests.wrong_cullers.depth import Depth
from tests.wrong_cullers.frustum import Frustum
from visref.culler import Culler, DrawnSet, Promise
from visref.engines.exact import ExactEngine
from visref.scene import Units

wrong = registry.wrong("exact")


@registry.right
class VisibleObjects(Culler):
    """The objects that own a sample, or may: by the exact engine."""

    promise = Promise.EXACT

    def prepare(self, scene):
        self.scene, self.engine = scene, ExactEngine(scene)
        return scene.object_units()

    def cull(self, camera):
        return DrawnSet(np.unique(self.scene.object_of_triangle[self.shown(camera)]))

    def shown(self, camera):
        """Ascending ids of the triangles that show at some sample, or may."""
        truth = self.engine.frame(camera)
        owners = truth.buffer.triangle
        parts = [owners[owners >= 0]]
        parts += [found.triangle for found in (truth.ties, truth.blend, truth.doubt)]
        return np.unique(np.concatenate(parts))


@registry.right
class VisibleTriangles(VisibleObjects):
    """The same triangle by triangle."""

    def prepare(self, scene):
        super().prepare(scene)
        count = scene.triangle_count
        return Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")

    def cull(self, camera):
        return DrawnSet(self.shown(camera).astype(np.int32))


@wrong
class OneTriangleEach(VisibleTriangles):
    """Of every visible object one triangle that shows is drawn, no more."""

    def cull(self, camera):
        shown = self.shown(camera)
        first = np.unique(self.scene.object_of_triangle[shown], return_index=True)[1]
        return DrawnSet(shown[first].astype(np.int32))


@wrong
class HiddenDrawnThoughExact(Depth):
    """Boxes are tested, which draws too much, and the answer is called exact."""

    promise = Promise.EXACT


@wrong
class HiddenDrawnThoughAggressive(Frustum):
    """All that is in the view is drawn, and the answer is called aggressive."""

    promise = Promise.AGGRESSIVE


@wrong
class BeyondFarDrawnThoughExact(VisibleObjects):
    """The far plane is not heeded, and the answer is called exact."""

    def cull(self, camera):
        return super().cull(replace(camera, far=float("inf")))


@wrong
class SamplesOfHalfTheSize(VisibleObjects):
    """Who is visible is asked at half the resolution."""

    def cull(self, camera):
        small = {
            "width": -(-camera.width // 2),
            "height": -(-camera.height // 2),
            "shift_x_px": camera.shift_x_px / 2,
            "shift_y_px": camera.shift_y_px / 2,
        }
        return super().cull(replace(camera, **small))


@wrong
class NearestOfATie(VisibleObjects):
    """Of objects at one depth none is drawn."""

    def shown(self, camera):
        truth = self.engine.frame(camera)
        owners = truth.buffer.triangle.reshape(-1).copy()
        owners[truth.ties.sample] = -1
        return np.unique(owners[owners >= 0])
