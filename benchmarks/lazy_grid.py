"""The lazy grid on this machine: what each choice costs, and traversal.

The paper's own figures are `visref tables --paper hey2001`.

`python -m benchmarks --only lazy_grid` takes a tenth of the large city; `python -m
benchmarks.lazy_grid 1` all of it (some 8 GiB and ten minutes).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import mean, median
from typing import Any

import numpy as np

from visref.camera_path import CameraPath
from visref.papers import hey2001
from visref.registry import make_culler
from visref.scene import Scene
from visref_culling.lazy_grid import LazyGridCulling
from visref_culling.lazy_grid import grid as grid_module
from visref_culling.lazy_grid.grid import FREE, FULL, OUTDATED, UNKNOWN
from visref_datasets_gen.city_large import city_large
from visref_datasets_gen.dataset import scene_of
from visref_datasets_gen.forest import forest

TITLE = "Lazy occlusion grid (Hey 2001): forest and city, 640x480"

Line = tuple[str, str]  # quantity, here

FRAMES = 16
SIZE = (640, 480)
CITY_SCALE = 0.1
CELLS_PX = (8, 16, 32, 64)


def run(city_scale: float = CITY_SCALE) -> list[dict[str, str]]:
    rows: list[tuple[str, ...]] = []
    for dataset in (forest(frames=FRAMES), city_large(scale=city_scale, frames=FRAMES)):
        scene = scene_of(dataset)
        label = f"{dataset.name} {SIZE[0]}x{SIZE[1]}"
        path = dataset.path.resized(*SIZE)
        boxes = hey2001.specs(dataset.name)["lazy"].partition(",cell=32")[2]
        rows += [(label, *line) for line in choice_rows(scene, path, boxes)]
        rows += [(label, *line) for line in traversal_rows(scene, path, boxes)]
    heads = ("scene", "quantity", "here")
    return [dict(zip(heads, row, strict=True)) for row in rows]


# What each choice asks, draws and takes.


class Forgetful(LazyGridCulling):
    """Section 5's comparison with nothing kept of its answers: a query for every cell asked."""

    def scan(self, walk: Any, node: int) -> Any:
        touched = ~walk.grid.untouched
        walk.grid.reached[touched] = UNKNOWN
        walk.grid.farthest[touched] = self.areas.z_max
        return super().scan(walk, node)


def choice_rows(scene: Scene, path: CameraPath, boxes: str) -> Iterator[Line]:
    """Buffers, ways of asking, cell sizes and extensions, lazy throughout."""
    options = [
        "buffer=z",
        "query=gl",
        "query=gl,buffer=z",
        "query=software",
        "query=software,buffer=z",
        *(f"cell={cell}" for cell in CELLS_PX if cell != hey2001.CELL_PX),
        "probability=0.5",
        "probability=1",
        "whole=0.25",
        "whole=0.75",
        f"large={path.cameras[0].samples // 8}",
    ]
    plain = make_culler(f"lazy-grid:update=lazy{boxes}")
    yield "readback, occlusion buffer, cell=32", _cost(plain, scene, path)
    for option in options:
        yield option, _cost(make_culler(f"lazy-grid:{option}{boxes}"), scene, path)
    values = dict(part.split("=") for part in boxes.split(",") if part)
    leaf = int(values["leaf"]) if "leaf" in values else 1500
    shape = {"boxes": values.get("boxes", "objects"), "leaf": leaf}
    forgetful = Forgetful(buffer="z", query="gl", **shape)
    yield "query=gl,buffer=z, no answer kept", _cost(forgetful, scene, path)


def _cost(culler: LazyGridCulling, scene: Scene, path: CameraPath) -> str:
    frames = _walk(culler, scene, path)
    asked, drawn = (mean(f[name] for f in frames) for name in ("queries", "triangles_drawn"))
    return f"{asked:,.0f} queries, {drawn:,.0f} triangles, {median(f['ms'] for f in frames):.0f} ms"


def _walk(culler: LazyGridCulling, scene: Scene, path: CameraPath) -> list[dict[str, Any]]:
    culler.prepare(scene)
    try:
        answers = [culler.cull(camera) for camera in path.cameras[::2]][1:]
    finally:
        culler.close()
    return [
        {
            **answer.stats.counts(),
            "ms": answer.stats.ms["frame"],
            "traversal": answer.stats.ms["frame"]
            - sum(answer.stats.ms.get(phase, 0.0) for phase in ("draw", "query")),
        }
        for answer in answers
    ]


# Traversal: everything but draws and queries, with the scan of a box's cells in three ways.


def _scan_states_numpy(
    state: Any, covered: Any, likely: float, spans: Any, internal: Any, border: Any
) -> tuple[bool, int, int]:
    x0, y0, x1, y1, inner_x0, inner_y0, inner_x1, inner_y1 = spans.tolist()
    inside = np.zeros((y1 - y0, x1 - x0), bool)
    inside[max(0, inner_y0 - y0) : inner_y1 - y0, max(0, inner_x0 - x0) : inner_x1 - x0] = True
    part = state[y0:y1, x0:x1]
    unlikely = covered[y0:y1, x0:x1] < likely
    open_cells = part != FULL
    inner = inside & open_cells
    if (inner & ((part != OUTDATED) | unlikely)).any():
        return True, 0, 0
    edge = ~inside & open_cells
    if (edge & ((part == FREE) | unlikely)).any():
        return True, 0, 0
    counts = []
    for chosen, found in ((inner, internal), (edge, border)):
        rows, columns = np.nonzero(chosen)
        found[: len(rows), 0], found[: len(rows), 1] = columns + x0, rows + y0
        counts.append(len(rows))
    return False, counts[0], counts[1]


@contextmanager
def _scanning(scan: Callable[..., Any]) -> Iterator[None]:
    before = grid_module._scan_states
    grid_module._scan_states = scan
    try:
        yield
    finally:
        grid_module._scan_states = before


def traversal_rows(scene: Scene, path: CameraPath, boxes: str) -> Iterator[Line]:
    ways = {
        "numba": grid_module._scan_states,
        "NumPy": _scan_states_numpy,
        "Python": grid_module._scan_states.py_func,
    }
    for cell in (8, 32):
        for name, scan in ways.items():
            with _scanning(scan):
                frames = _walk(make_culler(f"lazy-grid:cell={cell}{boxes}"), scene, path)
            traversal, whole = (median(f[key] for f in frames) for key in ("traversal", "ms"))
            told = f"{traversal:.1f} of {whole:.0f} ms"
            yield f"traversal a frame, cell={cell}, cells scanned in {name}", told


def main() -> None:
    from benchmarks.page import table

    started = time.perf_counter()
    print("\n".join(table(run(float(sys.argv[1]) if len(sys.argv) > 1 else CITY_SCALE))))
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
