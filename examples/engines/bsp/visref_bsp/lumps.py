"""A compiled map, as it lies in its file: IBSP version 46, of Quake III and its kin.

A header names 17 lumps by offset and length; each is an array of records. Source: id Software's
`qfiles.h` (GPL, of 2005), and K. Proudfoot's "Unofficial Quake 3 Map Specs". What a record refers
to is checked here, once, so that what reads a `Bsp` can index without a thought.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError

Records = NDArray[Any]

MAGIC, VERSION = b"IBSP", 46
FIX = "export or copy it anew"
# Kinds of faces.
PLANAR, PATCH, TRIANGLES, FLARE = 1, 2, 3, 4
# What a shader says of its faces.
SURFACE_NODRAW = 0x80

LUMPS: dict[str, tuple[int, Any]] = {
    "entities": (0, np.uint8),
    "shaders": (1, [("name", "S64"), ("surface", "<u4"), ("contents", "<u4")]),
    "planes": (2, [("normal", "<f4", 3), ("distance", "<f4")]),
    "nodes": (3, [("plane", "<i4"), ("child", "<i4", 2), ("least", "<i4", 3), ("most", "<i4", 3)]),
    "leaves": (
        4,
        [
            *(("cluster", "<i4"), ("area", "<i4"), ("least", "<i4", 3), ("most", "<i4", 3)),
            *(("face", "<i4"), ("faces", "<i4"), ("brush", "<i4"), ("brushes", "<i4")),
        ],
    ),
    "leaf_faces": (5, "<i4"),
    "leaf_brushes": (6, "<i4"),
    "models": (
        7,
        [
            *(("least", "<f4", 3), ("most", "<f4", 3), ("face", "<i4"), ("faces", "<i4")),
            *(("brush", "<i4"), ("brushes", "<i4")),
        ],
    ),
    "brushes": (8, [("side", "<i4"), ("sides", "<i4"), ("shader", "<i4")]),
    "vertices": (10, [("place", "<f4", 3), ("rest", "V32")]),
    "mesh_vertices": (11, "<i4"),
    "faces": (
        13,
        [
            *(("shader", "<i4"), ("fog", "<i4"), ("kind", "<i4"), ("vertex", "<i4")),
            *(("vertices", "<i4"), ("mesh_vertex", "<i4"), ("mesh_vertices", "<i4")),
            *(("lightmap", "V68"), ("size", "<i4", 2)),
        ],
    ),
    "visibility": (16, np.uint8),
}


@dataclass(frozen=True, eq=False)
class Bsp:
    """The lumps that are used, as records in the file's order.

    `nodes`: `child` below zero is leaf `-1 - child`; a child node stands behind its parent.
    `leaves`: `cluster` -1 is solid, or outside. `pvs`: (clusters, clusters) bool, whether what is
    in the second may be seen from the first; None where the map was compiled without.
    """

    entities: str
    shaders: Records
    planes: Records
    nodes: Records
    leaves: Records
    leaf_faces: Records
    leaf_brushes: Records
    models: Records
    brushes: Records
    vertices: Records
    mesh_vertices: Records
    faces: Records
    pvs: NDArray[np.bool_] | None

    @property
    def world(self) -> range:
        """The faces of the world, which the tree holds; the rest are those of doors and lifts."""
        first = int(self.models["face"][0])
        return range(first, first + int(self.models["faces"][0]))


def load(file: Path | str) -> Bsp:
    """Raises InputError for whatever is wrong with it; the place is a lump, and a record of it."""
    try:
        data = Path(file).read_bytes()
    except OSError as error:
        raise InputError(f"cannot read it: {error.strerror}", source=str(file)) from None
    return parse(data)


def parse(data: bytes) -> Bsp:
    """As `load`, of the file's bytes."""
    head = np.frombuffer(data[:144], "<i4") if len(data) >= 144 else None
    if head is None or data[:4] != MAGIC:
        raise InputError("this is no compiled map (IBSP)", fix="give a .bsp file of Quake III")
    if head[1] != VERSION:
        raise InputError(f"this is version {head[1]} of IBSP", fix=f"version {VERSION} is read")
    lumps: dict[str, Any] = {
        name: _lump(data, name, *head[2 + 2 * at : 4 + 2 * at].tolist(), np.dtype(kind))
        for name, (at, kind) in LUMPS.items()
    }
    entities = lumps.pop("entities").tobytes().split(b"\0")[0].decode("latin-1")
    bsp = Bsp(entities, pvs=_pvs(lumps.pop("visibility")), **lumps)
    _check(bsp)
    return bsp


def _lump(data: bytes, name: str, offset: int, length: int, kind: np.dtype[Any]) -> Records:
    if offset < 0 or length < 0 or offset + length > len(data):
        raise InputError(
            f"it lies at bytes {offset} to {offset + length} of {len(data)}", place=name, fix=FIX
        )
    if length % kind.itemsize:
        raise InputError(f"{length} bytes are no records of {kind.itemsize}", place=name, fix=FIX)
    return np.frombuffer(data, kind, length // kind.itemsize, offset)


def _pvs(lump: Records) -> NDArray[np.bool_] | None:
    """A row of bits for each cluster, the lowest bit of a byte first, uncompressed."""
    if not lump[:4].any():  # no lump, or no cluster: compiled without
        return None
    clusters, row = lump[:8].view("<i4").tolist() if len(lump) >= 8 else (-1, -1)
    if clusters < 1 or row < (clusters + 7) // 8 or len(lump) - 8 < clusters * row:
        raise InputError(
            f"{clusters} clusters of {row} bytes do not fit its {len(lump)} bytes",
            place="visibility",
            fix=FIX,
        )
    rows = lump[8 : 8 + clusters * row].reshape(clusters, row)
    return np.unpackbits(rows, axis=1, count=clusters, bitorder="little").astype(np.bool_)


def _check(bsp: Bsp) -> None:
    """Every number of a record is one of what it numbers."""
    if not len(bsp.models):
        raise InputError("there is no world", place="models", fix=FIX)
    faces, leaves, nodes = bsp.faces, bsp.leaves, bsp.nodes
    _within("models", bsp.models["face"], bsp.models["faces"], len(faces), "faces")
    _within("faces", faces["vertex"], faces["vertices"], len(bsp.vertices), "vertices")
    _within(
        *("faces", faces["mesh_vertex"], faces["mesh_vertices"]),
        *(len(bsp.mesh_vertices), "mesh vertices"),
    )
    _numbers("faces", faces["shader"], len(bsp.shaders), "shader")
    _within("leaves", leaves["face"], leaves["faces"], len(bsp.leaf_faces), "faces of leaves")
    _numbers("leaf_faces", bsp.leaf_faces, len(faces), "face")
    _within(
        *("leaves", leaves["brush"], leaves["brushes"]),
        *(len(bsp.leaf_brushes), "brushes of leaves"),
    )
    _numbers("leaf_brushes", bsp.leaf_brushes, len(bsp.brushes), "brush")
    _numbers("brushes", bsp.brushes["shader"], len(bsp.shaders), "shader")
    _numbers("nodes", nodes["plane"], len(bsp.planes), "plane")
    if bsp.pvs is not None:
        _numbers("leaves", np.maximum(leaves["cluster"], 0), len(bsp.pvs), "cluster")
    children = nodes["child"].astype(np.int64)
    own = np.arange(len(nodes))[:, None]
    # A node before its parent could be its ancestor, and the walk down the tree would not end.
    bad = np.where(children >= 0, (children <= own) | (children >= len(nodes)), False)
    bad |= (children < 0) & (-1 - children >= len(leaves))
    if bad.any():
        place, side = np.argwhere(bad)[0].tolist()
        raise InputError(
            f"there is no child {children[place, side]} for it", place=f"nodes[{place}]", fix=FIX
        )
    if not len(leaves):
        raise InputError("there is no leaf", place="leaves", fix=FIX)
    if not np.isfinite(bsp.planes["normal"]).all() or not np.isfinite(bsp.planes["distance"]).all():
        raise InputError("a plane is not finite", place="planes", fix=FIX)


def _within(lump: str, first: Records, count: Records, there_are: int, what: str) -> None:
    first, count = first.astype(np.int64), count.astype(np.int64)
    bad = (count < 0) | ((count > 0) & ((first < 0) | (first + count > there_are)))
    if bad.any():
        at = int(np.argmax(bad))
        raise InputError(
            f"it names {what} {first[at]} to {first[at] + count[at]} of {there_are}",
            place=f"{lump}[{at}]",
            fix=FIX,
        )


def _numbers(lump: str, numbers: Records, there_are: int, what: str) -> None:
    bad = (numbers < 0) | (numbers >= there_are)
    if bad.any():
        at = int(np.argmax(bad))
        raise InputError(
            f"it names {what} {numbers[at]} of {there_are}", place=f"{lump}[{at}]", fix=FIX
        )
