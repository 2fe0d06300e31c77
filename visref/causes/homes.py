"""Boxes that an object's place, turn or scale is left out of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from visref.causes.boxes import Boxes
from visref.causes.in_view import kept_by_depth
from visref.causes.sights import At, Tell, Told
from visref.scene import Float64, Scene

Bool = NDArray[np.bool_]

# Of more triangles the boxes at home are not asked for.
MOST = 4_000_000


def home_boxes(scene: Scene, worlds: Float64) -> Float64:
    """(n, 2, 3) float64, the box of each object in its own space. `worlds`: (n, 4, 4),
    world_from_object. Infinities of what has no triangle, or a matrix that cannot be undone."""
    able = np.abs(np.linalg.det(worlds[:, :3, :3])) > 1e-12
    inverse = np.tile(np.eye(4), (len(worlds), 1, 1))
    inverse[able] = np.linalg.inv(worlds[able])
    owner = scene.object_of_triangle
    points = scene.vertices[scene.triangles].astype(np.float64) + scene.origin
    local = np.einsum("tij,tkj->tki", inverse[owner, :3, :3], points) + inverse[owner, None, :3, 3]
    low, high = np.full((2, scene.object_count, 3), np.inf)
    np.minimum.at(low, owner, local.min(axis=1))
    np.minimum.at(high, owner, -local.max(axis=1))
    found = np.stack([low, -high], axis=1)
    found[~able | ~np.isfinite(low).all(axis=1)] = np.inf
    return found


def homes(at: At) -> tuple[Float64, Float64] | None:
    """(k, 2, 3) boxes at home, and (k, 4, 4) world_from_object, of the objects asked about."""
    moments = at.sights.moments
    worlds = moments.timeline.worlds(at.frame)
    if worlds is None or at.scene.triangle_count > MOST:
        return None
    known = moments.homes
    if known is None:
        first = moments.frames[0]
        there = moments.timeline.worlds(first)
        assert there is not None
        known = moments.homes = home_boxes(moments.timeline.at(first), there)
    objects = np.maximum(at.objects(), 0)
    return known[objects], worlds[objects]


def _turns(worlds: Float64) -> tuple[Float64, Float64]:
    """(k, 3, 3) turns, and (k, 3) scales along the object's axes."""
    scales = np.linalg.norm(worlds[:, :3, :3], axis=1)
    return worlds[:, :3, :3] / np.maximum(scales, 1e-12)[:, None], scales


def as_it_is(worlds: Float64) -> Float64:
    """Nothing is done to it."""
    return np.tile(np.eye(4), (len(worlds), 1, 1))


def moved(worlds: Float64) -> Float64:
    """Neither turned nor scaled."""
    found = as_it_is(worlds)
    found[:, :3, 3] = worlds[:, :3, 3]
    return found


def unscaled(worlds: Float64) -> Float64:
    found = worlds.copy()
    found[:, :3, :3] = _turns(worlds)[0]
    return found


def unturned(worlds: Float64) -> Float64:
    found = moved(worlds)
    found[:, [0, 1, 2], [0, 1, 2]] = _turns(worlds)[1]
    return found


def not_moved(worlds: Float64) -> Float64:
    found = worlds.copy()
    found[:, :3, 3] = 0.0
    return found


def placed(how: Callable[[Float64], Float64], *, hidden: bool) -> Tell:
    """The box at home under part of its matrix, in the view, and (`hidden`) against depth."""

    def tell(at: At) -> Told:
        found = homes(at)
        if found is None:
            return None
        boxes, worlds = found
        known = np.isfinite(boxes).all(axis=(1, 2)) & (at.objects() >= 0)
        changed = how(worlds)
        if np.allclose(changed, worlds, atol=1e-9):
            return None
        corners = Boxes(at.camera, boxes).corners
        points = np.einsum("kij,kcj->kci", changed[:, :3, :3], corners) + changed[:, None, :3, 3]
        points -= at.scene.origin
        there = Boxes(at.camera, np.stack([points.min(axis=1), points.max(axis=1)], axis=1))
        kept = kept_by_depth(at, there) if hidden else there.in_view
        return kept | ~known | ~at.boxes.there

    return tell


HOMES: dict[str, Tell] = {
    f"{name}{', hidden' * hidden}": placed(how, hidden=hidden)
    for name, how in (
        ("at home", as_it_is),
        ("moved alone", moved),
        ("not scaled", unscaled),
        ("not turned", unturned),
        ("not moved", not_moved),
    )
    for hidden in (False, True)
}
