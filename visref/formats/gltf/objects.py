"""A glTF file's objects: every node with a mesh, in the order of the hierarchy."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from visref.findings import Code
from visref.formats.gltf.accessors import MAX_COUNT, read_floats
from visref.formats.gltf.document import Document, Json
from visref.formats.gltf.masks import MaskReader
from visref.formats.gltf.materials import open_questions
from visref.formats.gltf.meshes import read_mesh
from visref.formats.gltf.nodes import Nodes, have_length, read_nodes, trs_matrices
from visref.formats.placed import NO_MESH, Placed, below, compose
from visref.memory import Budget
from visref.scene import Float64
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
    known: dict[tuple[int, int, tuple[float, ...]], int] = {}
    masks = MaskReader(document, placed.masks)
    entries = document.entries("nodes")
    # The nearest name at or above each node, and the path down to it.
    named: dict[int, tuple[str, str]] = {}
    for node in nodes.order:
        entry = entries[node]
        above, path = named.get(nodes.parent[node], ("", ""))
        named[node] = (_name(entry) or above, below(path, _name(entry)))
        document.budget.claim("the nodes' paths", sys.getsizeof(named[node][1]))
        if "mesh" not in entry.value:
            continue
        mesh = document.entry("meshes", entry["mesh"])
        skin = entry.get("skin")
        weights = _weights(entry, mesh)
        key = (
            entry["mesh"].integer(),
            -1 if skin is None else skin.integer(),
            tuple(weights),
        )
        if node in nodes.hidden:
            index = NO_MESH
        elif key in known:
            index = known[key]
        else:
            joints = None if skin is None else _joints(document, skin, world_from_node)
            index = known[key] = len(placed.meshes)
            placed.meshes.append(read_mesh(document, mesh, weights, joints, masks))
        _claim(document, placed, index, entry)
        # A skinned mesh stands where its joints are, wherever its node is.
        world = world_from_node[node] if skin is None else np.eye(4)
        own = _name(entry) or _name(mesh)
        placed.add(
            own or above,
            index,
            _instances(document, entry, world),
            path=below(path, own),
            group=entry.extension(_INSTANCING) is not None,
        )
    placed.notes.extend(masks.notes())
    placed.notes.extend(
        (Code.PARTLY_READ, f"extension {name} is not known; it may move or hide geometry")
        for name in document.unknown_extensions
    )
    placed.notes.extend((Code.PARTLY_READ, text) for text in open_questions(document))
    _note_animation(document, nodes, placed)
    return placed


def _name(entry: Json) -> str:
    name = entry.get("name")
    return name.text() if name is not None else ""


def _weights(node: Json, mesh: Json) -> list[float]:
    """The morph targets' rest weights: the node's, else the mesh's."""
    for owner in (node, mesh):
        weights = owner.get("weights")
        if weights is not None:
            return [weight.number() for weight in weights.items()]
    return []


def _joints(document: Document, skin: Json, world_from_node: Float64) -> Float64:
    """(j, 4, 4) float64: world_from_mesh as each joint of the skin alone would have it."""
    entry = document.entry("skins", skin)
    joints = entry["joints"].items()
    for joint in joints:
        document.entry("nodes", joint)
    worlds = world_from_node[[joint.integer() for joint in joints]]
    reference = entry.get("inverseBindMatrices")
    if reference is None:
        return worlds
    bind = read_floats(document, reference, ("MAT4",)).astype(np.float64)
    if len(bind) < len(joints):
        reference.fail(f"{len(bind)} matrices for {len(joints)} joints")
    joint_from_mesh = bind[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
    return compose(worlds, joint_from_mesh)


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


def _instances(document: Document, node: Json, world: Float64) -> Float64:
    """(k, 4, 4) float64: one matrix, or those of EXT_mesh_gpu_instancing."""
    extension = node.extension(_INSTANCING)
    if extension is None:
        return world[None]
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
    return compose(world[None], trs_matrices(translation, rotation, scale))


def _note_animation(document: Document, nodes: Nodes, placed: Placed) -> None:
    """Say how many objects an animation would move (DESIGN: the rest pose is used)."""
    entries = document.entries("nodes")
    pointed = _pointed(document)
    changed = {number for kind, number, path in pointed if kind == "materials" and _hides(path)}
    if changed:
        placed.notes.append(
            (
                Code.ANIMATION_IGNORED,
                f"{len(changed)} materials' animated alpha or transmission stands as written,"
                f" first materials[{min(changed)}]",
            )
        )
    moved = {node for animation in document.entries("animations") for node in targets(animation)}
    meshes = {number for kind, number, _ in pointed if kind == "meshes"}
    for node in nodes.order:
        if "mesh" in entries[node].value and entries[node]["mesh"].integer() in meshes:
            moved.add(node)
    if not moved:
        return
    carried: set[int] = set()
    for node in nodes.order:
        if node in moved or nodes.parent[node] in carried:
            carried.add(node)
    count = 0
    for node in nodes.order:
        value = entries[node].value
        if "mesh" not in value:
            continue
        bones = []
        if "skin" in value:
            skin = document.entry("skins", entries[node]["skin"])
            bones = [joint.integer() for joint in skin["joints"].items()]
        count += node in carried or any(bone in carried for bone in bones)
    if count:
        placed.notes.append(
            (Code.ANIMATION_IGNORED, f"{count} animated nodes with a mesh stand in their rest pose")
        )


def targets(animation: Json) -> list[int]:
    """The nodes that an animation's channels move, morph or (by pointer) change."""
    result = []
    for channel in animation["channels"].items():
        target = channel["target"]
        node = target.get("node")
        if node is not None:
            result.append(node.integer())
        elif (pointer := _pointer(target)) is not None and pointer[0] == "nodes":
            result.append(pointer[1])
    return result


def _pointed(document: Document) -> list[tuple[str, int, str]]:
    """What KHR_animation_pointer's channels change, in all animations."""
    found = []
    for animation in document.entries("animations"):
        for channel in animation["channels"].items():
            pointer = _pointer(channel["target"])
            if pointer is not None:
                found.append(pointer)
    return found


def _pointer(target: Json) -> tuple[str, int, str] | None:
    """The list, the number in it and the rest of a JSON pointer `/KIND/NUMBER/REST`."""
    extension = target.extension("KHR_animation_pointer")
    parts = extension["pointer"].text().split("/", 3) if extension is not None else []
    if len(parts) > 2 and parts[2].isdecimal():
        return parts[1], int(parts[2]), "/".join(parts[3:])
    return None


def _hides(path: str) -> bool:
    """Whether a material's property at `path` changes what it hides."""
    return path.endswith(("alphaCutoff", "baseColorFactor", "diffuseFactor", "transmissionFactor"))
