"""Truth about particles: how many sprites show at each sample.

A sprite is a square of whole pixels that faces the camera, at the view depth of its centre: a
quad parallel to the image. It is placed as OpenGL places a wide point of an even size: its corner
is the pixel border nearest to where it belongs. It shows at a sample where it is no farther than
the nearest surface there, which is ray-cast; sprites hide nothing, so their layers add up.

Where an image disagrees, `SpriteTruth.bounds` gives what a rasteriser may make of the sample:
float32 may take a sprite over the next pixel border, and move its depth; the surface there lies
between the bounds of `visref.effects.surfaces`. Outward: what float64 cannot decide counts as
possible.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.effects.images import NO_BOUNDS, Bounds, ImageVerdict, disputed, judge
from visref.effects.surfaces import depth_doubt, surfaces_at
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.scene import Float32, Float64, Int32, Int64, Scene
from visref.visibility import FrameTruth

# Sprites are compared with so many samples at once, to bound the memory.
SPRITE_BLOCK = 1 << 22


@dataclass(frozen=True, eq=False)
class Sprites:
    """`centres`: (n, 3) float32, world space; `side_px`: pixels on a side, all the same, an even
    number. Raises InputError where these do not hold."""

    centres: Float32
    side_px: int

    def __post_init__(self) -> None:
        if self.side_px < 2 or self.side_px % 2:
            raise InputError(
                f"sprites of {self.side_px} pixels", place="side_px", fix="give an even number"
            )
        if self.centres.dtype != np.float32 or not np.isfinite(self.centres).all():
            raise InputError("a sprite's centre is no finite float32", fix="mend the centres")

    def corners(self, camera: Camera, off_px: float = 0.0) -> tuple[Int64, Float64]:
        """Each sprite's top-left pixel, (n, 2) int64 x and y, and view depth, (n,) float64.

        `off_px` moves the centres right and down. Where the depth is not positive in a
        perspective view, the pixel means nothing.
        """
        pixel, depth = camera.pixel_of(self.centres.astype(np.float64))
        # A pixel's centre is a whole number there, its border half a pixel before; the sprite's
        # border belongs at `pixel - side / 2`, and goes to the nearest one.
        corner = np.floor(pixel - self.side_px / 2 + 1.0 + off_px)
        # Far outside is outside; int64 holds what is left.
        return np.nan_to_num(np.clip(corner, -1e9, 1e9)).astype(np.int64), depth

    def layers(self, truth: FrameTruth) -> Int32:
        """(height, width) int32: how many sprites show at each sample, as rays see the scene."""
        camera = truth.camera
        corner, depth = self.corners(camera)
        kept = np.flatnonzero(
            (depth >= camera.near)
            & (depth <= camera.far)
            & (corner > -self.side_px).all(axis=1)
            & (corner < (camera.width, camera.height)).all(axis=1)
        )
        inside = np.arange(self.side_px)
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
        `visref.effects.images`."""
        layers = self.sprites.layers(self.engine.frame(camera))
        samples = disputed(image, reference, layers)
        return judge(image, reference, layers, self.bounds(camera, samples, tolerance))

    def bounds(self, camera: Camera, samples: Int64, tolerance: RasterTolerance) -> Bounds:
        """Between what the layers at some samples lie."""
        if not len(samples):
            return NO_BOUNDS
        exact, sprites = self._exact, self.sprites
        surfaces = surfaces_at(exact, camera, samples, tolerance)
        nearest, limit = surfaces.nearest(), surfaces.limit
        low, depth = sprites.corners(camera, -tolerance.snap_px)
        high, _ = sprites.corners(camera, tolerance.snap_px)
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
