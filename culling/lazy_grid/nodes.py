"""The bounding-box hierarchy as one camera sees it: which nodes meet the view, and where.

Every node's screen rectangle and depth range are found once a frame, for all nodes in the view
together. The boxes come inflated (`boxes.conservative`), by twice what moves their geometry on the
rasteriser's side; float64 projects them, so half of that is left over for its rounding, which
is some 2**-29 as large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visref.scene import Float64, Int64
from visref_culling.boxes.conservative import inflated, meets_frustum
from visref_culling.boxes.hierarchy import FAN_OUT, BoxTree
from visref_culling.gl.view import View

Area = tuple[int, int, int, int]  # x0, y0, x1, y1 in pixels, half-open, y down

INNER = -1

# The corners at both ends of a box's edges: numbers that differ in one bit.
_EDGES = np.array([(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit])


@dataclass(frozen=True, eq=False)
class ViewNodes:
    """The (k) nodes of a tree that meet a view, the root first, children one after another.

    `boxes`: (k, 2, 3) float64, inflated, relative to the eye; `unit`: (k,) int64, `INNER` for
    a node that is no leaf; `first_child`, `children`: (k,) int64, a range of these nodes.
    """

    boxes: Float64
    unit: Int64
    first_child: Int64
    children: Int64


def nodes_in_view(tree: BoxTree, view: View) -> ViewNodes:
    """Descend from the root, leaving out what lies wholly outside one of the view's planes."""
    nodes = np.arange(len(tree.levels[-1]))
    boxes = inflated(view, tree.levels[-1][nodes])
    meets = meets_frustum(view, boxes)
    nodes, boxes = nodes[meets], boxes[meets]
    parts, units, firsts, counts = [], [], [], []
    seen = 0
    for depth in range(len(tree.levels) - 1, -1, -1):
        seen += len(nodes)
        parts.append(boxes)
        if depth == 0:
            units.append(tree.ids[nodes])
            firsts.append(np.full(len(nodes), seen))
            counts.append(np.zeros(len(nodes), np.int64))
            break
        below = tree.levels[depth - 1]
        children = (nodes[:, None] * FAN_OUT + np.arange(FAN_OUT)).reshape(-1)
        parents = np.repeat(np.arange(len(nodes)), FAN_OUT)
        there = children < len(below)
        children, parents = children[there], parents[there]
        boxes = inflated(view, below[children])
        meets = meets_frustum(view, boxes)
        of_parent = np.bincount(parents[meets], minlength=len(nodes))
        units.append(np.full(len(nodes), INNER))
        firsts.append(seen + np.cumsum(of_parent) - of_parent)
        counts.append(of_parent)
        nodes, boxes = children[meets], boxes[meets]
    return ViewNodes(
        np.concatenate(parts),
        np.concatenate(units),
        np.concatenate(firsts),
        np.concatenate(counts),
    )


def corners_of(boxes: Float64) -> Float64:
    """(k, 8, 3) float64 of boxes (k, 2, 3)."""
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return boxes[:, bits, np.arange(3)]


def clipped_corners(view: View, boxes: Float64) -> Float64:
    """(k, 20, 3) points that span what lies of each box beyond the near plane: its corners
    there, and where its edges cross the plane. A box that has no such point keeps its corners,
    which then mean nothing."""
    corners, near = corners_of(boxes), view.camera.near
    depth = corners @ view.depth_row
    start, end = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    before, after = depth[:, _EDGES[:, 0]], depth[:, _EDGES[:, 1]]
    crosses = (before < near) != (after < near)
    share = (near - before) / np.where(crosses, after - before, 1.0)
    points = np.concatenate([corners, start + share[..., None] * (end - start)], axis=1)
    holds = np.concatenate([depth >= near, crosses], axis=1)
    # Points that do not count repeat one that does.
    first = points[np.arange(len(points)), np.argmax(holds, axis=1)]
    result: Float64 = np.where(holds[..., None], points, first[:, None])
    return result


def pixel_bounds(view: View, corners: Float64) -> tuple[Float64, Float64]:
    """Least and greatest sample coordinates, (k, 2) float64 each, of corners (k, c, 3) that lie
    before the eye."""
    camera, clip_from_relative = view.camera, view.clip_from_relative
    clip = corners @ clip_from_relative[:, :3].T + clip_from_relative[:, 3]
    x = 0.5 * (clip[..., 0] / clip[..., 3] + 1.0) * camera.width - 0.5
    y = 0.5 * (1.0 - clip[..., 1] / clip[..., 3]) * camera.height - 0.5
    low = np.stack([x.min(axis=1), y.min(axis=1)], axis=1)
    high = np.stack([x.max(axis=1), y.max(axis=1)], axis=1)
    return low, high


def areas(low: Float64, high: Float64, width: int, height: int) -> Int64:
    """(k, 4) int64: every sample between the bounds, within the image; x0 >= x1 or y0 >= y1
    where there is none. Outward with bounds of inflated boxes, which hold every sample that
    their geometry may cover."""
    size = (width, height)
    first, after = np.ceil(low), np.floor(high) + 1.0
    return np.concatenate([np.clip(first, 0, size), np.clip(after, 0, size)], axis=1).astype(
        np.int64
    )


def farthest_depth(view: View, boxes: Float64) -> Float64:
    """(k,) float64: the greatest view depth of boxes relative to the eye."""
    row = view.depth_row
    farthest: Float64 = np.where(row > 0.0, boxes[:, 1], boxes[:, 0]) @ row
    return farthest
