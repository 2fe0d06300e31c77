"""Where a glTF file's vertices are at a time, written from the specification: the slow, plain way.

It shares no code with the reader. All is in `np.longdouble`, and beside each number goes a
`size`: the sum of the sizes of the terms that it came from. A float64 evaluation in whatever order
is off by a small number of roundings, each at most 2^-53 of such a size (`ROUNDINGS`).

Source: Khronos Group, "glTF 2.0 Specification", sections 3.5, 3.7, 3.11 and appendix C.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

Long = np.longdouble
DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

# What a coordinate takes part in, at most: the share of the span (3), a spline's or a slerp's
# terms (12), normalising (6), a matrix's entry from a quaternion (10) times a scale (1); then a
# product of four terms for each node on the way (4 each; ten nodes and a bind matrix), a morph
# target's terms (2 each, of four), a blend of twelve weighted joints and its division (26), and
# the point's own product (4): 116.
ROUNDINGS = 128


def opened(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    """The JSON and the buffers of a .gltf file."""
    document = json.loads(path.read_text())
    buffers = []
    for buffer in document["buffers"]:
        head, _, data = buffer["uri"].partition("base64,")
        is_within = head.startswith("data:")
        buffers.append(base64.b64decode(data) if is_within else (path.parent / head).read_bytes())
    return document, buffers


class Pose:
    """A document (its JSON and its buffers) at a time of an animation, None for the rest pose."""

    def __init__(
        self, document: dict[str, Any], buffers: list[bytes], clip: int | None, time: float
    ) -> None:
        self.document, self.buffers = document, buffers
        self.nodes = document["nodes"]
        self.changes: dict[tuple[str, int, str], tuple[np.ndarray, np.ndarray]] = {}
        if clip is not None:
            self._animate(document["animations"][clip], Long(time))
        self.parent = {}
        for index, node in enumerate(self.nodes):
            for child in node.get("children", []):
                self.parent[child] = index

    # Accessors (section 3.6).
    def accessor(self, index: int) -> np.ndarray:
        entry = self.document["accessors"][index]
        dtype, width = np.dtype(DTYPES[entry["componentType"]]), WIDTHS[entry["type"]]
        values = np.zeros((entry["count"], width), dtype)
        if "bufferView" in entry:
            values = self._bytes(entry, dtype, entry["count"] * width).reshape(-1, width).copy()
        if "sparse" in entry:
            sparse = entry["sparse"]
            kind = np.dtype(DTYPES[sparse["indices"]["componentType"]])
            rows = self._bytes(sparse["indices"], kind, sparse["count"])
            new = self._bytes(sparse["values"], dtype, sparse["count"] * width)
            for row, value in zip(rows, new.reshape(-1, width), strict=True):
                values[row] = value
        result = values.astype(Long)
        if entry.get("normalized"):
            result = np.maximum(result / Long(np.iinfo(dtype).max), Long(-1))
        return result

    def _bytes(self, entry: dict[str, Any], dtype: np.dtype, count: int) -> np.ndarray:
        view = self.document["bufferViews"][entry["bufferView"]]
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        buffer = self.buffers[view["buffer"]]
        if "byteStride" not in view:
            return np.frombuffer(buffer, dtype, count, start)
        width = WIDTHS[entry["type"]]
        starts = range(start, start + count // width * view["byteStride"], view["byteStride"])
        return np.concatenate([np.frombuffer(buffer, dtype, width, at) for at in starts])

    # Animations (section 3.11, appendix C).
    def _animate(self, animation: dict[str, Any], time: Any) -> None:
        for channel in animation["channels"]:
            target = channel["target"]
            if target["path"] == "pointer":
                pointer = target["extensions"]["KHR_animation_pointer"]["pointer"]
                _, kind, index, path = pointer.split("/", 3)
                place = (kind, int(index), path.split("/")[-1])
            else:
                place = ("nodes", target["node"], target["path"])
            sampler = animation["samplers"][channel["sampler"]]
            self.changes[place] = self._sampled(sampler, place[2], time)

    def _sampled(self, sampler: dict[str, Any], path: str, time: Any) -> tuple[Any, Any]:
        keys = self.accessor(sampler["input"])[:, 0]
        values = self.accessor(sampler["output"])
        kind = sampler.get("interpolation", "LINEAR")
        values = values.reshape(len(keys), 3 if kind == "CUBICSPLINE" else 1, -1)
        middle = 1 if kind == "CUBICSPLINE" else 0
        if time <= keys[0]:
            return values[0, middle], np.abs(values[0, middle])
        if time >= keys[-1]:
            return values[-1, middle], np.abs(values[-1, middle])
        k = max(i for i in range(len(keys)) if keys[i] <= time)
        span = keys[k + 1] - keys[k]
        t = (time - keys[k]) / span
        a, b = values[k, middle], values[k + 1, middle]
        if kind == "STEP":
            return a, np.abs(a)
        if kind == "CUBICSPLINE":
            out, into = values[k, 2], values[k + 1, 0]
            terms = [
                (2 * t**3 - 3 * t**2 + 1) * a,
                span * (t**3 - 2 * t**2 + t) * out,
                (-2 * t**3 + 3 * t**2) * b,
                span * (t**3 - t**2) * into,
            ]
            # The polynomials' own terms are at most 6 in all.
            size = 6 * (np.abs(a) + np.abs(b)) + 4 * span * (np.abs(out) + np.abs(into))
            return sum(terms), size
        if path == "rotation":
            a, b = a / np.sqrt((a * a).sum()), b / np.sqrt((b * b).sum())
            dot = (a * b).sum()
            if dot < 0:
                b, dot = -b, -dot
            angle = np.arccos(min(dot, Long(1)))
            if angle < Long(1e-9):
                return a + t * (b - a), np.ones(4)
            mixed = (np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle)
            return mixed, np.ones(4)
        return a + t * (b - a), np.abs(a) + np.abs(b)

    def _value(self, node: int, name: str, default: list[float]) -> tuple[Any, Any]:
        changed = self.changes.get(("nodes", node, name))
        if changed is not None:
            return changed
        value = np.array(self.nodes[node].get(name, default), Long)
        return value, np.abs(value)

    # Nodes (section 3.5).
    def local(self, node: int) -> tuple[np.ndarray, np.ndarray]:
        """(4, 4) parent_from_node, and the sizes of its entries."""
        if "matrix" in self.nodes[node]:
            matrix = np.array(self.nodes[node]["matrix"], Long).reshape(4, 4).T
            return matrix, np.abs(matrix)
        moved, moved_size = self._value(node, "translation", [0, 0, 0])
        turned, turned_size = self._value(node, "rotation", [0, 0, 0, 1])
        scaled, scaled_size = self._value(node, "scale", [1, 1, 1])
        return _trs(moved, turned, scaled, moved_size, turned_size, scaled_size)

    def world(self, node: int) -> tuple[np.ndarray, np.ndarray]:
        matrix, size = self.local(node)
        while node in self.parent:
            node = self.parent[node]
            above, above_size = self.local(node)
            matrix, size = above @ matrix, above_size @ size
        return matrix, size

    def hidden(self, node: int) -> bool:
        """Whether KHR_node_visibility switches it, or a node above it, off."""
        extension = self.nodes[node].get("extensions", {}).get("KHR_node_visibility", {})
        shown = extension.get("visible", True)
        if ("nodes", node, "visible") in self.changes:
            shown = bool(self.changes["nodes", node, "visible"][0][0])
        return not shown or (node in self.parent and self.hidden(self.parent[node]))

    # Meshes (section 3.7): instances, corners of triangles, coordinates.
    def corners(self, node: int) -> tuple[np.ndarray, np.ndarray]:
        """(k, 3 t, 3) where the corners of a node's triangles are in world space, k of each for
        its instances, and the sizes of these numbers."""
        mesh = self.document["meshes"][self.nodes[node]["mesh"]]
        weights = self._weights(node, mesh)
        points, sizes = [], []
        for primitive in mesh["primitives"]:
            point, size = self._primitive(primitive, node, weights)
            chosen = self.accessor(primitive["indices"])[:, 0].astype(int)
            points.append(point[chosen])
            sizes.append(size[chosen])
        point, size = np.concatenate(points), np.concatenate(sizes)
        if "skin" in self.nodes[node]:
            above = np.eye(4, dtype=Long), np.eye(4, dtype=Long)
        else:
            above = self.world(node)
        placed = [
            (_point(above[0] @ matrix, point), _point(above[1] @ matrix_size, size))
            for matrix, matrix_size in self._instances(node)
        ]
        return np.stack([one for one, _ in placed]), np.stack([one for _, one in placed])

    def _instances(self, node: int) -> list[tuple[np.ndarray, np.ndarray]]:
        extension = self.nodes[node].get("extensions", {}).get("EXT_mesh_gpu_instancing")
        if extension is None:
            return [(np.eye(4, dtype=Long), np.eye(4, dtype=Long))]
        places = self.accessor(extension["attributes"]["TRANSLATION"])
        none, one = np.array([0, 0, 0, 1], Long), np.ones(3, Long)
        return [_trs(place, none, one, np.abs(place), none, one) for place in places]

    def _weights(self, node: int, mesh: dict[str, Any]) -> tuple[Any, Any]:
        index = self.nodes[node]["mesh"]
        if ("nodes", node, "weights") in self.changes:
            return self.changes["nodes", node, "weights"]
        if "weights" in self.nodes[node]:
            value = np.array(self.nodes[node]["weights"], Long)
        elif ("meshes", index, "weights") in self.changes:
            return self.changes["meshes", index, "weights"]
        else:
            value = np.array(mesh.get("weights", []), Long)
        return value, np.abs(value)

    def _primitive(self, primitive: dict[str, Any], node: int, weights: Any) -> tuple[Any, Any]:
        attributes = primitive["attributes"]
        point = self.accessor(attributes["POSITION"])
        size = np.abs(point)
        for number, target in enumerate(primitive.get("targets", [])):
            if "POSITION" in target and number < len(weights[0]):
                moved = self.accessor(target["POSITION"])
                point = point + weights[0][number] * moved
                size = size + weights[1][number] * np.abs(moved)
        if "skin" not in self.nodes[node]:
            return point, size
        skin = self.document["skins"][self.nodes[node]["skin"]]
        joints = []
        for number, joint in enumerate(skin["joints"]):
            matrix, matrix_size = self.world(joint)
            if "inverseBindMatrices" in skin:
                flat = self.accessor(skin["inverseBindMatrices"])[number]
                bind = flat.reshape(4, 4).T  # column-major
                matrix, matrix_size = matrix @ bind, matrix_size @ np.abs(bind)
            joints.append((matrix, matrix_size))
        result, result_size = np.zeros_like(point), np.zeros_like(size)
        for vertex in range(len(point)):
            blended, total, blended_size = np.zeros((4, 4), Long), Long(0), np.zeros((4, 4), Long)
            number = 0
            while f"JOINTS_{number}" in attributes:
                chosen = self.accessor(attributes[f"JOINTS_{number}"])[vertex].astype(int)
                shares = self.accessor(attributes[f"WEIGHTS_{number}"])[vertex]
                for joint, share in zip(chosen, shares, strict=True):
                    blended += share * joints[joint][0]
                    blended_size += abs(share) * joints[joint][1]
                    total += share
                number += 1
            result[vertex] = _point(blended / total, point[vertex : vertex + 1])[0]
            result_size[vertex] = _point(blended_size / total, size[vertex : vertex + 1])[0]
        return result, result_size


def _point(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _trs(
    moved: Any, turned: Any, scaled: Any, moved_size: Any, turned_size: Any, scaled_size: Any
) -> tuple[np.ndarray, np.ndarray]:
    """T R S, R of a quaternion that is normalised first; and the sizes of the entries. A rotation's
    entry is a sum of products of numbers up to 1; where the quaternion came from larger ones, their
    error is larger by as much."""
    length = np.sqrt((turned * turned).sum())
    x, y, z, w = turned / length
    rotation = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ],
        Long,
    )
    rough = 3 * max(Long(1), np.abs(turned_size).max() / length)
    matrix, size = np.eye(4, dtype=Long), np.eye(4, dtype=Long)
    matrix[:3, :3] = rotation * scaled
    matrix[:3, 3] = moved
    size[:3, :3] = rough * np.abs(scaled_size)
    size[:3, 3] = moved_size
    return matrix, size
