"""Where rounding the vertices to float32 moved them by more than a picture forgives.

A scene so large that its own origin does not help still has vertices that were moved. Where one
moved by more than `FORGIVEN_PX`, who owns the samples about it is the rounding's doing as much
as the file's, and convicts nobody.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.exact import ExactScene
from visref.scene import Float64, Int32, Int64, Scene
from visref.visibility import (
    BACKGROUND,
    Doubt,
    FrameTruth,
    Ties,
    VisibilityBuffer,
    hit_depths,
)

# A sixteenth of a pixel: what eight sub-pixel bits of a rasteriser make of it, with room to spare.
FORGIVEN_PX = 1.0 / 16.0


def moved_px(scene: Scene, camera: Camera, triangles: Int32) -> Float64:
    """(k,) float64: by how many pixels rounding moved the vertices of each triangle at most, at
    their view depth or near, whichever is greater."""
    if scene.moved is None or not len(triangles):
        return np.zeros(len(triangles))
    corners = scene.triangles[triangles]
    pixel = 2.0 * camera.half_pixel
    if camera.is_perspective:
        depth = (scene.vertices[corners] - camera.eye) @ camera.forward
        pixels: Float64 = scene.moved[corners] / (pixel * np.maximum(depth, camera.near))
    else:
        pixels = scene.moved[corners].astype(np.float64) / pixel
    greatest: Float64 = pixels.max(axis=1)
    return greatest


def may_matter(scene: Scene, camera: Camera) -> bool:
    """Whether any vertex moved so far that it may be seen from this camera at all."""
    if scene.moved is None:
        return False
    pixel = 2.0 * camera.half_pixel
    least = camera.near if camera.is_perspective else 1.0
    return scene.most_moved > FORGIVEN_PX * pixel * least


def greatest_move(scene: Scene, truth: FrameTruth) -> tuple[float, int]:
    """By how many pixels rounding moved what is seen in a frame at most, and the triangle; (0, -1)
    where nothing moved."""
    if not may_matter(scene, truth.camera):
        return 0.0, -1
    owner = truth.buffer.triangle.reshape(-1)
    seen = np.zeros(scene.triangle_count + 1, np.bool_)
    seen[owner] = True  # the background is -1, the last
    triangles = np.flatnonzero(seen[:-1]).astype(np.int32)
    moves = moved_px(scene, truth.camera, triangles)
    if not len(moves):
        return 0.0, -1
    worst = int(np.argmax(moves))
    return float(moves[worst]), int(triangles[worst])


def in_doubt(exact: ExactScene, truth: FrameTruth, lost: Int64) -> FrameTruth:
    """The truth, with those of the lost samples in doubt whose owner, or what is right behind it,
    has a vertex that moved by more than `FORGIVEN_PX`. `lost`: (k,) int64 flat samples."""
    scene, camera = exact.scene, truth.camera
    if not len(lost) or not may_matter(scene, camera):
        return truth
    everything = np.arange(scene.triangle_count, dtype=np.int32)
    moved = moved_px(scene, camera, everything) > FORGIVEN_PX
    if not moved.any():
        return truth
    sample, triangle = _first_two(exact, camera, lost)
    open_ = np.unique(sample[moved[triangle]])
    if not len(open_):
        return truth
    involved = np.isin(sample, open_)
    shape = truth.buffer.triangle.shape
    owner, depth = (
        truth.buffer.triangle.reshape(-1).copy(),
        truth.buffer.depth.reshape(-1).copy(),
    )
    owner[open_], depth[open_] = BACKGROUND, np.inf
    tied = ~np.isin(truth.ties.sample, open_)
    known = ~np.isin(truth.doubt.at(), open_)
    samples = np.concatenate([truth.doubt.at()[known], sample[involved]])
    triangles = np.concatenate([truth.doubt.triangle[known], triangle[involved]])
    order = np.argsort(samples, kind="stable")
    return replace(
        truth,
        buffer=VisibilityBuffer(owner.reshape(shape), depth.reshape(shape)),
        ties=Ties(truth.ties.sample[tied], truth.ties.triangle[tied]),
        doubt=Doubt.of(samples[order], triangles[order]),
    )


def _first_two(
    exact: ExactScene, camera: Camera, samples: Int64
) -> tuple[Int64, NDArray[np.int32]]:
    """The triangles at the two least depths of each sample: (sample, triangle), front to back."""
    wanted = np.zeros((camera.height, camera.width), np.bool_)
    wanted.reshape(-1)[samples] = True
    hits = exact.hits(camera, np.ones(exact.scene.triangle_count, np.bool_), wanted)
    depth = hit_depths(exact.scene, camera, hits.sample, hits.triangle)
    order = np.lexsort((hits.triangle, depth, hits.sample))
    sample, triangle, depth = hits.sample[order], hits.triangle[order], depth[order]
    fresh = np.ones(len(sample), np.bool_)
    fresh[1:] = sample[1:] != sample[:-1]
    deeper = np.ones(len(sample), np.bool_)
    deeper[1:] = fresh[1:] | (depth[1:] > depth[:-1])
    layer = np.cumsum(deeper)
    first = layer[np.flatnonzero(fresh)][np.cumsum(fresh) - 1] if len(sample) else layer
    kept = layer - first < 2
    return sample[kept], triangle[kept].astype(np.int32)
