"""A glTF file's objects: every node with a mesh, in the order of the hierarchy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from visref.findings import Code
from visref.formats.gltf.accessors import read_floats
from visref.formats.gltf.document import Document, Json
from visref.formats.gltf.meshes import read_mesh
from visref.formats.gltf.nodes import Nodes, have_length, read_nodes, trs_matrices
from visref.formats.placed import NO_MESH, Placed, compose
from visref.scene import Float64

_INSTANCING = "EXT_mesh_gpu_instancing"


def read_gltf(path: Path) -> Placed:
    """The objects of a .glb, .gltf or .vrm file. Raises InputError naming the place."""
    return read_objects(Document(path))


def read_objects(document: Document) -> Placed:
    """The meshes and objects of the file's scene. Raises InputError naming the place."""
    nodes = read_nodes(document)
    world_from_node = nodes.world_from_node()
    placed = Placed()
    known: dict[tuple[int, int, tuple[float, ...]], int] = {}
    constant: set[int] = set()
    for node in nodes.order:
        entry = document.entries("nodes")[node]
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
            placed.meshes.append(read_mesh(document, mesh, weights, joints, constant))
        # A skinned mesh stands where its joints are, wherever its node is.
        world = world_from_node[node] if skin is None else np.eye(4)
        placed.add(_name(entry) or _name(mesh), index, _instances(document, entry, world))
    if constant:
        placed.notes.append(
            (
                Code.ALPHA_MASK_CONSTANT,
                f"{len(constant)} materials, first materials[{min(constant)}]",
            )
        )
    placed.notes.extend(
        (Code.PARTLY_READ, f"extension {name} is not known; it may move or hide geometry")
        for name in document.unknown_extensions
    )
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


def _instances(document: Document, node: Json, world: Float64) -> Float64:
    """(k, 4, 4) float64: one matrix, or those of EXT_mesh_gpu_instancing."""
    extensions = node.get("extensions")
    extension = extensions.get(_INSTANCING) if extensions is not None else None
    if extension is None:
        return world[None]
    attributes = extension["attributes"]
    found = {
        name: read_floats(document, attributes[name], (kind,), integers=True).astype(np.float64)
        for name, kind in (("TRANSLATION", "VEC3"), ("ROTATION", "VEC4"), ("SCALE", "VEC3"))
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
    moved = {node for animation in document.entries("animations") for node in targets(animation)}
    if not moved:
        return
    entries = document.entries("nodes")
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
            continue
        extensions = target.get("extensions")
        pointer = extensions.get("KHR_animation_pointer") if extensions is not None else None
        parts = pointer["pointer"].text().split("/") if pointer is not None else []
        if len(parts) > 2 and parts[1] == "nodes" and parts[2].isdecimal():
            result.append(int(parts[2]))
    return result
