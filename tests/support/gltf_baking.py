"""One moment of an animated GLB, in plain NumPy and by the specification (glTF 2.0, chapters 3.5 to
3.11 and appendix C, KHR_node_visibility, KHR_animation_pointer, MSFT_lod): where each object's
vertices are. Nothing of visref, and no speed."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
VISIBLE = "/extensions/KHR_node_visibility/visible"


@dataclass
class Posed:
    """An object. `local`: by primitive, (v, 3) float64, its mesh as it is deformed (of a skinned
    one: in the world). `world`: (4, 4), the identity for a skinned one. `level`: the group that it
    is a level of, by the name of its finest one, and which."""

    name: str
    node: int
    local: list[np.ndarray]
    world: np.ndarray
    hidden: bool
    skinned: bool
    level: tuple[str, int] | None

    @property
    def points(self) -> list[np.ndarray]:
        """By primitive, (v, 3) float64 in the world."""
        return [one @ self.world[:3, :3].T + self.world[:3, 3] for one in self.local]

    @property
    def mirrored(self) -> bool:
        return bool(np.linalg.det(self.world[:3, :3]) < 0)


class Animated:
    """A GLB, read; `clip` of its animations, by number."""

    def __init__(self, glb: bytes) -> None:
        (length,) = struct.unpack_from("<I", glb, 12)
        self.json: dict[str, Any] = json.loads(glb[20 : 20 + length])
        self.blob = glb[20 + length + 8 :]
        self.nodes = self.json.get("nodes", [])
        self._read: dict[int, np.ndarray] = {}

    def values(self, number: int) -> np.ndarray:
        """(count, width), integers as they are, or as shares where they are normalised."""
        if number not in self._read:
            self._read[number] = self._values(number)
        return self._read[number]

    def _values(self, number: int) -> np.ndarray:
        accessor = self.json["accessors"][number]
        width, kind = WIDTHS[accessor["type"]], np.dtype(TYPES[accessor["componentType"]])
        count = accessor["count"]
        result = np.zeros((count, width), kind)
        if "bufferView" in accessor:
            result = self._view(accessor, count, width, kind).copy()
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            place = sparse["indices"]
            at = self._view(place, sparse["count"], 1, np.dtype(TYPES[place["componentType"]]))
            result[at[:, 0]] = self._view(sparse["values"], sparse["count"], width, kind)
        if accessor.get("normalized"):
            return np.maximum(result / float(np.iinfo(kind).max), -1.0)
        return result if kind.kind in "ui" else result.astype(np.float64)

    def _view(self, at: Mapping[str, Any], count: int, width: int, kind: np.dtype) -> np.ndarray:
        view = self.json["bufferViews"][at["bufferView"]]
        start = view.get("byteOffset", 0) + at.get("byteOffset", 0)
        step = view.get("byteStride", width * kind.itemsize)
        steps = step, kind.itemsize
        return np.ndarray((count, width), kind, self.blob, start, steps)

    def at(self, time_s: float | None, clip: int = 0) -> list[Posed]:
        """The objects, in the order of their ids, at a time; None: in the rest pose."""
        state = self._state(time_s, clip)
        worlds: dict[int, np.ndarray] = {}
        found = []
        for node, parent, hidden, level in self._visit(state):
            worlds[node] = (np.eye(4) if parent is None else worlds[parent]) @ state[node]["local"]
            if "mesh" in self.nodes[node]:
                found.append((node, hidden, level))
        return [self._posed(node, hidden, level, state, worlds) for node, hidden, level in found]

    def _visit(self, state: list[dict[str, Any]]) -> Iterator[tuple[int, Any, bool, Any]]:
        """Each node, depth first, levels of detail after the finest one's own nodes: with its
        parent, whether it is switched off, and the level that it is of."""

        def walk(node: int, parent: int | None, hidden: bool, level: Any, levels: bool) -> Any:
            entry = self.nodes[node]
            coarser = entry.get("extensions", {}).get("MSFT_lod", {}).get("ids", [])
            name = entry.get("name", "")
            own = (name, 0) if levels and coarser else level
            off = hidden or not state[node]["visible"]
            yield node, parent, off, own
            for child in entry.get("children", []):
                yield from walk(child, node, off, own, True)
            for k, other in enumerate(coarser if levels else [], 1):
                yield from walk(other, parent, hidden, (name, k), False)

        for root in self.json["scenes"][self.json.get("scene", 0)].get("nodes", []):
            yield from walk(root, None, False, None, True)

    def _state(self, time_s: float | None, clip: int) -> list[dict[str, Any]]:
        state = []
        for entry in self.nodes:
            mesh = self.json["meshes"][entry["mesh"]] if "mesh" in entry else {}
            shown = entry.get("extensions", {}).get("KHR_node_visibility", {})
            state.append(
                {
                    "translation": np.array(entry.get("translation", (0, 0, 0)), float),
                    "rotation": np.array(entry.get("rotation", (0, 0, 0, 1)), float),
                    "scale": np.array(entry.get("scale", (1, 1, 1)), float),
                    "weights": np.array(entry.get("weights", mesh.get("weights", ())), float),
                    "visible": shown.get("visible", True),
                }
            )
        if time_s is not None and self.json.get("animations"):
            animation = self.json["animations"][clip]
            for channel in animation["channels"]:
                target, path = channel["target"], channel["target"]["path"]
                if path == "pointer":
                    pointer = target["extensions"]["KHR_animation_pointer"]["pointer"]
                    assert pointer.startswith("/nodes/")
                    assert pointer.endswith(VISIBLE)
                    node, path = int(pointer.split("/")[2]), "visible"
                else:
                    node = target["node"]
                value = self._sampled(animation["samplers"][channel["sampler"]], time_s, path)
                state[node][path] = bool(value[0]) if path == "visible" else value
        for node, entry in zip(state, self.nodes, strict=True):
            if "matrix" in entry:
                node["local"] = np.array(entry["matrix"], float).reshape(4, 4).T
            else:
                node["local"] = composed(node["translation"], node["rotation"], node["scale"])
        return state

    def _sampled(self, sampler: Mapping[str, Any], time_s: float, path: str) -> np.ndarray:
        times = self.values(sampler["input"])[:, 0]
        how = sampler.get("interpolation", "LINEAR")
        keys = self.values(sampler["output"]).astype(float)
        keys = keys.reshape(len(times), 3 if how == "CUBICSPLINE" else 1, -1)
        inner = 1 if how == "CUBICSPLINE" else 0
        if time_s <= times[0]:
            return keys[0, inner]
        if time_s >= times[-1]:
            return keys[-1, inner]
        k = int(np.searchsorted(times, time_s, side="right")) - 1
        if how == "STEP" or times[k] == time_s:
            return keys[k, inner]
        span = times[k + 1] - times[k]
        u = (time_s - times[k]) / span
        if how == "CUBICSPLINE":
            return (
                (2 * u**3 - 3 * u**2 + 1) * keys[k, 1]
                + span * (u**3 - 2 * u**2 + u) * keys[k, 2]
                + (3 * u**2 - 2 * u**3) * keys[k + 1, 1]
                + span * (u**3 - u**2) * keys[k + 1, 0]
            )
        first, second = keys[k, 0], keys[k + 1, 0]
        return slerp(first, second, u) if path == "rotation" else first + u * (second - first)

    def _posed(
        self, node: int, hidden: bool, level: Any, state: Any, worlds: dict[int, np.ndarray]
    ) -> Posed:
        entry = self.nodes[node]
        mesh = self.json["meshes"][entry["mesh"]]
        local = []
        for primitive in mesh["primitives"]:
            points = self.values(primitive["attributes"]["POSITION"]).astype(float)
            for weight, target in zip(
                state[node]["weights"], primitive.get("targets", ()), strict=False
            ):
                if "POSITION" in target:
                    points = points + weight * self.values(target["POSITION"])
            if "skin" in entry:
                points = self._skinned(points, primitive["attributes"], entry["skin"], worlds)
            local.append(points)
        name = entry.get("name") or mesh.get("name") or ""
        world = np.eye(4) if "skin" in entry else worlds[node]
        return Posed(name, node, local, world, hidden, "skin" in entry, level)

    def _skinned(
        self, points: np.ndarray, attributes: Mapping[str, int], number: int, worlds: Any
    ) -> np.ndarray:
        skin = self.json["skins"][number]
        moves = [worlds[joint] for joint in skin["joints"]]
        if "inverseBindMatrices" in skin:
            inverse = self.values(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
            moves = [m @ b.T for m, b in zip(moves, inverse, strict=False)]
        result, total = np.zeros_like(points), np.zeros((len(points), 1))
        for k in range(sum(name.startswith("JOINTS_") for name in attributes)):
            joints = self.values(attributes[f"JOINTS_{k}"])
            weights = self.values(attributes[f"WEIGHTS_{k}"])
            for j, w in zip(joints.T, weights.T, strict=True):
                m = np.array(moves)[j]
                result += w[:, None] * (np.einsum("vij,vj->vi", m[:, :3, :3], points) + m[:, :3, 3])
                total += w[:, None]
        return result / total  # 1, but for what float32 took off the weights


def slerp(first: np.ndarray, second: np.ndarray, u: float) -> np.ndarray:
    """Along the shorter arc; keys are unit quaternions, once what float32 took off is restored."""
    first, second = unit(first), unit(second)
    cosine = float(first @ second)
    sign = -1.0 if cosine < 0.0 else 1.0
    angle = math.acos(min(abs(cosine), 1.0))
    if angle < 1e-9:  # the arc is its chord to the last bit
        return first + u * (sign * second - first)
    return (math.sin((1 - u) * angle) * first + sign * math.sin(u * angle) * second) / math.sin(
        angle
    )


def unit(q: np.ndarray) -> np.ndarray:
    return q / math.sqrt(float(q @ q))


def composed(t: np.ndarray, q: np.ndarray, s: np.ndarray) -> np.ndarray:
    """T R S."""
    x, y, z, w = unit(q)
    result = np.eye(4)
    result[:3, :3] = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ) * np.asarray(s)
    result[:3, 3] = t
    return result


def bake(file: Animated, path: Mapping[str, Any], frame: int) -> list[tuple[Posed, bool]]:
    """The objects at a path's frame, as `docs/formats.md` says, and whether each is there."""
    entry = path["frames"][frame]
    time_s = entry.get("time_s")
    if time_s is None and "fps" in path:
        time_s = frame / path["fps"]
    names = [animation.get("name") for animation in file.json.get("animations", [])]
    clip = names.index(path["animation"]) if "animation" in path else 0
    levels, absent = entry.get("levels", {}), entry.get("absent", [])
    places = entry.get("world_from_object", {})
    result = []
    for posed in file.at(time_s, clip):
        # The name of the finest level is that of all of them.
        group = posed.level[0] if posed.level is not None else None
        if group in places:
            posed.world = np.array(places[group], float) @ posed.world
        elif posed.name in places:
            posed.world = np.array(places[posed.name], float)
        here = not posed.hidden and posed.name not in absent and group not in absent
        if posed.level is not None:
            here = here and levels.get(group, 0) == posed.level[1]
        result.append((posed, here))
    return result
