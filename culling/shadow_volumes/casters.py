"""Shadow volumes of triangle soup: caps, and sides along the silhouette.

What bounds a solid casts by its lit faces alone (`shadow_volumes.closed`): the silhouette is the
edge between lit and unlit, and the shadow of the unlit faces lies in that of the lit ones.

Objects of real scenes are seldom closed, and their triangles face either way. So every other
triangle is turned towards the light first, and casts a prism of its own: itself, the same moved
away from the light, and three sides. Two neighbours' sides along their common edge cancel; what is
left over, counted with its sign, is the silhouette. An edge of three sheets keeps a side, an edge
where two sheets fold back keeps two, and the volume of any soup is closed. A point's count in it
is the number of casting triangles between it and the light. (P. Bergeron, A General Version of
Crow's Shadow Volumes, IEEE Computer Graphics and Applications 6(9), 1986.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from visref.effects.light import Light
from visref.scene import Float32, Float64, Int32, Int64, Scene
from visref_culling.shadow_volumes.closed import bounds_a_solid


@dataclass(frozen=True, eq=False)
class Faces:
    """Triangles of all casters: `indices` (k, 3) int32 sorted by caster, caster i has rows
    `offsets[i]:offsets[i + 1]`."""

    indices: Int32
    offsets: Int64


@dataclass(frozen=True, eq=False)
class Casters:
    """A scene's shadow volumes for one light; caster i is object i.

    `vertex_world`: (v, 3) float32, `caster`: (v,) int32. An index below v means a vertex, from v
    on the same moved away from the light. `caps_front`, `caps_back`: the light caps, those of the
    scene's own triangles that cast, in their own order of corners, whose front or back faces the
    light. `body`: sides and dark caps, counter-clockwise from outside. `solid`: how many triangles
    bound a solid; of these, none of `caps_back` is one.

    `front_lit`, `back_lit`: (k, 3) int32, all triangles whose front or back faces the light,
    casting or not.

    `rectangle`: (n, 4) float64 in lexels, x0, y0, x1, y1, light-space bounds of the vertices
    (pixel k is k ... k + 1); `nearest`, `farthest`: (n,) float64 distances along the light, in
    world units; NaN all for a caster without triangles.
    """

    vertex_world: Float32
    caster: Int32
    caps_front: Faces
    caps_back: Faces
    body: Faces
    solid: int
    front_lit: Int32
    back_lit: Int32
    rectangle: Float64
    nearest: Float64
    farthest: Float64

    @property
    def count(self) -> int:
        return len(self.nearest)


def casters_of(scene: Scene, light: Light) -> Casters:
    """The shadow volumes of a solid scene's objects."""
    vertex_world, caster, triangles = _by_position(scene)
    count, size = scene.object_count, len(vertex_world)
    corners = vertex_world[triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.sign((normal * light.toward(corners[:, 0])).sum(axis=1))
    # Either sign is right where the light grazes a triangle, so float64's is taken; edge-on it
    # casts nothing.
    solid = bounds_a_solid(vertex_world, triangles)
    front, back = triangles[facing > 0.0], triangles[(facing < 0.0) & ~solid]
    turned = np.concatenate([front, back[:, ::-1]])
    body = np.concatenate([_sides(turned, size), turned[:, ::-1] + size])
    rectangle, nearest, farthest = _light_bounds(scene, light)
    return Casters(
        vertex_world=vertex_world,
        caster=caster,
        caps_front=_by_caster(front, caster, count),
        caps_back=_by_caster(back, caster, count),
        body=_by_caster(body, caster, count),
        solid=int(np.count_nonzero(solid)),
        front_lit=front,
        back_lit=triangles[facing < 0.0],
        rectangle=rectangle,
        nearest=nearest,
        farthest=farthest,
    )


def _by_position(scene: Scene) -> tuple[Float32, Int32, Int32]:
    """The corners of each object, one for each position: (v, 3) float32, (v,) int32 objects,
    (t, 3) int32 triangles. Meshes repeat a vertex wherever normals or materials differ."""
    corner = scene.triangles.reshape(-1)
    rows = np.empty((len(corner), 4), np.int32)
    # Adding 0 turns -0 into 0: they are one position.
    rows[:, :3] = (scene.vertices[corner] + np.float32(0.0)).view(np.int32)
    rows[:, 3] = np.repeat(scene.object_of_triangle, 3)
    _, first, index = np.unique(
        rows.view([("", np.int32)] * 4).reshape(-1), return_index=True, return_inverse=True
    )
    points = rows[first, :3].view(np.float32)
    return points, rows[first, 3], index.reshape(-1, 3).astype(np.int32)


def _sides(turned: Int32, size: int) -> Int32:
    """The sides that do not cancel: (k, 3) int32 triangles, two for each, of caps turned
    towards the light. `size`: vertices."""
    start = turned.reshape(-1).astype(np.int64)
    end = turned[:, [1, 2, 0]].reshape(-1).astype(np.int64)
    low, high = np.minimum(start, end), np.maximum(start, end)
    edge, index = np.unique(low * size + high, return_inverse=True)
    # How many more caps run along an edge from its lower vertex than to it.
    surplus = np.bincount(index.reshape(-1), np.where(start < end, 1, -1), len(edge)).astype(int)
    low, high = edge // size, edge % size
    repeat = np.abs(surplus)
    i = np.repeat(np.where(surplus > 0, low, high), repeat)
    j = np.repeat(np.where(surplus > 0, high, low), repeat)
    quads = np.stack([j, i, i + size, j, i + size, j + size], axis=1)
    return quads.reshape(-1, 3).astype(np.int32)


def _by_caster(faces: Int32, caster: Int32, count: int) -> Faces:
    owner = caster[faces[:, 0] % max(len(caster), 1)]
    order = np.argsort(owner, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))])
    return Faces(np.ascontiguousarray(faces[order]), offsets.astype(np.int64))


def _light_bounds(scene: Scene, light: Light) -> tuple[Float64, Float64, Float64]:
    camera = light.camera
    pixel, depth = camera.pixel_of(scene.vertices[scene.triangles.reshape(-1)].astype(np.float64))
    # From pixel centres at whole numbers to lexels that begin there.
    at = np.concatenate([pixel + 0.5, depth[:, None]], axis=1)
    low, high = np.full((2, scene.object_count, 3), np.nan)
    sizes = np.diff(scene.object_offsets)
    starts = 3 * scene.object_offsets[:-1][sizes > 0]
    if len(starts):
        low[sizes > 0] = np.minimum.reduceat(at, starts, axis=0)
        high[sizes > 0] = np.maximum.reduceat(at, starts, axis=0)
    rectangle: NDArray[np.float64] = np.concatenate([low[:, :2], high[:, :2]], axis=1)
    return rectangle, low[:, 2], high[:, 2]
