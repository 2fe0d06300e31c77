"""A glTF file's objects: every node with a mesh, in the order of the hierarchy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from sys import getsizeof

import numpy as np

from visref.doing import doing
from visref.findings import Code
from visref.formats.gltf.accessors import MAX_COUNT, read_floats
from visref.formats.gltf.document import Document
from visref.formats.gltf.masks import MaskReader
from visref.formats.gltf.materials import open_questions
from visref.formats.gltf.meshes import morphs_masks, read_mesh
from visref.formats.gltf.motion import Carrier
from visref.formats.gltf.nodes import Nodes, have_length, read_nodes, trs_matrices
from visref.formats.gltf.rigging import Rigging
from visref.formats.gltf.values import Json
from visref.formats.placed import LONG_PATH, NO_MESH, Placed, below, compose
from visref.memory import OBJECT_BYTES, TRIANGLE_BYTES, VERTEX_BYTES, Budget
from visref.scene import Float64, Group, clean_name
from visref.wording import counted

_INSTANCING = "EXT_mesh_gpu_instancing"
_TRS = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}


def read_gltf(path: Path, *, budget: Budget) -> Placed:
    """The objects of a .glb, .gltf or .vrm file. Raises InputError naming the place."""
    return read_objects(Document(path, budget))


def read_objects(document: Document) -> Placed:
    """The meshes and objects of the file's scene. Raises InputError naming the place."""
    return _Objects(document, read_nodes(document)).read()


@dataclass(frozen=True)
class _Plain:
    """A mesh that a node may show with nothing else to be said: no skin, weights or extension, and
    no clip that deforms it. `need`: what `_claim` asks for, in bytes."""

    index: int
    name: str
    need: int


class _Objects:
    """Reads the objects of a file, node by node. What most of a million nodes are, a name, a place
    and a mesh that is known, takes the way of `_run`; all others `_one`."""

    def __init__(self, document: Document, nodes: Nodes) -> None:
        self.document = document
        self.nodes = nodes
        self.entries = document.entries("nodes")
        self.worlds = nodes.world_from_node()
        self.placed = Placed()
        self.rigging = Rigging(document, nodes)
        self.masks = MaskReader(document, self.placed.masks)
        self.known: dict[tuple[int, int, tuple[float, ...]], tuple[int, int]] = {}
        self.plain: dict[int, _Plain] = {}
        # Of each node the nearest name at or above it, and the path down to it; the last are those
        # of a root's parent, which is -1.
        self.names = [""] * (len(self.entries) + 1)
        self.paths = list(self.names)
        # Of each node of the order, and of its end, how many objects come before.
        self.firsts: list[int] = []
        self.still_coordinates: list[int] = []

    def read(self) -> Placed:
        placed, order, at = self.placed, self.nodes.order, 0
        with doing("reading nodes", len(order)) as reach:
            while at < len(order):
                at = self._run(at)
                if at < len(order):
                    self._one(order[at])
                    at += 1
                reach(at)
        self.firsts.append(len(placed.names))
        placed.motion = self.rigging.motion()
        placed.groups.extend(self._levels())
        placed.notes.extend(self.masks.notes())
        placed.notes.extend(
            (Code.PARTLY_READ, f"extension {name} is not known; it may move or hide geometry")
            for name in self.document.unknown_extensions
        )
        placed.notes.extend((Code.PARTLY_READ, text) for text in open_questions(self.document))
        unplayed = self.rigging.animations.unplayed
        placed.notes.extend(_unplayed(unplayed, self.still_coordinates))
        return placed

    def _run(self, at: int) -> int:
        """Place the plain nodes of the order from `at` on; return where another kind of node, or
        one that something is wrong with, or the end stops it."""
        nodes, placed, budget = self.nodes, self.placed, self.document.budget
        values, parent, names, paths = self.entries.values, nodes.parent, self.names, self.paths
        hidden, still, plain = nodes.hidden, self.rigging.stands_still, self.plain
        placed_names, placed_paths = placed.names, placed.paths
        start, free = len(placed_names), budget.left
        meshes, where, firsts = placed.mesh_of_object, placed.nodes, self.firsts
        for stop in range(at, len(nodes.order)):
            node = nodes.order[stop]
            value, above = values[node], parent[node]
            name, path = value.get("name", ""), paths[above]
            if type(name) is not str:
                break
            down = f"{path}/{name}" if path and name and len(path) < LONG_PATH else name or path
            size = getsizeof(down)
            if "mesh" not in value:
                if size > free:
                    break
                firsts.append(len(placed_names))
                names[node], paths[node] = name or names[above], down
                free -= size
                continue
            if "skin" in value or "weights" in value or "extensions" in value or not still[node]:
                break
            mesh = value["mesh"]
            found = plain.get(mesh) if type(mesh) is int else None
            if found is None or size + found.need > free:
                break
            own = down
            if not name and found.name:
                own = below(path, found.name)
            shown = name or found.name or names[above]
            if not own.isascii() or "\0" in own:
                shown, own = clean_name(shown), clean_name(own)
            firsts.append(len(placed_names))
            names[node], paths[node] = name or names[above], down
            placed_names.append(shown or "object")
            placed_paths.append(own or shown or "object")
            meshes.append(found.index)
            where.append(node)
            free -= size + OBJECT_BYTES
        else:
            stop = len(nodes.order)
        budget.claim("its nodes", budget.left - free)
        if len(placed_names) > start:
            new = where[start:]
            placed.world_from_object.append(self.worlds[new])
            placed.hidden.extend([node in hidden for node in new] if hidden else [False] * len(new))
            self.rigging.skinned.extend([False] * len(new))
        return stop

    def _one(self, node: int) -> None:
        """Place any node."""
        document, rigging, placed = self.document, self.rigging, self.placed
        entry = self.entries[node]
        self.firsts.append(len(placed.names))
        above, path = (them[self.nodes.parent[node]] for them in (self.names, self.paths))
        self.names[node], self.paths[node] = _name(entry) or above, below(path, _name(entry))
        document.budget.claim("the nodes' paths", getsizeof(self.paths[node]))
        if "mesh" not in entry.value:
            return
        mesh = document.entry("meshes", entry["mesh"])
        skin = rigging.skin_of(entry)
        weights, own_weights = _weights(entry, mesh)
        key = (entry["mesh"].integer(), skin, tuple(weights))
        index, deformer = self._mesh(node, mesh, key)
        need = _claim(document, placed, index, entry)
        # A skinned mesh stands where its joints are, wherever its node is.
        world = self.worlds[node] if skin < 0 else np.eye(4)
        instances = _instances(document, entry)
        worlds = world[None] if instances is None else compose(world[None], instances)
        own = _name(entry) or _name(mesh)
        carrier = Carrier(
            node=node,
            mesh=key[0],
            skin=skin,
            first=len(placed.names),
            deformer=deformer,
            weights=key[2],
            own_weights=own_weights,
            worlds=worlds,
            instances=instances,
            drawn=index != NO_MESH,
        )
        rigging.add(carrier)
        placed.add(
            own or above,
            index,
            worlds,
            path=below(path, own),
            group=instances is not None and node not in self.nodes.levels,
            hidden=carrier.drawn and node in self.nodes.hidden,
            node=node,
        )
        if skin < 0 and not own_weights and index != NO_MESH and not rigging.deforms(key[0], -1):
            self.plain.setdefault(key[0], _Plain(index, _name(mesh), need))

    def _mesh(
        self, node: int, mesh: Json, key: tuple[int, int, tuple[float, ...]]
    ) -> tuple[int, int]:
        """The places of a node's mesh and of its deformer, which are read if they were not."""
        rigging, placed = self.rigging, self.placed
        if not rigging.shows(node):
            return NO_MESH, -1
        if key not in self.known:
            number, skin, weights = key
            deforms = rigging.deforms(number, skin)
            joints = rigging.world_from_mesh(skin, self.worlds)
            read, made = read_mesh(self.document, mesh, list(weights), joints, self.masks, deforms)
            index, deformer = len(placed.meshes), -1
            placed.meshes.append(read)
            if made is not None:
                deformer = len(rigging.deformers)
                rigging.deformers.append(made)
                if rigging.morphs(number) and morphs_masks(self.document, mesh):
                    self.still_coordinates.append(number)
            self.known[key] = index, deformer
        return self.known[key]

    def _levels(self) -> list[Group]:
        """The groups of MSFT_lod."""
        if not self.nodes.levels:
            return []
        starts, ends = self.nodes.subtrees

        def objects(node: int) -> tuple[int, ...]:
            return tuple(range(self.firsts[starts[node]], self.firsts[ends[node]]))

        groups = []
        for finest, coarser in self.nodes.levels.items():
            if starts[finest] < 0 or not coarser:
                continue
            levels = tuple(objects(node) for node in (finest, *coarser))
            members = tuple(number for level in levels for number in level)
            entry = self.entries[finest]
            own = _name(entry)
            if not own and "mesh" in entry.value:
                own = _name(self.document.entry("meshes", entry["mesh"]))
            above, path = (them[self.nodes.parent[finest]] for them in (self.names, self.paths))
            name = clean_name(own or above) or "object"
            if members:
                groups.append(Group(name, clean_name(below(path, own)) or name, members, levels))
        return groups


def _name(entry: Json) -> str:
    name = entry.get("name")
    return name.text() if name is not None else ""


def _weights(node: Json, mesh: Json) -> tuple[list[float], bool]:
    """The morph targets' rest weights: the node's, else the mesh's; and whether the node's."""
    for owner in (node, mesh):
        weights = owner.get("weights")
        if weights is not None:
            return [weight.number() for weight in weights.items()], owner is node
    return [], False


def _claim(document: Document, placed: Placed, index: int, node: Json) -> int:
    """Refuse a node's instances before they are made, where their scene would not fit. Returns what
    each of them needs, in bytes."""
    extension = node.extension(_INSTANCING)
    count = 1
    if extension is not None:
        attributes = extension["attributes"]
        counts = [
            document.entry("accessors", attributes[name])["count"].integer(1, MAX_COUNT)
            for name in _TRS
            if attributes.get(name) is not None
        ]
        count = max(counts, default=1)
    mesh = None if index == NO_MESH else placed.meshes[index]
    triangles = 0 if mesh is None else len(mesh.triangles)
    vertices = 0 if mesh is None else len(mesh.positions)
    what = f"{counted(count, 'instance')} × {counted(triangles, 'triangle')}"
    document.budget.need(
        what,
        objects=count,
        vertices=count * vertices,
        triangles=count * triangles,
        place=node.place,
    )
    # The triangles are claimed together, once all are known.
    document.budget.claim(what, objects=count, place=node.place)
    return OBJECT_BYTES + vertices * VERTEX_BYTES + triangles * TRIANGLE_BYTES


def _instances(document: Document, node: Json) -> Float64 | None:
    """(k, 4, 4) float64: the matrices of EXT_mesh_gpu_instancing, None without it."""
    extension = node.extension(_INSTANCING)
    if extension is None:
        return None
    attributes = extension["attributes"]
    found = {
        name: read_floats(document, attributes[name], (kind,), integers=True).astype(np.float64)
        for name, kind in _TRS.items()
        if attributes.get(name) is not None
    }
    counts = {len(values) for values in found.values()}
    if len(counts) != 1:
        attributes.fail("TRANSLATION, ROTATION and SCALE are missing or differ in count")
    (count,) = counts
    translation = found.get("TRANSLATION", np.zeros((count, 3)))
    rotation = found.get("ROTATION", np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)))
    if not have_length(rotation):
        attributes["ROTATION"].fail("a rotation of zero or infinite length")
    scale = found.get("SCALE", np.ones((count, 3)))
    return trs_matrices(translation, rotation, scale)


def _unplayed(pointers: list[str], still: list[int]) -> list[tuple[Code, str]]:
    """Notes about what is animated and stands as written: what `pointers` change, and the texture
    coordinates and colours of the masked meshes `still`."""
    notes = []
    if pointers:
        what = counted(len(pointers), "animated property", "animated properties")
        verb = "stands" if len(pointers) == 1 else "stand"
        first = f"{pointers[0][:200]!a}"
        notes.append((Code.ANIMATION_IGNORED, f"{what} {verb} as written, first {first}"))
    if still:
        notes.append(
            (
                Code.PARTLY_READ,
                "morph targets move the texture coordinates or colours of masked meshes, which stay"
                f" as in the rest pose while they are animated, first meshes[{still[0]}]",
            )
        )
    return notes
