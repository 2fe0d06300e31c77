"""What the occupancy map trades: a lookup's cost against a query's, on this machine.

Staneker, Bartz, Meissner 2003, sections 2 and 3. Each time is the quickest of several rounds:
whatever else the machine does only adds to it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.compiled import njit
from visref.culler import QueryStats
from visref.scene import Float64, Scene
from visref_culling.baselines import NoCulling
from visref_culling.boxes.conservative import (
    growth_of_box,
    inflate_box,
    inflated,
    round_outward,
)
from visref_culling.boxes.rectangles import projection_of, rectangle_of_box
from visref_culling.gl.device import State, device
from visref_culling.gl.view import View
from visref_culling.occupancy_map import OccupancyMapCulling
from visref_culling.occupancy_map.tiles import (
    TILES,
    WORDS,
    Grid,
    Projection,
    covered,
    mark,
    tiles_under_rectangle,
)
from visref_culling.queries.occlusion_query import BoxQueries
from visref_experiments.timing import quickest_ms

UInt32 = NDArray[np.uint32]

SIZES_PX = (8, 16, 32, 64, 128, 192, 256, 384, 512, 640, 768, 896, 1000)
WINDOW_PX = 1024
WAYS = {"sync": 200, "batch": 1000, "instanced": 4000}  # boxes asked at once
LOOKUP_TILES = (1, 4, 16, TILES)
LOOKUPS = 2_000_000
BOXES = 20_000  # lookups of a box
ROUNDS = 15

# Section 2 compares a query with triangles of 25 pixels.
TRIANGLE_PX = 25
TRIANGLES = 20_000


def lookup(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Milliseconds of one lookup by the side of a square of `tiles`, and the map's size.

    Every lookup finds all set, so that it has to look at every word: the dearest.
    """
    words = _full()
    counts = [LOOKUPS // tiles for tiles in LOOKUP_TILES]
    jobs = [
        partial(_look_up_many, words, tiles, count)
        for tiles, count in zip(LOOKUP_TILES, counts, strict=True)
    ]
    times = [
        ms / count for ms, count in zip(quickest_ms(*jobs, rounds=ROUNDS), counts, strict=True)
    ]
    culler = OccupancyMapCulling()
    result = {
        "tiles": list(LOOKUP_TILES),
        "lookup_ms": times,
        "map_bytes": culler.maps[0].nbytes,
    }
    culler.close()
    return result


def _full() -> UInt32:
    """A map whose every tile is set."""
    words = np.zeros(WORDS, np.uint32)
    mark(words, 0, 0, TILES - 1, TILES - 1)
    return words


@njit()
def _look_up_many(words: Any, tiles: int, count: int) -> int:
    found = 0
    for i in range(count):
        at = (i * 37) % (TILES - tiles + 1)
        found += covered(words, at, at, at + tiles - 1, at + tiles - 1)
    return found


def latency(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Milliseconds of one query waited for, by the side of the box's front face in pixels, with
    and without back-face culling; of a lookup of the same box, from its place in the world to the
    answer, and of the lookup's bits alone; and of a small query by how it is asked."""
    asker = _Asker()
    words = _full()
    boxes = [asker.bounds(size) for size in SIZES_PX]
    best = quickest_ms(
        *(
            asker.asking(size, 1, "sync", cull_back_faces=cull)
            for size in SIZES_PX
            for cull in (True, False)
        ),
        rounds=ROUNDS,
    )
    grid, projection = _lookup_of(asker.view)
    lookups = quickest_ms(
        *(
            partial(_look_up_boxes, words, box, projection, grid, BOXES, bits_only)
            for box in boxes
            for bits_only in (False, True)
        ),
        rounds=ROUNDS,
    )
    each = quickest_ms(
        *(
            asker.asking(SIZES_PX[0], count, way, cull_back_faces=True)
            for way, count in WAYS.items()
        ),
        rounds=ROUNDS,
    )
    asker.queries.release()
    return {
        "renderer": device().report()["renderer"],
        "sizes_px": list(SIZES_PX),
        "culled_ms": best[::2],
        "unculled_ms": best[1::2],
        "lookup_ms": [ms / BOXES for ms in lookups[::2]],
        "bits_ms": [ms / BOXES for ms in lookups[1::2]],
        "each_ms": {way: ms / count for (way, count), ms in zip(WAYS.items(), each, strict=True)},
    }


def _lookup_of(view: View) -> tuple[Grid, Projection]:
    """What a lookup of a box in the world takes."""
    side = WINDOW_PX // TILES
    return Grid(0, 0, side, side), Projection(
        view.camera.eye, growth_of_box(view), *projection_of(view)
    )


@njit()
def _look_up_boxes(
    words: Any, bounds: Any, projection: Any, grid: Any, count: int, bits_only: bool
) -> int:
    """Look up a box, (1, 2, 3) float64 in the world, `count` times, each time a little elsewhere,
    as a compiler must not find out; with `bits_only` it is projected the first time alone."""
    moved, box, at = bounds[0].copy(), np.empty((2, 3)), np.empty((8, 4))
    pixels, tiles = np.empty(4, np.int32), np.empty(4, np.int32)
    found = 0
    for i in range(count):
        if i == 0 or not bits_only:
            moved[0, 2] = bounds[0, 0, 2] - (i & 7) * 0.125
            inflate_box(moved, projection.eye, projection.growth, box)
            rectangle_of_box(
                box, projection.rows, projection.near, projection.window, 0, at, pixels
            )
            tiles_under_rectangle(pixels, grid, tiles)
        row = found & 0  # always 0
        found += covered(words, tiles[0], tiles[1] + row, tiles[2], tiles[3])
    return found


def query_in_triangles(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Milliseconds of one query waited for, its box's front face as large as a triangle of
    `TRIANGLE_PX` pixels, and of drawing such a triangle among many."""
    asker = _Asker()
    asking = asker.asking(TRIANGLE_PX**0.5, 1, "sync", cull_back_faces=True)
    (query_ms,) = quickest_ms(asking, rounds=ROUNDS)
    asker.queries.release()
    empty_ms, full_ms = (_frame_ms(count) for count in (1, TRIANGLES))
    return {"query_ms": query_ms, "triangle_ms": (full_ms - empty_ms) / (TRIANGLES - 1)}


def _frame_ms(count: int) -> float:
    """Milliseconds of a frame of so many triangles, in rows on the window, none over another."""
    leg = (2.0 * TRIANGLE_PX) ** 0.5
    row = int(WINDOW_PX / leg)
    at = np.stack([np.arange(count) % row, np.arange(count) // row % row, -5.0 * np.ones(count)], 1)
    corner = at * [leg, leg, 1.0] - [WINDOW_PX / 2, WINDOW_PX / 2, 0.0]
    corners = corner[:, None] + np.array([[0, 0, 0], [leg, 0, 0], [0, leg, 0]])
    triangles = np.arange(3 * count).reshape(-1, 3)
    scene = Scene.from_objects([("many", corners.reshape(-1, 3).astype(np.float32), triangles)])
    culler = NoCulling()
    culler.prepare(scene)
    camera = _camera()
    ms = min(culler.cull(camera).stats.ms["frame"] for _ in range(ROUNDS))
    culler.close()
    return ms


def _camera() -> Camera:
    """A window of world units, a pixel each."""
    return Camera(np.eye(4), WINDOW_PX, WINDOW_PX, 0.0, 100.0, ymag=WINDOW_PX / 2)


class _Asker:
    """Queries of boxes on an empty depth buffer, so that every fragment passes."""

    def __init__(self) -> None:
        self.view = View.of(_camera(), Scene.from_objects([]), device().subpixel_bits)
        self.target = device().target(WINDOW_PX, WINDOW_PX)
        self.queries = BoxQueries(device())
        program = device().program("mesh.vert", "plain.frag")
        device().clear(State(self.target.framebuffer, program))

    @staticmethod
    def bounds(size_px: float) -> Float64:
        """(1, 2, 3) float64: the box in the world."""
        half = np.array([size_px / 2, size_px / 2, 1.0])
        return np.stack([-half, half])[None] - (0.0, 0.0, 5.0)

    def asking(
        self, size_px: float, count: int, way: str, *, cull_back_faces: bool
    ) -> Callable[[], Any]:
        """A call that asks `count` boxes which face the view with squares of `size_px` a side."""
        one = inflated(self.view, self.bounds(size_px))
        boxes = round_outward(np.repeat(one, count, axis=0))

        def ask() -> None:
            self.queries.ask(
                self.view,
                self.target,
                boxes,
                QueryStats(),
                way=way,
                cull_back_faces=cull_back_faces,
            )

        return ask
