"""What the engine draws of a compiled map: `R_MarkLeaves` and `R_RecursiveWorldNode` of Quake III's
renderer (id Software, GPL, 2005), in the map's own axes.

The eye's leaf has a cluster, whose row of the PVS says which other clusters may be seen. Every leaf
of one of those that is not cut off by the frustum draws the faces that it lists. An eye in no
cluster, or a map without PVS, draws the faces of all leaves that have a cluster. Area portals are
open. What the renderer then culls face by face, what is turned away above all, is not done here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref_bsp.lumps import Bsp
from visref_bsp.scene import theirs


def leaf_at(bsp: Bsp, point: NDArray[np.float64]) -> int:
    """The leaf of a point in the map's axes; a point on a plane is behind it, as in the engine."""
    at = 0 if len(bsp.nodes) else -1
    while at >= 0:
        node = bsp.nodes[at]
        plane = bsp.planes[node["plane"]]
        in_front = plane["normal"].astype(np.float64) @ point > plane["distance"]
        at = int(node["child"][0 if in_front else 1])
    return -1 - at


def leaves_drawn(bsp: Bsp, eye: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(leaves,): those that the PVS lets through."""
    clusters = bsp.leaves["cluster"]
    cluster = int(clusters[leaf_at(bsp, eye)])
    if bsp.pvs is None or cluster < 0:
        return clusters >= 0
    seen: NDArray[np.bool_] = bsp.pvs[cluster][np.maximum(clusters, 0)] & (clusters >= 0)
    return seen


def in_frustum(bsp: Bsp, camera: Camera) -> NDArray[np.bool_]:
    """(leaves,): those that no box on the way down to them lies beyond one of the view's sides."""
    sides = frustum(camera)
    seen = np.zeros(len(bsp.leaves), np.bool_)
    beyond = _beyond(bsp.nodes["least"], bsp.nodes["most"], sides)
    leaf_beyond = _beyond(bsp.leaves["least"], bsp.leaves["most"], sides)
    waiting = [0] if len(bsp.nodes) else [-1]
    while waiting:
        at = waiting.pop()
        if at < 0:
            seen[-1 - at] = not leaf_beyond[-1 - at]
        elif not beyond[at]:
            waiting.extend(bsp.nodes["child"][at].tolist())
    return seen


def frustum(camera: Camera) -> NDArray[np.float64]:
    """(4, 4): a x + b y + c z + d >= 0 within each side, in the map's axes."""
    clip = camera.clip_from_world(far=camera.near + 1.0)
    rows = np.array([clip[3] + clip[0], clip[3] - clip[0], clip[3] + clip[1], clip[3] - clip[1]])
    # The map's (x, y, z) is (x, z, -y) in the world, and so are a plane's numbers.
    return np.stack([rows[:, 0], -rows[:, 2], rows[:, 1], rows[:, 3]], axis=1)


def _beyond(
    least: NDArray[np.int32], most: NDArray[np.int32], sides: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n,): whether a box lies wholly beyond a side, by the corner that is furthest within."""
    normals = sides[:, None, :3]
    reached = np.where(normals > 0, normals * most, normals * least).sum(axis=2) + sides[:, 3:]
    result: NDArray[np.bool_] = (reached < 0).any(axis=0)
    return result


def drawn(bsp: Bsp, camera: Camera, *, with_frustum: bool) -> list[int]:
    """The world's faces that are drawn from there, ascending."""
    leaves = leaves_drawn(bsp, theirs(camera.eye))
    if with_frustum:
        leaves &= in_frustum(bsp, camera)
    marked = np.zeros(len(bsp.faces), np.bool_)
    for leaf in bsp.leaves[leaves]:
        marked[bsp.leaf_faces[leaf["face"] : leaf["face"] + leaf["faces"]]] = True
    return [face for face in bsp.world if marked[face]]


def way(
    bsp: Bsp, start: NDArray[np.float64], end: NDArray[np.float64]
) -> list[tuple[float, float, int]]:
    """The leaves along a segment in the map's axes: from and to which part of it, and which."""
    pieces: list[tuple[float, float, int]] = []
    waiting = [(0 if len(bsp.nodes) else -1, 0.0, 1.0)]
    while waiting:
        at, first, last = waiting.pop()
        if at < 0:
            pieces.append((first, last, -1 - at))
            continue
        node = bsp.nodes[at]
        plane = bsp.planes[node["plane"]]
        normal = plane["normal"].astype(np.float64)
        ends = [
            normal @ (start + (end - start) * t) - float(plane["distance"]) for t in (first, last)
        ]
        near = int(ends[0] <= 0)
        if (ends[0] > 0) == (ends[1] > 0):
            waiting.append((int(node["child"][near]), first, last))
            continue
        middle = first + (last - first) * ends[0] / (ends[0] - ends[1])
        waiting.append((int(node["child"][1 - near]), middle, last))
        waiting.append((int(node["child"][near]), first, middle))
    return pieces
