"""A recent lot: reports of what is asked of depth, and of what hides."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.bounds import PointBelowTheHorizon
from tests.causes.reported.hiding import Pyramid
from tests.causes.reported.sound import (
    SLACK,
    Sound,
    corners,
    recent,
    rectangles,
)
from tests.causes.reported.sound import places as projected
from visref.camera import Camera
from visref.scene import Scene


def named(scene: Scene, *starts: str):
    """(n,) bool, which objects have such a name."""
    return np.array([name.startswith(starts) for name in scene.names])


class Twice(Sound):
    """Casts another scene too."""

    def __init__(self, place=None):
        super().__init__(place)
        self.second = Sound()

    def also(self, scene: Scene, camera: Camera):
        return self.second.cast(scene, camera)

    def close(self):
        self.second.close()
        super().close()


@recent(
    "bevyengine/bevy #22603",
    "last texels left out",
    partial(places.library, width=223, height=139),
)
class TwoByTwoOfAnySide(Pyramid):
    """A texel is made of two by two finer ones, though those of an odd side cover up to three by
    three of them."""

    def half(self, fine):
        rows, columns = (max(1, side // 2) for side in fine.shape)
        even = fine[: 2 * rows, : 2 * columns]
        return even.reshape(rows, even.shape[0] // rows, columns, -1).max(axis=(1, 3))

    def passes(self, levels, low, high, nearest):
        depth = levels[min(self.level(low, high), len(levels) - 1)]
        share = np.array(depth.shape[::-1]) / np.array(levels[0].shape[::-1])
        first = np.floor(low * share).astype(int)
        last = np.ceil((high + 1) * share).astype(int) - 1
        found = self.texels(depth, first, last)
        return bool((found >= nearest * (1.0 - SLACK)).any())


@recent("BabylonJS/Babylon.js #3552", "front for back", places.library)
class OneSideOfTheQueriedBoxInsideOut(Sound):
    """One side of the box that is drawn for a query has its corners in the wrong order, and is not
    drawn for an eye on that side."""

    def shows(self, camera, some, boxes):
        depth = self.depth(camera)
        result = self.nearest(camera, boxes) <= camera.near * (1.0 + SLACK)
        low, high = rectangles(camera, boxes)
        for at in np.flatnonzero(~result):
            ways = rays(camera, low[at], high[at])
            found = depth[low[at, 1] : high[at, 1] + 1, low[at, 0] : high[at, 0] + 1]
            result[at] = self.fragments(ways, boxes[at] - camera.eye, found)
        return result

    def fragments(self, ways, box, found) -> bool:
        """Whether any of the box about the eye passes, seen along (h, w, 3) rays."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(box[0] - 1e-4) / ways, (box[1] + 1e-4) / ways])
        first, last = ends.min(axis=0), ends.max(axis=0)
        enters, leaves = first.max(axis=2), last.min(axis=2)
        hit = (enters <= leaves) & (leaves > 0)
        before = first.argmax(axis=2) == 0
        beyond = last.argmin(axis=2) == 0
        front = hit & ~(before & (ways[..., 0] < 0)) & (found >= enters)
        back = hit & beyond & (ways[..., 0] > 0) & (found >= leaves)
        return bool((front | back).any())


def rays(camera: Camera, low, high):
    """(h, w, 3) through the pixels from column and row to column and row, of depth 1."""
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    a = 2.0 * (x + camera.shift_x_px) + 1.0 - camera.width
    b = camera.height - 2.0 * (y + camera.shift_y_px) - 1.0
    across, up = a[..., None] * camera.right_step, b[..., None] * camera.up_step
    return camera.forward + across + up


@recent("Paril/q2repro #117", "small box asked in its place", places.harbour)
class QueryOfTheLampsMiddle(Sound):
    """Whether a lamp shows is asked with a square of a hand's breadth at it, which misses every
    sample from far away."""

    SIDE = 0.2

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        lamps = np.flatnonzero(named(self.scene, "lamp")[some])
        depth = self.depth(camera)
        pixels, _ = projected(camera, boxes[lamps].mean(axis=1)[:, None])
        nearest = self.nearest(camera, boxes[lamps])
        half = self.SIDE * camera.height / (4.0 * np.tan(camera.yfov / 2) * nearest)
        last = np.array([camera.width, camera.height]) - 1
        for at, middle, reach, away in zip(lamps, pixels[:, 0], half, nearest, strict=True):
            if away > camera.near:
                low = np.maximum(np.ceil(middle - reach), 0).astype(int)
                high = np.minimum(np.floor(middle + reach), last).astype(int)
                result[at] = (low <= high).all() and self.passes(depth, low, high, away)
        return result


@recent("Haven-King/SAX #30", "some samples of the rectangle", places.sheds)
class RaysToTheEightCorners(Sound):
    """A ray goes to each of eight corners, and a thing is hidden if all of them are stopped."""

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        depth = self.depth(camera)
        pixels, away = projected(camera, corners(boxes))
        size = np.array([camera.width, camera.height])
        asked = named(self.scene, "tool", "bucket")[some]
        for at in np.flatnonzero(result & asked & (away > camera.near).all(axis=1)):
            place = np.rint(pixels[at]).astype(int)
            if ((place >= 0) & (place < size)).all():
                column, row = place.T
                result[at] = (depth[row, column] >= away[at] * (1.0 - 2e-3)).any()
        return result


@recent("Aleph-One-Marathon/alephone #435", "no depth compared", places.library)
class ClippedByWhatIsBehind(Twice):
    """Small things are cut off at the edges of pillars, of those that stand behind them too."""

    alone = None

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        if self.alone is None:
            self.alone = replace(self.scene, absent=~named(self.scene, "pillar"))
        pillars = np.isfinite(self.also(self.alone, camera))
        depth = np.where(pillars, 0.0, self.depth(camera))
        nearest = self.nearest(camera, boxes)
        low, high = rectangles(camera, boxes)
        small = named(self.scene, "stool", "globe")[some]
        for at in np.flatnonzero(result & small & (nearest > camera.near)):
            result[at] = self.passes(depth, low[at], high[at], nearest[at])
        return result


@recent("CesiumGS/cesium #8397", "occluders too large", places.basins)
class HorizonOfTheEllipsoid(PointBelowTheHorizon):
    """The horizon is that of an ellipsoid, which the ground lies below in parts."""

    RADIUS = 100.0

    def in_view(self, camera, some, boxes):
        result = Sound.in_view(self, camera, some, boxes)
        for at, one in enumerate(some):
            if result[at] and self.scene.names[one].startswith("tile"):
                first, last = self.scene.object_offsets[one : one + 2]
                used = np.unique(self.scene.triangles[first:last])
                points = self.scene.vertices[used].astype(float)
                result[at] = not self.below(camera.eye, points).all()
        return result


@recent("urho3d/urho3d #822", "occluders too large", places.hills)
class GroundOfTheCoarsestLevel(Twice):
    """The ground hides by its coarsest level, which cuts across hollows."""

    STEP = 8
    coarse = None

    def depth(self, camera):
        if self.coarse is None:
            self.coarse = Scene.from_objects(list(self.meshes()), source="reported")
        return self.also(self.coarse, camera)

    def meshes(self):
        """Name, points and faces of each object, of the ground only every so many vertices."""
        for one, name in enumerate(self.scene.names):
            first, last = self.scene.object_offsets[one : one + 2]
            used, faces = np.unique(self.scene.triangles[first:last], return_inverse=True)
            points = self.scene.vertices[used].astype(float)
            faces = faces.reshape(-1, 3)
            if name.startswith("tile"):
                fine = np.arange(len(points)).reshape(9, 9)[:: self.STEP, :: self.STEP]
                a, b, c, d = fine[:-1, :-1], fine[:-1, 1:], fine[1:, 1:], fine[1:, :-1]
                faces = np.concatenate(
                    [np.stack(each, -1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))]
                )
            yield name, points, faces


@recent("TokisanGames/Terrain3D #301", "occluders too large", places.cellars)
class HolesNotInTheOccluder(GroundOfTheCoarsestLevel):
    """The ground's occluder is made at a coarse level, which leaves out a hole that lies between
    its vertices."""

    def meshes(self):
        for name, points, faces in super().meshes():
            if name.startswith("plot"):
                low, high = points.min(axis=0), points.max(axis=0)
                x, z = [low[0], low[0], high[0], high[0]], [low[2], high[2], high[2], low[2]]
                yield name, np.stack([x, np.zeros(4), z], axis=1), [[0, 1, 2], [0, 2, 3]]
            else:
                yield name, points, faces


@recent("Spellcast-Studios/ardenfall-issues #47", "small holes of occluders closed", places.sheds)
class SmallHolesFilledIn(Twice):
    """Walls with small holes are baked as occluders, and holes below some size are filled in."""

    SMALLEST = 0.25
    baked = None

    def depth(self, camera):
        if self.baked is None:
            points = np.array(self.scene.vertices)
            for one in np.flatnonzero(named(self.scene, "front")):
                first, last = self.scene.object_offsets[one : one + 2]
                used = np.unique(self.scene.triangles[first:last])
                z = points[used, 2].reshape(-1, 8)
                for plank, after in pairwise(z):
                    if after.min() - plank.max() < self.SMALLEST:
                        plank[plank == plank.max()] = after.min()
                points[used, 2] = z.ravel()
            self.baked = replace(self.scene, vertices=points)
        return self.also(self.baked, camera)


@recent("playcanvas/supersplat-viewer #274", "threshold of samples", places.fleet)
class BelowTwoPixels(Sound):
    """What is less than two pixels wide and high is left out."""

    LEAST = 2.0

    def shows(self, camera, some, boxes):
        pixels, away = projected(camera, corners(boxes))
        tiny = (np.ptp(pixels, axis=1) < self.LEAST).all(axis=1)
        return super().shows(camera, some, boxes) & ~(tiny & (away > camera.near).all(axis=1))


@recent("StrayLightning/aeolius #14", "near too large", partial(places.fleet, near=3.0))
class NearPlaneOfTheOtherRange(Sound):
    """The near plane is found as if depth ran from 0 to 1 in a projection where it runs from -1:
    it lies almost twice as far out."""

    def lens(self, camera):
        n, f = camera.near, camera.far
        return replace(camera, near=2.0 * f * n / (f + n))


@recent("godotengine/godot-proposals #10515", "no far plane", partial(places.fleet, deep=True))
class FarPlaneRoundedAway(Sound):
    """With near and far too far apart, the projection rounds to one without a far plane, whose
    normal is then zero, and nothing is drawn."""

    def in_view(self, camera, some, boxes):
        n, f = np.float32(camera.near), np.float32(camera.far)
        normal = np.float32(1.0) - (f + n) / (f - n)
        return super().in_view(camera, some, boxes) & (normal != 0)
