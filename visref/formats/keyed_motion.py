"""How nodes with keyed operations pose their objects: an implementation of `visref.rig.Motion`,
which can be written down in plain JSON and arrays."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.formats.keyed_ops import WIDTHS, Keys, Op, product
from visref.formats.placed import compose
from visref.rig import Moment
from visref.scene import Float64, Int64

CLIP = "animation"


@dataclass(frozen=True, eq=False)
class Node:
    """`parent`: its number, less than the node's own, -1 for none; where it `resets`, its
    parent does not move it, though it may hide it. `shown`: in time, (k,) of 0 and 1, or None;
    `shown_at_rest`: of itself, whatever is above it."""

    parent: int
    ops: tuple[Op, ...] = ()
    resets: bool = False
    shown: Keys | None = None
    shown_at_rest: bool = True

    @property
    def moves(self) -> bool:
        return any(op.keys is not None for op in self.ops)


@dataclass(frozen=True, eq=False)
class KeyedMotion:
    """`root`: (4, 4) float64, world from what the nodes stand in. `node_of_object`: (n,) int64;
    `node_from_object`: by object, (4, 4) float64, those alone that are not the identity.
    `points`: by mesh, (k, v, 3) floats in time; `mesh_of_object`: (n,) int64, -1 for none."""

    root: Float64
    nodes: Sequence[Node]
    node_of_object: Int64
    node_from_object: Mapping[int, Float64]
    points: Mapping[int, Keys]
    mesh_of_object: Int64
    clips: Sequence[str] = (CLIP,)
    _worlds: dict[int, Float64] = field(default_factory=dict, init=False)

    @property
    def skinned(self) -> NDArray[np.bool_]:
        return np.zeros(len(self.node_of_object), np.bool_)

    @cached_property
    def digest(self) -> str:
        state = hashlib.sha256()
        described, arrays = self.written()
        state.update(json.dumps(described).encode())
        for array in arrays:
            state.update(np.ascontiguousarray(array).view(np.uint8).data)
        return state.hexdigest()

    def affected(self, clip: int) -> NDArray[np.bool_]:
        """(n,) bool, as `visref.rig.Motion` says; `clip` is 0."""
        del clip
        return self._affected.copy()

    @cached_property
    def _affected(self) -> NDArray[np.bool_]:
        moved, switched = self._reached
        reached = np.array([*(a or b for a, b in zip(moved, switched, strict=True)), False])
        result: NDArray[np.bool_] = reached[self.node_of_object]
        result |= np.isin(self.mesh_of_object, list(self.points))
        return result

    @cached_property
    def _reached(self) -> tuple[list[bool], list[bool]]:
        """Which nodes anything moves, and which anything hides or shows."""
        moved: list[bool] = []
        switched: list[bool] = []
        for node in self.nodes:
            above = node.parent >= 0
            moved.append(node.moves or (above and not node.resets and moved[node.parent]))
            switched.append(node.shown is not None or (above and switched[node.parent]))
        return moved, switched

    def at(self, clip: int, time_s: float) -> Moment:
        """As `visref.rig.Motion` says. Raises InputError where a pose is not finite."""
        del clip
        objects: Int64 = np.flatnonzero(self._affected)
        worlds = self._posed(time_s)
        shown = self._shown(time_s)
        found = np.empty((len(objects), 4, 4))
        hidden = np.zeros(len(self.node_of_object), np.bool_)
        for place, number in enumerate(objects.tolist()):
            node = int(self.node_of_object[number])
            found[place] = worlds[node]
            if number in self.node_from_object:
                found[place] = compose(worlds[node], self.node_from_object[number])
            hidden[number] = not shown[node]
        if not np.isfinite(found).all():
            raise InputError(
                "the matrix of an object is not finite at a time that is asked for",
                fix="mend its keys",
            )
        kept = {mesh: keys.linear(time_s) for mesh, keys in self.points.items()}
        meshes = self.mesh_of_object[objects].tolist()
        positions = {
            number: kept[mesh]
            for number, mesh in zip(objects.tolist(), meshes, strict=True)
            if mesh in kept
        }
        return Moment(objects, found, positions, hidden)

    def _posed(self, time_s: float) -> list[Float64]:
        moved, _ = self._reached
        worlds: list[Float64] = []
        for number, node in enumerate(self.nodes):
            if not moved[number] and number in self._worlds:
                worlds.append(self._worlds[number])
                continue
            above = self.root if node.parent < 0 or node.resets else worlds[node.parent]
            world = compose(above, product(node.ops, time_s)) if node.ops else above
            if not moved[number]:
                self._worlds[number] = world
            worlds.append(world)
        return worlds

    def _shown(self, time_s: float) -> list[bool]:
        shown: list[bool] = []
        for node in self.nodes:
            own = node.shown_at_rest if node.shown is None else bool(node.shown.held(time_s))
            shown.append(own and (node.parent < 0 or shown[node.parent]))
        return shown

    def written(self) -> tuple[dict[str, Any], list[Float64 | Int64]]:
        """What `read` makes a motion of: JSON, and arrays in the order in which it takes them."""
        arrays: list[Float64 | Int64] = [self.root]

        def keys(given: Keys | None) -> int:
            if given is None:
                return 0
            arrays.extend((given.times, np.asarray(given.values, np.float64)))
            return len(given.times)

        nodes = []
        for node in self.nodes:
            ops = []
            for op in node.ops:
                arrays.append(op.rest)
                ops.append([op.kind, op.inverse, keys(op.keys)])
            shown = keys(node.shown)
            nodes.append([node.parent, node.resets, node.shown_at_rest, shown, ops])
        instances = sorted(self.node_from_object)
        arrays.extend(self.node_from_object[number] for number in instances)
        points = [
            [mesh, keys(moved), moved.values.shape[1]]
            for mesh, moved in sorted(self.points.items())
        ]
        arrays.append(self.node_of_object)
        return {"nodes": nodes, "instances": instances, "points": points}, arrays


def read(
    given: Any,
    floats: Callable[[tuple[int, ...]], Float64],
    integers: Callable[[tuple[int, ...]], Int64],
    mesh_of_object: Int64,
    mesh_sizes: Sequence[int],
) -> KeyedMotion:
    """A motion from what `KeyedMotion.written` says of it; `floats` and `integers` give the next
    array of a shape, and `mesh_sizes` are the meshes' numbers of vertices.

    Raises ValueError, KeyError or TypeError where it is none.
    """
    count = len(mesh_of_object)

    def keys(length: int, shape: tuple[int, ...]) -> Keys | None:
        if length == 0:
            return None
        times = floats((length,))
        if not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
            raise ValueError("times do not increase")
        return Keys(times, floats((length, *shape)))

    root = floats((4, 4))
    nodes: list[Node] = []
    for parent, resets, shown_at_rest, shown, listed in given["nodes"]:
        if not -1 <= parent < len(nodes):
            raise ValueError("a node's parent comes after it")
        ops = []
        for kind, inverse, length in listed:
            width = (WIDTHS[kind],)
            rest = floats(width)
            ops.append(Op(kind, rest, keys(length, width), bool(inverse)))
        visible = keys(shown, ())
        nodes.append(Node(int(parent), tuple(ops), bool(resets), visible, bool(shown_at_rest)))
    instances = {int(number): floats((4, 4)) for number in given["instances"]}
    if instances and not 0 <= min(instances) <= max(instances) < count:
        raise ValueError("an instance is of no object")
    points = {}
    for mesh, length, size in given["points"]:
        moved = keys(length, (size, 3))
        if not 0 <= mesh < len(mesh_sizes) or size != mesh_sizes[mesh] or moved is None:
            raise ValueError("points are of no mesh")
        points[int(mesh)] = moved
    node_of_object = integers((count,))
    if count and not 0 <= node_of_object.min() <= node_of_object.max() < len(nodes):
        raise ValueError("an object has no node")
    return KeyedMotion(root, nodes, node_of_object, instances, points, mesh_of_object)
