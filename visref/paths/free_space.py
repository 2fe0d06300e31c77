"""Where in a scene one can walk: routes at one height that keep away from the triangles.

The space about the scene is a grid of cubic cells, each with the distance from its centre to the
nearest triangle. A cell is free if that is at least the clearance and half a cell more: then every
point of the line to the centre of a free neighbour keeps the clearance. Free cells of one height
that hang together are a room; which room is worth walking is asked of rays (`_best`). In it the
route goes through places that lie far from each other, along ways that rather keep near to walls
than to the middle, and is then pulled straight where the straight line, too, keeps the clearance
from every triangle, by `distance_to_triangles`.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.engines import make_engine
from visref.errors import InputError
from visref.judging.winding import from_behind
from visref.paths.clearance import cell_distances, distance_to_triangles
from visref.paths.cube import cube_views
from visref.registry import DEFAULT_ENGINE
from visref.scene import Float32, Float64, Int64, Scene

# Cells of the grid, in all: some seconds' work, and 16 MB.
CELLS = 4_000_000
# So many cells beyond what the clearance asks for, a place is as far from everything as any other.
_BEYOND = 2
# Rooms that rays look at, places in each, and samples across the image in each of six directions.
_LOOKED_AT, _PLACES, _SIDE = 24, 6, 16
# A room of fewer cells is a gap, and taken only where there is nothing else.
_GAP = 200
# What a cell is worth by how many of the six directions along the axes meet something: places among
# things before those beside them.
_SURROUNDED = np.array((0.0, 0.0, 1.0, 3.0, 9.0, 30.0, 40.0))
# A leg crosses so many cells at most, so that the walk keeps to its way near the walls.
_LONGEST = 24


@dataclass(frozen=True, eq=False)
class _Grid:
    """`low`: the first cell's centre, (3,) float64 in the scene's own space; `size`: a cell's side;
    `distance`: (ny, nz, nx) float32, up to `reach`; `clearance`: what a walk keeps."""

    low: Float64
    size: float
    distance: Float32
    reach: float
    clearance: float

    def centres(self, layer: int, cells: Int64) -> Float64:
        """(k, 3) float64, the centres of cells of a layer."""
        z, x = np.divmod(cells, self.distance.shape[2])
        places = np.stack([x, np.full_like(x, layer), z], axis=1)
        result: Float64 = self.low + self.size * places
        return result

    @property
    def free(self) -> NDArray[np.bool_]:
        # Half a cell: the farthest that a point between two neighbours is from the nearer centre.
        # The distance is rounded to float32, by less than the last factor.
        result: NDArray[np.bool_] = self.distance >= (self.clearance + self.size / 2) * (1 + 1e-6)
        return result


@dataclass(frozen=True, eq=False)
class _Room:
    """Free cells of one layer that hang together: `cells`, (k,) int64, ascending, numbered by z and
    x."""

    layer: int
    cells: Int64


# What a room is worth by what surrounds it, how many cells it has, its layer and label there.
_Found = tuple[float, int, int, int]


def free_route(
    scene: Scene,
    *,
    seed: int,
    places: int,
    clearance: float | None = None,
    height: float | None = None,
) -> tuple[Float64, float]:
    """Points of a walk through a scene, (k, 3) float64 in world space, and its clearance: on the
    straight lines between them no triangle is nearer.

    `places`: how many places it goes to. `clearance`: in world units; by default what the grid
    resolves. `height`: of the eye, world y; by default where most is to be seen. The same for the
    same seed. There is always room around the scene. Raises InputError where it has no triangles.
    """
    grid = _grid(scene, clearance, height)
    surrounded = _surrounded(grid)
    room = _best(scene, grid, _rooms(grid, surrounded))
    cells = _route(grid, room, surrounded[room.layer], np.random.default_rng(seed), places)
    points = _pulled(scene, grid, room.layer, grid.centres(room.layer, cells))
    return points + scene.origin, grid.clearance


def _grid(scene: Scene, clearance: float | None, height: float | None) -> _Grid:
    low, high = scene.core_bounds
    extent = high - low
    longest = float(extent.max())
    if not longest > 0.0:
        raise InputError("there is nothing to walk about in", source=scene.source)
    if clearance is not None and not 0.0 < clearance < longest:
        raise InputError(f"--clearance is {clearance:g}", fix=f"give a length below {longest:.3g}")
    # What is flat has cells as if it were an eighth as thick as long.
    size = float(np.cbrt(np.prod(np.maximum(extent, longest / 8)) / CELLS))
    clearance = 2.5 * size if clearance is None else clearance
    # No finer than it takes: each triangle is asked for all cells within reach.
    size = max(size, clearance / 4)
    reach = clearance + _BEYOND * size
    # One can walk around a scene as well as in it.
    first, last = low - 2 * reach, high + 2 * reach
    if height is not None:
        first[1] = last[1] = height - scene.origin[1]
    count = np.ceil((last - first) / size).astype(np.int64) + 1
    distance = np.full((count[1], count[2], count[0]), reach, np.float32)
    there = np.ascontiguousarray(scene.present)
    cell_distances(scene.vertices, scene.triangles, there, first, size, reach, distance)
    return _Grid(first, size, distance, reach, clearance)


def _rooms(grid: _Grid, surrounded: NDArray[np.uint8]) -> list[_Room]:
    """Rooms of two cells or more that are worth a look. There are some: beyond what `_grid` reaches
    around the scene, nothing is in the way."""
    free, worth = grid.free, _SURROUNDED[surrounded]
    found: list[_Found] = []
    for layer in range(len(free)):
        label = np.zeros(free.shape[1:], np.int64)
        count = _label(free[layer], label)
        flat = label.reshape(-1)
        sums = np.bincount(flat, worth[layer].reshape(-1), count + 1)
        sizes = np.bincount(flat, minlength=count + 1)
        # What is not free has label 0.
        found += [
            (float(sums[i]), int(sizes[i]), layer, i) for i in range(1, count + 1) if sizes[i] > 1
        ]
    found = [entry for entry in found if entry[1] >= _GAP] or found
    # Those most surrounded, and of what is left the largest: around a thing that stands alone.
    found.sort(key=lambda entry: (-entry[0], entry[2:]))
    rooms = _apart(free, found, [], _LOOKED_AT // 2)
    found.sort(key=lambda entry: (-entry[1], entry[2:]))
    return _apart(free, found, rooms, _LOOKED_AT)


def _apart(
    free: NDArray[np.bool_], found: list[_Found], rooms: list[_Room], count: int
) -> list[_Room]:
    """Rooms and further ones, up to so many, that are not the same a little higher or lower."""
    rooms = list(rooms)
    near = max(1, len(free) // 16)
    for _, _, layer, index in found:
        if len(rooms) >= count:
            break
        label = np.zeros(free.shape[1:], np.int64)
        _label(free[layer], label)
        inside = label.reshape(-1) == index
        if not any(
            abs(room.layer - layer) < near
            and 2 * np.count_nonzero(inside[room.cells]) > np.count_nonzero(inside)
            for room in rooms
        ):
            rooms.append(_Room(layer, np.flatnonzero(inside)))
    return rooms


def _surrounded(grid: _Grid) -> NDArray[np.uint8]:
    """(ny, nz, nx) uint8, in how many of the six directions along the axes there is something."""
    # Half a cell's diagonal: what is in a cell is no farther from its centre.
    met = grid.distance <= grid.size * math.sqrt(3.0) / 2
    count = np.zeros(met.shape, np.uint8)
    for axis in range(3):
        for way in (met, np.flip(met, axis)):
            beyond = np.logical_or.accumulate(way, axis)
            count += beyond if way is met else np.flip(beyond, axis)
    return count


def _best(scene: Scene, grid: _Grid, rooms: list[_Room]) -> _Room:
    """The room from which rays meet the most objects, and fronts at the most samples: what shows
    its backs is seen from inside of it."""
    engine = make_engine(DEFAULT_ENGINE, scene)
    try:
        worths = []
        for room in rooms:
            step = max(1, len(room.cells) // _PLACES)
            eyes = grid.centres(room.layer, room.cells[step // 2 :: step][:_PLACES])
            objects, hits, fronts, samples = 0, 0, 0, 0
            for eye in eyes:
                seen = set()
                for camera in cube_views(eye, _SIDE, grid.clearance / 2):
                    owner = engine.frame(
                        replace(camera, origin=_point(scene.origin))
                    ).buffer.triangle
                    hit = np.flatnonzero(owner.reshape(-1) >= 0)
                    owners = owner.reshape(-1)[hit]
                    seen.update(np.unique(scene.object_of_triangle[owners]).tolist())
                    hits += len(hit)
                    fronts += int(np.count_nonzero(~from_behind(scene, camera, hit, owners)))
                    samples += camera.samples
                objects += len(seen)
            # Inside of a hull most of what shows are backs.
            outside = 1.0 if 2 * fronts > hits else 0.01
            worths.append(outside * objects / len(eyes) * fronts / samples)
    finally:
        engine.close()
    return rooms[int(np.argmax(worths))]


def _point(vector: Float64) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])


def _route(
    grid: _Grid,
    room: _Room,
    surrounded: NDArray[np.uint8],
    rng: np.random.Generator,
    places: int,
) -> Int64:
    """(k,) int64, cells from neighbour to neighbour through a room: from a place anywhere to places
    far from those before, by ways that rather go along walls and among things; `surrounded` of its
    layer, (nz, nx)."""
    distance = grid.distance[room.layer]
    least = grid.clearance + grid.size / 2
    cost = 1.0 + (distance.astype(np.float64) - least) / (grid.reach - least)
    cost += 6.0 - surrounded
    among = surrounded.reshape(-1)[room.cells] / 6.0
    inside = np.zeros(distance.shape, np.bool_)
    inside.reshape(-1)[room.cells] = True
    at = int(room.cells[np.argmax(among * rng.uniform(0.5, 1.0, len(among)))])
    route = [np.array([at])]
    nearest = np.full(len(room.cells), np.inf)
    for _ in range(places):
        way, parent = _ways(inside, cost, at)
        nearest = np.minimum(nearest, way.reshape(-1)[room.cells])
        # Far and among things, but not always the farthest and most.
        score = nearest * among * rng.uniform(0.5, 1.0, len(nearest))
        chosen = int(np.argmax(score))
        if not score[chosen] > 0.0:
            break
        target = int(room.cells[chosen])
        steps = [target]
        while steps[-1] != at:
            steps.append(int(parent.reshape(-1)[steps[-1]]))
        route.append(np.array(steps[-2::-1]))
        at = target
    return np.concatenate(route)


def _pulled(scene: Scene, grid: _Grid, layer: int, points: Float64) -> Float64:
    """Some of the points, between which straight lines keep the clearance too."""
    kept, at = [0], 0
    while at < len(points) - 1:
        for step in range(min(_LONGEST, len(points) - 1 - at), 0, -1):
            # Neighbours keep it by what free means.
            if step == 1 or _keeps(scene, grid, layer, points[at], points[at + step]):
                break
        at += step
        kept.append(at)
    result: Float64 = points[kept]
    # Where a route turns back there may be a point twice in a row.
    moved: NDArray[np.bool_] = np.any(np.diff(result, axis=0) != 0.0, axis=1)
    distinct: Float64 = result[np.append(True, moved)]
    return distinct


def _keeps(scene: Scene, grid: _Grid, layer: int, start: Float64, end: Float64) -> bool:
    """Whether the line between two points of a layer keeps the clearance: by the grid where that
    tells, else by the triangles."""
    count = math.ceil(float(np.linalg.norm(end - start)) / grid.size * 4) + 1
    places = (np.linspace(start, end, count) - grid.low) / grid.size
    x, z = np.rint(places[:, (0, 2)]).astype(np.int64).T
    least = float(grid.distance[layer, z, x].min())
    # A point of the line is within an eighth of a cell of one of these, and that within half a
    # cell's diagonal of its cell's centre; 0.84 is more than both.
    if least >= grid.clearance + 0.84 * grid.size:
        return True
    # Float64's rounding is far below the last factor, which leaves it room.
    limit = grid.clearance * (1 + 1e-9)
    return math.isinf(distance_to_triangles(scene, start, end, limit)[0])


@njit()
def _label(free, label):  # type: ignore[no-untyped-def]
    """Number free cells that hang together by their sides, from 1; how many numbers there are."""
    count = 0
    stack = np.empty(free.size, np.int64)
    rows, columns = free.shape
    for start in range(free.size):
        if not free[start // columns, start % columns] or label[start // columns, start % columns]:
            continue
        count += 1
        label[start // columns, start % columns] = count
        stack[0], depth = start, 1
        while depth:
            depth -= 1
            row, column = stack[depth] // columns, stack[depth] % columns
            for side in range(4):
                z, x = row + (side == 0) - (side == 1), column + (side == 2) - (side == 3)
                if 0 <= z < rows and 0 <= x < columns and free[z, x] and not label[z, x]:
                    label[z, x] = count
                    stack[depth] = z * columns + x
                    depth += 1
    return count


@njit()
def _ways(inside, cost, source):  # type: ignore[no-untyped-def]
    """The cheapest way from a cell to each of the cells inside (Dijkstra 1959), from side to side:
    (way, parent), its cost and the cell before."""
    rows, columns = inside.shape
    way = np.full(inside.shape, np.inf)
    parent = np.full(inside.shape, -1)
    way[source // columns, source % columns] = 0.0
    heap = [(0.0, source)]
    while len(heap):
        reached, cell = heapq.heappop(heap)
        row, column = cell // columns, cell % columns
        if reached > way[row, column]:
            continue
        for side in range(4):
            z, x = row + (side == 0) - (side == 1), column + (side == 2) - (side == 3)
            if 0 <= z < rows and 0 <= x < columns and inside[z, x]:
                further = reached + (cost[row, column] + cost[z, x]) / 2
                if further < way[z, x]:
                    way[z, x] = further
                    parent[z, x] = cell
                    heapq.heappush(heap, (further, z * columns + x))
    return way, parent
