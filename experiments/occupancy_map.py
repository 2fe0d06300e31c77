"""What the occupancy map trades: a lookup's cost against a query's, on this machine.

Staneker, Bartz, Meissner 2003, sections 2 and 3. Each time is the quickest of several rounds:
whatever else the machine does only adds to it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.compiled import njit
from visref.culler import QueryStats
from visref.scene import Scene
from visref_culling.baselines import NoCulling
from visref_culling.boxes.conservative import inflated, round_outward
from visref_culling.gl.device import State, device
from visref_culling.gl.view import View
from visref_culling.occupancy_map import TILES, WORDS, OccupancyMapCulling, covered, mark
from visref_culling.queries.occlusion_query import BoxQueries
from visref_experiments.timing import quickest_ms

SIZES_PX = (8, 16, 32, 64, 128, 192, 256, 384, 512, 640, 768, 896, 1000)
WINDOW_PX = 1024
WAYS = {"sync": 200, "batch": 1000, "instanced": 4000}  # boxes asked at once
LOOKUP_TILES = (1, 4, 16, TILES)
LOOKUPS = 2_000_000
ROUNDS = 15

# Section 2 compares a query with triangles of 25 pixels.
TRIANGLE_PX = 25
TRIANGLES = 20_000


def lookup(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Milliseconds of one lookup by the side of a square of `tiles`, and the map's size.

    Every lookup finds all set, so that it has to look at every word: the dearest.
    """
    words = np.zeros(WORDS, np.uint32)
    mark(words, 0, 0, TILES - 1, TILES - 1)
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
        "lists": culler.lists,
    }
    culler.close()
    return result


@njit()
def _look_up_many(words: Any, tiles: int, count: int) -> int:
    found = 0
    for i in range(count):
        at = (i * 37) % (TILES - tiles + 1)
        found += covered(words, at, at, at + tiles - 1, at + tiles - 1)
    return found


def latency(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Milliseconds of one query waited for, by the side of the box's front face in pixels,
    with and without back-face culling; and of a small one by how it is asked."""
    asker = _Asker()
    best = quickest_ms(
        *(
            asker.asking(size, 1, "sync", cull_back_faces=cull)
            for size in SIZES_PX
            for cull in (True, False)
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
        "each_ms": {way: ms / count for (way, count), ms in zip(WAYS.items(), each, strict=True)},
    }


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

    def asking(
        self, size_px: float, count: int, way: str, *, cull_back_faces: bool
    ) -> Callable[[], Any]:
        """A call that asks `count` boxes which face the view with squares of `size_px` a side."""
        half = np.array([size_px / 2, size_px / 2, 1.0])
        bounds = np.stack([-half, half])[None] - (0.0, 0.0, 5.0)
        boxes = round_outward(np.repeat(inflated(self.view, bounds), count, axis=0))

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
