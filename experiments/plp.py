"""What cPLP's ways of asking cost on this machine, how good PLP's estimate is, and what it and its
preparation take.

Klosowski, Silva 2001, section 4. Each time of a single step is the quickest of several rounds after
one that warms up: whatever else the machine does only adds to it. Times along the path are given
frame by frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import moderngl
import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import QueryStats
from visref.formats import load_scene
from visref.inputs import scene_file
from visref.scene import Float32, Int32, Scene
from visref_culling.boxes.conservative import inflated, needs_no_query, round_outward
from visref_culling.gl.device import State, Target, device
from visref_culling.gl.view import View
from visref_culling.item_buffer_engine import ItemBufferEngine
from visref_culling.plp.cplp import ConservativePLPCulling
from visref_culling.plp.octree import build
from visref_culling.plp.plp import PLPCulling
from visref_culling.plp.solidity import by_area, by_count
from visref_culling.queries.histogram import HistogramQueries
from visref_culling.queries.item_buffer_query import ItemBufferQueries
from visref_culling.queries.occlusion_query import BoxQueries
from visref_experiments.timing import quickest_ms

SIDES_PX = (64, 512)
CHANNELS = (1, 4)
IDS = 255

# The paper's leaves, and smaller ones: then many cells are asked at once.
LEAVES = (5_000, 500, 30)
BUDGET = 25_000

FRAMES = 6  # of the path, among which the largest front is looked for

QUALITY_BUDGETS = (10_000, 25_000, 50_000, 100_000)

# Of the scene's triangles, for the sweep over the leaves' size.
SWEEP_BUDGET = 0.1
SWEEP_LEAVES = (5_000, 2_500, 1_250, 625)
SOLIDITIES = ("area", "count")

# Table 3's.
TIME_BUDGETS = (1_000, 10_000, 25_000, 50_000, 75_000, 100_000)

ROUNDS = 5


def primitives(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Table 2: milliseconds to read ids from square images and to scan them, by the image's
    side and the channels read; and to count them on the GPU instead."""
    return {"images": [_primitives(side) for side in SIDES_PX]}


def _primitives(side: int) -> dict[str, Any]:
    target = device().target(side, side, channels=4)
    histogram = HistogramQueries(device())
    histogram.begin(side, side)
    device().clear(State(target.framebuffer, histogram.program))
    items = np.zeros((side, side, 4), np.uint8)
    items[..., 0] = np.random.default_rng(0).integers(0, IDS, (side, side))
    image = target.scratch.color_attachments[0]
    assert isinstance(image, moderngl.Texture)
    image.write(items.tobytes())
    transfer, scan = [], []
    for channels in CHANNELS:
        ids = np.frombuffer(
            target.scratch.read(components=channels, alignment=1),
            np.uint8 if channels == 1 else np.uint32,
        )
        read = partial(target.scratch.read, components=channels, alignment=1)
        count = partial(np.bincount, ids, minlength=IDS + 1)
        times = quickest_ms(read, count, rounds=ROUNDS)
        transfer.append(times[0])
        scan.append(times[1])
    on_gpu = partial(histogram.scan, target.scratch, histogram.active, IDS, QueryStats())
    (histogram_ms,) = quickest_ms(on_gpu, rounds=ROUNDS)
    result = {
        "side_px": side,
        "channels": list(CHANNELS),
        "transfer_ms": transfer,
        "scan_ms": scan,
        "histogram_ms": histogram_ms,
    }
    histogram.release()
    return result


def queries(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """By the leaves' size: the largest front that PLP's estimate leaves along the path, and the
    milliseconds to ask all of its cells, by the way of asking."""
    assert scene is not None
    assert path is not None
    cameras = path.cameras[:: -(-len(path) // FRAMES)]
    return {"fronts": [_front(scene, cameras, leaf) for leaf in LEAVES]}


class _Estimate(PLPCulling):
    """PLP alone, with room for ids beside its picture."""

    def target_for(self, camera: Camera) -> Target:
        return self.device.target(camera.width, camera.height, self.depth_bits, channels=4)


def _front(scene: Scene, cameras: Sequence[Camera], leaf: int) -> dict[str, Any]:
    culler = _Estimate(leaf=leaf, budget=BUDGET)
    culler.prepare(scene)
    fronts = [_asked_after_estimate(culler, camera) for camera in cameras]
    most = int(np.argmax([len(boxes) for boxes in fronts]))
    camera, boxes = cameras[most], fronts[most]
    culler.cull(camera)
    view, target = View.of(camera, scene, device().subpixel_bits), culler.target_for(camera)
    hardware = BoxQueries(device())
    items = {"item-buffer": ItemBufferQueries(device()), "histogram": HistogramQueries(device())}

    def ask(way: str) -> Any:
        stats = QueryStats()
        if way not in items:
            return hardware.ask(view, target, boxes, stats, way=way, cull_back_faces=True)
        items[way].begin(camera.width, camera.height)
        return items[way].ask(
            view, target.scratch, boxes, stats, whole_front=False, cull_back_faces=True
        )

    samples = ask("batch")
    covered = hardware.fragments(view, target, boxes, cull_back_faces=True)
    ways = ("sync", "batch", "instanced", "counted", *items)
    times = quickest_ms(*(partial(ask, way) for way in ways), rounds=ROUNDS)
    result = {
        "leaf": leaf,
        "cells": len(boxes),
        "visible": int(np.count_nonzero(samples)),
        "fragments": int(covered.sum()),
        "ms": dict(zip(ways, times, strict=True)),
    }
    hardware.release()
    for of_way in items.values():
        of_way.release()
    culler.close()
    return result


def _asked_after_estimate(culler: PLPCulling, camera: Camera) -> Float32:
    """The boxes that the front's first question is about."""
    culler.cull(camera)
    view = View.of(camera, culler.scene, culler.device.subpixel_bits)
    boxes = inflated(view, culler.unit_boxes[culler.walk.front()])
    return round_outward(boxes[~needs_no_query(view, boxes)])


def quality(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """The share of the visible triangles that PLP draws, by budget and frame. Visible is what
    owns a pixel of the rasteriser's own unculled picture."""
    assert scene is not None
    assert path is not None
    owners = _owners(scene, path)
    found = [_estimated(scene, path, owners, budget=budget)["found"] for budget in QUALITY_BUDGETS]
    return {"budgets": list(QUALITY_BUDGETS), "found": found}


def leaves(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """PLP alone on a tenth of the triangles, by the leaves' size and what solidity is taken from:
    by frame, the share of the visible triangles that it draws, and of the pixels that it gets
    wrong."""
    assert scene is not None
    assert path is not None
    owners = _owners(scene, path)
    budget = round(SWEEP_BUDGET * scene.triangle_count)
    sweep = {
        solidity: [
            {"leaf": leaf}
            | _estimated(scene, path, owners, budget=budget, leaf=leaf, solidity=solidity)
            for leaf in SWEEP_LEAVES
        ]
        for solidity in SOLIDITIES
    }
    return {"budget": budget, "sweep": sweep}


def _owners(scene: Scene, path: CameraPath) -> list[Int32]:
    """By frame, the triangle at each pixel of the rasteriser's unculled picture, -1 for none."""
    engine = ItemBufferEngine(scene)
    owners = [engine.frame(camera).buffer.triangle for camera in path]
    engine.close()
    return owners


def _estimated(
    scene: Scene, path: CameraPath, owners: Sequence[Int32], **options: Any
) -> dict[str, Any]:
    culler = PLPCulling(**options)
    units = culler.prepare(scene)
    found, wrong = [], []
    for camera, owner in zip(path, owners, strict=True):
        drawn = units.mask(culler.cull(camera).unit_ids, scene.triangle_count)
        owned = owner[owner >= 0]
        visible = np.unique(owned)
        found.append(float(drawn[visible].mean()) if len(visible) else 1.0)
        wrong.append(float(np.count_nonzero(~drawn[owned]) / owner.size))
    culler.close()
    return {"cells": units.count, "found": found, "wrong": wrong}


def times(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Table 3's "PLP Time" beside the whole: milliseconds of PLP alone and of cPLP, by budget and
    frame. They take turns, frame by frame, after a frame that warms up."""
    assert scene is not None
    assert path is not None
    cameras = list(path)
    result: dict[str, Any] = {"budgets": list(TIME_BUDGETS), "plp_ms": [], "cplp_ms": []}
    cullers = {"plp_ms": PLPCulling(), "cplp_ms": ConservativePLPCulling()}
    for culler in cullers.values():
        culler.prepare(scene)
    for budget in TIME_BUDGETS:
        for key, culler in cullers.items():
            culler.budget = budget
            culler.cull(cameras[0])
            result[key].append([])
        for camera in cameras:
            for key, culler in cullers.items():
                result[key][-1].append(culler.cull(camera).stats.ms["frame"])
    for culler in cullers.values():
        culler.close()
    return result


def preparation(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Milliseconds of each step before the first frame: reading the scene's file, the octree with
    the triangles of each cell, which cells are neighbours, and each kind of solidity."""
    assert scene is not None
    spec = scene.source
    with TemporaryDirectory(prefix="visref-experiment-") as folder:
        file = scene_file(spec, Path(folder))
        read = partial(load_scene, file)
        (load_ms,) = quickest_ms(read, rounds=1)
    octree = build(scene, LEAVES[0])
    jobs: dict[str, Callable[[], object]] = {
        "octree_ms": partial(build, scene, LEAVES[0]),
        "neighbours_ms": octree.links,
        "area_ms": partial(by_area, scene, octree),
        "count_ms": partial(by_count, octree),
    }
    steps = dict(zip(jobs, quickest_ms(*jobs.values(), rounds=2), strict=True))
    return {"leaf": LEAVES[0], "cells": octree.leaf_count, "load_ms": load_ms, **steps}
