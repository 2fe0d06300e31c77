"""The occupancy map on this machine: a lookup's and a query's cost, and what the map saves."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from culling.baselines import SingleQueryCulling
from culling.device import State, device
from culling.method import GLCuller
from culling.occupancy_map import TILES, WORDS, OccupancyMapCulling, covered, mark
from culling.queries.occlusion_query import BoxQueries
from culling.view import View, round_outward
from datasets_gen.dataset import scene_of
from datasets_gen.vessels import vessels
from visref.camera import Camera
from visref.culler import QueryStats
from visref.scene import Scene

TITLE = "Occupancy map (Staneker 2003): lookups, queries, and the vessels at 876x584"

FIGURE = Path("bench-out/query_latency.svg")
SIZES_PX = (8, 16, 32, 64, 128, 192, 256, 384, 512, 640, 768, 896, 1000)
WINDOW = 1024
LOOKUPS = 2_000_000
ROUNDS = 5
FRAME_STEP = 9


def run() -> list[dict[str, str]]:
    rows = [*lookup_rows(), *query_rows(), *latency_rows(), *vessel_rows()]
    return [dict(zip(("measured", "here", "paper"), row, strict=True)) for row in rows]


# The lookup.


@numba.njit(cache=True)
def _look_up_many(words: Any, tiles: int, count: int) -> int:
    found = 0
    for i in range(count):
        at = (i * 37) % (TILES - tiles + 1)
        found += covered(words, at, at, at + tiles - 1, at + tiles - 1)
    return found


def lookup_rows() -> list[tuple[str, str, str]]:
    """Every lookup finds all set, so that it has to look at every word: the dearest."""
    words = np.zeros(WORDS, np.uint32)
    mark(words, 0, 0, TILES - 1, TILES - 1)
    rows = []
    for tiles in (1, 4, 16, TILES):
        count = LOOKUPS // tiles
        assert _look_up_many(words, tiles, count) == count
        ns = _best(lambda n=tiles, c=count: _look_up_many(words, n, c)) / count * 1e9
        rows.append((f"lookup of {tiles} x {tiles} tiles", f"{ns:.1f} ns", ""))
    return rows


# The query.


class _Asker:
    """Queries of boxes on an empty depth buffer, so that every fragment passes."""

    def __init__(self) -> None:
        self.camera = Camera(np.eye(4), WINDOW, WINDOW, 0.0, 100.0, ymag=WINDOW / 2)
        empty = Scene.from_objects([])
        self.view = View.of(self.camera, empty, device().subpixel_bits)
        self.target = device().target(WINDOW, WINDOW)
        self.queries = BoxQueries(device())
        program = device().program("mesh.vert", "plain.frag")
        device().clear(State(self.target.framebuffer, program))

    def seconds(self, size_px: float, count: int, way: str, *, cull_back_faces: bool) -> float:
        half = np.array([size_px / 2, size_px / 2, 1.0])
        bounds = np.stack([-half, half])[None] - (0.0, 0.0, 5.0)
        boxes = round_outward(np.repeat(self.view.inflated(bounds), count, axis=0))

        def ask() -> None:
            self.queries.ask(
                self.view,
                self.target,
                boxes,
                QueryStats(),
                way=way,
                cull_back_faces=cull_back_faces,
            )

        ask()
        return _best(ask)


def query_rows() -> list[tuple[str, str, str]]:
    asker = _Asker()
    rows = []
    for way, count in (("sync", 200), ("batch", 1000), ("instanced", 4000)):
        us = asker.seconds(8, count, way, cull_back_faces=True) / count * 1e6
        rows.append((f"query of 8 x 8 px, {way}, {count} boxes", f"{us:.1f} µs each", ""))
    return rows


def latency() -> dict[bool, list[float]]:
    """Microseconds of one query waited for, by `SIZES_PX`; True with back-face culling."""
    asker = _Asker()
    return {
        culled: [asker.seconds(size, 1, "sync", cull_back_faces=culled) * 1e6 for size in SIZES_PX]
        for culled in (False, True)
    }


def plot(curves: dict[bool, list[float]], path: Path) -> None:
    """The paper's Figure 1 for this machine: latency of a query against the box's size."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.add_subplot()
    # Colours that stay apart for every kind of colour vision, and markers besides.
    for culled, colour, marker in ((False, "#d55e00", "s"), (True, "#0072b2", "o")):
        label = f"{'with' if culled else 'without'} back-face culling"
        axes.plot(
            np.square(SIZES_PX) / 1e3, curves[culled], color=colour, marker=marker, label=label
        )
    axes.set_xlabel("front face of the box (thousand pixels)")
    axes.set_ylabel("latency of one query (µs)")
    axes.set_title(f"Occlusion query on {device().report()['renderer']}", fontsize=10)
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def latency_rows() -> list[tuple[str, str, str]]:
    curves = latency()
    plot(curves, FIGURE)
    rows = []
    for size in (16, 256, 1000):
        at = SIZES_PX.index(size)
        both, front = curves[False][at], curves[True][at]
        rows.append(
            (
                f"query of {size} x {size} px, waited for",
                f"{both:.0f} µs; culled {front:.0f} µs ({front / both:.2f})",
                "about half with back-face culling" if size == 1000 else "",
            )
        )
    return [*rows, (f"latency against size: {FIGURE}", "", "Figure 1")]


# The vessels.


def vessel_rows() -> list[tuple[str, str, str]]:
    """Counts of one pass; for times each frame's quickest of several, methods in turn."""
    dataset = vessels()
    scene, frames = scene_of(dataset), dataset.path.frames[::FRAME_STEP]
    makers: dict[str, Callable[..., GLCuller]] = {
        "single": SingleQueryCulling,
        "single + map": lambda **more: OccupancyMapCulling(maps=1, **more),
        "single + map, parts=1": lambda **more: OccupancyMapCulling(maps=1, parts=1, **more),
        "multiple": OccupancyMapCulling,
    }
    fragments, batches = {}, 0
    for name, make in makers.items():
        culler = make(fragments=True)
        culler.prepare(scene)
        stats = [culler.cull(camera).stats for camera in frames]
        fragments[name] = sum(s.query_fragments_passed for s in stats) / len(stats)
        batches = max(s.batches for s in stats)  # the last: multiple
        culler.close()
    rows = []
    for name in ("single + map, parts=1", "single + map"):
        share = fragments[name] / fragments["single"]
        value = f"{fragments['single']:,.0f} → {fragments[name]:,.0f} ({share:.0%})"
        rows.append((f"fragments of visible boxes, {name}", value, "13 % (Angio)"))
    rows.append(("batches a frame, multiple", f"at most {batches}", "at most 5"))
    cullers = {name: makers[name]() for name in ("single", "single + map", "multiple")}
    for culler in cullers.values():
        culler.prepare(scene)
    ms = {name: np.full(len(frames), np.inf) for name in cullers}
    for _ in range(ROUNDS):
        for at, camera in enumerate(frames):
            for name, culler in cullers.items():
                ms[name][at] = min(ms[name][at], culler.cull(camera).stats.ms["frame"])
    typical = {name: float(best.mean()) for name, best in ms.items()}
    for culler in cullers.values():
        culler.close()
    for name, value in typical.items():
        rows.append((f"milliseconds a frame, {name}", f"{value:.1f}", ""))
    single, one_map, multiple = (typical[name] for name in cullers)
    rows.append(("speed-up of the map over single", f"{single / one_map:.2f}", "1.12 (Angio)"))
    rows.append(("speed-up of multiple over single + map", f"{one_map / multiple:.2f}", "1.34"))
    rows.append(
        ("speed-up of multiple over single", f"{single / multiple:.2f}", "1.50; 1.35 to 1.78")
    )
    return rows


def _best(job: Callable[[], Any]) -> float:
    """Seconds of the quickest round: whatever else the machine does only adds to it."""
    times = []
    for _ in range(3 * ROUNDS):
        started = time.perf_counter()
        job()
        times.append(time.perf_counter() - started)
    return min(times)
