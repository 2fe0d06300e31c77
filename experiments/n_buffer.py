"""What an N-buffer's levels cost to build, and how tightly its squares cover rectangles.

Décoret 2005, Table 1 and Fig. 4.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from visref.camera_path import CameraPath
from visref.scene import Int64, Scene
from visref_culling.gl.device import State, device
from visref_culling.n_buffer.cover import FOUR, ONE, Cover, four_squares, one_square
from visref_culling.n_buffer.gpu import NBufferTexture
from visref_culling.n_buffer.levels import build_levels, level_count
from visref_experiments.timing import quickest_ms

SIZES = ((256, 256), (512, 512), (640, 480), (1024, 1024))
ROUNDS = 5
LARGEST_PX = 512
# Where Fig. 4's surface is kept for drawing: every so many pixels along each side.
SHOWN_STEP_PX = 16


def levels(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """By size: the levels above level 0, and milliseconds to build them all on the GPU from a
    depth buffer and on the CPU from a depth map."""
    result: dict[str, Any] = {"sizes": [list(size) for size in SIZES], "levels": []}
    result |= {"gpu_ms": [], "cpu_ms": []}
    gl = device()
    for size in SIZES:
        result["levels"].append(level_count(*size))
        target = gl.target(*size)
        gl.clear(State(target.framebuffer, gl.program("mesh.vert", "plain.frag")))
        made = NBufferTexture(gl, *size)
        depth = np.random.default_rng(0).random(size[::-1], np.float32)
        on_gpu, on_cpu = partial(made.build, target), partial(build_levels, depth)
        gpu_ms, cpu_ms = quickest_ms(on_gpu, on_cpu, rounds=ROUNDS)
        result["gpu_ms"].append(gpu_ms)
        result["cpu_ms"].append(cpu_ms)
        made.release()
    return result


def coverage(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """Over rectangles of every size up to `LARGEST_PX` a side: pixels covered beyond the
    rectangle over the rectangles' own, with one square and with four; the share of sizes that
    four cover exactly; and one row of the surface, rectangles of `heights` by a width of 512."""
    sides = np.arange(1, LARGEST_PX + 1)
    width, height = (grid.reshape(-1) for grid in np.meshgrid(sides, sides))
    rectangles = np.stack([0 * width, 0 * height, width - 1, height - 1], axis=1).astype(np.int32)
    own = width * height
    result: dict[str, Any] = {}
    for squares, cover in ((ONE, one_square), (FOUR, four_squares)):
        extra = covered_pixels(cover(rectangles)) - own
        result[f"extra_{squares}"] = float(extra.sum() / own.sum())
        result[f"exact_{squares}"] = float(np.mean(extra == 0))
        shown = (width == LARGEST_PX) & (height % SHOWN_STEP_PX == 0)
        result[f"row_{squares}"] = (extra[shown] / own[shown]).tolist()
        result["heights"] = height[shown].tolist()
    return result


def covered_pixels(cover: Cover) -> Int64:
    """(k,) int64 pixels in the union of each rectangle's squares, which leave no gap between."""
    side = 1 << cover.level
    across = cover.x.max(axis=1) - cover.x.min(axis=1) + side
    down = cover.y.max(axis=1) - cover.y.min(axis=1) + side
    pixels: Int64 = across * down
    return pixels
