"""Wrong in what is brought up to date when things move, come and go, or are seen by two cameras."""

from __future__ import annotations

import itertools

import numpy as np

from tests.wrong_cullers import registry
from tests.wrong_cullers.depth import Depth
from tests.wrong_cullers.frustum import Frustum
from visref.culler import DrawnSet

wrong = registry.wrong("moving")


@registry.right
class MovingFrustum(Frustum):
    """Leaves out a box only if one plane has all its corners outside, wherever it is by now."""

    def prepare(self, scene):
        units = super().prepare(scene)
        bounds = scene.object_bounds
        self.filled = np.flatnonzero((bounds[:, 0] <= bounds[:, 1]).all(axis=1))
        return units

    def update(self, scene):
        self.prepare(scene)


@registry.right
class MovingDepth(Depth):
    """Rectangles against the depth of what was drawn, boxes and depth of this frame's scene."""

    def prepare(self, scene):
        self.bounds = scene.object_bounds
        self.hides = scene
        return super().prepare(scene)

    def update(self, scene):
        self.scene = self.hides = scene
        self.bounds = scene.object_bounds

    def filled(self):
        return np.flatnonzero((self.bounds[:, 0] <= self.bounds[:, 1]).all(axis=1))

    def corners(self, unit):
        low, high = self.bounds[unit]
        return np.array(list(itertools.product(*zip(low, high, strict=True))))

    def rasterise(self, camera, unit, depth):
        scene, self.scene = self.scene, self.hides
        super().rasterise(camera, unit, depth)
        self.scene = scene


@wrong
class BoxesAtRest(MovingDepth):
    """Boxes are those of the scene as it was first met."""

    def update(self, scene):
        bounds = self.bounds
        super().update(scene)
        gone = (self.bounds[:, 0] > self.bounds[:, 1]).any(axis=1)
        came = (bounds[:, 0] > bounds[:, 1]).any(axis=1)
        self.bounds = np.where((gone | came)[:, None, None], self.bounds, bounds)


@wrong
class BoxesOfTheFrameBefore(MovingDepth):
    """Boxes are brought up to date a change late."""

    def update(self, scene):
        coming = vars(self).get("coming", self.bounds)
        super().update(scene)
        self.coming, self.bounds = self.bounds, coming


@wrong
class FrustumOfBoxesAtRest(MovingFrustum):
    """What was in the view at first is, and what was not never is, whatever moved."""

    def update(self, scene):
        pass


@wrong
class MovedWithoutATurn(MovingDepth):
    """A box is moved as its first vertex is, and keeps its size and its turn."""

    def prepare(self, scene):
        units = super().prepare(scene)
        self.rest = scene
        return units

    def update(self, scene):
        super().update(scene)
        self.bounds = self.rest.object_bounds.copy()
        for unit in np.flatnonzero(np.diff(scene.object_offsets)):
            first = scene.triangles[scene.object_offsets[unit], 0]
            step = scene.vertices[first].astype(float) - self.rest.vertices[first]
            self.bounds[unit] += step
        gone = (scene.object_bounds[:, 0] > scene.object_bounds[:, 1]).any(axis=1)
        self.bounds[gone] = scene.object_bounds[gone]


@wrong
class BoxesOfJoints(MovingDepth):
    """A box holds the middle of what bends and not its reach."""

    def update(self, scene):
        old = self.scene.object_bounds
        super().update(scene)
        changed = (old != self.bounds).any(axis=(1, 2)) & (self.bounds[:, 0, 0] < np.inf)
        middle = self.bounds[changed].mean(axis=1, keepdims=True)
        self.bounds = self.bounds.copy()
        self.bounds[changed] = middle + 0.25 * (self.bounds[changed] - middle)


@wrong
class DepthAtItsOldPlace(MovingDepth):
    """What hides is where it was a change ago."""

    def update(self, scene):
        before = self.scene
        super().update(scene)
        self.hides = before


@wrong
class DepthAtRest(MovingDepth):
    """What hides is where it was when the scene was first met."""

    def update(self, scene):
        rest = self.hides
        super().update(scene)
        self.hides = rest


@wrong
class RemovedStillHides(MovingDepth):
    """What is gone is drawn into the depth as it last was."""

    def update(self, scene):
        gone = (scene.object_bounds[:, 0] > scene.object_bounds[:, 1]).any(axis=1)
        last, bounds = self.hides, self.bounds
        super().update(scene)
        self.bounds = np.where(gone[:, None, None], bounds, self.bounds)
        if gone.any():
            self.hides = last


@wrong
class AppearedUnknown(MovingDepth):
    """What was not there at first is in no list."""

    def prepare(self, scene):
        units = super().prepare(scene)
        self.known = super().filled()
        return units

    def filled(self):
        return np.intersect1d(super().filled(), self.known)


@wrong
class VanishedForGood(MovingDepth):
    """What has vanished once is in no list when it comes back."""

    def prepare(self, scene):
        units = super().prepare(scene)
        self.known = np.arange(scene.object_count)
        return units

    def update(self, scene):
        had = (self.bounds[:, 0] <= self.bounds[:, 1]).all(axis=1)
        super().update(scene)
        here = (self.bounds[:, 0] <= self.bounds[:, 1]).all(axis=1)
        self.known = np.setdiff1d(self.known, np.flatnonzero(had & ~here))

    def filled(self):
        return np.intersect1d(super().filled(), self.known)


@wrong
class AnswerOfTheOtherView(MovingDepth):
    """The answer of the view before serves for the next one, whichever that is."""

    last = None

    def cull(self, camera):
        found = super().cull(camera)
        last, self.last = self.last, (camera.view, found)
        if last is None or last[0] == camera.view:
            return found
        return DrawnSet(np.intersect1d(last[1].unit_ids, self.filled()).astype(np.int32))


@wrong
class HiddenInTheOtherView(MovingDepth):
    """What a view found hidden is not asked about in the view that is decided next."""

    hidden = np.zeros(0, np.int64)
    view = None

    def cull(self, camera):
        found = super().cull(camera)
        drawn = found.unit_ids
        if self.view is not None and self.view != camera.view:
            drawn = np.setdiff1d(drawn, self.hidden).astype(np.int32)
        self.view, self.hidden = camera.view, np.setdiff1d(self.filled(), found.unit_ids)
        return DrawnSet(drawn)


@wrong
class FirstViewsFrustum(MovingFrustum):
    """Both views are culled against the frustum of the first one."""

    first = None

    def believed(self, camera):
        self.first = self.first or camera.view
        if camera.view == self.first:
            self.ahead = camera
        return self.ahead
