"""What every ray engine shares: a float32 ray library finds, float64 decides what counts.

For each camera, tile by tile over all cores: rays are made in float64 and rounded once, the
library names the nearest triangle, and `ray_kernels.resolve` computes its view depth in
float64 and asks whether it counts. The few samples whose hit does not count but may hide one
that does, the masked triangles and the blended layers go to `ray_kernels.splat`, which tests
triangles against samples in float64; nothing is recast, so nothing behind a hit is lost.

Numeric policy: owners are the library's, good to its float32 rounding, so a sample within that
of an edge, or of a crossing of two surfaces, may go to a neighbour. Depths, near, far and sides
are float64. To keep float32 rounding small, the scene is moved so that it lies about the
origin, and rays start just before the scene or the near plane, however far the eye is.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.engines import ray_kernels
from visref.engines.base import TruthEngine
from visref.engines.ray_kernels import BLEND, MASK, OWN, PENDING, Layers, SampleGrid, Triangles
from visref.errors import InputError
from visref.scene import Alpha, Float32, Float64, Int32, Scene
from visref.threads import available_threads
from visref.visibility import BACKGROUND, BlendVisibility, FrameTruth, VisibilityBuffer

T = TypeVar("T")

# A scene is moved to the origin where its core lies further out than this many times its own
# size: nearer than that, float32 loses less than three bits to the distance.
REBASE_DISTANCE = 4.0

# How far the library's hit may be off in depth, relative to the largest local coordinate: some
# 16 roundings (2^-24) of vertex less origin, which is at most 2 sqrt(3) of that coordinate,
# come to 2^-18.2. Rays start this much early; hits that this lets in are sorted out in float64.
DEPTH_SLACK = 2.0**-18

# Embree ignores triangles beyond this (its FLT_LARGE, 1.844e18); with room for the rebasing.
GREATEST_COORDINATE = 1e18


class RayEngine(TruthEngine):
    """A truth engine over a ray library; subclasses say how rays are cast.

    `rebase`: (3,) float64, what is subtracted from the scene before it becomes float32 again;
    `rebase_exact` says that no vertex was rounded by it.
    """

    # Samples in a tile: rays and answers of one tile stay in a core's cache.
    tile_samples = 1 << 15

    def __init__(self, scene: Scene, *, threads: int | None = None) -> None:
        super().__init__(scene, threads=threads)
        self._workers = threads or available_threads()
        self.rebase = choose_rebase(scene)
        local = (scene.vertices - self.rebase).astype(np.float32)
        self.rebase_exact = _is_exact(scene.vertices, local, self.rebase)
        self._solid = _of_alpha(scene, Alpha.OPAQUE)
        self._masked = _of_alpha(scene, Alpha.MASK)
        self._blended = _of_alpha(scene, Alpha.BLEND)
        self._mesh = Triangles(
            scene.vertices, scene.triangles, scene.one_sided, scene.object_of_triangle
        )
        self._reach = float(np.abs(local).max(initial=0.0))
        if self._reach > GREATEST_COORDINATE:
            raise InputError(
                f"a coordinate is beyond {GREATEST_COORDINATE:g}",
                source=scene.source,
                fix="scale the scene down, or use the engine 'exact'",
            )
        self._triangle: Int32 = np.empty(0, np.int32)
        self._depth: Float64 = np.empty(0)
        self._pool = ThreadPoolExecutor(self._workers) if self._workers > 1 else None
        if len(self._solid):
            self._build(local, scene.triangles[self._solid])

    @abstractmethod
    def _build(self, vertices: Float32, triangles: Int32) -> None:
        """Meet the opaque triangles, once: local vertices (v, 3), at least one triangle."""

    @abstractmethod
    def _nearest(self, rays: Float32) -> Int32:
        """The nearest triangle along each ray, -1 for none.

        `rays`: (n, 6), origins and directions. Hits count from parameter 0 on, closed.
        """

    def frame(self, camera: Camera) -> FrameTruth:
        samples = camera.samples
        if len(self._triangle) < samples:
            self._triangle, self._depth = np.empty(samples, np.int32), np.empty(samples)
        triangle, depth = self._triangle[:samples], self._depth[:samples]
        grid = sample_grid(camera)
        if self._cast(grid, triangle, depth):
            self._settle(grid, triangle, depth)
        undecided, masked = np.zeros(0, np.int64), np.zeros(0, np.int32)
        mark = np.zeros(samples if len(self._masked) or len(self._blended) else 0, np.bool_)
        if len(self._masked):
            layers = _layers(triangle, depth, mark, objects=self.scene.object_count)
            self._splat(MASK, self._masked, grid, _whole(grid), lambda: layers)
            undecided = np.flatnonzero(mark).astype(np.int64)
            masked = np.flatnonzero(layers.pixels).astype(np.int32)
        blend = BlendVisibility()
        if len(self._blended):
            blend = self._blend(grid, triangle, depth, mark)
        shape = (camera.height, camera.width)
        buffer = VisibilityBuffer(triangle.reshape(shape), depth.reshape(shape))
        return FrameTruth(
            camera, self.name, buffer, undecided=undecided, masked=masked, blend=blend
        )

    def probe(self, camera: Camera, a: Float64, b: Float64) -> Int32:
        """Who is seen at any points of the continuous image, as `frame` sees its samples.

        `a`, `b`: (k,) float64 each, the points' coordinates as `visref.camera` defines them
        (need not be those of a sample, or within the image). Returns (k,) int32, the nearest
        opaque triangle within near and far, one-sided ones from their front only,
        `BACKGROUND` for none. Masked and blended triangles are not looked at.
        """
        grid = sample_grid(camera)._replace(
            column_a=np.ascontiguousarray(a, np.float64),
            row_b=np.ascontiguousarray(b, np.float64),
            scattered=True,
        )
        triangle, depth = np.empty(len(a), np.int32), np.empty(len(a))
        if len(a) and self._cast(grid, triangle, depth):
            pending = np.flatnonzero(triangle == PENDING)
            triangle[pending] = BACKGROUND
            by_a = pending[np.argsort(grid.column_a[pending], kind="stable")]
            ray_kernels.settle_points(self._solid, self._mesh, grid, by_a, triangle, depth)
        return triangle

    def along(self, origins: Float64, directions: Float64) -> Int32:
        """The opaque triangle that any ray meets first, from its origin on: (k,) int32, as the
        ray library sees it in float32, `BACKGROUND` for none. Both sides are met, at any
        distance. `origins`, `directions`: (k, 3) float64.
        """
        result = np.full(len(origins), BACKGROUND, np.int32)
        if not len(self._solid):
            return result
        starts = range(0, len(origins), self.tile_samples)
        turn = count()

        def work(_: int) -> None:
            while (index := next(turn)) < len(starts):
                part = slice(starts[index], starts[index] + self.tile_samples)
                rays = np.concatenate([origins[part] - self.rebase, directions[part]], axis=1)
                met = self._nearest(rays.astype(np.float32))
                result[part] = np.where(met >= 0, self._solid[met], BACKGROUND)

        self._on_all(work, min(self._casting_workers, len(starts)))
        return result

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def _cast(self, grid: SampleGrid, triangle: Int32, depth: Float64) -> int:
        """Fill the buffers tile by tile; returns how many samples are pending."""
        if not len(self._solid):
            triangle.fill(BACKGROUND)
            depth.fill(np.inf)
            return 0
        start_depth, slack = self._start(grid)
        samples, tile = len(triangle), self.tile_samples
        starts = range(0, samples, tile)
        turn = count()

        def work(_: int) -> int:
            rays = np.empty((min(tile, samples), 6), np.float32)
            pending = 0
            # Whichever worker is free takes the next tile; each tile's answer is its own.
            while (index := next(turn)) < len(starts):
                start = starts[index]
                size = min(tile, samples - start)
                ray_kernels.fill_rays(rays, start, size, grid, self.rebase, start_depth)
                pending += ray_kernels.resolve(
                    self._nearest(rays[:size]),
                    start,
                    size,
                    grid,
                    self._mesh,
                    self._solid,
                    slack,
                    triangle,
                    depth,
                )
            return pending

        return sum(self._on_all(work, min(self._casting_workers, len(starts))))

    @property
    def _casting_workers(self) -> int:
        return self._workers

    def _start(self, grid: SampleGrid) -> tuple[float, float]:
        """The view depth at which rays start, and how far off the library's depths may be.

        Rays start on the near plane or where the scene's box begins, whichever is further,
        less the slack: an origin far from the scene would round by more than the scene's own
        coordinates do.
        """
        low, high = self.scene.bounds
        corners = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
        nearest = float(((corners - grid.axes[0]) @ grid.axes[4]).min())
        depth = max(grid.near, nearest)
        side = abs(grid.axes[2]) * np.abs(grid.column_a).max()
        side += abs(grid.axes[3]) * np.abs(grid.row_b).max()
        centre = np.abs(grid.axes[0] - self.rebase + depth * grid.axes[1])
        spread = depth if grid.perspective else 1.0
        slack = DEPTH_SLACK * max(self._reach, float((centre + spread * side).max()))
        start = depth - slack
        return (max(start, 0.0) if grid.perspective else start), slack

    def _settle(self, grid: SampleGrid, triangle: Int32, depth: Float64) -> None:
        """Decide the pending samples in float64, against all opaque triangles."""
        mark = triangle == PENDING
        triangle[mark] = BACKGROUND
        rows, columns = np.divmod(np.flatnonzero(mark), len(grid.column_a))
        window = (int(columns.min()), int(columns.max()) + 1, int(rows[0]), int(rows[-1]) + 1)
        layers = _layers(triangle, depth, mark)
        self._splat(OWN, self._solid, grid, window, lambda: layers)

    def _blend(
        self, grid: SampleGrid, triangle: Int32, depth: Float64, undecided: NDArray[np.bool_]
    ) -> BlendVisibility:
        stamp = np.full(len(triangle), -1, np.int32)
        objects = self.scene.object_count
        bands = self._splat(
            BLEND,
            self._blended,
            grid,
            _whole(grid),
            lambda: _layers(triangle, depth, undecided, stamp, objects),
        )
        pixels = np.sum([band.pixels for band in bands], axis=0)
        seen = np.flatnonzero(pixels)
        # The nearest sample of each object; of equal ones the first, whatever the bands.
        depths = np.stack([band.nearest_depth[seen] for band in bands])
        triangles = np.stack([band.nearest_triangle[seen] for band in bands])
        at = np.stack([band.nearest_sample[seen] for band in bands])
        best = np.lexsort((at, triangles, depths), axis=0)[0], np.arange(len(seen))
        return BlendVisibility(
            seen.astype(np.int32), pixels[seen], at[best], triangles[best], depths[best]
        )

    def _splat(
        self,
        mode: int,
        which: Int32,
        grid: SampleGrid,
        window: tuple[int, int, int, int],
        make_layers: Callable[[], Layers],
    ) -> list[Layers]:
        """`ray_kernels.splat` on all cores, a band of rows each; the layers of each band."""
        x0, x1, y0, y1 = window
        bands = min(self._workers, y1 - y0)
        edges = [y0 + (y1 - y0) * band // bands for band in range(bands + 1)]

        def work(band: int) -> Layers:
            layers = make_layers()
            rows = (x0, x1, edges[band], edges[band + 1])
            ray_kernels.splat(mode, which, self._mesh, grid, rows, layers)
            return layers

        return self._on_all(work, bands)

    def _on_all(self, work: Callable[[int], T], workers: int) -> list[T]:
        if self._pool is None or workers == 1:
            return [work(index) for index in range(workers)]
        return list(self._pool.map(work, range(workers)))


def choose_rebase(scene: Scene) -> Float64:
    """(3,) float64: a translation that brings a far-away scene to the origin.

    Each component is zero unless the scene's core is far out along that axis; then a multiple
    of a power of two no less than the core's size, near its centre. Such a multiple is a
    multiple of the far vertices' last bits too, so their differences from it are float32.
    """
    low, high = scene.core_bounds
    size = float((high - low).max())
    if size == 0.0:
        return np.zeros(3)
    centre = (low + high) / 2.0
    # 2^ceil(log2 size), exactly.
    step = 2.0 ** int(np.frexp(size)[1])
    return np.where(np.abs(centre) > REBASE_DISTANCE * size, np.rint(centre / step) * step, 0.0)


def _is_exact(vertices: Float32, local: Float32, rebase: Float64) -> bool:
    """Whether local + rebase is each vertex with no rounding (either way round)."""
    moved = local.astype(np.float64)
    same = np.array_equal(moved + rebase, vertices)
    return bool(same and np.array_equal(moved, vertices.astype(np.float64) - rebase))


def sample_grid(camera: Camera) -> SampleGrid:
    """The camera's samples as the compiled loops read them."""
    basis = np.stack([camera.forward, camera.right_step, camera.up_step])
    axes = np.concatenate([camera.eye[None], basis, np.linalg.inv(basis.T)])
    return SampleGrid(
        np.ascontiguousarray(axes),
        camera.is_perspective,
        float(camera.near),
        float(camera.far),
        camera.column_a,
        camera.row_b,
    )


def _whole(grid: SampleGrid) -> tuple[int, int, int, int]:
    return 0, len(grid.column_a), 0, len(grid.row_b)


def _of_alpha(scene: Scene, alpha: Alpha) -> Int32:
    return np.flatnonzero(scene.alpha == alpha).astype(np.int32)


def _layers(
    triangle: Int32,
    depth: Float64,
    mark: NDArray[np.bool_],
    stamp: Int32 | None = None,
    objects: int = 0,
) -> Layers:
    return Layers(
        triangle,
        depth,
        mark,
        np.zeros(0, np.int32) if stamp is None else stamp,
        np.zeros(objects, np.int64),
        np.zeros(objects, np.int64),
        np.zeros(objects, np.int32),
        np.full(objects, np.inf),
    )
