"""Wrong in what is drawn of what was found visible, and under which number."""

from __future__ import annotations

import numpy as np

from tests.wrong_cullers import registry
from tests.wrong_cullers.depth import Depth
from tests.wrong_cullers.frustum import Frustum
from visref.culler import DrawnSet
from visref.scene import Units

wrong = registry.wrong("units")


@registry.right
class Clusters(Frustum):
    """Clusters of up to four of an object's triangles, each a unit with a box of its own."""

    size = 4

    def prepare(self, scene):
        super().prepare(scene)
        starts = [
            start
            for first, end in zip(scene.object_offsets[:-1], scene.object_offsets[1:], strict=True)
            for start in range(int(first), int(end), self.size)
        ]
        offsets = np.array([*starts, scene.triangle_count], np.int64)
        units = Units(offsets, np.arange(scene.triangle_count, dtype=np.int32), "cluster")
        low, high = np.moveaxis(scene.bounds_of(units), 1, 0)
        pick = np.array([[(k >> 2) & 1, (k >> 1) & 1, k & 1] for k in range(8)])
        self.corners = low[:, None] + pick * (high - low)[:, None]
        self.filled = np.arange(units.count)
        self.object_of_unit = scene.object_of_triangle[offsets[:-1]]
        return self.listed(units)

    def listed(self, units):
        """The units as they are told to the judge, and drawn."""
        return units


@wrong
class HalfOfTheClusters(Clusters):
    """Every second cluster is not drawn."""

    def cull(self, camera):
        return DrawnSet(super().cull(camera).unit_ids[::2])


@wrong
class FirstClusterAlone(Clusters):
    """Of each visible object the first visible cluster is drawn."""

    def cull(self, camera):
        kept = super().cull(camera).unit_ids
        return DrawnSet(kept[np.unique(self.object_of_unit[kept], return_index=True)[1]])


@wrong
class LastClusterLost(Clusters):
    """An object's last cluster is lost where it is not full."""

    def prepare(self, scene):
        units = super().prepare(scene)
        self.filled = np.flatnonzero(units.sizes == self.size)
        return units


@wrong
class EverySecondTriangleLost(Clusters):
    """A cluster lists every second of its triangles."""

    def listed(self, units):
        first = [
            np.arange(a, b, 2) for a, b in zip(units.offsets[:-1], units.offsets[1:], strict=True)
        ]
        offsets = np.cumsum([0, *(len(part) for part in first)])
        return Units(offsets, np.concatenate([*first, []]).astype(np.int32), units.kind)


@wrong
class LastTriangleLost(Frustum):
    """An object's last triangle is lost: a count that is one short."""

    def prepare(self, scene):
        super().prepare(scene)
        spans = zip(scene.object_offsets[:-1], scene.object_offsets[1:], strict=True)
        parts = [np.arange(first, max(first, end - 1)) for first, end in spans]
        offsets = np.cumsum([0, *(len(part) for part in parts)])
        return Units(offsets, np.concatenate([*parts, []]).astype(np.int32), "part")


@wrong
class CellsOfCentroids(Clusters):
    """Boxes hold the centroids of a cluster's triangles, not the triangles."""

    def prepare(self, scene):
        units = super().prepare(scene)
        centroid = scene.vertices[scene.triangles].astype(np.float64).mean(axis=1)
        pick = np.array([[(k >> 2) & 1, (k >> 1) & 1, k & 1] for k in range(8)])
        for unit in range(units.count):
            own = centroid[units.offsets[unit] : units.offsets[unit + 1]]
            low, high = own.min(axis=0), own.max(axis=0)
            self.corners[unit] = low + pick * (high - low)
        return units


@wrong
class NumbersOffByOne(Frustum):
    """Ids count from one."""

    def cull(self, camera):
        kept = super().cull(camera).unit_ids
        return DrawnSet(np.unique((kept + 1) % max(1, self.scene.object_count)).astype(np.int32))


@wrong
class NumbersOfOneByte(Frustum):
    """Ids wrap at 256."""

    def cull(self, camera):
        return DrawnSet(np.unique(super().cull(camera).unit_ids % 256).astype(np.int32))


@wrong
class AnswersShifted(Depth):
    """Each object gets the answer of the one that was asked before it."""

    previous = True

    def passes(self, depth, nearest):
        answer, self.previous = self.previous, super().passes(depth, nearest)
        return answer


@wrong
class LastAnswerLost(Depth):
    """The answer about the last object asked is never read."""

    def cull(self, camera):
        return DrawnSet(super().cull(camera).unit_ids[:-1])


@wrong
class AtMostAHundred(Frustum):
    """The list of draws has room for a hundred."""

    def cull(self, camera):
        return DrawnSet(super().cull(camera).unit_ids[:100])


@wrong
class SameNamesMerged(Frustum):
    """Of objects that bear one name in the file only the first is known."""

    def cull(self, camera):
        kept = super().cull(camera).unit_ids
        names = np.array(self.scene.given_names)[kept]
        return DrawnSet(kept[np.sort(np.unique(names, return_index=True)[1])])


@wrong
class EmptyObjectBreaks(Frustum):
    """An object without triangles is not expected."""

    def prepare(self, scene):
        units = super().prepare(scene)
        for first, count in zip(units.offsets[:-1], units.sizes, strict=True):
            scene.vertices[scene.triangles[first : first + count]].min(axis=0)
        return units


@wrong
class EmptySceneBreaks(Frustum):
    """A scene without objects is not expected."""

    def prepare(self, scene):
        scene.object_bounds[0]
        return super().prepare(scene)
