"""What an occupancy map gains in whole frames, and what its rectangles would gain besides.

Staneker, Bartz, Meissner 2003, sections 5 and 6.1. The gain of a map over single queries is 1 to
12 % there, less than a machine's own disturbances from one minute to the next. So methods take
turns within each frame, over the frames every one in every place of the order, and of a method's
rounds the quickest counts. Processor time of all threads stands beside: what others run on the
machine changes that less.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import DrawnSet
from visref.scene import Float64, Int64, Scene
from visref_culling.baselines import SingleQueryCulling
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.method import GLCuller
from visref_culling.occupancy_map import OccupancyMapCulling
from visref_culling.three_pass.stand_ins import stand_ins

ROUNDS = 2

# Section 6.1 has the lookup's rectangle choose a level of detail. Levels are stand-ins of one in so
# many triangles; a shape gets the coarsest that leaves it a triangle for each so many pixels of its
# rectangle.
REDUCTIONS = (1, 4, 16)
PIXELS_A_TRIANGLE = (8, 32, 128)
LEAST_TRIANGLES = 24  # a shape of fewer has no levels


def turns(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """Single queries, with one map, multiple ones, and these arranged in a second thread.

    Each method's frames, the quickest of `ROUNDS`, with counts and milliseconds by phase, a
    number a frame; and the triangles of the shapes that meet the view."""
    return _turns(scene, path, _METHODS)


def pair(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """The same of single queries without and with a map alone."""
    return _turns(scene, path, {name: _METHODS[name] for name in ("single", "map")})


_METHODS: dict[str, Callable[[], GLCuller]] = {
    "single": SingleQueryCulling,
    "map": partial(OccupancyMapCulling, maps=1),
    "multiple": partial(OccupancyMapCulling, maps=5),
    "thread": partial(OccupancyMapCulling, maps=5, thread=True),
}


def _turns(
    scene: Scene, path: CameraPath, made: Mapping[str, Callable[[], GLCuller]]
) -> dict[str, Any]:
    methods = {name: make() for name, make in made.items()}
    sizes = np.diff(scene.object_offsets)
    in_view: list[int] = []
    kept: dict[str, list[DrawnSet]] = {name: [] for name in methods}
    processor: dict[str, list[float]] = {name: [] for name in methods}
    for culler in methods.values():
        culler.prepare(scene)
        culler.cull(path.cameras[0])
    for number, camera in enumerate(path.cameras):
        single = methods["single"]
        in_view.append(int(sizes[single.in_frustum(single.view_of(camera))].sum()))
        drawn: dict[str, list[DrawnSet]] = {name: [] for name in methods}
        spent: dict[str, list[float]] = {name: [] for name in methods}
        for turn in range(ROUNDS):
            for name in _rotated(list(methods), ROUNDS * number + turn):
                started = time.process_time()
                drawn[name].append(methods[name].cull(camera))
                spent[name].append(1e3 * (time.process_time() - started))
        for name in methods:
            kept[name].append(min(drawn[name], key=lambda one: one.stats.ms["frame"]))
            processor[name].append(min(spent[name]))
    for culler in methods.values():
        culler.close()
    return {
        "rounds": ROUNDS,
        "triangles_in_view": in_view,
        "methods": {
            name: {"processor_ms": processor[name], **_frames(kept[name])} for name in methods
        },
    }


def _rotated(names: list[str], by: int) -> list[str]:
    by %= len(names)
    return names[by:] + names[:by]


def _frames(drawn: list[DrawnSet]) -> dict[str, list[float]]:
    counters = ("queries", "queries_passed", "tests_skipped", "batches", "triangles_drawn")
    result: dict[str, list[float]] = {
        f"{phase}_ms": [one.stats.ms.get(phase, 0.0) for one in drawn]
        for phase in ("frame", "sort", "arrange", "query", "draw")
    }
    for counter in counters:
        result[counter] = [getattr(one.stats, counter) or 0 for one in drawn]
    return result


def detail(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """Levels of detail by the lookup's rectangle: the triangles of the shapes drawn, how many are
    left for each of `PIXELS_A_TRIANGLE`, and the share of the covered samples that another object
    owns then, or none; means over frames."""
    levels = Levels(scene)
    culler = OccupancyMapCulling()
    culler.prepare(scene)
    rectangles: dict[str, Any] = {}

    def keep(step: str, data: Mapping[str, Any]) -> None:
        if step == "tiles":
            rectangles.update(data)

    culler.observer = keep
    whole = GLRaster(scene)
    full = 0
    left, changed = np.zeros((2, len(PIXELS_A_TRIANGLE)))
    for camera in path.cameras:
        units = culler.cull(camera).unit_ids.astype(np.int64)
        full += int(levels.sizes[0, units].sum())
        corners = rectangles["rectangles"]
        pixels = np.zeros(scene.object_count)
        pixels[rectangles["units"]] = (corners[:, 2:] - corners[:, :2] + 1).prod(axis=1)
        before = _owners(whole, scene, camera)
        for place, pixels_a_triangle in enumerate(PIXELS_A_TRIANGLE):
            mixed = levels.mixed(units, levels.coarsest(pixels / pixels_a_triangle))
            raster = GLRaster(mixed)
            after = _owners(raster, mixed, camera)
            raster.close()
            left[place] += mixed.triangle_count
            changed[place] += np.count_nonzero(before != after) / max(1, (before >= 0).sum())
    whole.close()
    culler.close()
    frames = len(path.cameras)
    return {
        "reductions": list(REDUCTIONS),
        "pixels_a_triangle": list(PIXELS_A_TRIANGLE),
        "triangles": full / frames,
        "triangles_left": (left / frames).tolist(),
        "samples_changed": (changed / frames).tolist(),
    }


class Levels:
    """A scene's objects at each of `REDUCTIONS`. `sizes`: (levels, n) int64 triangles."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        scenes = [scene, *(stand_ins(scene, r, LEAST_TRIANGLES) for r in REDUCTIONS[1:])]
        first = np.cumsum([0, *(len(level.vertices) for level in scenes)])
        self.vertices = np.concatenate([level.vertices for level in scenes])
        self.triangles = np.concatenate(
            [level.triangles + start for level, start in zip(scenes, first, strict=False)]
        ).astype(np.int32)
        self.one_sided = np.concatenate([level.one_sided for level in scenes])
        self.alpha = np.concatenate([level.alpha for level in scenes])
        self.sizes = np.stack([np.diff(level.object_offsets) for level in scenes])
        self.starts = np.concatenate([[0], np.cumsum(self.sizes)])[:-1].reshape(self.sizes.shape)

    def coarsest(self, triangles: Float64) -> Int64:
        """(n,) int64: each object's coarsest level of at least so many `triangles`, (n,) float64;
        0 where none but the full one has."""
        enough = self.sizes >= triangles
        levels = np.arange(len(self.sizes))[:, None]
        result: Int64 = np.where(enough, levels, 0).max(axis=0)
        return result

    def mixed(self, units: Int64, level_of: Int64) -> Scene:
        """The scene with these units alone, (k,) object ids, each at its level: `level_of`, (n,)
        int64."""
        every = np.arange(self.scene.object_count)
        sizes = np.zeros(len(every), np.int64)
        sizes[units] = self.sizes[level_of, every][units]
        offsets = np.concatenate([[0], np.cumsum(sizes)])
        at = np.repeat(self.starts[level_of, every] - offsets[:-1], sizes)
        chosen = at + np.arange(offsets[-1])
        return Scene(
            vertices=self.vertices,
            triangles=self.triangles[chosen],
            object_offsets=offsets,
            names=self.scene.names,
            one_sided=self.one_sided[chosen],
            alpha=self.alpha[chosen],
            source=f"levels of detail of {self.scene.source}",
        )


def _owners(raster: GLRaster, scene: Scene, camera: Camera) -> Int64:
    """(height, width) int64: the object that owns each sample, -1 for none."""
    triangle = raster.item_buffer(camera)
    objects = np.append(scene.object_of_triangle, -1)
    return objects[np.where(triangle >= 0, triangle, len(objects) - 1)].astype(np.int64)
