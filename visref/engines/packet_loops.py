"""Compiled loops that cast rays through Embree a packet at a time.

Lanes in memory are those of Embree's `RTCRayHit8` and `RTCRayHit16`: one row of lanes for each
field. What a packet costs in the hierarchy grows with how far its rays part, so the samples of an
image go by blocks: 4 x 4 where there are sixteen lanes, 4 x 2 where there are eight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines.ray_kernels import (
    PENDING,
    SampleGrid,
    Triangles,
    cross,
    dot,
    minus,
    point,
)
from visref.engines.turns import take
from visref.scene import Float64, Int32
from visref.visibility import BACKGROUND

# Rows of a packet, in lanes of 32 bits: origin, tnear, direction, time, tfar, mask, id, flags,
# then the normal, u, v, the primitive's, the geometry's and the instance's ids (one or two words
# per level). The valid mask comes after them, with room to spare.
ORIGIN, TNEAR, DIRECTION, TIME, TFAR, MASK, ID, FLAGS = 0, 3, 4, 7, 8, 9, 10, 11
NORMAL, PRIMITIVE, GEOMETRY = 12, 17, 18
VALID = 32
ROWS = 34
# Bytes; what Embree asks of a packet of sixteen.
ALIGNMENT = 64
BLOCK_WIDTH = 4
# Rows of an image that a thread takes at a time: whole blocks.
TURN_ROWS = 16

# What float32 leaves no doubt about is not asked again in float64. Let u = 2^-24 and M the greatest
# coordinate before a ray's start (for a triangle's own, M = 1). Embree's tests of edges and its
# parameter are off by some 4 u M across and, on a plane that the ray meets at cosine c, 4 u M / c
# along the ray. The slack of `ray_kernels.resolve` is 18 u M and more (`rays.DEPTH_SLACK`). So
# wherever c is 1/4 or more, the plane's depth is within the slack of the triangle's own, and the
# parameter within it of that depth; two slacks are kept from near and far.
#
# That cosine is computed with Embree's normal. A normal is a sum of products of two edges, off by
# 7 u L^2 at most where L is the longest edge: 2^-11 of its length if that is at least SHAPE L^2.
# Vertices were rounded when they were moved, which is another 7 u L, 2^-3.2 of its length if that
# is at least APART L. Less both, a cosine of STEEP is 1/4.
STEEP, SHAPE, APART = 3.0 / 8.0, 2.0**-10, 2.0**-18

# The sides of a triangle on which a hit counts, as bits; corners are counter-clockwise in front.
FRONT, BACK = 1, 2


class Packet(NamedTuple):
    """The same memory as float32, as int32, (ROWS, lanes) each, and four at a time as what has as
    many bytes, (ROWS, lanes / 4) complex128; and its address. `lanes` has one entry per lane: how
    many there are is then known where a loop is compiled."""

    words: NDArray[np.float32]
    ids: NDArray[np.int32]
    fours: NDArray[np.complex128]
    address: int
    lanes: tuple[int, ...]


def new_packet(lanes: int) -> Packet:
    """Of rays from parameter 0 on. It holds for one thread, and as long as its arrays."""
    memory = np.zeros(ROWS * lanes + ALIGNMENT // 4, np.float32)
    start = -(memory.ctypes.data // 4) % (ALIGNMENT // 4)
    words = memory[start : start + ROWS * lanes].reshape(ROWS, lanes)
    ids = words.view(np.int32)
    ids[MASK] = ids[VALID] = -1
    return Packet(words, ids, words.view(np.complex128), words.ctypes.data, (0,) * lanes)


class Scratch(NamedTuple):
    """What a thread needs of its own while it casts: (lanes,) each, but for `rays`, (6, rows, w)
    float32, the rays of a row of blocks, origins and directions, by axis, row and column, w the
    width made up to whole blocks; `fours`, the same as `Packet.fours`; and `sides`, (3, lanes)
    float64, a R + b U by axis."""

    first: NDArray[np.float32]
    places: NDArray[np.int32]
    owners: NDArray[np.int32]
    sure: NDArray[np.uint8]
    rays: NDArray[np.float32]
    fours: NDArray[np.complex128]
    sides: NDArray[np.float64]


def new_scratch(lanes: int, columns: int) -> Scratch:
    """For packets of so many lanes, and images so wide, in whole blocks."""
    rays = np.empty((6, lanes // BLOCK_WIDTH, columns), np.float32)
    places, owners = np.empty((2, lanes), np.int32)
    first, sure = np.empty(lanes, np.float32), np.empty(lanes, np.uint8)
    sides = np.empty((3, lanes))
    return Scratch(first, places, owners, sure, rays, rays.view(np.complex128), sides)


class Scenes(NamedTuple):
    """What to cast into: Embree's function, its arguments, a scene of what stands still and one of
    what moves (0 for none), addresses all but the first; and what a triangle of either is called,
    (t,) int32 and (m,) int32, read only where something moves."""

    intersect: Any
    arguments: int
    still: int
    moving: int
    still_place: NDArray[np.int32]
    moving_place: NDArray[np.int32]


class Aim(NamedTuple):
    """What is cast, beside the rows: see `ray_kernels.fill_rays` and `ray_kernels.resolve`. Several
    views of as many samples each, v of them.

    `width`, `height`: samples of a view. `axes`: (v, 7, 3) float64, `near` and `far`: (v,) float64,
    `perspective`: (v,) bool, as of `SampleGrid`. `across`: (v, 3, w) float64, a R by axis and
    column, w the width made up to whole blocks; `up`: (v, 3, h), b U by row; what lies beyond the
    image is as at its edge. `start_depth` and `depth_slack`: (v,) float64. `reached`: (v, r, c)
    uint8, by block whether anything may be met there. `plain`: (p,) uint8, by place the sides on
    which the triangle counts, as bits; 0 where it is not `well_shaped`."""

    width: int
    height: int
    axes: NDArray[np.float64]
    near: NDArray[np.float64]
    far: NDArray[np.float64]
    perspective: NDArray[np.bool_]
    across: NDArray[np.float64]
    up: NDArray[np.float64]
    start_depth: NDArray[np.float64]
    depth_slack: NDArray[np.float64]
    reached: NDArray[np.uint8]
    origin: NDArray[np.float64]
    scale: float
    mesh: Triangles
    triangle_of_place: NDArray[np.int32]
    plain: NDArray[np.uint8]

    @classmethod
    def of(
        cls, lanes: int, grids: Sequence[SampleGrid], starts: Sequence[tuple[float, float]],
        reached: Sequence[NDArray[np.uint8]], origin: Float64, scale: float, mesh: Triangles,
        triangle_of_place: Int32, plain: NDArray[np.uint8],
    ) -> Aim:  # fmt: skip
        """At the samples of grids alike in size. `starts`: by view, the depth of a ray's start, and
        the slack; the rest as of the class."""
        across = [_padded(one.column_a, BLOCK_WIDTH) * one.axes[2][:, None] for one in grids]
        up = [_padded(one.row_b, lanes // BLOCK_WIDTH) * one.axes[3][:, None] for one in grids]
        start_depth, depth_slack = np.array(starts, np.float64).T.copy()
        return cls(
            len(grids[0].column_a), len(grids[0].row_b),
            np.stack([one.axes for one in grids]),
            np.array([one.near for one in grids]), np.array([one.far for one in grids]),
            np.array([one.perspective for one in grids]),
            np.stack(across), np.stack(up), start_depth, depth_slack, np.stack(reached),
            origin, scale, mesh, triangle_of_place, plain,
        )  # fmt: skip


def _padded(values: Float64, size: int) -> Float64:
    """Values made up to a multiple of `size` with the last of them."""
    more = -len(values) % size
    return np.concatenate([values, np.repeat(values[-1:], more)]) if more else values


@njit(inline="always")
def meet(scenes, packet, first, places):  # type: ignore[no-untyped-def]
    """Cast a packet whose origins and directions are there; its triangles go to `places`,
    (lanes,) int32, -1 for none. What moves is cast second, each ray no further than what it met
    first; of both at one distance, the lesser is given."""
    intersect, arguments, still, moving, still_place, moving_place = scenes
    words, ids, _, address, lanes = packet
    for lane in range(len(lanes)):
        words[TFAR, lane] = np.inf
        ids[GEOMETRY, lane] = -1
    valid = address + 4 * VALID * len(lanes)
    intersect(valid, still, address, arguments)
    if moving == 0:
        for lane in range(len(lanes)):
            met = ids[GEOMETRY, lane] != -1
            places[lane] = ids[PRIMITIVE, lane] if met else -1
        return
    for lane in range(len(lanes)):
        first[lane] = words[TFAR, lane]
        met = ids[GEOMETRY, lane] != -1
        places[lane] = still_place[ids[PRIMITIVE, lane]] if met else -1
        ids[GEOMETRY, lane] = -1
    intersect(valid, moving, address, arguments)
    for lane in range(len(lanes)):
        if ids[GEOMETRY, lane] != -1:
            other = moving_place[ids[PRIMITIVE, lane]]
            place = places[lane]
            if place < 0 or words[TFAR, lane] < first[lane] or other < place:
                places[lane] = other
            else:
                # The normal is the other's.
                words[TFAR, lane] = np.nan


@njit(makes_arrays=False)
def fill(rays, across, up, top, lens):  # type: ignore[no-untyped-def]
    """The rays of a row of blocks."""
    perspective, scale, start, eye, forward = lens
    for i in range(3):
        e, f = eye[i], forward[i]
        for row in range(rays.shape[1]):
            upward = up[i, top + row]
            if perspective:
                for x in range(across.shape[1]):
                    d = f + (across[i, x] + upward)
                    rays[i, row, x] = np.float32(scale * (e + start * d))
                    rays[3 + i, row, x] = np.float32(d)
            else:
                for x in range(across.shape[1]):
                    side = across[i, x] + upward
                    rays[i, row, x] = np.float32(scale * (e + (side + start * f)))
                    rays[3 + i, row, x] = np.float32(f)


@njit(makes_arrays=False)
def sift(lanes, words, sure, sure_from, sure_to):  # type: ignore[no-untyped-def]
    """Which rays met something steeply, within the range whatever was rounded? To `sure`, the
    side that they met, 0 for the others."""
    for lane in range(len(lanes)):
        # In float64, so that no product underflows.
        nx = np.float64(words[NORMAL, lane])
        ny = np.float64(words[NORMAL + 1, lane])
        nz = np.float64(words[NORMAL + 2, lane])
        dx = np.float64(words[DIRECTION, lane])
        dy = np.float64(words[DIRECTION + 1, lane])
        dz = np.float64(words[DIRECTION + 2, lane])
        t = np.float64(words[TFAR, lane])
        along = nx * dx + ny * dy + nz * dz
        least = STEEP * STEEP * (nx * nx + ny * ny + nz * nz) * (dx * dx + dy * dy + dz * dz)
        steep = (along * along >= least) & (t >= sure_from) & (t <= sure_to)
        side = FRONT if along < 0.0 else BACK
        sure[lane] = side if steep else 0


@njit(inline="always")
def decide(lanes, corners, two_sided, view, t, place, sides, places, owners):  # type: ignore[no-untyped-def]
    """Whose are the samples of a block whose nearest triangle is t, at `place`? Then these are
    done with, and nothing is left there in `places`."""
    perspective, eye, ahead, dual, near, far, slack = view
    v0, v1, v2 = corners
    n, p = cross(minus(v1, v0), minus(v2, v0)), minus(v0, eye)
    z0, z1, z2 = dot(p, dual), dot(minus(v1, eye), dual), dot(minus(v2, eye), dual)
    low, high = min(z0, z1, z2) - slack, max(z0, z1, z2) + slack
    above, below = dot(n, p), dot(n, ahead)
    for lane in range(len(lanes)):
        side = sides[0, lane], sides[1, lane], sides[2, lane]
        if perspective:
            toward = ahead[0] + side[0], ahead[1] + side[1], ahead[2] + side[2]
            numerator, denominator = above, dot(n, toward)
        else:
            numerator, denominator = dot(n, minus(p, side)), below
        z = numerator / denominator
        covers = (denominator < 0.0) | ((denominator > 0.0) & two_sided)
        true_hit = covers & (z >= low) & (z <= high)
        owner = BACKGROUND if true_hit & (z > far + slack) else PENDING
        owner = t if true_hit & (z >= near) & (z <= far) else owner
        own = places[lane] == place
        owners[lane] = owner if own else owners[lane]
        places[lane] = -1 if own else places[lane]


@njit(makes_arrays=False)
def nearest(
    scratch: Scratch,
    scenes: Scenes,
    packet: Packet,
    rays: NDArray[Any],
    places: NDArray[Any],
) -> None:
    """The nearest triangle along each ray, (n, 6) float32, into `places`, (n,) int32, -1 for
    none."""
    words, ids, lanes = packet.words, packet.ids, packet.lanes
    first, found = scratch.first, scratch.places
    for start in range(0, len(rays), len(lanes)):
        for lane in range(len(lanes)):
            ray = min(start + lane, len(rays) - 1)
            ids[VALID, lane] = -1 if start + lane < len(rays) else 0
            for axis in range(3):
                words[ORIGIN + axis, lane] = rays[ray, axis]
                words[DIRECTION + axis, lane] = rays[ray, 3 + axis]
        meet(scenes, packet, first, found)
        for lane in range(min(len(lanes), len(rays) - start)):
            places[start + lane] = found[lane]


@njit(error_model="numpy", makes_arrays=False)
def _cast_rows(scratch, scenes, packet, aim, number, rows, triangle):  # type: ignore[no-untyped-def]
    """Some rows of a view, from rows[0] to before rows[1]: see `cast`. To `triangle`, (samples,)
    int32; returns how many are `PENDING`."""
    words, ids, fours, _, lanes = packet
    block_rows = len(lanes) // BLOCK_WIDTH
    first, places, owners, sure, rays, ray_fours, sides = scratch
    mesh, triangle_of_place, plain = aim.mesh, aim.triangle_of_place, aim.plain
    vertices, triangles, one_sided = mesh.vertices, mesh.triangles, mesh.one_sided
    across, up, reached = aim.across[number], aim.up[number], aim.reached[number]
    perspective, width, m = aim.perspective[number], aim.width, aim.axes[number]
    near, far, origin, scale = aim.near[number], aim.far[number], aim.origin, aim.scale
    start, slack = aim.start_depth[number], aim.depth_slack[number]
    view = (
        perspective,
        (m[0, 0], m[0, 1], m[0, 2]),
        (m[1, 0], m[1, 1], m[1, 2]),
        (m[4, 0], m[4, 1], m[4, 2]),
        near,
        far,
        slack,
    )
    # Parameters between which a hit's depth is within the range, whatever was rounded.
    sure_from = scale * (near + 2.0 * slack - start)
    sure_to = scale * (far - 2.0 * slack - start)
    lens = (
        perspective, scale, start,
        (m[0, 0] - origin[0], m[0, 1] - origin[1], m[0, 2] - origin[2]), view[2],
    )  # fmt: skip
    pending = 0
    for top in range(rows[0], rows[1], block_rows):
        height = min(block_rows, rows[1] - top)
        blocks = rays.shape[2] // BLOCK_WIDTH
        begin, end = 0, blocks
        while begin < end and not reached[top // block_rows, begin]:
            begin += 1
        while end > begin and not reached[top // block_rows, end - 1]:
            end -= 1
        for row in range(height):
            start_at = (top + row) * width
            for x in range(min(begin * BLOCK_WIDTH, width)):
                triangle[start_at + x] = BACKGROUND
            for x in range(min(end * BLOCK_WIDTH, width), width):
                triangle[start_at + x] = BACKGROUND
        if begin == end:
            continue
        fill(rays, across, up, top, lens)
        for block in range(begin, end):
            left = block * BLOCK_WIDTH
            columns = min(BLOCK_WIDTH, width - left)
            if not reached[top // block_rows, block]:
                for row in range(height):
                    start_at = (top + row) * width + left
                    for column in range(columns):
                        triangle[start_at + column] = BACKGROUND
                continue
            full = height == block_rows and columns == BLOCK_WIDTH
            if not full:
                for lane in range(len(lanes)):
                    inside = lane % BLOCK_WIDTH < columns and lane // BLOCK_WIDTH < height
                    ids[VALID, lane] = -1 if inside else 0
            for i in range(3):
                for row in range(block_rows):
                    fours[ORIGIN + i, row] = ray_fours[i, row, block]
                    fours[DIRECTION + i, row] = ray_fours[3 + i, row, block]
            meet(scenes, packet, first, places)
            met, doubts = 0, 0
            for lane in range(len(lanes)):
                owners[lane] = BACKGROUND
                met += places[lane] >= 0
            if met:
                sift(lanes, words, sure, sure_from, sure_to)
                for lane in range(len(lanes)):
                    place = places[lane]
                    if place >= 0:
                        if sure[lane] & plain[place]:
                            owners[lane] = triangle_of_place[place]
                        else:
                            doubts += 1
            if doubts > 0:
                for i in range(3):
                    for lane in range(len(lanes)):
                        upward = up[i, top + lane // BLOCK_WIDTH]
                        sides[i, lane] = across[i, left + lane % BLOCK_WIDTH] + upward
                for lane in range(len(lanes)):
                    place = places[lane]
                    if place < 0 or sure[lane] & plain[place]:
                        continue
                    t = triangle_of_place[place]
                    corners = (
                        point(vertices, triangles[t, 0]),
                        point(vertices, triangles[t, 1]),
                        point(vertices, triangles[t, 2]),
                    )
                    two_sided = not one_sided[t]
                    decide(lanes, corners, two_sided, view, t, place, sides, places, owners)
                for lane in range(len(lanes)):
                    pending += owners[lane] == PENDING and ids[VALID, lane] != 0
            if full:
                for row in range(block_rows):
                    start_at = (top + row) * width + left
                    for column in range(BLOCK_WIDTH):
                        triangle[start_at + column] = owners[row * BLOCK_WIDTH + column]
            else:
                for row in range(height):
                    for column in range(columns):
                        owner = owners[row * BLOCK_WIDTH + column]
                        triangle[(top + row) * width + left + column] = owner
                for lane in range(len(lanes)):
                    ids[VALID, lane] = -1
    return pending


@njit(makes_arrays=False)
def cast(
    scratch: Scratch,
    scenes: Scenes,
    packet: Packet,
    aim: Aim,
    turns: NDArray[Any],
    triangle: NDArray[Any],
    pending: NDArray[Any],
) -> None:
    """Who owns the samples of some views: into `triangle`, (v, samples) int32; how many of each are
    `PENDING` is added to `pending`, (v,) int64. All threads that share the counter `turns`, (1,)
    int64, share the work.

    Rays are those of `ray_kernels.fill_rays`, and hits mean what `ray_kernels.resolve` says.
    What is plainly a hit is not asked in float64 (see `STEEP`). The others of a block mostly
    share a triangle or two, so that each triangle is asked about all of the block's samples at
    once, in the machine's vectors.

    Views that follow one another show much the same, so their rows are cast in turn: what one has
    brought into the core's cache the others find there.
    """
    while True:
        top = take(turns, TURN_ROWS)
        if top >= aim.height:
            break
        rows = top, min(top + TURN_ROWS, aim.height)
        for view in range(len(triangle)):
            pending[view] += _cast_rows(scratch, scenes, packet, aim, view, rows, triangle[view])


@njit()
def well_shaped(vertices: NDArray[Any], triangles: NDArray[Any]) -> NDArray[np.bool_]:
    """Which triangles, (t, 3) int32, of local `vertices`, (v, 3) float32, have a normal that
    float32 can tell (see `STEEP`): (t,) bool."""
    reach = 1.0
    for v in range(len(vertices)):
        for i in range(3):
            reach = max(reach, abs(np.float64(vertices[v, i])))
    result = np.empty(len(triangles), np.bool_)
    for t in range(len(triangles)):
        v0 = point(vertices, triangles[t, 0])
        a = minus(point(vertices, triangles[t, 1]), v0)
        b = minus(point(vertices, triangles[t, 2]), v0)
        c = minus(b, a)
        longest = max(dot(a, a), dot(b, b), dot(c, c))
        n = cross(a, b)
        twice_area = np.sqrt(dot(n, n))
        result[t] = (
            twice_area > 0.0
            and twice_area >= SHAPE * longest
            and twice_area >= APART * reach * np.sqrt(longest)
        )
    return result
