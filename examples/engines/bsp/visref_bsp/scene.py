"""The faces of a compiled map as a scene, an object for each.

The engine walks the leaves that the PVS lets through and draws each face that one of them lists,
once: so a face is what it skips or draws, and not a leaf, of which neighbours share faces. Objects
stand in the file's order and are called `face0`, `face1`, ...; their paths begin with their shader.

Axes: the map's (x, y, z), with z up, is (x, z, -y) here, which rounds nothing. Units stay.

- Curved faces (biquadratic Bezier patches) become `STEPS` by `STEPS` pairs of triangles for each
  patch of three by three points; the engine chooses its own steps, by distance.
- Every face hides what is behind it: shader scripts are not read, and the map itself does not tell
  a pane from a teleporter that is painted on a wall. So glass, water, grates and the sky count as
  walls, which makes fewer things visible, and accuses no PVS wrongly.
- Flares, and faces that are not drawn (`SURF_NODRAW`), keep their ids without triangles.
- Doors, lifts and all else that is an entity's are left out, as if they stood open.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.findings import Code
from visref.formats import NO_MESH, Mesh, Placed
from visref.memory import Budget
from visref_bsp.lumps import (
    FIX,
    FLARE,
    PATCH,
    SURFACE_NODRAW,
    Bsp,
    load,
)

STEPS = 8


def name_of(face: int) -> str:
    return f"face{face}"


def read_bsp(path: Path, *, budget: Budget) -> Placed:
    """The world's faces. Raises InputError where the file is no such map, or broken."""
    return placed(load(path), budget)


def placed(bsp: Bsp, budget: Budget) -> Placed:
    faces = bsp.faces[bsp.world.start : bsp.world.stop]
    pieces = np.where(faces["kind"] == PATCH, 2 * STEPS**2 * faces["vertices"].astype(np.int64), 0)
    corners = pieces.sum() * 3 + faces["mesh_vertices"].sum(dtype=np.int64)
    count = int(faces["vertices"].sum(dtype=np.int64) + corners)
    budget.claim("the map's faces", vertices=count, triangles=count)
    result = Placed()
    for number, face in zip(bsp.world, faces, strict=True):
        shader = bsp.shaders[face["shader"]]
        mesh = NO_MESH
        if not shader["surface"] & SURFACE_NODRAW and face["kind"] != FLARE:
            try:
                positions, triangles = _geometry(bsp, face)
            except InputError as error:
                raise error.at(place=f"faces[{number}]") from None
            mesh = len(result.meshes)
            result.meshes.append(Mesh.plain(ours(positions), triangles))
        name = name_of(number)
        path = f"{shader['name'].decode('latin-1')}/{name}"
        result.add(name, mesh, np.eye(4), path=path)
    if left := len(bsp.faces) - len(faces):
        result.notes.append(
            (Code.PARTLY_READ, f"{left} faces of doors, lifts and other entities are left out")
        )
    return result


def ours(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """(n, 3) points of the map, whose z is up, with y up. The world is not mirrored by it."""
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def theirs(point: NDArray[np.float64]) -> NDArray[np.float64]:
    """The other way round."""
    return np.array([point[0], -point[2], point[1]])


def _geometry(bsp: Bsp, face: np.void) -> tuple[NDArray[np.floating], NDArray[np.int64]]:
    """(v, 3) points and (t, 3) triangles, counterclockwise from where the face is seen: the map's
    are clockwise."""
    points = bsp.vertices["place"][face["vertex"] : face["vertex"] + face["vertices"]]
    if face["kind"] == PATCH:
        across, along = face["size"].tolist()
        if across < 3 or along < 3 or not across % 2 or not along % 2:
            raise InputError(f"a patch of {across} by {along} points", fix=FIX)
        if across * along != len(points):
            raise InputError(f"{across} by {along} points of a patch are {len(points)}", fix=FIX)
        return _tessellated(points.reshape(along, across, 3).astype(np.float64))
    first = face["mesh_vertex"]
    corners = bsp.mesh_vertices[first : first + face["mesh_vertices"]].astype(np.int64)
    if len(corners) % 3:
        raise InputError(f"{len(corners)} mesh vertices are no triangles", fix=FIX)
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
        raise InputError(f"a mesh vertex is none of its {len(points)} vertices", fix=FIX)
    return points, corners.reshape(-1, 3)[:, ::-1]


def _tessellated(grid: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Of (along, across, 3) control points, both odd: neighbouring patches share a row."""
    surface = _curves(_curves(grid).transpose(1, 0, 2)).transpose(1, 0, 2)
    along, across = surface.shape[:2]
    at = np.arange(along * across).reshape(along, across)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]
    triangles = np.stack([a, b, c, c, b, d], axis=-1).reshape(-1, 3)
    return surface.reshape(-1, 3), triangles


def _curves(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quadratic Bezier curves down the columns, `STEPS` steps for each three points of one."""
    t = (np.arange(STEPS) / STEPS)[:, None, None]
    first, middle, last = grid[:-2:2, None], grid[1:-1:2, None], grid[2::2, None]
    points = first * (1 - t) ** 2 + middle * (2 * t * (1 - t)) + last * t**2
    return np.concatenate([points.reshape(-1, *grid.shape[1:]), grid[-1:]])
