"""How a glTF file's animations pose its objects: an implementation of `visref.rig.Motion`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.formats.gltf.animation import (
    TRANSFORMS,
    VISIBLE,
    WEIGHTS,
    Animations,
    Bank,
    Channel,
    Playback,
    Target,
)
from visref.formats.gltf.deform import Deformer
from visref.formats.gltf.nodes import Nodes, trs_matrices
from visref.formats.placed import compose
from visref.rig import Moment
from visref.scene import Float64, Int64

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Skin:
    """`joints`: (j,) int64 node ids; `bind`: (j, 4, 4) float64, joint_from_mesh, or None for the
    identity."""

    joints: Int64
    bind: Float64 | None

    def world_from_mesh(self, world_from_joint: Float64) -> Float64:
        """(j, 4, 4) float64: where each joint alone would have the mesh."""
        return world_from_joint if self.bind is None else compose(world_from_joint, self.bind)


@dataclass(frozen=True, eq=False)
class Carrier:
    """A node with a mesh, and the objects that it makes, `first` to `first + count - 1`.

    `skin`: its number, -1 for none. `deformer`: its number, -1 where its vertices never move.
    `weights`: the morph targets' rest weights, and whether they are the node's own or the mesh's.
    `worlds`: (count, 4, 4) float64, world_from_object in the rest pose. `instances`: (count, 4, 4)
    float64, node_from_object, or None for the identity. `drawn`: it has triangles to show.
    """

    node: int
    mesh: int
    skin: int
    first: int
    deformer: int
    weights: tuple[float, ...]
    own_weights: bool
    worlds: Float64
    instances: Float64 | None
    drawn: bool

    @property
    def count(self) -> int:
        return len(self.worlds)


@dataclass(frozen=True, eq=False)
class Reach:
    """The nodes and meshes that the channels of some clips name: `moved` are nodes whose place they
    change, `switched` nodes that they show or hide, `morphed_nodes` and `morphed_meshes` those
    whose weights they change."""

    moved: frozenset[int]
    switched: frozenset[int]
    morphed_nodes: frozenset[int]
    morphed_meshes: frozenset[int]

    @classmethod
    def of(cls, targets: Iterable[Target]) -> Reach:
        """What these targets name."""
        named: dict[str, set[int]] = {
            "move": set(),
            "nodes": set(),
            "meshes": set(),
            VISIBLE: set(),
        }
        for target in targets:
            kind = target.kind if target.path == WEIGHTS else target.path
            named["move" if kind in TRANSFORMS else kind].add(target.index)
        groups = (named["move"], named[VISIBLE], named["nodes"], named["meshes"])
        return cls(*(frozenset(group) for group in groups))

    def morphs(self, node: int, mesh: int, own_weights: bool) -> bool:
        """Whether the weights of a node with a mesh are animated."""
        return node in self.morphed_nodes or (mesh in self.morphed_meshes and not own_weights)


@dataclass(eq=False)
class GltfMotion:
    """The animations of a glTF file over its objects, of which `carriers` are those that some clip
    bears on, ascending; `skinned` as in `visref.rig.Motion`."""

    nodes: Nodes
    animations: Animations
    channels: list[list[Channel]]
    skins: Mapping[int, Skin]
    carriers: Sequence[Carrier]
    deformers: Sequence[Deformer]
    skinned: Flags
    clips: Sequence[str] = field(init=False)
    digest: str = field(init=False)
    _clips: dict[int, _Clip] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.clips = self.animations.clips
        self.digest = self._digest()

    @cached_property
    def rest(self) -> Float64:
        """(n + 1, 4, 4) float64, world_from_node in the rest pose; the last is the identity, for
        a root's parent, which is -1."""
        return np.concatenate([self.nodes.world_from_node(), np.eye(4)[None]])

    def affected(self, clip: int) -> Flags:
        """(n,) bool, as `visref.rig.Motion` says."""
        return self._clip(clip).affected.copy()

    def at(self, clip: int, time_s: float) -> Moment:
        """As `visref.rig.Motion` says. Raises InputError where a pose is not finite."""
        return self._clip(clip).at(time_s)

    def _clip(self, clip: int) -> _Clip:
        if clip not in self._clips:
            self._clips[clip] = _Clip(self, clip)
        return self._clips[clip]

    def _digest(self) -> str:
        state = hashlib.sha256()

        def add(*values: object) -> None:
            state.update(repr(values).encode())

        def add_array(array: NDArray[np.generic]) -> None:
            add(array.dtype.str, array.shape)
            state.update(np.ascontiguousarray(array).view(np.uint8).data)

        nodes = self.nodes
        add(len(self.skinned), nodes.order, nodes.parent)
        for array in (nodes.parent_from_node(), nodes.visible):
            add_array(array)
        for name, channels in zip(self.clips, self.channels, strict=True):
            add(name, len(channels))
            for channel in channels:
                target = channel.target
                add(target.kind, target.index, target.path, channel.interpolation)
                add_array(channel.times)
                add_array(channel.values)
        for number, skin in sorted(self.skins.items()):
            add(number, skin.bind is None)
            add_array(skin.joints)
            if skin.bind is not None:
                add_array(skin.bind)
        for carrier in self.carriers:
            add(carrier.node, carrier.mesh, carrier.skin, carrier.first, carrier.count)
            add(carrier.deformer, carrier.weights, carrier.own_weights, carrier.drawn)
            if carrier.instances is not None:
                add_array(carrier.instances)
        for deformer in self.deformers:
            state.update(deformer.digest())
        return state.hexdigest()


class _Forest:
    """Some nodes, with all below each of them, parents first."""

    def __init__(self, nodes: Nodes, members: Flags, others: Sequence[int] = ()) -> None:
        """`others`: nodes outside that are asked for too."""
        chosen = [generation[members[generation]] for generation in nodes.generations]
        # (m,) int64, the nodes.
        self.ids: Int64 = np.concatenate([np.zeros(0, np.int64), *chosen])
        ends = np.cumsum([0, *(len(generation) for generation in chosen)])
        self.generations = [slice(a, b) for a, b in pairwise(ends) if a < b]
        parent = np.array(nodes.parent, np.int64)
        above = parent[self.ids]
        outside = np.array(others, np.int64)
        # Nodes outside that are looked at, after the members: -1 is the root's parent.
        fixed = np.unique(np.concatenate([above[~_holds(members, above)], outside]))
        self.fixed: Int64 = fixed
        self._row = {node: row for row, node in enumerate((*self.ids.tolist(), *fixed.tolist()))}
        self.parent_rows = self.rows(above.tolist())

    def rows(self, nodes: Sequence[int]) -> Int64:
        """Where each of these is, among the members and then those outside."""
        return np.array([self._row[node] for node in nodes], np.int64)

    def __contains__(self, node: int) -> bool:
        return node in self._row


def _holds(members: Flags, nodes: Int64) -> Flags:
    """Whether each of these nodes, -1 for none, is a member."""
    result: Flags = (nodes >= 0) & members[nodes] if len(members) else np.zeros(len(nodes), bool)
    return result


class _Clip:
    """One animation, prepared: what is the same at all its times is worked out once."""

    def __init__(self, motion: GltfMotion, clip: int) -> None:
        self.motion = motion
        self.place = motion.animations.places[clip].place
        nodes = motion.nodes
        self.playback = Playback(motion.channels[clip])
        reach = Reach.of(motion.animations.targets[clip])
        moved, switched = nodes.and_below(reach.moved), nodes.and_below(reach.switched)
        moving_skins = {number for number, skin in motion.skins.items() if moved[skin.joints].any()}
        self.affected = np.zeros(len(motion.skinned), np.bool_)
        self.rigid: list[Carrier] = []
        self.deformed: list[Carrier] = []
        self.veiled: list[Carrier] = []
        for carrier in motion.carriers:
            rigid = carrier.skin < 0 and bool(moved[carrier.node])
            deformed = carrier.deformer >= 0 and (
                carrier.skin in moving_skins
                or reach.morphs(carrier.node, carrier.mesh, carrier.own_weights)
            )
            veiled = carrier.drawn and bool(switched[carrier.node])
            if rigid:
                self.rigid.append(carrier)
            if deformed:
                self.deformed.append(carrier)
            if veiled:
                self.veiled.append(carrier)
            if rigid or deformed or veiled:
                self.affected[carrier.first : carrier.first + carrier.count] = True
        self.objects: Int64 = np.flatnonzero(self.affected)
        self.rest_worlds = np.concatenate(
            [np.zeros((0, 4, 4))]
            + [carrier.worlds for carrier in motion.carriers if self.affected[carrier.first]]
        )
        joints = [
            node
            for carrier in self.deformed
            if carrier.skin >= 0
            for node in motion.skins[carrier.skin].joints.tolist()
            if not moved[node]
        ]
        self.forest = _Forest(nodes, moved, joints)
        self.local = nodes.parent_from_node()[self.forest.ids]
        self.trs = (nodes.translation, nodes.rotation, nodes.scale)
        self.skin_rows = {
            carrier.skin: self.forest.rows(motion.skins[carrier.skin].joints.tolist())
            for carrier in self.deformed
            if carrier.skin >= 0
        }
        self.veils = _Forest(nodes, switched)
        self.rest_hidden = _hidden_at_rest(motion)
        self._prepare_rigid()
        self._prepare_driven()
        self._prepare_veils()

    def _prepare_rigid(self) -> None:
        """Objects without instances are posed together: their places among the affected ones, and
        their nodes' rows."""
        alone = [carrier for carrier in self.rigid if carrier.instances is None]
        firsts = [carrier.first for carrier in alone]
        self.alone: Int64 = np.searchsorted(self.objects, np.array(firsts, np.int64))
        self.alone_rows = self.forest.rows([carrier.node for carrier in alone])
        self.instanced = [carrier for carrier in self.rigid if carrier.instances is not None]

    def _prepare_driven(self) -> None:
        """The nodes that channels drive, and where in their translation, rotation and scale each
        bank's values go; what else the banks drive is looked up by node or mesh."""
        banks = self.playback.banks
        turning = [bank for bank in banks if bank.path in TRANSFORMS]
        names = np.concatenate([np.zeros(0, np.int64), *(bank.indices for bank in turning)])
        reached = np.array([node in self.forest for node in names.tolist()], np.bool_)
        self.driven: Int64 = np.unique(names[reached])
        self.driven_rows = self.forest.rows(self.driven.tolist())
        self.slots: dict[int, tuple[Flags, Int64]] = {}
        for bank in turning:
            used = np.isin(bank.indices, self.driven)
            self.slots[id(bank)] = used, np.searchsorted(self.driven, bank.indices[used])

    def _prepare_veils(self) -> None:
        """The nodes whose visibility changes, and the objects that they carry."""
        nodes, forest = self.motion.nodes, self.veils
        above = [node not in nodes.hidden for node in forest.fixed.tolist()]
        self.rest_shown = np.concatenate([nodes.visible[forest.ids], np.array(above, np.bool_)])
        self.veil_slots: dict[int, tuple[Flags, Int64]] = {}
        for bank in self.playback.banks:
            if bank.path == VISIBLE:
                used = np.array([node in forest for node in bank.indices.tolist()], np.bool_)
                self.veil_slots[id(bank)] = used, forest.rows(bank.indices[used].tolist())
        counts = [carrier.count for carrier in self.veiled]
        rows = forest.rows([carrier.node for carrier in self.veiled])
        self.veiled_rows: Int64 = np.repeat(rows, counts)
        self.veiled_objects: Int64 = np.concatenate(
            [np.zeros(0, np.int64)] + [np.arange(c.first, c.first + c.count) for c in self.veiled]
        )

    def at(self, time_s: float) -> Moment:
        sampled = self.playback.at(time_s)
        worlds = self.rest_worlds.copy()
        world_from_node = self._worlds(sampled)
        worlds[self.alone] = world_from_node[self.alone_rows]
        for carrier in self.instanced:
            place = int(np.searchsorted(self.objects, carrier.first))
            above = world_from_node[self.forest.rows([carrier.node])]
            if carrier.instances is not None:
                worlds[place : place + carrier.count] = compose(above, carrier.instances)
        self._check(worlds, "an object")
        positions = self._positions(sampled, world_from_node)
        return Moment(self.objects.copy(), worlds, positions, self._hidden(sampled))

    def _check(self, matrices: Float64, of: str) -> None:
        if not np.isfinite(matrices).all():
            raise InputError(
                f"the matrix of {of} is not finite at a time that is asked for",
                place=self.place,
                fix="mend its keys",
            )

    def _worlds(self, sampled: list[tuple[Bank, Float64]]) -> Float64:
        """world_from_node of the forest's rows."""
        translation, rotation, scale = (values[self.driven] for values in self.trs)
        parts = {"translation": translation, "rotation": rotation, "scale": scale}
        for bank, values in sampled:
            if bank.path in TRANSFORMS:
                used, places = self.slots[id(bank)]
                parts[bank.path][places] = values[used]
        local = self.local.copy()
        with np.errstate(invalid="ignore", divide="ignore"):
            local[self.driven_rows] = trs_matrices(translation, rotation, scale)
        result = np.concatenate([local, self.motion.rest[self.forest.fixed]])
        for generation in self.forest.generations:
            above = result[self.forest.parent_rows[generation]]
            result[generation] = compose(above, local[generation])
        return result

    def _positions(
        self, sampled: list[tuple[Bank, Float64]], world_from_node: Float64
    ) -> dict[int, Float64]:
        weights = {
            (bank.kind, index): tuple(row)
            for bank, values in sampled
            if bank.path == WEIGHTS
            for index, row in zip(bank.indices.tolist(), values.tolist(), strict=True)
        }
        made: dict[tuple[int, tuple[float, ...]], Float64] = {}
        matrices = {
            number: self.motion.skins[number].world_from_mesh(world_from_node[rows])
            for number, rows in self.skin_rows.items()
        }
        for number, joints in matrices.items():
            self._check(joints, f"a joint of skins[{number}]")
        result = {}
        for carrier in self.deformed:
            chosen = weights.get(("nodes", carrier.node))
            if chosen is None and not carrier.own_weights:
                chosen = weights.get(("meshes", carrier.mesh))
            if chosen is None:
                chosen = carrier.weights
            key = (carrier.deformer, chosen)
            if key not in made:
                deformer = self.motion.deformers[carrier.deformer]
                made[key] = deformer.at(chosen, matrices.get(carrier.skin))
            for number in range(carrier.first, carrier.first + carrier.count):
                result[number] = made[key]
        return result

    def _hidden(self, sampled: list[tuple[Bank, Float64]]) -> Flags:
        """(n,) bool, objects that are switched off."""
        result = self.rest_hidden.copy()
        if not self.veiled:
            return result
        shown = self.rest_shown.copy()
        for bank, values in sampled:
            if bank.path == VISIBLE:
                used, rows = self.veil_slots[id(bank)]
                shown[rows] = values[used, 0] != 0.0
        for generation in self.veils.generations:
            shown[generation] &= shown[self.veils.parent_rows[generation]]
        result[self.veiled_objects] = ~shown[self.veiled_rows]
        return result


def _hidden_at_rest(motion: GltfMotion) -> Flags:
    result = np.zeros(len(motion.skinned), np.bool_)
    for carrier in motion.carriers:
        if carrier.drawn and carrier.node in motion.nodes.hidden:
            result[carrier.first : carrier.first + carrier.count] = True
    return result
