"""Reports of depth: what is compared with what, at which resolution, of which moment, and what is
taken to hide."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.sound import (
    SLACK,
    Sound,
    corners,
    depths,
    reported,
)
from tests.causes.reported.sound import places as projected
from visref.scene import Alpha


@reported("godotengine/godot #94210", "distance for depth", partial(places.hall, yfov=1.7))
class PointNearestByDistance(Sound):
    """Of a box the depth of the point is compared that is nearest by straight distance."""

    def nearest(self, camera, boxes):
        closest = np.clip(camera.eye, boxes[:, 0], boxes[:, 1])
        least = depths(camera, closest[:, None])[:, 0]
        sure = super().nearest(camera, boxes) <= camera.near
        return np.where(sure, 0.0, least)


@reported("godotengine/godot #52545", "distance for depth", places.village)
class DistanceAgainstDepth(Sound):
    """Straight distance to a box is compared with depths, and hides what is small at the edges."""

    def nearest(self, camera, boxes):
        closest = np.clip(camera.eye, boxes[:, 0], boxes[:, 1])
        sure = super().nearest(camera, boxes) <= camera.near
        return np.where(sure, 0.0, np.linalg.norm(closest - camera.eye, axis=1))


class Coarse(Sound):
    """Depth is cast along fewer rays, each of which stands for a square of pixels."""

    TEXEL = 4

    def depth(self, camera):
        return self.cast(self.scene, self.coarser(camera))

    def coarser(self, camera):
        return replace(
            camera,
            width=camera.width // self.TEXEL,
            height=camera.height // self.TEXEL,
            shift_x_px=camera.shift_x_px / self.TEXEL,
            shift_y_px=camera.shift_y_px / self.TEXEL,
        )

    def passes(self, depth, low, high, nearest):
        low, high = low // self.TEXEL, high // self.TEXEL
        found = depth[low[1] : high[1] + 1, low[0] : high[0] + 1]
        return bool((found >= nearest * (1.0 - SLACK)).any())


@reported("godotengine/godot #53288", "quarter of the resolution", places.groves)
class ThroughNarrowGaps(Coarse):
    """Depth has a quarter of the resolution, and a gap may lie between its rays."""


@reported("godotengine/godot #81919", "eighth of the resolution", places.village)
class RaysInPlaceOfPixels(Coarse):
    """Depth is cast along one ray for eight by eight pixels."""

    TEXEL = 8


class Pyramid(Sound):
    """Levels of the farthest depth, each of half the sides of the one before."""

    def depth(self, camera):
        levels = [super().depth(camera)]
        while min(levels[-1].shape) > 1:
            levels.append(self.half(levels[-1]))
        return levels

    def half(self, fine):
        rows, columns = (-(-side // 2) for side in fine.shape)
        wide = np.full((2 * rows, 2 * columns), -np.inf)
        wide[: fine.shape[0], : fine.shape[1]] = fine
        return wide.reshape(rows, 2, columns, 2).max(axis=(1, 3))

    def level(self, low, high):
        """The first at which a rectangle is no wider than two texels."""
        side = int((high - low).max()) + 1
        return max(0, int(np.ceil(np.log2(side))))

    def passes(self, levels, low, high, nearest):
        at = min(self.level(low, high), len(levels) - 1)
        found = self.texels(levels[at], low >> at, high >> at)
        return bool((found >= nearest * (1.0 - SLACK)).any())

    def texels(self, depth, low, high):
        return depth[low[1] : high[1] + 1, low[0] : high[0] + 1]


@reported(
    "bevyengine/bevy #14062",
    "last texels left out",
    partial(places.hall, width=255, height=159),
)
class OddSidesCut(Pyramid):
    """A level of odd sides loses its last column or row to the next."""

    def half(self, fine):
        rows, columns = (max(1, side // 2) for side in fine.shape)
        even = fine[: 2 * rows, : 2 * columns]
        return even.reshape(rows, even.shape[0] // rows, columns, -1).max(axis=(1, 3))

    def texels(self, depth, low, high):
        last = np.array(depth.shape[::-1]) - 1
        return super().texels(depth, np.minimum(low, last), np.minimum(high, last))


@reported("bevyengine/bevy #14042", "some samples of the rectangle", places.passages)
class LevelTooFine(Pyramid):
    """Two by two texels are looked up, in a level too fine for them to cover the rectangle."""

    def level(self, low, high):
        return max(0, super().level(low, high) - 2)

    def texels(self, depth, low, high):
        return depth[np.ix_([low[1], high[1]], [low[0], high[0]])]


@reported("tr7zw/EntityCulling #77", "some samples of the rectangle", places.village)
class RaysToSomePoints(Sound):
    """Rays go to a few points of a box, and none to what shows between them."""

    def shows(self, camera, some, boxes):
        depth = self.depth(camera)
        low, high = boxes[:, None, 0], boxes[:, None, 1]
        points = np.concatenate([corners(boxes), (low + high) / 2], axis=1)
        pixels, away = projected(camera, points)
        result = away.min(axis=1) <= camera.near
        size = np.array([camera.width, camera.height])
        for at in np.flatnonzero(~result):
            place = np.rint(pixels[at]).astype(int)
            inside = ((place >= 0) & (place < size)).all(axis=1)
            column, row = place[inside].T
            result[at] = (depth[row, column] >= away[at][inside] * (1.0 - 1e-3)).any()
        return result


@reported("TheMiningTeamYT/TICraft #1", "some samples of the rectangle", places.strewn)
class CentreHidden(Sound):
    """A thing is hidden if the middle of its rectangle is."""

    def passes(self, depth, low, high, nearest):
        column, row = (low + high) // 2
        return bool(depth[row, column] >= nearest * (1.0 - SLACK))


@reported("DoubleStyx/Renderide #332", "earlier depth", places.hall)
class PyramidOfTheFrameBefore(Sound):
    """What is in the view is held against the depth of the frame before."""

    last = None

    def depth(self, camera):
        now = super().depth(camera)
        before, self.last = now if self.last is None else self.last, now
        return before


@reported("drsnuggles8/OloEngineBase #487", "earlier depth", places.plaza)
class PyramidStillCountsAsValid(Sound):
    """In frames that make no pyramid the last one is used, and counts as this frame's."""

    last, frame = None, 0

    def depth(self, camera):
        self.frame += 1
        if self.last is None or self.frame % 3 == 1:
            self.last = super().depth(camera)
        return self.last


@reported("Milk-Drinker01/Milk_Instancer01 #6", "earlier depth", places.passages)
class NoReprojection(Sound):
    """Depth is that of the frame before, as it was seen then, though eye and things move."""

    last = None

    def depth(self, camera):
        now = super().depth(camera)
        before, self.last = now if self.last is None else self.last, now
        return before


class Queried(Sound):
    """What is in the view is drawn if it passed a query so many frames ago, or had none."""

    LATE = 1

    def prepare(self, scene):
        self.asked = []
        return super().prepare(scene)

    def shows(self, camera, some, boxes):
        now = np.ones(self.scene.object_count, np.bool_)
        now[some] = super().shows(camera, some, boxes)
        self.asked.append(now)
        if len(self.asked) <= self.LATE:
            return np.ones(len(some), np.bool_)
        return self.asked.pop(0)[some]


@reported("horde3d/Horde3D #199", "answer a frame late", places.hall)
class QueriesReadNextFrame(Queried):
    """Queries of one frame are read in the next, which draws by them."""


@reported("OpenMW/openmw #2399", "answer two frames late", places.passages)
class QueriesNotWaitedFor(Queried):
    """Queries are read two frames later, so that nobody waits for them."""

    LATE = 2


@reported("SaiyansKing/GD3D11 #23", "answer several frames late", places.village)
class QueriesWhenTheyAreReady(Queried):
    """Queries are read when the device is done, some frames later."""

    LATE = 4


@reported("godotengine/godot #98562", "occluders through another lens", places.village_from_above)
class RaysNotParallel(Sound):
    """The rays of an orthographic view's depth part from each other."""

    def depth(self, camera):
        spread = replace(camera, ymag=None, yfov=2 * float(np.arctan(camera.ymag / 42.0)))
        return self.cast(self.scene, replace(spread, near=max(spread.near, 0.1)))


@reported("godotengine/godot #91030", "glass solid", places.glasshouse)
class GlassBakedAsOccluder(Sound):
    """What is transparent by its shader is baked into the occluders."""

    def depth(self, camera):
        return self.cast(self.solid(), camera)

    made = None

    def solid(self):
        """The scene, its glass opaque."""
        if self.made is None:
            alpha = np.where(self.scene.alpha == Alpha.BLEND, Alpha.OPAQUE, self.scene.alpha)
            self.made = replace(self.scene, alpha=alpha.astype(np.uint8))
        return self.made


@reported("fte-team/fteqw #210", "glass solid", places.lake)
class WaterHidesTheBed(GlassBakedAsOccluder):
    """Visibility was computed with opaque water, which is drawn transparent."""


@reported("GothicVRProject/GothicVR #235, first", "masks solid", places.glasshouse)
class ClippedLeavesHide(Sound):
    """What is alpha-clipped is among the occluders, as if it had no holes."""

    made = None

    def depth(self, camera):
        if self.made is None:
            alpha = np.where(self.scene.alpha == Alpha.MASK, Alpha.OPAQUE, self.scene.alpha)
            self.made = replace(self.scene, alpha=alpha.astype(np.uint8), masks=None)
        return self.cast(self.made, camera)


@reported("godotengine/godot #57889", "occluders at their old place", places.passages)
class OccludersRebuiltLater(Sound):
    """Occluders that move are rebuilt in the background, and stand where they were until then."""

    def depth(self, camera):
        found, self.before = self.cast(self.before, camera), self.scene
        return found


@reported("luanti-org/luanti #2070", "depth from another eye", places.village)
class EyeOfTheCharacter(Sound):
    """The camera looks over the character's shoulder, and what hides is asked from his eyes."""

    def shows(self, camera, some, boxes):
        pose = camera.world_from_camera.copy()
        pose[:3, 3] += 2.5 * camera.forward + 0.4 * pose[:3, 0]
        his = replace(camera, world_from_camera=pose, yfov=2.4)
        result = super().shows(his, some, boxes)
        # What he has beside him or behind is not asked about.
        pixels, depth = projected(his, corners(boxes))
        size = np.array([his.width, his.height])
        inside = ((pixels > 0) & (pixels < size - 1)).all(axis=(1, 2)) & (depth > 0).all(axis=1)
        return result | ~inside
