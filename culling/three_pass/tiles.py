"""Dividing large objects into tiles: the preprocess of the slides, for scenes that come undivided.

A horizon is one object in most files, and is seen somewhere in nearly every frame: what is asked
about whole saves nothing. An object of more than so many triangles is halved along the widest axis
of its triangles' centroids until no tile has more. Tiles share no triangle and leave none out, so
whatever is true of the units is true of the scene.
"""

from __future__ import annotations

import numpy as np

from visref.scene import OBJECT, Int32, Int64, Scene, Units
from visref_culling.three_pass.parts import halved


def tiles_of(scene: Scene, most: int) -> Units:
    """Units of at most `most` triangles each, tiles of one object after those of the one before;
    objects that are no larger stay whole. Within a tile triangles are in the scene's order."""
    pieces: list[Int64] = []
    large = np.diff(scene.object_offsets) > most
    centroids = scene.vertices.astype(np.float64)[scene.triangles].mean(axis=1)
    for number, (start, end) in enumerate(
        zip(scene.object_offsets[:-1], scene.object_offsets[1:], strict=True)
    ):
        own = np.arange(start, end)
        if large[number]:
            pieces += [np.sort(one) for one in halved(own, centroids, -(-len(own) // most))]
        else:
            pieces.append(own)
    offsets = np.cumsum([0, *map(len, pieces)]).astype(np.int64)
    triangles: Int32 = np.concatenate([np.zeros(0, np.int64), *pieces]).astype(np.int32)
    return Units(offsets, triangles, "tile" if large.any() else OBJECT)


def divided(scene: Scene, tiles: Units) -> Scene:
    """The scene with each tile as an object of its own."""
    counts = np.diff(tiles.offsets)
    # Of an empty object whatever stands at its place; it has one tile, as empty.
    first = np.append(tiles.triangles, 0)[tiles.offsets[:-1]]
    owner = np.full(tiles.count, -1, np.int64)
    owner[counts > 0] = scene.object_of_triangle[first[counts > 0]]
    owner[counts == 0] = np.flatnonzero(np.diff(scene.object_offsets) == 0)
    return Scene(
        vertices=scene.vertices,
        triangles=scene.triangles[tiles.triangles],
        object_offsets=tiles.offsets,
        names=tuple(f"{number}" for number in range(tiles.count)),
        one_sided=scene.one_sided[tiles.triangles],
        alpha=scene.alpha[tiles.triangles],
        source=scene.source,
        origin=scene.origin,
        absent=None if scene.absent is None else scene.absent[owner],
    )
