"""A USD stage's prims, depth-first, as objects: meshes, instances, what hides and what moves them.

Source: the documentation of UsdGeom (Pixar): Imageable for purpose and visibility, Xformable,
PointInstancer, Mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom

from visref.errors import InputError
from visref.findings import Code
from visref.formats.gltf.nodes import trs_matrices
from visref.formats.keyed_motion import KeyedMotion, Node
from visref.formats.keyed_ops import product
from visref.formats.placed import Placed, below, compose
from visref.formats.usd.meshes import Meshes
from visref.formats.usd.stage import open_stage, said
from visref.formats.usd.transforms import (
    Clock,
    operations,
    quaternions,
    rest_time,
    rest_value,
    visibility,
)
from visref.memory import Budget
from visref.scene import Float64, Group, Int64
from visref.wording import counted

# Drawn in a final picture.
_DRAWN = ("default", "render")
# Prims are claimed so many at a time.
_CLAIMED = 1024
_LISTED = Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract
_DEFINED = Usd.TraverseInstanceProxies(_LISTED & Usd.PrimIsDefined)
# Prototypes of a point instancer often stand below an `over`, so that nothing else draws them.
_ANY = Usd.TraverseInstanceProxies(_LISTED)


def parse_usd(path: Path, budget: Budget) -> Placed:
    """`visref.formats.usd.read_usd`, in this process."""
    opened = open_stage(path)
    try:
        reader = _Reader(opened.stage, opened.root, budget)
        reader.walk(opened.stage.GetPseudoRoot().GetFilteredChildren(_DEFINED), _DEFINED)
    except Tf.ErrorException as error:
        raise InputError(
            f"USD cannot read it: {said(error)}", fix="export the file anew"
        ) from error
    return reader.finished(opened.notes)


@dataclass(frozen=True)
class _Part:
    """What a prototype places: a mesh's number, its name and its path within, (4, 4) float64, and
    whether it is hidden at rest."""

    mesh: int
    name: str
    path: str
    prototype_from_object: Float64
    hidden: bool


@dataclass(frozen=True)
class _Above:
    """What a prim takes over from what is above it: the node's number and whether it is shown at
    rest, its place there, (4, 4) float64, the path, and the purpose."""

    node: int
    shown: bool
    world: Float64
    path: str
    purpose: str


@dataclass
class _Reader:
    stage: Any
    root: Float64
    budget: Budget
    placed: Placed = field(default_factory=Placed)
    nodes: list[Node] = field(default_factory=list)
    node_of_object: list[int] = field(default_factory=list)
    instances: dict[int, Float64] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    seen: int = 0
    nothing: int = -1

    def __post_init__(self) -> None:
        self.clock = Clock(self.stage)
        self.meshes = Meshes(self.clock, self.budget)
        self.prototypes: dict[str, list[_Part]] = {}
        self.open: list[str] = []

    def walk(self, prims: list[Any], listed: Any) -> None:
        """Place every prim that is drawn of these and below them, in the stage's order."""
        start = _Above(-1, True, self.root, "", "default")
        waiting = [(prim, start) for prim in reversed(prims)]
        while waiting:
            prim, above = waiting.pop()
            found = self.enter(prim, above)
            if found is None:
                continue
            if prim.IsA(UsdGeom.PointInstancer):
                self.instancer(prim, found)
                continue
            if prim.IsA(UsdGeom.Gprim):
                self.add(str(prim.GetName()), self.meshes.of(prim), found)
            children = prim.GetFilteredChildren(listed)
            waiting.extend((child, found) for child in reversed(children))

    def enter(self, prim: Any, above: _Above) -> _Above | None:
        """Make a node of a prim; None where nothing of it is drawn."""
        self.claim()
        if prim.HasAuthoredMetadata("clips"):
            # Their files are opened when a value is asked for, whatever their names are.
            raise InputError(
                "value clips are not read",
                place=str(prim.GetPath()),
                fix="export the stage without them",
            )
        purpose = _purpose(prim, above.purpose)
        drawn = prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer)
        if drawn and purpose not in _DRAWN:
            self.left_out[purpose] = self.left_out.get(purpose, 0) + 1
            return None
        path = below(above.path, str(prim.GetName()))
        ops, resets = operations(prim, self.clock)
        shown, keys = visibility(prim, self.clock)
        base = self.root if resets else above.world
        world = compose(base, product(ops, None)) if ops else base
        number = above.node
        if ops or resets or keys is not None or not shown or number < 0:
            number = len(self.nodes)
            self.nodes.append(Node(above.node, ops, resets, keys, shown))
        return _Above(number, above.shown and shown, world, path, purpose)

    def claim(self) -> None:
        if self.seen % _CLAIMED == 0:
            self.budget.claim(f"{_CLAIMED:,} prims", objects=_CLAIMED)
        self.seen += 1

    def add(self, name: str, mesh: int, at: _Above) -> None:
        self.placed.add(name, mesh, at.world, path=at.path, hidden=not at.shown)
        self.node_of_object.append(at.node)

    def instancer(self, prim: Any, at: _Above) -> None:
        """The objects of a point instancer: those of the first instance, then of the next."""
        instancer = UsdGeom.PointInstancer(prim)
        place = str(prim.GetPath())
        for attribute in (
            instancer.GetPositionsAttr(),
            instancer.GetOrientationsAttr(),
            instancer.GetOrientationsfAttr(),
            instancer.GetScalesAttr(),
            instancer.GetProtoIndicesAttr(),
            instancer.GetInvisibleIdsAttr(),
        ):
            self.clock.moving(attribute)
        which = rest_value(instancer.GetProtoIndicesAttr())
        which = np.zeros(0, np.int64) if which is None else np.array(which, np.int64)
        self.budget.need(f"{len(which):,} instances", objects=len(which), place=place)
        matrices = _instance_matrices(instancer, len(which), place)
        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        if len(which) and not 0 <= which.min() <= which.max() < len(targets):
            raise InputError(
                f"protoIndices names a prototype that is none of its {len(targets)}",
                place=place,
                fix="export the file anew",
            )
        mask = instancer.ComputeMaskAtTime(rest_time(instancer.GetProtoIndicesAttr()))
        there = list(mask) or [True] * len(which)
        if len(there) != len(which):
            raise InputError("its ids are not one per instance", place=place, fix="mend its ids")
        parts = [self.parts(str(target), place) for target in targets]
        sizes = np.bincount(which, minlength=len(parts)) if len(which) else np.zeros(len(parts))
        total = int(sum(len(part) * int(n) for part, n in zip(parts, sizes, strict=True)))
        self.budget.claim(f"{total:,} objects of its instances", objects=total, place=place)
        first = len(self.placed.names)
        # Of each prototype, and of each of its parts, all instances at once.
        local = [
            [compose(matrices[which == number], part.prototype_from_object) for part in listed]
            for number, listed in enumerate(parts)
        ]
        world = [[compose(at.world, places) for places in each] for each in local]
        done = [0] * len(parts)
        for number, present in zip(which.tolist(), there, strict=True):
            row = done[number]
            done[number] += 1
            for k, part in enumerate(parts[number]):
                gone = part.hidden or not present
                self.instances[len(self.placed.names)] = local[number][k][row]
                path = below(at.path, part.path)
                here, hidden = world[number][k][row], gone or not at.shown
                self.placed.add(part.name, part.mesh, here, path=path, hidden=hidden)
                self.node_of_object.append(self.gone() if gone else at.node)
        if len(self.placed.names) > first:
            members = tuple(range(first, len(self.placed.names)))
            name = str(prim.GetName())
            self.placed.groups.append(Group(name, at.path, members))

    def gone(self) -> int:
        """A node that shows nothing at any time."""
        if self.nothing < 0:
            self.nothing = len(self.nodes)
            self.nodes.append(Node(-1, shown_at_rest=False))
        return self.nothing

    def parts(self, path: str, of: str) -> list[_Part]:
        """What the prototype at a path places, in its own space, as it is at rest."""
        if path in self.prototypes:
            return self.prototypes[path]
        prim = self.stage.GetPrimAtPath(path)
        if not prim or path in self.open:
            problem = "instances itself" if prim else "is not there"
            raise InputError(f"its prototype {path[:200]} {problem}", place=of, fix="mend it")
        self.open.append(path)
        # A reader of its own for what stands below, whose nodes nobody asks for.
        inner = _Reader(self.stage, np.eye(4), self.budget)
        inner.clock, inner.meshes = self.clock, self.meshes
        inner.prototypes, inner.open = self.prototypes, self.open
        inner.walk([prim], _ANY)
        self.left_out = {
            purpose: self.left_out.get(purpose, 0) + inner.left_out.get(purpose, 0)
            for purpose in {*self.left_out, *inner.left_out}
        }
        self.open.pop()
        placed = inner.placed
        worlds = np.concatenate([np.zeros((0, 4, 4)), *placed.world_from_object])
        rows = zip(
            placed.mesh_of_object, placed.names, placed.paths, worlds, placed.hidden, strict=True
        )
        self.prototypes[path] = [_Part(*row) for row in rows]
        if any(node.moves or node.shown is not None for node in inner.nodes):
            self.clock.unplayed.append(path)
        return self.prototypes[path]

    def finished(self, notes: list[tuple[Code, str]]) -> Placed:
        """The objects, with their motion and what was found."""
        placed = self.placed
        placed.meshes = self.meshes.meshes
        moves = self.meshes.points or any(n.moves or n.shown is not None for n in self.nodes)
        if moves and placed.names:
            node_of_object: Int64 = np.array(self.node_of_object, np.int64)
            motion = KeyedMotion(
                self.root,
                self.nodes,
                node_of_object,
                self.instances,
                self.meshes.points,
                np.array(placed.mesh_of_object, np.int64),
            )
            placed.motion = motion if motion.affected(0).any() else None
        placed.notes += notes
        for purpose, number in sorted(self.left_out.items()):
            what = counted(number, "prim")
            placed.notes.append((Code.PARTLY_READ, f"{what} of purpose '{purpose}' left out"))
        placed.notes += self.meshes.notes()
        unplayed = sorted(set(self.clock.unplayed))
        if unplayed:
            what = counted(len(unplayed), "animated property", "animated properties")
            verb = "stands" if len(unplayed) == 1 else "stand"
            text = f"{what} {verb} as at rest, first {unplayed[0][:200]!a}"
            placed.notes.append((Code.ANIMATION_IGNORED, text))
        return placed


def _purpose(prim: Any, above: str) -> str:
    """A prim's own purpose where it is written, else what is above it."""
    imageable = UsdGeom.Imageable(prim)
    if not imageable:
        return above
    attribute = imageable.GetPurposeAttr()
    return str(attribute.Get()) if attribute.HasAuthoredValue() else above


def _instance_matrices(instancer: Any, count: int, place: str) -> Float64:
    """(count, 4, 4) float64, instancer_from_instance."""

    def values(attribute: Any, width: int) -> Float64 | None:
        given = rest_value(attribute) if attribute else None
        if given is None or not len(given):
            return None
        found = quaternions(given) if width == 4 else np.array(given, np.float64)
        if len(found) != count:
            raise InputError(
                f"{len(found)} {attribute.GetName()} for {count} instances",
                place=place,
                fix="export the file anew",
            )
        return found.reshape(count, width)

    positions = values(instancer.GetPositionsAttr(), 3)
    turns = values(instancer.GetOrientationsfAttr(), 4)
    if turns is None:
        turns = values(instancer.GetOrientationsAttr(), 4)
    scales = values(instancer.GetScalesAttr(), 3)
    return trs_matrices(
        np.zeros((count, 3)) if positions is None else positions,
        np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)) if turns is None else turns,
        np.ones((count, 3)) if scales is None else scales,
    )
