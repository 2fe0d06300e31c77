"""A glTF file's objects: every node with a mesh, in the order of the hierarchy."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

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
from visref.formats.placed import NO_MESH, Placed, below, compose
from visref.memory import Budget
from visref.scene import Float64, Group, clean_name
from visref.wording import counted

_INSTANCING = "EXT_mesh_gpu_instancing"
_TRS = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}


def read_gltf(path: Path, *, budget: Budget) -> Placed:
    """The objects of a .glb, .gltf or .vrm file. Raises InputError naming the place."""
    return read_objects(Document(path, budget))


def read_objects(document: Document) -> Placed:
    """The meshes and objects of the file's scene. Raises InputError naming the place."""
    nodes = read_nodes(document)
    world_from_node = nodes.world_from_node()
    placed = Placed()
    rigging = Rigging(document, nodes)
    known: dict[tuple[int, int, tuple[float, ...]], tuple[int, int]] = {}
    masks = MaskReader(document, placed.masks)
    entries = document.entries("nodes")
    # The nearest name at or above each node, and the path down to it.
    named: dict[int, tuple[str, str]] = {}
    firsts: list[int] = []
    still_coordinates: list[int] = []
    for node in nodes.order:
        entry = entries[node]
        firsts.append(len(placed.names))
        above, path = named.get(nodes.parent[node], ("", ""))
        named[node] = (_name(entry) or above, below(path, _name(entry)))
        document.budget.claim("the nodes' paths", sys.getsizeof(named[node][1]))
        if "mesh" not in entry.value:
            continue
        mesh = document.entry("meshes", entry["mesh"])
        skin = rigging.skin_of(entry)
        weights, own_weights = _weights(entry, mesh)
        key = (entry["mesh"].integer(), skin, tuple(weights))
        if not rigging.shows(node):
            index, deformer = NO_MESH, -1
        elif key in known:
            index, deformer = known[key]
        else:
            deforms = rigging.deforms(key[0], skin)
            joints = rigging.world_from_mesh(skin, world_from_node)
            read, made = read_mesh(document, mesh, weights, joints, masks, deforms)
            index, deformer = len(placed.meshes), -1
            placed.meshes.append(read)
            if made is not None:
                deformer = len(rigging.deformers)
                rigging.deformers.append(made)
                if rigging.morphs(key[0]) and morphs_masks(document, mesh):
                    still_coordinates.append(key[0])
            known[key] = index, deformer
        _claim(document, placed, index, entry)
        # A skinned mesh stands where its joints are, wherever its node is.
        world = world_from_node[node] if skin < 0 else np.eye(4)
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
            group=instances is not None and node not in nodes.levels,
            hidden=carrier.drawn and node in nodes.hidden,
            node=node,
        )
    placed.motion = rigging.motion()
    placed.groups.extend(_levels(document, nodes, named, [*firsts, len(placed.names)]))
    placed.notes.extend(masks.notes())
    placed.notes.extend(
        (Code.PARTLY_READ, f"extension {name} is not known; it may move or hide geometry")
        for name in document.unknown_extensions
    )
    placed.notes.extend((Code.PARTLY_READ, text) for text in open_questions(document))
    placed.notes.extend(_unplayed(rigging.animations.unplayed, still_coordinates))
    return placed


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


def _claim(document: Document, placed: Placed, index: int, node: Json) -> None:
    """Refuse a node's instances before they are made, where their scene would not fit."""
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


def _levels(
    document: Document, nodes: Nodes, named: dict[int, tuple[str, str]], firsts: list[int]
) -> list[Group]:
    """The groups of MSFT_lod. `named`: the name at or above each node, and its path; `firsts`: of
    each node of the order, and of its end, how many objects come before."""
    starts, ends = nodes.subtrees

    def objects(node: int) -> tuple[int, ...]:
        return tuple(range(firsts[starts[node]], firsts[ends[node]]))

    groups = []
    for finest, coarser in nodes.levels.items():
        if starts[finest] < 0 or not coarser:
            continue
        levels = tuple(objects(node) for node in (finest, *coarser))
        members = tuple(number for level in levels for number in level)
        entry = document.entries("nodes")[finest]
        own = _name(entry)
        if not own and "mesh" in entry.value:
            own = _name(document.entry("meshes", entry["mesh"]))
        above, path = named.get(nodes.parent[finest], ("", ""))
        name = clean_name(own or above) or "object"
        if members:
            groups.append(Group(name, clean_name(below(path, own)) or name, members, levels))
    return groups


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
