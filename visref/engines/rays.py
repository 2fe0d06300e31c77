"""What every ray engine shares: a float32 ray library finds, float64 decides what counts.

For each camera, tile by tile over all cores: rays are made in float64 and rounded once, the
library names the nearest triangle, and `ray_kernels.resolve` computes its view depth in
float64 and asks whether it counts. What is kept is the owner: its depth is computed again where
somebody looks at it. The few samples whose hit does not count but may hide one that does, the
masked triangles and the blended layers are left to `visref.engines.deciding`; nothing is recast, so
nothing behind a hit is lost.

Numeric policy: owners are the library's, good to its float32 rounding, so a sample within that
of an edge, or of a crossing of two surfaces, may go to a neighbour. Depths, near, far and sides
are float64. To keep float32 rounding small, the scene is moved so that it lies about the
origin, and rays start just before the scene or the near plane, however far the eye is. To keep
within float32's exponents it is scaled by a power of two, which rounds nothing, and known samples
tell whether that was enough.

In a scene that moves, what stands still is built once, and each pose builds the rest
(`visref.engines.in_motion`). How the scene is moved and scaled hangs on the pose alone, so that a
frame's truth does not depend on the frames cast before it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from itertools import groupby

import numpy as np

from visref.camera import Camera
from visref.engines import ray_kernels, splat_kernels
from visref.engines.base import TruthEngine
from visref.engines.crew import Crew
from visref.engines.deciding import Deciding, View, of_alpha
from visref.engines.grids import sample_grid
from visref.engines.in_motion import (
    Parts,
    Places,
    local_vertices,
    own_corners,
    place_corners,
    reach,
    scale_of,
)
from visref.engines.known_samples import (
    DEPTH_ROUNDING,
    PER_OCTAVE_IN_VIEW,
    known_samples,
    misses,
    of_each_size,
    points_in_view,
)
from visref.engines.lending import Lender
from visref.engines.ray_kernels import PENDING, SampleGrid, Triangles
from visref.errors import InputError
from visref.placing import origin_of, somewhere
from visref.scene import OTHERS_MOVE, Alpha, Float32, Float64, Int32, Int64, Scene, same_moving
from visref.threads import available_threads
from visref.visibility import BACKGROUND, FrameTruth

# A view depth, and how far off depths may be: see `RayEngine._start`.
Start = tuple[float, float]

# How far the library's hit may be off in depth, relative to the largest local coordinate: some
# 16 roundings (2^-24) of vertex less origin, which is at most 2 sqrt(3) of that coordinate,
# come to 2^-18.2. Rays start this much early; hits that this lets in are sorted out in float64.
DEPTH_SLACK = 2.0**-18

# An engine that gets known samples of one in so many triangles of some size wrong does not see
# such triangles.
SIGHT = 8


class RayEngine(TruthEngine):
    """A truth engine over a ray library; subclasses say how rays are cast.

    `rebase`: (3,) float64, what is subtracted from the scene before it becomes float32 again;
    `rebase_exact` says that no vertex was rounded by it, in any pose so far. `scale`: a power of
    two by which the rest is multiplied, so that the greatest coordinate that the library gets of
    what stands still is between 1/2 and 1: it multiplies lengths, and ignores what lies beyond
    some 1e18.

    Raises InputError where the library does not see what it was given: known samples of many of the
    triangles of some size (`known_samples`).
    """

    ahead = True

    # Samples in a tile: rays and answers of one tile stay in a core's cache.
    tile_samples = 1 << 15

    def __init__(self, scene: Scene, *, threads: int | None = None) -> None:
        super().__init__(scene, threads=threads)
        self._unseen, self._asked = np.zeros(0, np.int32), 0
        self._workers = threads or available_threads()
        moving = scene.moving if scene.moving is not None and scene.moving.any() else None
        self._solid = of_alpha(scene, Alpha.OPAQUE)
        if scene.absent is not None:
            ever = ~scene.absent if moving is None else ~scene.absent | moving
            self._solid = self._solid[ever[scene.object_of_triangle[self._solid]]]
        self._mesh = Triangles(
            scene.vertices, scene.triangles, scene.one_sided, scene.object_of_triangle
        )
        self._memory, self._crew = Lender(), Crew(self._workers)
        self._deciding = Deciding(scene, self._solid, self._crew, self._memory)
        self.rebase_exact = True
        self._parts: Parts | None = None
        if moving is not None:
            self._parts = Parts(scene, moving, self._solid)
            # Of what stands still: the greatest coordinate, and the scale with which it was built.
            self._still_reach, self._still_scale = 0.0, 0.0
            self.rebase = np.full(3, np.nan)
            self._place(self._parts)
            return
        self.rebase = origin_of(somewhere(scene.object_bounds))
        local, self.scale, self.rebase_exact = local_vertices(scene.vertices, self.rebase)
        self._reach = float(np.abs(local).max(initial=0.0)) / self.scale
        if len(self._solid):
            all_solid = len(self._solid) == len(scene.triangles)
            triangles = scene.triangles if all_solid else scene.triangles[self._solid]
            self._build(local, triangles)
            self._check_sight(local, triangles, np.arange(len(triangles), dtype=np.int32))

    @abstractmethod
    def _build(self, vertices: Float32, triangles: Int32) -> None:
        """Meet the opaque triangles that stand still: local vertices (v, 3) and triangles (t, 3).
        Again where another translation or scale is taken."""

    @abstractmethod
    def _build_moving(self, vertices: Float32, triangles: Int32, places: Places) -> None:
        """Meet those that move, as they are now, in place of what they were: called after each
        pose where something opaque moves. From then on, `_nearest` answers in `places`, for
        which see `nearer`."""

    @abstractmethod
    def _nearest(self, rays: Float32) -> Int32:
        """The place in `_solid` of the nearest triangle along each ray, -1 for none.

        `rays`: (n, 6), origins and directions. Hits count from parameter 0 on, closed.
        """

    def pose(self, scene: Scene) -> None:
        if self._parts is None or not same_moving(self.scene, scene):
            raise ValueError(OTHERS_MOVE)
        self.scene = scene
        self._mesh = self._mesh._replace(vertices=scene.vertices, triangles=scene.triangles)
        self.__dict__.pop("_picked", None)
        self._place(self._parts)

    def _place(self, parts: Parts) -> None:
        """Let the library see the scene of this moment."""
        scene, solid = self.scene, self._solid
        parts.meet(scene)
        rebase = parts.origin()
        if not np.array_equal(rebase, self.rebase):
            self.rebase, self._still_scale = rebase, 0.0
            self._still_reach = reach(*self._mesh[:2], solid[parts.still], rebase)
        moving = solid[parts.there]
        outer = reach(*self._mesh[:2], moving, rebase)
        self.scale = scale_of(self._still_reach, outer)
        self._reach = max(self._still_reach, outer)
        built: list[tuple[Float32, Int32, Int32]] = []
        if self._still_scale != self.scale and len(solid):
            self._still_scale = self.scale
            vertices, triangles = parts.standing(scene)
            local, _, exact = local_vertices(vertices, rebase, self.scale)
            self.rebase_exact &= exact
            self._build(local, triangles)
            built.append((local, triangles, parts.still))
        if len(parts.movable):
            corners, exact = self._corners(moving)
            self.rebase_exact &= exact
            own = own_corners(len(moving))
            self._build_moving(corners, own, (parts.still, parts.there))
            built.append((corners, own, parts.there))
        for part in built:
            self._check_sight(*part)

    def _corners(self, which: Int32) -> tuple[Float32, bool]:
        """Local corners of some triangles, (3 k, 3), and whether no rounding came of it."""
        corners = np.empty((3 * len(which), 3), np.float32)
        mesh = self._mesh
        exact = place_corners(
            mesh.vertices, mesh.triangles, which, self.rebase, self.scale, corners
        )
        return corners, bool(exact)

    def _check_sight(self, vertices: Float32, triangles: Int32, places: Int32) -> None:
        """Raise InputError if the library, as built, gets known samples of a share of the triangles
        of some size wrong, `1 / SIGHT`; fewer are kept for `unseen`. Local triangles, (t, 3), at
        `places`, (t,), in `_solid`."""
        known = known_samples(vertices, triangles)
        answer = self._nearest(known.rays)
        known = known._replace(primitive=places[known.primitive])
        # All that is asked for or met, in corners of its own.
        some = np.unique(np.concatenate([known.primitive, answer[answer >= 0]]))
        asked = known._replace(primitive=np.searchsorted(some, known.primitive).astype(np.int32))
        met = np.where(answer >= 0, np.searchsorted(some, answer), BACKGROUND).astype(np.int32)
        wrong = misses(asked, met, self._corners(self._solid[some])[0], own_corners(len(some)))
        self._asked += len(known.primitive)
        if not len(wrong):
            return
        asked_of = self._solid[known.primitive]
        corners = self.scene.vertices[self.scene.triangles[asked_of]].astype(np.float64)
        size = np.ptp(corners, axis=1).max(axis=1)
        octave = np.frexp(size)[1]
        for one in np.unique(octave[wrong]):
            lost = wrong[octave[wrong] == one]
            of_size, missed = (len(np.unique(asked_of[at])) for at in (octave == one, lost))
            # A lone sliver may be at the limit of what float32 tells apart; a size is not.
            if SIGHT * missed < of_size or (missed == 1 and len(lost) < np.sum(octave == one)):
                continue
            first = int(asked_of[lost[0]])
            raise InputError(
                f"the engine '{self.name}' does not see all of it: it gets known samples wrong of "
                f"{missed} of {of_size} triangles of size {size[lost[0]]:.3g} "
                f"in a scene that reaches to {self._reach:.3g}",
                source=self.scene.source,
                place=f"object '{self.scene.names[self.scene.object_of_triangle[first]]}'",
                fix="use the engine 'exact'; float32 cannot hold such different sizes at once",
            )
        self._unseen = np.concatenate([self._unseen, asked_of[wrong]])

    @property
    def unseen(self) -> tuple[Int32, int]:
        return self._unseen, self._asked

    def known_wrong(self, camera: Camera) -> tuple[Int32, int]:
        """Which triangles a view shows by a pixel or more around their centres while its ray there
        meets nothing, or only what lies behind: (k,) int32; and how many were asked for."""
        if not len(self._solid) or camera.clip_plane is not None:
            # What a plane cuts away is known to nobody here.
            return np.zeros(0, np.int32), 0
        camera = camera.relative_to(self.scene.origin)
        corners = self.scene.vertices[self.scene.triangles[self._picked]].astype(np.float64)
        index, a, b, depth = points_in_view(corners, camera)
        grid = sample_grid(camera)._replace(column_a=a, row_b=b, scattered=True)
        if not len(index):
            return np.zeros(0, np.int32), 0
        rays = np.empty((len(index), 6), np.float32)
        start = self._start(grid)[0]
        ray_kernels.fill_rays(rays, 0, len(index), grid, self.rebase, self.scale, start)
        answer = self._nearest(rays)
        met = np.where(answer >= 0, self._solid[answer], BACKGROUND)
        least = ray_kernels.least_depths(met, self._mesh, grid)
        away = np.abs(corners[index] - camera.eye).max(axis=(1, 2))
        wrong = (met != self._picked[index]) & (least > depth + DEPTH_ROUNDING * away)
        return self._picked[index[wrong]], len(index)

    def frame(self, camera: Camera) -> FrameTruth:
        return self._alike([camera.relative_to(self.scene.origin)])[0]

    def frames(self, cameras: Sequence[Camera]) -> list[FrameTruth]:
        if type(self).frame is not RayEngine.frame:
            # A subclass has its own way to cast a frame.
            return super().frames(cameras)
        placed = [camera.relative_to(self.scene.origin) for camera in cameras]
        alike = groupby(placed, key=lambda camera: (camera.width, camera.height))
        return [truth for _, some in alike for truth in self._alike(list(some))]

    def _alike(self, cameras: Sequence[Camera]) -> list[FrameTruth]:
        """Of cameras of one size, which are cast together."""
        samples = cameras[0].samples
        triangles = self._memory.lend(len(cameras) * samples).reshape(len(cameras), samples)
        grids = [sample_grid(camera) for camera in cameras]
        pending = self._cast(grids, triangles)
        return [
            self._deciding.truth(
                View(self.scene, camera, grid, self._mesh, triangle), self.name, pending=count > 0
            )
            for camera, grid, triangle, count in zip(
                cameras, grids, triangles, pending, strict=True
            )
        ]

    def probe(self, camera: Camera, a: Float64, b: Float64) -> Int32:
        """Who is seen at any points of the continuous image, as `frame` sees its samples.

        `a`, `b`: (k,) float64 each, the points' coordinates as `visref.camera` defines them
        (need not be those of a sample, or within the image). Returns (k,) int32, the nearest
        opaque triangle within near and far, one-sided ones from their front only,
        `BACKGROUND` for none. Masked and blended triangles are not looked at.
        """
        camera = camera.relative_to(self.scene.origin)
        grid = sample_grid(camera)._replace(
            column_a=np.ascontiguousarray(a, np.float64),
            row_b=np.ascontiguousarray(b, np.float64),
            scattered=True,
        )
        triangle = np.empty(len(a), np.int32)
        if len(a) and self._cast([grid], triangle[None])[0]:
            pending = np.flatnonzero(triangle == PENDING)
            triangle[pending] = BACKGROUND
            depth = np.full(len(a), np.inf)
            by_a = pending[np.argsort(grid.column_a[pending], kind="stable")]
            splat_kernels.settle_points(self._solid, self._mesh, grid, by_a, triangle, depth)
        return triangle

    def along(self, origins: Float64, directions: Float64) -> Int32:
        """The opaque triangle that any ray meets first, from its origin on: (k,) int32, as the
        ray library sees it in float32, `BACKGROUND` for none. Both sides are met, at any
        distance. `origins`, `directions`: (k, 3) float64.
        """
        result = np.full(len(origins), BACKGROUND, np.int32)
        if not len(self._solid):
            return result

        def work(start: int) -> None:
            part = slice(start, start + self.tile_samples)
            starts_at = (origins[part] - self.rebase) * self.scale
            rays = np.concatenate([starts_at, _about_one(directions[part])], axis=1)
            met = self._nearest(rays.astype(np.float32))
            result[part] = np.where(met >= 0, self._solid[met], BACKGROUND)

        self._crew.by_turns(work, range(0, len(origins), self.tile_samples), self._casting_workers)
        return result

    def close(self) -> None:
        self._crew.close()

    def _cast(self, grids: Sequence[SampleGrid], triangle: Int32) -> Int64:
        """Fill in the owners of views alike in size, (v, samples); returns how many samples of each
        are pending, (v,)."""
        if not len(self._solid):
            triangle.fill(BACKGROUND)
            return np.zeros(len(grids), np.int64)
        return self._cast_all(grids, [self._start(grid) for grid in grids], triangle)

    def _cast_all(
        self, grids: Sequence[SampleGrid], starts: Sequence[Start], triangle: Int32
    ) -> Int64:
        """As `_cast`, where there is something to meet. `starts`: by view, see `_start`."""
        each = zip(grids, starts, triangle, strict=True)
        return np.array([self._cast_one(*one) for one in each], np.int64)

    def _cast_one(self, grid: SampleGrid, start: Start, triangle: Int32) -> int:
        start_depth, slack = start
        samples, tile = len(triangle), self.tile_samples

        def work(start: int) -> int:
            size = min(tile, samples - start)
            rays = np.empty((size, 6), np.float32)
            ray_kernels.fill_rays(rays, start, size, grid, self.rebase, self.scale, start_depth)
            met = self._nearest(rays)
            pending: int = ray_kernels.resolve(
                met, start, size, grid, self._mesh, self._solid, slack, triangle
            )
            return pending

        return sum(self._crew.by_turns(work, range(0, samples, tile), self._casting_workers))

    @cached_property
    def _picked(self) -> Int32:
        """The opaque triangles that `known_wrong` asks for, (k,) int32 ids."""
        triangles = self.scene.triangles[self._solid]
        chosen = of_each_size(self.scene.vertices, triangles, PER_OCTAVE_IN_VIEW)
        picked: Int32 = self._solid[chosen]
        return picked

    @property
    def _casting_workers(self) -> int:
        return self._workers

    def _start(self, grid: SampleGrid) -> Start:
        """The view depth at which rays start, and how far off the library's depths may be.

        Rays start on the near plane or where the scene's box begins, whichever is further,
        less the slack: an origin far from the scene would round by more than the scene's own
        coordinates do.
        """
        low, high = self.scene.bounds if self._parts is None else self._parts.bounds()
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


def _about_one(directions: Float64) -> Float64:
    """Each row of (k, 3) times a power of two, its greatest component from 1/2 to 1."""
    exponent = np.frexp(np.abs(directions).max(axis=1))[1]
    scaled: Float64 = np.ldexp(directions, -exponent[:, None])
    return scaled
