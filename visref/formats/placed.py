"""Meshes placed in a world become one Scene: what every file format's reader ends in.

A reader hands over its meshes, once each, and its objects in order: a name, a mesh and a
transform. Everything here is vectorised over triangles, and over the instances of a mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.doing import doing
from visref.errors import InputError
from visref.findings import Code
from visref.formats.place_kernels import place_triangles, place_vertices
from visref.frozen import Fresh, frozen
from visref.masks.instances import MaskRows, MaskTable, MeshMasks
from visref.memory import Budget
from visref.placing import origin_of, placed_boxes, rounded
from visref.rig import Motion, Rig
from visref.scene import (
    Alpha,
    Float64,
    Group,
    Int64,
    Scene,
    check_indices,
    clean_name,
    unique_names,
)

# How many masked triangles get their rows at a time: bounds the scratch memory to some 20 MB.
_BLOCK_TRIANGLES = 1 << 20
_MAX_INT32 = 2**31 - 1

NO_MESH = -1
# Nodes nested without end would take memory for their paths without end.
LONG_PATH = 4096


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh in its own space.

    `positions`: (v, 3) float32 or float64. `triangles`: (t, 3) integers below v.
    `one_sided`: (t,) bool, the material is not double-sided. `alpha`: (t,) uint8, `Alpha`.
    `masks`: of the masked triangles that are looked up, None if there is none.
    """

    positions: NDArray[Any]
    triangles: NDArray[Any]
    one_sided: NDArray[np.bool_]
    alpha: NDArray[np.uint8]
    masks: MeshMasks | None = None

    @classmethod
    def plain(
        cls,
        positions: NDArray[Any],
        triangles: NDArray[Any],
        *,
        one_sided: bool = True,
        alpha: Alpha = Alpha.OPAQUE,
    ) -> Mesh:
        """A mesh of one material, without the vertices that no triangle uses.

        `positions`: (v, 3) float32 or float64. `triangles`: (t, 3) integers below v.
        Raises InputError where a triangle names a vertex that there is not.
        """
        check_indices(triangles, len(positions), lambda bad: f"triangle {bad}")
        positions, triangles = _without_unused(positions, triangles)
        count = len(triangles)
        return cls(
            positions,
            triangles,
            np.full(count, one_sided, np.bool_),
            np.full(count, int(alpha), np.uint8),
        )

    @classmethod
    def joined(cls, parts: Sequence[Mesh]) -> Mesh:
        """Several primitives as one mesh, in order."""
        if len(parts) == 1:
            return parts[0]
        starts = np.cumsum([0, *(len(part.positions) for part in parts)])
        triangles = [
            part.triangles.astype(np.int64) + start
            for part, start in zip(parts, starts, strict=False)
        ]
        empty = (np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int64))
        return cls(
            np.concatenate([empty[0], *(part.positions for part in parts)]),
            np.concatenate([empty[1], *triangles]),
            np.concatenate([np.zeros(0, np.bool_), *(part.one_sided for part in parts)]),
            np.concatenate([np.zeros(0, np.uint8), *(part.alpha for part in parts)]),
            MeshMasks.joined([(len(part.triangles), part.masks) for part in parts]),
        )


@dataclass
class Placed:
    """The objects of a file, in order: a name, a path, a mesh (`NO_MESH` for none), a glTF node (-1
    for none) and `world_from_object` (4, 4) float64 of each; `masks`: the materials and images that
    the meshes' masks name; `groups` and `notes` as in `Scene`. `hidden`: whether each object is
    switched off in the rest pose; of a group with levels of detail all but the finest are absent
    there too. `motion`: how the file animates its objects, None where it does not."""

    meshes: list[Mesh] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    paths: list[str] = field(default_factory=list)
    mesh_of_object: list[int] = field(default_factory=list)
    world_from_object: list[Float64] = field(default_factory=list)
    hidden: list[bool] = field(default_factory=list)
    motion: Motion | None = None
    nodes: list[int] = field(default_factory=list)
    groups: list[Group] = field(default_factory=list)
    masks: MaskTable = field(default_factory=MaskTable)
    notes: list[tuple[Code, str]] = field(default_factory=list)

    def add(
        self,
        name: str,
        mesh: int,
        world_from_object: Float64,
        *,
        path: str = "",
        group: bool = False,
        hidden: bool = False,
        node: int = -1,
    ) -> None:
        """Append instances of a mesh; `world_from_object` is (4, 4) or (k, 4, 4).

        `path`: from the scene graph's root, names with slashes between; by default the name.
        `group`: whether the name stands for all these instances together. `hidden`: whether they
        are switched off in the rest pose. `node`: the glTF node.
        """
        matrices = world_from_object.reshape(-1, 4, 4)
        name = clean_name(name) or "object"
        path = clean_name(path) or name
        if group:
            start = len(self.names)
            self.groups.append(Group(name, path, tuple(range(start, start + len(matrices)))))
        self.names.extend([name] * len(matrices))
        self.paths.extend([path] * len(matrices))
        self.mesh_of_object.extend([mesh] * len(matrices))
        self.hidden.extend([hidden] * len(matrices))
        self.nodes.extend([node] * len(matrices))
        self.world_from_object.append(matrices)


def below(path: str, name: str) -> str:
    """The path of what is called `name` below `path`; either may be empty. Below a path of
    `LONG_PATH` characters a new one starts."""
    return f"{path}/{name}" if path and name and len(path) < LONG_PATH else name or path


def compose(a: Float64, b: Float64) -> Float64:
    """Matrix products `a @ b` of stacks of (4, 4) float64 matrices, every sum in the same order.

    Not `@`: a BLAS may sum in another order, or fuse, on another machine, and a vertex that
    rounds the other way is another scene.
    """
    result: Float64 = a[..., :, 0, None] * b[..., None, 0, :]
    for k in range(1, 4):
        result = result + a[..., :, k, None] * b[..., None, k, :]
    return result


def flatten(
    placed: Placed, *, source: str, cull_backfaces: bool, lenient: bool, budget: Budget
) -> Scene:
    """The Scene of all objects, every vertex transformed in float64 and rounded once, relative
    to the scene's origin.

    A transform with negative determinant flips its triangles' winding. `cull_backfaces`:
    whether `one_sided` takes effect. `lenient`: triangles with a vertex that is not finite
    are dropped and counted in a note, instead of an error.

    Raises InputError where there is no object, a vertex is NaN or infinite, or the scene does not
    fit `budget`.
    """
    if not placed.names:
        raise InputError("there is no mesh in it", source=source, fix="give a file with a mesh")
    mesh_of_object = np.array(placed.mesh_of_object, np.int64)
    worlds = np.concatenate(placed.world_from_object)
    vertex_starts = _starts([len(mesh.positions) for mesh in placed.meshes], mesh_of_object)
    starts = _starts([len(mesh.triangles) for mesh in placed.meshes], mesh_of_object)
    if max(vertex_starts[-1], starts[-1]) > _MAX_INT32:
        raise InputError(
            f"the scene has {starts[-1]} triangles with {vertex_starts[-1]} vertices",
            source=source,
            fix=f"at most {_MAX_INT32} of each can be held",
        )
    # Repeated names get a mark each, and so a string each.
    budget.claim("the objects' names", sum(map(len, placed.names)))
    budget.claim(
        f"{len(mesh_of_object):,} objects with {starts[-1]:,} triangles",
        vertices=int(vertex_starts[-1]),
        triangles=int(starts[-1]),
    )
    order = np.argsort(mesh_of_object, kind="stable")
    ends = np.searchsorted(mesh_of_object[order], np.arange(len(placed.meshes) + 1))
    users = [order[start:end] for start, end in pairwise(ends)]
    origin = origin_of(
        placed_boxes(
            (mesh.positions, worlds[some]) for mesh, some in zip(placed.meshes, users, strict=True)
        )
    )
    vertex_count, count = int(vertex_starts[-1]), int(starts[-1])
    made = [
        Fresh((vertex_count, 3), np.float32),
        Fresh(vertex_count, np.float32),
        Fresh((count, 3), np.int32),
        Fresh(count, np.bool_),
        Fresh(count, np.uint8),
    ]
    vertices, moved, triangles, one_sided, alpha = (one.array for one in made)
    mask_rows = MaskRows(count)
    mirrored = _determinants(worlds) < 0.0
    with doing("placing triangles", count) as reach:
        placed_yet = 0
        for mesh, some in zip(placed.meshes, users, strict=True):
            place_vertices(
                np.array(mesh.positions, np.float64, order="C"),
                *(worlds, some, vertex_starts, origin),
                *(vertices, moved, moved.view(np.int32)),
            )
            sides = np.array(mesh.one_sided, np.uint8) * np.uint8(cull_backfaces)
            place_triangles(
                np.array(mesh.triangles, np.int64, order="C"),
                (sides, np.array(mesh.alpha, np.uint8)),
                *(some, mirrored, vertex_starts, starts),
                triangles,
                (one_sided.view(np.uint8), alpha),
            )
            if mesh.masks is not None:
                bases = mask_rows.add(mesh.masks, mirrored[some])
                block = max(1, _BLOCK_TRIANGLES // max(1, len(mesh.triangles)))
                for at in range(0, len(some), block):
                    rows = starts[some[at : at + block], None] + np.arange(len(mesh.triangles))
                    mask_rows.fill(rows, mesh.masks, bases[at : at + block])
            placed_yet += len(some) * len(mesh.triangles)
            reach(placed_yet)
    vertices, moved, triangles, one_sided, alpha = (one.frozen() for one in made)
    masks = mask_rows.masks(placed.masks)
    finite = None
    names = unique_names(placed.names)
    notes = list(placed.notes)
    if not np.isfinite(vertices).all():
        if not lenient:
            _refuse_not_finite(vertices, vertex_starts, names, source)
        finite = np.all(np.isfinite(vertices), axis=1)
        moved = moved[finite]
        vertices, triangles, kept = _without_not_finite(vertices, triangles)
        one_sided, alpha = one_sided[kept], alpha[kept]
        masks = masks.take(kept) if masks is not None else None
        starts = np.concatenate([[0], np.cumsum(kept)])[starts]
        dropped = int((~kept).sum())
        notes.append(
            (Code.NONFINITE_DROPPED, f"{dropped} triangles with a NaN or infinite vertex dropped")
        )
    empty = np.flatnonzero(np.diff(starts) == 0)
    if len(empty):
        first = f"'{names[empty[0]]}'"
        notes.append((Code.NO_TRIANGLES, f"{len(empty)} objects have no triangles, first {first}"))
    triangles = frozen(triangles)  # The scene and its rig share them.
    hidden = np.array(placed.hidden or [False] * len(names), np.bool_)
    absent = hidden.copy()
    for group in placed.groups:
        for level in group.levels[1:]:
            absent[list(level)] = True
    rig = Rig(
        [mesh.positions for mesh in placed.meshes],
        mesh_of_object,
        worlds,
        vertex_starts,
        finite,
        placed.motion,
        triangles if absent.any() else None,
        hidden if hidden.any() else None,
    )
    return Scene(
        vertices,
        triangles,
        starts,
        names,
        one_sided,
        alpha,
        source,
        tuple(notes),
        masks,
        origin=origin,
        moved=moved if moved.any() else None,
        given_names=tuple(placed.names),
        paths=tuple(placed.paths),
        groups=tuple(placed.groups),
        absent=absent if absent.any() else None,
        rig=rig,
        motion="" if placed.motion is None else placed.motion.digest,
        nodes=np.array(placed.nodes, np.int32) if max(placed.nodes, default=-1) >= 0 else None,
    )


def _starts(sizes: Sequence[int], mesh_of_object: Int64) -> Int64:
    """(n + 1,) int64: where each object's elements start, from the meshes' sizes."""
    by_mesh = np.array([*sizes, 0], np.int64)  # NO_MESH is -1, the last
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(by_mesh[mesh_of_object])])


def transformed(
    worlds: Float64, positions: NDArray[Any], origin: Float64
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """`positions` under each of (k, 4, 4), less the origin: (k, v, 3) float32, float64 until the
    last step, and how far that step moved each, (k, v) float32."""
    exact = np.empty((len(worlds), len(positions), 3))
    x, y, z = (positions[:, axis].astype(np.float64) for axis in range(3))
    for axis in range(3):
        row = worlds[:, axis, :, None]
        exact[:, :, axis] = (row[:, 0] * x + row[:, 1] * y + row[:, 2] * z + row[:, 3]) - origin[
            axis
        ]
    return rounded(exact)


def _determinants(worlds: Float64) -> Float64:
    """Determinants of the linear parts, scaled to survive tiny and huge units."""
    linear = worlds[:, :3, :3]
    scale = np.abs(linear).max(axis=(1, 2), initial=0.0, keepdims=True)
    linear = linear / np.where(scale > 0.0, scale, 1.0)
    cross = np.cross(linear[:, :, 1], linear[:, :, 2])
    result: Float64 = (linear[:, :, 0] * cross).sum(axis=1)
    return result


def used_vertices(vertex_count: int, triangles: NDArray[Any]) -> NDArray[Any]:
    """The vertices that a Mesh of these triangles keeps (`Mesh.plain`), ascending int64 ids."""
    return _without_unused(np.arange(vertex_count), triangles)[0]


def _without_unused(
    positions: NDArray[Any], triangles: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """The same triangles over the vertices that they use.

    Files share one vertex buffer among many primitives: without this each would copy it all.
    """
    if not len(triangles):
        return positions[:0], triangles
    low, high = int(triangles.min()), int(triangles.max())
    if (high - low) // 8 > triangles.size:
        # Few of many, so that a table of all would cost more than sorting those.
        kept, places = np.unique(triangles, return_inverse=True)
        return positions[kept], places.reshape(triangles.shape)
    used = np.zeros(high - low + 1, np.bool_)
    triangles = triangles.astype(np.int64) - low
    used[triangles] = True
    positions = positions[low : high + 1]
    if used.all():
        return positions, triangles
    return positions[used], (np.cumsum(used) - 1)[triangles]


def _refuse_not_finite(
    vertices: NDArray[np.float32], vertex_starts: Int64, names: Sequence[str], source: str
) -> None:
    bad = int(np.argmin(np.all(np.isfinite(vertices), axis=1)))
    owner = int(np.searchsorted(vertex_starts, bad, side="right")) - 1
    where = ", ".join(f"{value:g}" for value in vertices[bad])
    raise InputError(
        f"a vertex is NaN or infinite ({where})",
        source=source,
        place=f"object '{names[owner]}'",
        fix="mend the mesh, or drop such triangles with --lenient",
    )


def _without_not_finite(
    vertices: NDArray[np.float32], triangles: NDArray[np.int32]
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.bool_]]:
    """The finite vertices, the triangles over them, and which triangles those are."""
    finite: NDArray[np.bool_] = np.all(np.isfinite(vertices), axis=1)
    kept: NDArray[np.bool_] = np.all(finite[triangles], axis=1)
    renumbered = (np.cumsum(finite) - 1).astype(np.int32)
    return vertices[finite], renumbered[triangles[kept]], kept
