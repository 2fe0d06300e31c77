"""Boxes against a depth buffer on the CPU, wrong in what is compared with what."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.toy_culler import ToyCuller, fill
from tests.wrong_cullers import registry

wrong = registry.wrong("depth")


@registry.right
class Depth(ToyCuller):
    """Front to back, the rectangle around each box against the depth of what was drawn."""


class Coarse(Depth):
    """The same with a texel for four by four pixels."""

    def __init__(self):
        super().__init__(texel=4)


registry.right(Coarse)


@wrong
class DistanceForDepth(Depth):
    """The box's straight distance is compared with depths."""

    def nearest(self, camera, corners):
        point = np.clip(camera.eye, corners.min(axis=0), corners.max(axis=0))
        return np.linalg.norm(point - camera.eye)


@wrong
class DepthOfTheNearestByDistance(Depth):
    """The depth tested is that of the point which is nearest by straight distance."""

    def nearest(self, camera, corners):
        point = np.clip(camera.eye, corners.min(axis=0), corners.max(axis=0))
        return camera.pixel_of(point[None])[1][0]


@wrong
class CentreDepth(Depth):
    """The depth tested is that of the box's centre."""

    def nearest(self, camera, corners):
        return camera.pixel_of(corners.mean(axis=0)[None])[1][0]


@wrong
class FarCornerDepth(Depth):
    """The depth tested is that of the box's farthest corner."""

    def nearest(self, camera, corners):
        return camera.pixel_of(corners)[1].max()


@wrong
class CornersBehindTaken(Depth):
    """A box that reaches behind the eye is projected as if it lay before it."""

    def sure(self, camera, corners):
        return False

    def nearest(self, camera, corners):
        depth = camera.pixel_of(corners)[1]
        return depth[depth > 0.0].min(initial=np.inf)


@wrong
class YFlipped(Depth):
    """The depth is read back upside down."""

    def read_back(self, camera, depth):
        return depth[::-1]


@wrong
class XFlipped(Depth):
    """The depth is read back mirrored."""

    def read_back(self, camera, depth):
        return depth[:, ::-1]


@wrong
class NearestOfTheRectangle(Depth):
    """The box is compared with the nearest depth of its rectangle in place of the farthest."""

    def passes(self, depth, nearest):
        return bool(depth.size) and depth.min() >= nearest


@wrong
class CentreOfTheRectangle(Depth):
    """Only the middle of the rectangle is looked up."""

    def passes(self, depth, nearest):
        return bool(depth.size) and depth[depth.shape[0] // 2, depth.shape[1] // 2] >= nearest


@wrong
class FourCornersOfTheRectangle(Depth):
    """Only the corners of the rectangle are looked up."""

    def passes(self, depth, nearest):
        return bool(depth.size) and depth[[0, 0, -1, -1], [0, -1, 0, -1]].max() >= nearest


@wrong
class PointSampled(Coarse):
    """A texel holds the depth of one of its pixels in place of the farthest."""

    def reduce(self, depth):
        return depth[:: self.texel, :: self.texel]


@wrong
class Averaged(Coarse):
    """A texel holds the mean depth of its pixels in place of the farthest."""

    def reduce(self, depth):
        finite = np.where(np.isfinite(depth), depth, 1e3)
        rows, columns = (range(0, side, self.texel) for side in depth.shape)
        total = np.add.reduceat(np.add.reduceat(finite, rows, axis=0), columns, axis=1)
        weight = np.add.reduceat(
            np.add.reduceat(np.ones_like(finite), rows, axis=0), columns, axis=1
        )
        return total / weight


@wrong
class OddSidesCut(Coarse):
    """The last row or column of an odd side has no texel."""

    def reduce(self, depth):
        height, width = (max(1, side // self.texel) for side in depth.shape)
        return super().reduce(depth)[:height, :width]


@wrong
class EightBits(Depth):
    """Depths are read back in 256 steps."""

    steps = 255.0

    def read_back(self, camera, depth):
        near, far = camera.near, min(camera.far, 1e4)
        with np.errstate(divide="ignore"):
            window = (1.0 / near - 1.0 / depth) / (1.0 / near - 1.0 / far)
        stored = np.round(np.clip(window, 0.0, 1.0) * self.steps) / self.steps
        back = 1.0 / (1.0 / near - stored * (1.0 / near - 1.0 / far))
        return np.where(np.isfinite(depth), back, np.inf)


@wrong
class SixteenBits(EightBits):
    """Depths are read back in 65,536 steps."""

    steps = 65535.0


@wrong
class StrictOwnDepth(Depth):
    """The depth of all objects is there first, and the test is strict."""

    def cull(self, camera):
        self.whole = np.full((camera.height, camera.width), np.inf)
        opaque = np.flatnonzero(self.occludes(np.arange(self.scene.triangle_count)))
        fill(camera, self.scene, opaque, self.whole)
        return super().cull(camera)

    def read_back(self, camera, depth):
        return self.whole

    def passes(self, depth, nearest):
        return np.count_nonzero(depth > nearest * (1.0 + 1e-9)) > 0


@wrong
class ThresholdOfTwo(Depth):
    """One passing sample is not enough."""

    def passes(self, depth, nearest):
        return np.count_nonzero(depth >= nearest) > 1


@wrong
class ThresholdOfEight(Depth):
    """Eight passing samples are needed."""

    def passes(self, depth, nearest):
        return np.count_nonzero(depth >= nearest) >= 8


@wrong
class RoundedInward(Coarse):
    """The rectangle holds only texels that lie in it wholly."""

    def texels(self, pixels):
        low = -(-pixels.start // self.texel)
        return slice(low, max(low, pixels.stop // self.texel))


@wrong
class LastRowLeftOut(Depth):
    """The rectangle ends a row early."""

    def rectangle(self, camera, corners):
        x, y = super().rectangle(camera, corners)
        return x, slice(y.start, max(y.start, min(y.stop, camera.height) - 1))


@wrong
class LastColumnLeftOut(Depth):
    """The rectangle ends a column early."""

    def rectangle(self, camera, corners):
        x, y = super().rectangle(camera, corners)
        return slice(x.start, max(x.start, min(x.stop, camera.width) - 1)), y


@wrong
class BoxesOcclude(Depth):
    """What hides is an object's box in place of its triangles."""

    def rasterise(self, camera, unit, depth):
        corners = self.corners(unit)
        if self.sure(camera, corners):
            return
        places, own = camera.pixel_of(corners)
        low = np.ceil(places.min(axis=0)).clip(0, None).astype(int)
        high = np.floor(places.max(axis=0)).clip(-1, (camera.width - 1, camera.height - 1))
        x, y = (slice(a, int(b) + 1) for a, b in zip(low, high, strict=True))
        depth[y, x] = np.minimum(depth[y, x], own.max())


@wrong
class ClipPlaneIgnored(Depth):
    """What a clip plane cuts off hides still."""

    def rasterise(self, camera, unit, depth):
        super().rasterise(replace(camera, clip_plane=None), unit, depth)


@wrong
class OccludersBeforeNear(Depth):
    """What lies before the near plane hides what is behind it."""

    def rasterise(self, camera, unit, depth):
        super().rasterise(replace(camera, near=1e-9), unit, depth)


@wrong
class OccludersDilated(Depth):
    """What hides is a pixel wider than it is."""

    def rasterise(self, camera, unit, depth):
        own = np.full_like(depth, np.inf)
        super().rasterise(camera, unit, own)
        wide = np.pad(own, 1, constant_values=np.inf)
        for y in range(3):
            for x in range(3):
                part = wide[y : y + depth.shape[0], x : x + depth.shape[1]]
                np.minimum(depth, part, out=depth)


@wrong
class OnlyTheBackgroundShows(Depth):
    """A box counts as hidden where something nearer in the order was drawn, whatever its depth."""

    def passes(self, depth, nearest):
        return not np.isfinite(depth).all()


@wrong
class BackgroundIsNear(Depth):
    """Where nothing was drawn the depth reads zero, and hides."""

    def read_back(self, camera, depth):
        return np.where(np.isfinite(depth), depth, 0.0)

    def passes(self, depth, nearest):
        return bool(depth.size) and (depth.max() == 0.0 or super().passes(depth, nearest))
