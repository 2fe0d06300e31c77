"""Random cases in motion: animated nodes, skins, morph targets, visibility and levels of detail in
a file; places, absences, levels and one or two views in a path; and what is drawn in each frame.

Exact cases hold numbers so small and whole that each pose is the same in float32 and in fractions:
turns of a cube's diagonal and half turns, whose quaternions are halves, and shares of quarters.
General ones turn and blend as it comes.
"""

from __future__ import annotations

import itertools
import random
from dataclasses import dataclass, field
from fractions import Fraction as Q
from functools import cached_property
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.fuzz_verdicts.case import Matrix, Part, Triangle, multiply
from tests.fuzz_verdicts.cases import (
    MIRRORS,
    PROMISES,
    TURNS,
    random_camera,
    random_node,
    random_parts,
    shifted,
)
from tests.fuzz_verdicts.files import columns, primitive
from tests.support.gltf_baking import Animated, Posed, bake
from tests.support.gltf_files import Gltf

# Unit quaternions of halves: the rotations of a tetrahedron.
WHOLE_TURNS = [
    *([float(i == k) for i in range(4)] for k in range(4)),
    *([a / 2.0, b / 2.0, c / 2.0, 0.5] for a, b, c in product((1, -1), repeat=3)),
]
VISIBLE = "/nodes/{}/extensions/KHR_node_visibility/visible"
HOW = ("STEP", "LINEAR", "LINEAR", "CUBICSPLINE")


@dataclass
class MovingCase:
    """`parts`: by glTF node, the primitives of its mesh. `joint`: whether one drawn set is for all
    views of a frame. `drawn`: by cell, unit ids. `units` None: the objects."""

    seed: int
    general: bool
    glb: bytes
    parts: dict[int, list[Part]]
    path: dict[str, Any]
    cull_backfaces: bool
    promise: str
    joint: bool
    kinds: set[str]
    units: list[list[int]] | None = None
    drawn: list[list[int]] = field(default_factory=list)
    _posed: dict[int, list[tuple[Posed, bool]]] = field(default_factory=dict)

    @cached_property
    def file(self) -> Animated:
        return Animated(self.glb)

    @cached_property
    def cells(self) -> list[tuple[int, list[str]]]:
        """A frame and the names of the views that one drawn set is for."""
        found: list[tuple[int, list[str]]] = []
        for frame, entry in enumerate(self.path["frames"]):
            views = list(entry.get("views", {"": None}))
            found += [(frame, views)] if self.joint else [(frame, [view]) for view in views]
        return found

    def posed(self, frame: int) -> list[tuple[Posed, bool]]:
        if frame not in self._posed:
            self._posed[frame] = bake(self.file, self.path, frame)
        return self._posed[frame]

    def camera(self, frame: int, view: str) -> dict[str, Any]:
        entry = self.path["frames"][frame]
        return entry["views"][view] if view else entry

    def triangles(self, frame: int, corners: np.ndarray | None = None) -> list[Triangle]:
        """A frame's scene, baked; what is absent is one point. `corners`: (t, 3, 3) in place of the
        evaluated ones, in a scene's order and winding."""
        result: list[Triangle] = []
        for number, (posed, here) in enumerate(self.posed(frame)):
            for part, points in zip(self.parts[posed.node], posed.points, strict=True):
                if part.mask is not None and part.mask.never:
                    continue
                result += _triangles(self, part, points, number, here, posed.mirrored)
        if corners is None:
            return result
        return [
            Triangle(
                tuple(tuple(Q(float(x)) for x in v) for v in row),
                t.object, t.one_sided, t.kind, t.mask, t.lookup,
            )
            for t, row in zip(result, corners, strict=True)
        ]  # fmt: skip

    def present(self, frame: int) -> list[bool]:
        """By triangle."""
        here = [there for _, there in self.posed(frame)]
        return [here[t.object] for t in self.triangles(frame)]

    @cached_property
    def unit_lists(self) -> list[list[int]]:
        if self.units is not None:
            return self.units
        result: list[list[int]] = [[] for _ in self.posed(0)]
        for index, triangle in enumerate(self.triangles(0)):
            result[triangle.object].append(index)
        return result


def _triangles(
    case: MovingCase, part: Part, points: np.ndarray, number: int, here: bool, mirrored: bool
) -> list[Triangle]:
    su, sv, ou, ov = (Q(x) for x in part.stretch)
    alpha = part.vertex_alpha or [1.0] * len(points)
    uv = part.uv or [(0.0, 0.0)] * len(points)
    looked = [(Q(u) * su + ou, Q(v) * sv + ov, Q(w)) for (u, v), w in zip(uv, alpha, strict=True)]
    exact = [tuple(Q(float(x)) for x in point) for point in points]
    result = []
    for face in part.faces:
        turned = face[::-1] if mirrored else face
        corners = tuple(exact[i] for i in turned) if here else (exact[face[0]],) * 3
        result.append(
            Triangle(
                corners,
                number,
                case.cull_backfaces and not part.double_sided,
                part.kind,
                part.mask,
                tuple(looked[i] for i in turned),
            )
        )
    return result


class _Maker:
    """Builds one case's file, node by node."""

    def __init__(self, rng: random.Random, *, general: bool, aligned: bool) -> None:
        self.rng, self.general, self.aligned = rng, general, aligned
        self.gltf = Gltf()
        self.parts: dict[int, list[Part]] = {}
        self.channels: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self.kinds: set[str] = set()
        self.groups: dict[str, int] = {}
        self.masked: set[str] = set()
        self.names: list[str] = []
        self.count = 0

    def number(self) -> float:
        return self.rng.uniform(-3.0, 3.0) if self.general else self.rng.randint(-6, 6) / 2.0

    def quaternion(self) -> list[float]:
        if not self.general:
            return self.rng.choice(WHOLE_TURNS)
        q = np.array([self.rng.gauss(0.0, 1.0) for _ in range(4)])
        return list((q / np.linalg.norm(q)).astype(np.float32).astype(float))

    def track(self, node: int, path: str, width: int, value: Any, *, kinds: Any = HOW) -> None:
        """Keys of random values; `kinds`: the interpolations that keep an exact case exact."""
        rng, how = self.rng, self.rng.choice(kinds)
        times = rng.choice(([0.0, 1.0, 2.0, 3.0], [0.0, 2.0], [1.0, 2.0], [0.0, 1.0, 3.0], [1.0]))
        if how == "CUBICSPLINE" or path == "rotation":
            times = [0.0, 1.0, 2.0, 3.0]  # what is asked at whole times is a key
        pointer = path == "pointer"
        keys = [value() for _ in times]
        rows: list[Any] = keys
        if how == "CUBICSPLINE":
            rows = [row for key in keys for row in (self.tangent(width), key, self.tangent(width))]
        data = np.array(rows, "u1" if pointer else "f4")
        data = data.reshape(-1, 1) if path in ("weights", "pointer") else data
        time = self.gltf.accessor(np.array(times, "f4"), min=[times[0]], max=[times[-1]])
        sampler = {"input": time, "output": self.gltf.accessor(data), "interpolation": how}
        target: dict[str, Any] = {"node": node, "path": path}
        if pointer:
            extension = {"KHR_animation_pointer": {"pointer": VISIBLE.format(node)}}
            target = {"path": "pointer", "extensions": extension}
        self.channels.append({"sampler": len(self.samplers), "target": target})
        self.samplers.append(sampler)
        self.kinds.add(f"track {path}, {how}")

    def tangent(self, width: int) -> list[float]:
        return [0.5 * self.number() for _ in range(width)]

    def mover(self, children: list[int], *, mirror: bool = True, grows: bool = True) -> int:
        """A node with tracks of its place."""
        rng = self.rng
        entry: dict[str, Any] = {"children": children} if children else {}
        if rng.random() < 0.3:
            entry |= {"translation": [self.number() for _ in range(3)]}
        node = self.gltf.node(root=False, **entry)
        if rng.random() < 0.8:
            self.track(node, "translation", 3, lambda: [self.number() for _ in range(3)])
        if rng.random() < 0.6:
            whole = not (self.general or self.aligned)
            self.track(node, "rotation", 4, self.quaternion, kinds=("STEP",) if whole else HOW)
        if grows and rng.random() < 0.3:
            # Never through zero: a flat thing has no winding.
            mirrors = mirror and rng.random() < 0.5
            sizes = (0.5, 1.0, 2.0, -1.0) if mirrors else (0.5, 1.0, 2.0)
            kinds = ("STEP",) if mirrors else ("STEP", "LINEAR")
            self.track(node, "scale", 3, lambda: self.scale(sizes), kinds=kinds)
        return node

    def scale(self, sizes: tuple[float, ...]) -> list[float]:
        return [self.rng.choice(sizes) for _ in range(3)]

    def blinking(self, node: int) -> int:
        """Switched on and off by the animation, or off from the start."""
        off = self.rng.random() < 0.3
        extensions = {"KHR_node_visibility": {"visible": not off}}
        self.gltf.json["nodes"][node].setdefault("extensions", {}).update(extensions)
        if off or self.rng.random() < 0.8:
            # What shows at no time at all a reader may leave out.
            keys = itertools.chain([[1]], iter(lambda: [self.rng.choice((0, 1))], None))
            self.track(node, "pointer", 1, lambda: next(keys), kinds=("STEP",))
        self.kinds.add("visibility")
        return node

    def mesh_node(self, *, kind: str = "", masks: bool = True, **entry: Any) -> int:
        """An object; `kind` morph or skin adds what its vertices need."""
        parts = random_parts(self.rng)
        if not masks:
            parts = [part for part in parts if part.mask is None] or [
                Part(parts[0].positions, parts[0].faces)
            ]
        name, self.count = f"o{self.count}", self.count + 1
        self.names.append(name)
        if any(part.mask is not None for part in parts):
            self.masked.add(name)
        rows = [primitive(self.gltf, part) for part in parts]
        more: dict[str, Any] = {}
        if kind == "morph":
            targets = self.rng.choice((1, 1, 2))
            for part, row in zip(parts, rows, strict=True):
                row["targets"] = [self.target(len(part.positions)) for _ in range(targets)]
            more["weights"] = [self.weight() for _ in range(targets)]
        if kind == "skin":
            for part, row in zip(parts, rows, strict=True):
                row["attributes"] |= self.bound(len(part.positions), entry["joints"])
            entry.pop("joints")
        node = self.gltf.node(root=False, name=name, mesh=self.gltf.mesh(*rows, **more), **entry)
        if kind == "morph" and self.rng.random() < 0.9:
            width = len(more["weights"])
            self.track(node, "weights", width, lambda: [self.weight() for _ in range(width)])
        self.parts[node] = parts
        return node

    def weight(self) -> float:
        if self.general:
            return self.rng.uniform(-0.5, 1.0)
        return self.rng.choice((0.0, 0.25, 0.5, 1.0, -0.5))

    def target(self, count: int) -> dict[str, int]:
        rows = np.array([[self.number() for _ in range(3)] for _ in range(count)], "f4")
        if self.rng.random() < 0.6:
            return {"POSITION": self.gltf.accessor(rows)}
        few = sorted(self.rng.sample(range(count), self.rng.randint(1, count)))
        sparse = {
            "count": len(few),
            "indices": {
                "bufferView": self.gltf.view(np.array(few, "u2").tobytes()),
                "componentType": 5123,
            },
            "values": {"bufferView": self.gltf.view(rows[few].tobytes())},
        }
        self.kinds.add("sparse targets")
        self.gltf.json["accessors"].append(
            {"componentType": 5126, "count": count, "type": "VEC3", "sparse": sparse}
        )
        return {"POSITION": len(self.gltf.json["accessors"]) - 1}

    def bound(self, count: int, joints: int) -> dict[str, int]:
        """One set of joints, or two."""
        sets = self.rng.choice((1, 1, 2))
        which = np.array([[self.rng.randrange(joints) for _ in range(4 * sets)]
                          for _ in range(count)])  # fmt: skip
        shares = np.zeros((count, 4 * sets))
        for row in shares:
            if self.general:
                row[:] = [self.rng.random() + 0.01 for _ in row]
                row /= row.sum()
            else:
                cut = self.rng.choice(((1.0,), (0.5, 0.5), (0.25, 0.75), (0.25, 0.25, 0.5)))
                row[self.rng.sample(range(len(row)), len(cut))] = cut
        which[shares == 0.0] = 0
        self.kinds.add(f"joint sets: {sets}")
        result = {}
        for k in range(sets):
            part = slice(4 * k, 4 * k + 4)
            result[f"JOINTS_{k}"] = self.gltf.accessor(which[:, part].astype("u1"))
            result[f"WEIGHTS_{k}"] = self.gltf.accessor(shares[:, part].astype("f4"))
        return result

    def thing(self) -> list[int]:
        """Nodes to put under a parent: something still, or in motion in one of the ways."""
        rng = self.rng
        kind = rng.choice(("still", "moves", "moves", "skin", "skin", "morph", "levels", "blinks"))
        self.kinds.add(kind)
        if kind == "still":
            return [self.mesh_node(matrix=columns(random_node(rng)))]
        if kind == "moves":
            place = {"matrix": columns(random_node(rng))} if rng.random() < 0.5 else {}
            children = [self.mesh_node(masks=False, **place)]
            if rng.random() < 0.3:
                children = [self.mover(children)]
            return [self.mover(children)]
        if kind == "morph":
            return [self.mesh_node(kind="morph", matrix=columns(random_node(rng)))]
        if kind == "blinks":
            inner = [node for _ in range(rng.choice((1, 2))) for node in [self.mesh_node()]]
            below = [self.blinking(node) if rng.random() < 0.5 else node for node in inner]
            group = self.gltf.node(root=False, children=below)
            return [self.blinking(group) if rng.random() < 0.7 else group]
        if kind == "skin":
            joint = self.mover([], grows=False)
            joints = [joint]
            for _ in range(rng.randint(0, 2)):
                joint = self.mover([joint], grows=False)
                joints.append(joint)
            rng.shuffle(joints)
            entry: dict[str, Any] = {"joints": joints}
            if rng.random() < 0.8:
                inverse = [
                    multiply(shifted(tuple(self.number() for _ in range(3))), rng.choice(TURNS))
                    for _ in joints
                ]
                rows = np.array(inverse).transpose(0, 2, 1).reshape(-1, 16).astype("f4")
                entry["inverseBindMatrices"] = self.gltf.accessor(rows)
            skin = self.gltf.entry("skins", **entry)
            return [self.mesh_node(kind="skin", skin=skin, joints=len(joints)), joint]
        levels = [
            self.mesh_node(matrix=columns(random_node(rng))) for _ in range(rng.randint(1, 2))
        ]
        children = [self.mesh_node()] if rng.random() < 0.3 else []
        finest = self.mesh_node(
            matrix=columns(random_node(rng)),
            children=children,
            extensions={"MSFT_lod": {"ids": levels}},
        )
        for node in (*levels, finest):
            if rng.random() < 0.25:
                self.blinking(node)
        self.groups[self.gltf.json["nodes"][finest]["name"]] = len(levels) + 1
        return [self.mover([finest], mirror=False)] if rng.random() < 0.4 else [finest]

    def finish(self, root: Matrix) -> bytes:
        children = [node for _ in range(self.rng.randint(3, 6)) for node in self.thing()]
        self.gltf.node(matrix=columns(root), children=children)
        for entry in self.gltf.json["nodes"]:
            if entry.get("children") == []:
                del entry["children"]
        if self.channels:
            self.gltf.entry("animations", channels=self.channels, samplers=self.samplers)
        return self.gltf.glb()


def random_moving_case(seed: int, *, general: bool = False) -> MovingCase:
    """The case of a seed; its own whether general or not."""
    rng = random.Random(f"{seed} {general}")
    far_out = [0.0, 0.0, 0.0]
    if rng.random() < 0.15:
        far_out[rng.randrange(3)] = rng.choice((6.4e6, -1.5e8))
    root = shifted(tuple(far_out))
    aligned = rng.random() < 0.4
    maker = _Maker(rng, general=general, aligned=aligned)
    glb = maker.finish(root)
    path: dict[str, Any] = {"format": "visref-path", "version": 1, "frames": []}
    case = MovingCase(
        seed, general, glb, maker.parts, path, rng.random() < 0.4, rng.choice(PROMISES),
        rng.random() < 0.5, maker.kinds,
    )  # fmt: skip
    count = rng.randint(2, 3)
    times = [rng.choice((0.0, 1.0, 2.0, 3.0)) if aligned else rng.choice((0.0, 0.5, 0.75, 1.0, 1.5,
             2.25, 4.0)) for _ in range(count)]  # fmt: skip
    if general:
        times = [rng.uniform(0.0, 3.5) for _ in range(count)]
    if rng.random() < 0.3 and not general:
        path["fps"] = rng.choice((1.0, 2.0) if not aligned else (1.0, 0.5))
        times = [None] * count
    for frame in range(count):
        path["frames"].append(_frame(rng, maker, case, far_out, times[frame], frame))
    if any(far_out):
        case.kinds.add("far out")
    _draw(rng, case)
    return case


def _frame(
    rng: random.Random,
    maker: _Maker,
    case: MovingCase,
    far_out: list[float],
    time: Any,
    number: int,
) -> dict[str, Any]:
    entry: dict[str, Any] = {} if time is None else {"time_s": time}
    case.path["frames"].append(entry)
    if maker.groups:
        levels = {
            name: rng.randrange(size) for name, size in maker.groups.items() if rng.random() < 0.7
        }
        if levels:
            entry["levels"] = levels
    if rng.random() < 0.4:
        entry["absent"] = rng.sample(maker.names, rng.randint(1, 2))
        case.kinds.add("absent in the path")
    if rng.random() < 0.5:
        places = {}
        for name in rng.sample(maker.names, rng.randint(1, 2)):
            (rest,) = [one for one in case.file.at(None) if one.name == name]
            matrix = _place(rng, maker, name, rest)
            if rest.skinned or name in maker.groups:  # from the left, so about where it is
                matrix = multiply(matrix, shifted(tuple(-x for x in far_out)))
            places[name] = multiply(shifted(tuple(far_out)), matrix)
        entry["world_from_object"] = places
        case.kinds.add("placed by the path")
    case.path["frames"].pop()
    if rng.random() < 0.3:
        entry["cut"] = True
    pose = {**case.path, "frames": [*case.path["frames"], entry]}
    seen = SimpleNamespace(
        triangles=MovingCase(case.seed, case.general, case.glb, case.parts, pose, False, "", False,
                             set()).triangles(number)
    )  # fmt: skip
    cameras = [random_camera(rng, seen, 1.0, far_out) for _ in range(rng.choice((1, 2)))]
    if len(cameras) == 1:
        return {**entry, **cameras[0]}
    case.kinds.add("two views")
    return {**entry, "views": dict(zip(("left", "right"), cameras, strict=True))}


def _place(rng: random.Random, maker: _Maker, name: str, rest: Posed) -> Matrix:
    if name in maker.masked or name in maker.groups:
        # A mask that a pose mirrors, and rest does not, is refused.
        mirrored = rest.mirrored and name not in maker.groups
        turn = rng.choice(MIRRORS if mirrored else TURNS)
        return multiply(shifted(tuple(rng.randint(-2, 2) for _ in range(3))), turn)
    matrix = random_node(rng)
    if maker.general:
        matrix = [[x + rng.uniform(-0.1, 0.1) for x in row] for row in matrix[:3]] + [matrix[3]]
    return matrix


def _draw(rng: random.Random, case: MovingCase) -> None:
    count = len(case.triangles(0))
    if rng.random() < 0.6 and count:
        order = rng.sample(range(count), count)
        cuts = sorted(rng.choices(range(count + 1), k=rng.randint(0, 4)))
        case.units = [order[i:j] for i, j in zip([0, *cuts], [*cuts, count], strict=True)]
        for _ in range(rng.randint(0, 3)):
            case.units.append(rng.sample(range(count), rng.randint(0, min(3, count))))
    share = rng.choice((0.0, 0.3, 0.6, 0.85, 0.85, 1.0))
    case.drawn = [
        [u for u in range(len(case.unit_lists)) if rng.random() < share] for _ in case.cells
    ]


def mixed_case(seed: int) -> MovingCase:
    """Every fifth a general one."""
    return random_moving_case(seed, general=seed % 5 == 4)
