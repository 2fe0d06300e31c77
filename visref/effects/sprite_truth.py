"""Truth about particles: how many sprites show at each sample.

A sprite (`visref.effects.sprites`) shows at a sample where it is no farther than the nearest
surface there, which is ray-cast; sprites hide nothing, so their layers add up.

Where an image disagrees, `SpriteTruth.bounds` gives what a rasteriser may make of the sample:
float32 may take a sprite over the next pixel border, and move its depth; the surface there lies
between the bounds of `visref.effects.surfaces`. Outward: what float64 cannot decide counts as
possible.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.effects.images import NO_BOUNDS, Bounds, ImageVerdict, disputed, judge
from visref.effects.sprites import Sprites
from visref.effects.surfaces import depth_doubt, surfaces_at
from visref.engines.embree import EmbreeEngine
from visref.exact import ExactScene
from visref.scene import Float64, Int32, Int64, Scene
from visref.visibility import FrameTruth

# Sprites are compared with so many samples at once, to bound the memory.
SPRITE_BLOCK = 1 << 22


def corners(sprites: Sprites, camera: Camera, off_px: float = 0.0) -> tuple[Int64, Float64]:
    """Each sprite's top-left pixel, (n, 2) int64 x and y, and view depth, (n,) float64.

    `off_px` moves the centres right and down. Where the depth is not positive in a
    perspective view, the pixel means nothing.
    """
    pixel, depth = camera.pixel_of(sprites.centres.astype(np.float64))
    # A pixel's centre is a whole number there, its border half a pixel before; the sprite's
    # border belongs at `pixel - side / 2`, and goes to the nearest one.
    corner = np.floor(pixel - sprites.side_px / 2 + 1.0 + off_px)
    # Far outside is outside; int64 holds what is left.
    return np.nan_to_num(np.clip(corner, -1e9, 1e9)).astype(np.int64), depth


def layers(sprites: Sprites, truth: FrameTruth) -> Int32:
    """(height, width) int32: how many sprites show at each sample, as rays see the scene."""
    camera = truth.camera
    corner, depth = corners(sprites, camera)
    kept = np.flatnonzero(
        (depth >= camera.near)
        & (depth <= camera.far)
        & (corner > -sprites.side_px).all(axis=1)
        & (corner < (camera.width, camera.height)).all(axis=1)
    )
    inside = np.arange(sprites.side_px)
    x = corner[kept, 0, None, None] + inside[None, None]
    y = corner[kept, 1, None, None] + inside[None, :, None]
    x, y = np.broadcast_arrays(x, y)
    seen = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    sample = (y * camera.width + x)[seen]
    own = np.broadcast_to(depth[kept, None, None], seen.shape)[seen]
    shows = own <= truth.buffer.depth.reshape(-1)[sample]
    counts = np.bincount(sample[shows], minlength=camera.samples)
    return counts.astype(np.int32).reshape(camera.height, camera.width)


class SpriteTruth:
    """Sprites in a solid scene (`visref.effects.solid`), by rays."""

    def __init__(self, scene: Scene, sprites: Sprites, *, threads: int | None = None) -> None:
        self.scene, self.sprites = scene, sprites
        self.engine = EmbreeEngine(scene, threads=threads)

    def judge(
        self, camera: Camera, image: Int32, reference: Int32, tolerance: RasterTolerance
    ) -> ImageVerdict:
        """Hold a frame's layers, and those with no sprite culled, against rays: the protocol of
        `visref.effects.images`. `image`, `reference`: (height, width) int32."""
        shown = layers(self.sprites, self.engine.frame(camera))
        samples = disputed(image, reference, shown)
        return judge(image, reference, shown, self.bounds(camera, samples, tolerance))

    def bounds(self, camera: Camera, samples: Int64, tolerance: RasterTolerance) -> Bounds:
        """Between what the layers at some samples, (k,) flat indices, lie."""
        if not len(samples):
            return NO_BOUNDS
        exact, sprites = self._exact, self.sprites
        surfaces = surfaces_at(exact, camera, samples, tolerance)
        nearest, limit = surfaces.nearest(), surfaces.limit
        low, depth = corners(sprites, camera, -tolerance.snap_px)
        high, _ = corners(sprites, camera, tolerance.snap_px)
        before = np.flatnonzero(depth > 0.0) if camera.is_perspective else np.arange(len(depth))
        low, high = low[before], high[before]
        near, far = depth_doubt(exact, camera, sprites.centres[before], tolerance)
        possible = (far >= camera.near) & (near <= camera.far)
        certain = (near > camera.near) & (far < camera.far)
        least, most = np.zeros((2, len(samples)), np.int32)
        block = max(1, SPRITE_BLOCK // max(1, len(before)))
        for start in range(0, len(samples), block):
            part = slice(start, start + block)
            x, y = samples[part] % camera.width, samples[part] // camera.width
            at = np.stack([x, y], axis=1)[:, None]
            surely, maybe = self._over(at, high, low), self._over(at, low, high)
            least[part] = (surely & certain & (far <= nearest[part, None])).sum(axis=1)
            most[part] = (maybe & possible & (near <= limit[part, None])).sum(axis=1)
        return Bounds(samples, least, most)

    def _over(self, at: Int64, first: Int64, last: Int64) -> NDArray[np.bool_]:
        """(k, n) bool: which sprites cover samples (k, 1, 2), if they begin at `first` at the
        latest and at `last` at the earliest."""
        inside = (at >= first) & (at < last + self.sprites.side_px)
        covered: NDArray[np.bool_] = inside[..., 0] & inside[..., 1]
        return covered

    def close(self) -> None:
        self.engine.close()

    @cached_property
    def _exact(self) -> ExactScene:
        """Only disputes need it."""
        return ExactScene(self.scene)
