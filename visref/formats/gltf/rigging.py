"""What of a glTF file's objects its animations bear on, found before the meshes are read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.formats.gltf.accessors import read_floats
from visref.formats.gltf.animation import VISIBLE, Animations, Channel
from visref.formats.gltf.deform import Deformer
from visref.formats.gltf.document import Document
from visref.formats.gltf.motion import Carrier, GltfMotion, Reach, Skin
from visref.formats.gltf.nodes import Nodes
from visref.formats.gltf.values import Json
from visref.scene import Float64


class Rigging:
    """Collects what a `GltfMotion` needs while the objects are read."""

    def __init__(self, document: Document, nodes: Nodes) -> None:
        """Raises InputError naming the place where an animation or a skin is not well formed."""
        self.document = document
        self.nodes = nodes
        self.animations = Animations(document)
        self.carriers: list[Carrier] = []
        self.deformers: list[Deformer] = []
        self.skinned: list[bool] = []
        self._skins: dict[int, Skin] = {}
        self._joints_move: dict[int, bool] = {}
        self._channels = [self._read(clip) for clip in range(len(self.animations.targets))]
        self._reach = Reach.of(target for clip in self.animations.targets for target in clip)
        self._moved = nodes.and_below(self._reach.moved)
        self._switched = nodes.and_below(self._reach.switched)
        self._shown = self._ever_shown()
        # (n,) whether each node is shown at some time, and no clip moves it, shows or hides it.
        self.stands_still: list[bool] = (self._shown & ~self._moved & ~self._switched).tolist()
        self._deforming: set[tuple[int, int]] = set()
        # Meshes whose weights some clip animates.
        self._morphing = set(self._reach.morphed_meshes)
        if any(self._channels):
            self._find_deforming()

    def _read(self, clip: int) -> list[Channel]:
        result = []
        for target in self.animations.targets[clip]:
            channel = self.animations.channel(target)
            size = channel.times.nbytes + 2 * channel.values.nbytes
            self.document.budget.claim("an animation's keys", size, place=target.sampler.place)
            result.append(channel)
        return result

    def _ever_shown(self) -> NDArray[np.bool_]:
        """(n,) bool, nodes that are visible in the rest pose or at some time of a clip."""
        nodes = self.nodes
        off = np.flatnonzero(~nodes.visible).tolist()
        result = ~nodes.and_below(off)
        for channels in self._channels if off else []:
            on = {
                channel.target.index
                for channel in channels
                if channel.target.path == VISIBLE and channel.values.any()
            }
            if not on.isdisjoint(off):
                result |= ~nodes.and_below([node for node in off if node not in on])
        return result

    def _find_deforming(self) -> None:
        """The pairs of a mesh and a skin, -1 for none, whose vertices a clip may move."""
        entries = self.document.entries("nodes")
        for node in self.nodes.order:
            entry = entries[node]
            if "mesh" not in entry.value:
                continue
            mesh, own = entry["mesh"].integer(), "weights" in entry.value
            skin = self.skin_of(entry)
            morphs = self._reach.morphs(node, mesh, own)
            if morphs:
                self._morphing.add(mesh)
            if morphs or (skin >= 0 and self._moves(skin)):
                self._deforming.add((mesh, skin))

    def _moves(self, skin: int) -> bool:
        """Whether a clip moves a joint of a skin."""
        if skin not in self._joints_move:
            self._joints_move[skin] = bool(self._moved[self._skins[skin].joints].any())
        return self._joints_move[skin]

    def shows(self, node: int) -> bool:
        """Whether a node is visible in the rest pose, or at some time of a clip."""
        return bool(self._shown[node])

    def deforms(self, mesh: int, skin: int) -> bool:
        """Whether a clip may move the vertices of a mesh under a skin, -1 for none."""
        return (mesh, skin) in self._deforming

    def morphs(self, mesh: int) -> bool:
        """Whether a clip animates the weights of a mesh, or of a node with it."""
        return mesh in self._morphing

    def skin_of(self, node: Json) -> int:
        """The number of a node's skin, which is read if it was not; -1 for none."""
        reference = node.get("skin")
        if reference is None:
            return -1
        number = reference.integer()
        if number not in self._skins:
            self._skins[number] = read_skin(self.document, reference)
        return number

    def world_from_mesh(self, skin: int, world_from_node: Float64) -> Float64 | None:
        """(j, 4, 4) float64: world_from_mesh as each joint of a skin would have it."""
        if skin < 0:
            return None
        found = self._skins[skin]
        return found.world_from_mesh(world_from_node[found.joints])

    def add(self, carrier: Carrier) -> None:
        """A node with a mesh, and its objects; those that no clip bears on are not kept."""
        self.skinned.extend([carrier.skin >= 0] * carrier.count)
        if (
            self._moved[carrier.node]
            or self._switched[carrier.node]
            or self.deforms(carrier.mesh, carrier.skin)
        ):
            self.carriers.append(carrier)

    def motion(self) -> GltfMotion | None:
        """How the file moves its objects, None where it moves none."""
        if not self.carriers:
            return None
        used = {carrier.skin for carrier in self.carriers if carrier.skin >= 0}
        return GltfMotion(
            self.nodes,
            self.animations,
            self._channels,
            {number: self._skins[number] for number in sorted(used)},
            self.carriers,
            self.deformers,
            np.array(self.skinned, np.bool_),
        )


def read_skin(document: Document, reference: Json) -> Skin:
    """The skin that `reference` names."""
    entry = document.entry("skins", reference)
    joints = entry["joints"].items()
    for joint in joints:
        document.entry("nodes", joint)
    numbers = np.array([joint.integer() for joint in joints], np.int64)
    matrices = entry.get("inverseBindMatrices")
    if matrices is None:
        return Skin(numbers, None)
    bind = read_floats(document, matrices, ("MAT4",)).astype(np.float64)
    if len(bind) < len(joints):
        matrices.fail(f"{len(bind)} matrices for {len(joints)} joints")
    return Skin(numbers, bind[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1))
