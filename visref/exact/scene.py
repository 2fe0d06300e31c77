"""Exact visibility of a scene: who owns which samples, every tie, nothing assumed.

The float64 rasteriser decides what its bounds can; the samples it leaves open come with every
triangle that may still own them, and are settled in exact integers. Triangles in exactly the
same plane are at the same depth everywhere, so a wall of duplicates costs a look at each
triangle's plane (kept from frame to frame), not a decision per sample.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.exact import raster, screen
from visref.exact.clusters import CLUSTER, Clusters
from visref.exact.contests import Contest, crown, group, level_groups
from visref.exact.depths import depths
from visref.exact.filters import View, view_of
from visref.exact.layers import blended, masked
from visref.exact.planes import Planes
from visref.exact.rational import ExactFrame
from visref.scene import OTHERS_MOVE, Alpha, Float32, Float64, Int32, Int64, Scene, same_moving
from visref.threads import available_threads
from visref.visibility import (
    BACKGROUND,
    BlendVisibility,
    Doubt,
    FrameTruth,
    Ties,
    VisibilityBuffer,
)

Bool = NDArray[np.bool_]
Part = TypeVar("Part")

# Work is cut into this many parts whatever the number of threads, so that no array depends on it.
PARTS = 32
LEAST_CLUSTERS = 16
# Contenders that a part has room for at first: a few tiles full.
ROOM = 1 << 14
# The side of the squares in which depths are looked up.
SQUARE = 16


@dataclass(frozen=True, eq=False)
class Owners:
    """Who owns some samples, exactly.

    Sample i is owned by `triangles[offsets[i]:offsets[i + 1]]`: every triangle at exactly the
    nearest depth, ascending ids, none where nothing is hit. `offsets`: (k + 1,) int64,
    `triangles`: int32, `depth`: (k,) float64, the exact view depth rounded to nearest, inf where
    nothing is hit. `rational`: how many decisions took exact arithmetic.
    """

    offsets: Int64
    triangles: Int32
    depth: Float64
    rational: int


class ExactScene:
    """A scene made ready for exact decisions.

    `threads` None means all cores; the answer is the same for any number.
    """

    def __init__(self, scene: Scene, *, threads: int | None = None) -> None:
        self.scene = scene
        self._threads = threads or available_threads()
        self._clusters = Clusters(scene)
        self._planes = Planes(scene)
        self._tile_order: tuple[tuple[int, int], Int64] = (0, 0), np.zeros(0, np.int64)

    @property
    def order(self) -> Int32:
        """(k,) int32, the triangles that are there, in the order of their clusters."""
        return self._clusters.order

    @property
    def corners(self) -> Float32:
        """(k, 9) float32, their corners."""
        return self._clusters.corners

    @property
    def one_sided(self) -> Bool:
        """(k,) bool, `Scene.one_sided` of each."""
        return self._clusters.one_sided

    def pose(self, scene: Scene) -> None:
        """Follow the scene to another moment: what `scene.moving` names may have moved, come or
        gone. The answers are those of an `ExactScene` made of it. Raises ValueError where other
        objects move than in the scene that this was made of."""
        if not same_moving(self.scene, scene):
            raise ValueError(OTHERS_MOVE)
        self.scene = scene
        self._planes.pose(scene, self._clusters.movable, self._clusters.pose(scene))

    def decide(self, camera: Camera, samples: Int64, *, include: Bool | None = None) -> Owners:
        """The owners of some samples among the opaque triangles.

        `samples`: (k,) flat indices y * width + x, any order. `include`: (t,) bool, the only
        triangles that exist; None means all.
        """
        camera = camera.relative_to(self.scene.origin)
        samples = np.asarray(samples, np.int64)
        ours, place = np.unique(samples, return_inverse=True)
        wanted = np.zeros((camera.height, camera.width), np.bool_)
        wanted.reshape(-1)[ours] = True
        owner, at, triangle, rational, _ = self._owners(camera, wanted, include)
        # Owners first, then the further triangles of ties: sorted by sample, then triangle.
        first = owner.reshape(-1)[ours]
        owned = np.flatnonzero(first != BACKGROUND)
        index = np.concatenate([owned, np.searchsorted(ours, at)])
        every = np.concatenate([first[owned], triangle])
        order = np.lexsort((every, index))
        index, every = index[order], every[order]
        offsets = np.searchsorted(index, np.arange(len(ours) + 1))
        depth = self._depth(camera, ours, owner.reshape(-1))[ours]
        sizes = np.diff(offsets)[place]
        ends = np.cumsum(sizes)
        total = int(ends[-1]) if len(ends) else 0
        gather = np.arange(total) + np.repeat(offsets[place] - (ends - sizes), sizes)
        return Owners(
            offsets=np.concatenate([[0], ends]).astype(np.int64),
            triangles=every[gather].astype(np.int32),
            depth=depth[place],
            rational=rational,
        )

    def certify(self, camera: Camera, samples: Int64 | None = None) -> FrameTruth:
        """A whole frame in which every sample's owner is exact and every tie is listed.

        Of tied triangles the least id is in the visibility buffer. Depths are the exact ones
        rounded to nearest. With `samples`, (k,) flat indices, only what is said of those holds.
        """
        camera = camera.relative_to(self.scene.origin)
        wanted = np.zeros((0, 0), np.bool_)
        if samples is not None:
            wanted = np.zeros((camera.height, camera.width), np.bool_)
            wanted.reshape(-1)[samples] = True
        owner, at, triangle, _, bounds = self._owners(camera, wanted, None)
        flat = owner.reshape(-1)
        ties, doubt, blend = Ties(at, triangle), Doubt(), BlendVisibility()
        moved, veiled = np.zeros(0, np.int64), np.zeros(0, np.int32)
        if self.scene.has_mask:
            hits = self.before(camera, Alpha.MASK, flat, bounds, wanted, moved, closed=True)
            ties, doubt, moved = masked(self, camera, hits, flat, ties)
        if self.scene.has_blend:
            hits = self.before(camera, Alpha.BLEND, flat, bounds, wanted, moved, closed=False)
            blend, veiled = blended(self, camera, hits, doubt)
        where = self._in_tiles(camera) if samples is None else np.flatnonzero(wanted)
        depth = self._depth(camera, where, flat)
        return FrameTruth(
            camera=camera,
            engine="exact",
            buffer=VisibilityBuffer(owner, depth.reshape(owner.shape)),
            ties=ties,
            ties_complete=True,
            doubt=doubt,
            blend=blend,
            veiled=veiled,
        )

    def _owners(
        self, camera: Camera, wanted: Bool, include: Bool | None
    ) -> tuple[Int32, Int64, Int32, int, tuple[Float64, Float64]]:
        """Owners among the opaque: ((height, width) int32 ids, the further tied triangles as
        samples and ids sorted by both, exact decisions, bounds of the owners' keys)."""
        usable = self._clusters.alpha == Alpha.OPAQUE
        if include is not None:
            usable &= include[self.order]
        keep_bounds = self.scene.has_mask or self.scene.has_blend
        shape = (camera.height, camera.width) if keep_bounds else (0, 0)
        bounds = np.full(shape, -np.inf), np.full(shape, -np.inf)
        owner, contest = self._contend(camera, wanted, usable, bounds, collect=False)
        flat = owner.reshape(-1)
        if not len(contest.sample):
            return owner, contest.sample, contest.triangle, 0, bounds
        contest, rational = self._covering(camera, Contest(*group(*contest, flat, raster.COVERING)))
        if keep_bounds:
            bounds[1].reshape(-1)[contest.sample] = np.inf
        level = self._level(contest)
        if not level.all():
            nearest, exact = self._nearest(camera, contest.where(~level))
            rational += exact
            level[~level] = nearest
        further = crown(contest.sample, contest.triangle, level, flat)
        return owner, *further, rational, bounds

    def _contend(
        self,
        camera: Camera,
        wanted: Bool,
        usable: Bool,
        bounds: tuple[Float64, Float64],
        *,
        collect: bool,
    ) -> tuple[Int32, Contest]:
        """Run the rasteriser: certain owners (triangle ids), and what it could not decide.

        `usable`: (k,) bool in cluster order.
        """
        view = view_of(camera)
        found, boxes, keys = self.project(view, usable, wanted, 0.0, whole=True)
        columns = -(-camera.width // screen.TILE)
        rows = -(-camera.height // screen.TILE)
        tiles = np.ones(rows * columns, np.bool_)
        if wanted.size:
            y, x = np.nonzero(wanted)
            tiles[:] = False
            tiles[y // screen.TILE * columns + x // screen.TILE] = True
        bin_offsets, bin_entries = screen.bin_boxes(boxes, tiles, columns)
        owner = np.full((camera.height, camera.width), BACKGROUND, np.int32)
        binned = screen.Binned(found, boxes, keys, bin_offsets, bin_entries, columns)
        rays = camera.column_a, camera.row_b
        triangles = raster.ClusteredTriangles(
            self.corners,
            self.one_sided,
            self.order,
            usable,
            self._clusters.offsets,
            self._clusters.bounds,
        )
        owned = raster.Owned(owner, *bounds)

        def fill(part: Int64) -> list[Contest]:
            room, parts = ROOM, []
            while len(part):
                out = raster.room_for(room)
                done, count = raster.rasterise(
                    part, view, rays, triangles, binned, wanted, collect, owned, out
                )
                parts.append(Contest(out.sample[:count], out.triangle[:count], out.known[:count]))
                part, room = part[done:], 4 * room
            return parts

        results = list(chain.from_iterable(self.in_parallel(fill, np.flatnonzero(tiles))))
        if len(results) == 1:
            return owner, results[0]
        if not results:
            return owner, Contest(
                np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0, np.uint8)
            )
        return owner, Contest(*(np.concatenate(x) for x in zip(*results, strict=True)))

    def project(
        self, view: View, usable: Bool, wanted: Bool, grow: float, *, whole: bool = False
    ) -> tuple[Int32, Int32, Float64]:
        """Triangles that may own a sample, nearest clusters first: place, box, key bounds, as
        `visref.exact.screen.Binned` has them. With `whole` clusters that are small on the screen
        are not looked into.

        `usable`: (t,) bool in cluster order. `wanted`: (height, width) bool, or (0, 0) for all
        samples. `grow`: pixels to widen the screen boxes by.
        """
        sums = screen.count_wanted(wanted) if wanted.size else np.zeros((0, 0), np.int64)
        nearest = np.empty(len(self._clusters.bounds))
        boxes_of = np.empty((len(nearest), 4), np.int32)
        screen.cluster_depths(self._clusters.bounds, view, grow, sums, nearest, boxes_of)
        if not whole:
            boxes_of = boxes_of[:0]
        order = np.argsort(nearest, kind="stable")
        order = order[: np.count_nonzero(nearest < np.inf)]

        def part_of(clusters: Int64) -> tuple[Int32, Int32, Float64]:
            room = len(clusters) * CLUSTER
            found = np.empty(room, np.int32)
            boxes = np.empty((room, 4), np.int32)
            keys = np.empty((room, 3))
            into = found, boxes, keys
            count = screen.project(
                clusters,
                self._clusters.offsets,
                self.corners,
                usable,
                view,
                grow,
                sums,
                nearest,
                boxes_of,
                into,
            )
            return found[:count], boxes[:count], keys[:count]

        parts = max(1, min(PARTS, len(order) // LEAST_CLUSTERS))
        results = self.in_parallel(part_of, order, parts) or [part_of(order)]
        found, boxes, keys = (np.concatenate(x) for x in zip(*results, strict=True))
        return found, boxes, keys

    def in_parallel(
        self, work: Callable[[Int64], Part], whole: Int64, parts: int = PARTS
    ) -> list[Part]:
        """The results of `work` on each part of `whole`, (k,) int64, in order; empty parts are left
        out."""
        pieces = [piece for piece in np.array_split(whole, parts) if len(piece)]
        if self._threads == 1 or len(pieces) < 2:
            return [work(piece) for piece in pieces]
        with ThreadPoolExecutor(self._threads) as pool:
            return list(pool.map(work, pieces))

    def _exact(self, camera: Camera, triangles: Int32) -> tuple[ExactFrame, Int64]:
        """The exact frame of some triangles, and the place of each in it."""
        unique, which = np.unique(triangles, return_inverse=True)
        corners = self.scene.vertices[self.scene.triangles[unique]]
        return ExactFrame(camera, corners, self.scene.one_sided[unique]), which

    def _covering(self, camera: Camera, contest: Contest) -> tuple[Contest, int]:
        """The contest without the pairs that do not cover, and how many needed exactness."""
        doubtful = np.flatnonzero(contest.state == raster.POSSIBLE)
        if not len(doubtful):
            return contest, 0
        exact, which = self._exact(camera, contest.triangle[doubtful])
        covers = np.ones(len(contest.sample), np.bool_)
        covers[doubtful] = exact.covers(which, contest.sample[doubtful])
        return contest.where(covers), len(doubtful)

    def _level(self, contest: Contest) -> Bool:
        """Which pairs of a contest of covering triangles stand at samples with one plane."""
        self._planes.find(contest.triangle)
        level: Bool = level_groups(contest.sample, contest.triangle, self._planes.of_triangle)
        return level

    def _nearest(self, camera: Camera, contest: Contest) -> tuple[Bool, int]:
        """Which pairs of a grouped contest of covering triangles are at their sample's least
        depth, and how many exact comparisons that took."""
        sample, triangle, rational = contest.sample, contest.triangle, 0
        starts = np.flatnonzero(np.append(True, sample[1:] != sample[:-1]))
        sizes = np.diff(np.append(starts, len(sample)))
        # Each sample's champion so far, against its next contender, all samples at once. A pair
        # is among the nearest if no later contender beat the champion it was level with.
        champion = triangle[starts].copy()
        generation = np.zeros(len(starts), np.int64)
        level = np.full(len(sample), -1, np.int64)
        level[starts] = 0
        for rank in range(1, int(sizes.max())):
            rivals = np.flatnonzero(sizes > rank)
            entry = starts[rivals] + rank
            result, exact = self._compare(camera, triangle[entry], champion[rivals], sample[entry])
            rational += exact
            nearer = result < 0
            generation[rivals[nearer]] += 1
            champion[rivals[nearer]] = triangle[entry[nearer]]
            level[entry[result <= 0]] = generation[rivals[result <= 0]]
        return level == np.repeat(generation, sizes), rational

    def _compare(
        self, camera: Camera, first: Int32, second: Int32, samples: Int64
    ) -> tuple[NDArray[np.int8], int]:
        """Exact order of depth of pairs that cover their samples; how many were not coplanar."""
        self._planes.find(np.concatenate([first, second]))
        result = np.zeros(len(first), np.int8)
        open_ = np.flatnonzero(self._planes.of_triangle[first] != self._planes.of_triangle[second])
        if len(open_):
            exact, which = self._exact(camera, np.concatenate([first[open_], second[open_]]))
            half = len(open_)
            result[open_] = exact.compare(which[:half], which[half:], samples[open_])
        return result, len(open_)

    def _depth(self, camera: Camera, samples: Int64, owner: Int32) -> Float64:
        """All samples' view depths, right at the given ones: the exact depth of the owner
        rounded to nearest, inf for none."""
        view = view_of(camera)
        result = np.empty(camera.samples)
        scene, a, b = self.scene, camera.column_a, camera.row_b

        def part_of(part: Int64) -> Int64:
            torn: Int64 = depths(part, owner, scene.vertices, scene.triangles, view, a, b, result)
            return torn

        torn = self.in_parallel(part_of, samples)
        left = np.concatenate([np.zeros(0, np.int64), *torn])
        if len(left):
            exact, which = self._exact(camera, owner[left])
            result[left] = exact.depth(which, left)
        return result

    def _in_tiles(self, camera: Camera) -> Int64:
        """All samples, square by square, so that neighbours in the list share their triangles."""
        size = camera.height, camera.width
        if self._tile_order[0] != size:
            samples, side = np.arange(camera.samples).reshape(size), SQUARE
            strips = [samples[y : y + side] for y in range(0, camera.height, side)]
            tiles = [s[:, x : x + side].ravel() for s in strips for x in range(0, size[1], side)]
            self._tile_order = size, np.concatenate(tiles)
        return self._tile_order[1]

    def before(
        self,
        camera: Camera,
        alpha: Alpha,
        owner: Int32,
        bounds: tuple[Float64, Float64],
        wanted: Bool,
        moved: Int64,
        *,
        closed: bool,
    ) -> Contest:
        """Every hit of a triangle of this alpha that lies before its sample's owner, or with
        `closed` level with it too. `moved`: (k,) int64, the flat samples whose owner
        `bounds` do not speak of. `owner`: (samples,) int32 triangle ids. `wanted`: (height, width)
        bool, or (0, 0) for all samples. `bounds`: of the owners' keys, two
        of (height, width) float64, as `_owners` returns them."""
        usable = self._clusters.alpha == alpha
        _, contest = self._contend(camera, wanted, usable, bounds, collect=True)
        contest, _ = self._covering(camera, contest)
        known = np.ones(camera.samples, np.bool_)
        known[moved] = False
        open_ = (contest.state != raster.NEARER) | ~known[contest.sample]
        kept = np.ones(len(contest.sample), np.bool_)
        close = np.flatnonzero(open_ & (owner[contest.sample] != BACKGROUND))
        result = self.compare(
            camera, contest.triangle[close], owner[contest.sample[close]], contest.sample[close]
        )
        kept[close] = result <= 0 if closed else result < 0
        return contest.where(kept)

    def hits(self, camera: Camera, usable: Bool, wanted: Bool | None = None) -> Contest:
        """Every (sample, triangle) that a triangle of `usable`, (t,) bool, covers in the camera's
        range, whatever lies before it and whatever its material; of the samples `wanted`,
        (height, width) bool, None for all."""
        bounds = tuple(np.full((camera.height, camera.width), -np.inf) for _ in range(2))
        if wanted is None:
            wanted = np.zeros((0, 0), np.bool_)
        bounds_of = bounds[0], bounds[1]
        _, contest = self._contend(camera, wanted, usable[self.order], bounds_of, collect=True)
        return self._covering(camera, contest)[0]

    def compare(
        self, camera: Camera, first: Int32, second: Int32, samples: Int64
    ) -> NDArray[np.int8]:
        """(k,) int8: -1, 0 or 1 as the first triangle is nearer than, level with or farther than
        the second, exactly; each pair covers its sample."""
        return self._compare(camera, first, second, samples)[0]

    def front(self, camera: Camera, contest: Contest, owner: Int32) -> tuple[Int64, Int32]:
        """Let covering triangles contend with the owners so far: the least id of the nearest
        goes to `owner`, (samples,) int32, the further ones are returned, sorted by sample."""
        grouped = Contest(*group(*contest, owner, raster.COVERING))
        level = self._level(grouped)
        if not level.all():
            level[~level] = self._nearest(camera, grouped.where(~level))[0]
        further: tuple[Int64, Int32] = crown(grouped.sample, grouped.triangle, level, owner)
        return further

    def depth_by_layer(self, camera: Camera, sample: Int64, triangle: Int32) -> Float64:
        """The view depths, (k,) float64, of pairs of a sample, (k,) int64, and a triangle, (k,)
        int32: exact ones rounded to nearest."""
        depth = np.empty(len(sample))
        order = np.argsort(sample, kind="stable")
        first = np.searchsorted(sample[order], sample[order])
        layer = np.arange(len(order)) - first
        for number in range(int(layer.max(initial=-1)) + 1):
            pairs = order[layer == number]
            owner = np.full(camera.samples, BACKGROUND, np.int32)
            owner[sample[pairs]] = triangle[pairs]
            depth[pairs] = self._depth(camera, sample[pairs], owner)[sample[pairs]]
        return depth


def compare_depths(
    scene: Scene, camera: Camera, sample: int, triangle_a: int, triangle_b: int
) -> int:
    """-1, 0 or 1 as triangle a is nearer than, level with or farther than b along a sample's
    ray, exactly. Raises ValueError unless both cover the sample."""
    pair = np.array([triangle_a, triangle_b])
    corners = scene.vertices[scene.triangles[pair]]
    exact = ExactFrame(camera, corners, scene.one_sided[pair])
    at = np.array([sample, sample])
    if not exact.covers(np.array([0, 1]), at).all():
        raise ValueError("compare_depths needs two triangles that cover the sample")
    return int(exact.compare(np.array([0]), np.array([1]), at[:1])[0])
