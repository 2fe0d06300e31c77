"""Random glTF node trees, and a plain walk over one: the objects that it makes, in Python's own
floats, node by node and vertex by vertex. It shares nothing with visref's readers but the order of
sums that `visref.formats` states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf

Matrix = list[list[float]]
IDENTITY: Matrix = [[float(i == j) for j in range(4)] for i in range(4)]
NAMES = ["", "", "a", "a", "a#2", "b", "b/c", "Stuhl", "Tür", "椅子", "nul\0", "half\ud800"]


@dataclass
class Drawn:
    """An object: its exact float64 vertices, its triangles, whether the transform mirrors it."""

    name: str
    path: str
    node: int
    vertices: list[list[float]]
    triangles: list[list[int]]
    mirrored: bool


def random_tree(seed: int) -> Gltf:
    """A file of some 40 nodes in no order: matrices, TRS, shared meshes, skins, morph weights,
    instances, hidden nodes, names of all kinds, nodes that nobody reaches."""
    rng = np.random.default_rng(seed)
    gltf = Gltf()
    joints = 3
    weighted = gltf.primitive(SQUARE, TWO)
    weighted["targets"] = [{"POSITION": gltf.accessor(rng.normal(size=(4, 3)).astype("f4"))}]
    skinned = gltf.primitive(SQUARE, TWO)
    skinned["attributes"]["JOINTS_0"] = gltf.accessor(rng.integers(0, joints, (4, 4)).astype("u1"))
    skinned["attributes"]["WEIGHTS_0"] = gltf.accessor(rng.uniform(0.1, 1, (4, 4)).astype("f4"))
    meshes = [
        gltf.mesh(gltf.primitive(TRIANGLE), name="mesh"),
        gltf.mesh(gltf.primitive(SQUARE * 3, TWO), gltf.primitive(TRIANGLE), name=""),
        gltf.mesh(weighted, weights=[0.25]),
        gltf.mesh(skinned, name="skin"),
    ]
    count = int(rng.integers(5, 60))
    shuffled = rng.permutation(count).tolist()
    nodes: list[dict[str, Any]] = [{} for _ in range(count)]
    roots = []
    for place, node in enumerate(shuffled):
        entry = nodes[node]
        if place and rng.random() < 0.85:
            above = nodes[shuffled[int(rng.integers(place))]]
            # A whole number may be written with a point.
            above.setdefault("children", []).append(float(node) if rng.random() < 0.02 else node)
        elif rng.random() < 0.9:
            roots.append(node)
        _fill(gltf, rng, entry, meshes)
    for node in range(joints):
        nodes[node].pop("extensions", None)
    gltf.json["nodes"] = nodes
    gltf.json["scenes"][0]["nodes"] = roots
    binds = rng.normal(size=(joints, 4, 4)).astype("f4")
    binds[:, :, 3] = 0, 0, 0, 1  # the last row, as the columns stand one after another
    gltf.entry("skins", joints=list(range(joints)), inverseBindMatrices=gltf.accessor(binds))
    return gltf


def _fill(gltf: Gltf, rng: np.random.Generator, entry: dict[str, Any], meshes: list[int]) -> None:
    entry["name"] = NAMES[int(rng.integers(len(NAMES)))]
    if not entry["name"] and rng.random() < 0.5:
        del entry["name"]
    if rng.random() < 0.3:
        matrix = np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4))
        entry["matrix"] = matrix.T.ravel().tolist()
    else:
        if rng.random() < 0.6:
            entry["translation"] = rng.integers(-9, 9, 3).tolist()
        if rng.random() < 0.4:
            entry["rotation"] = rng.normal(size=4).tolist()
        if rng.random() < 0.4:
            entry["scale"] = (rng.uniform(0.5, 2, 3) * rng.choice([-1, 1], 3)).tolist()
    if rng.random() < 0.7:
        entry["mesh"] = int(rng.choice(meshes, p=[0.5, 0.3, 0.1, 0.1]))
        if entry["mesh"] == meshes[3] and rng.random() < 0.7:
            entry["skin"] = 0
        if entry["mesh"] == meshes[2] and rng.random() < 0.5:
            entry["weights"] = [float(rng.normal())]
        if rng.random() < 0.15:
            moves = gltf.accessor(rng.normal(size=(3, 3)).astype("f4"))
            turns = gltf.accessor(rng.normal(size=(3, 4)).astype("f4"))
            attributes = {"TRANSLATION": moves, "ROTATION": turns}
            entry["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    if rng.random() < 0.05:
        entry.setdefault("extensions", {})["KHR_node_visibility"] = {"visible": False}


class PlainWalk:
    """The objects of a file of `random_tree`, in order, and its groups of instances."""

    def __init__(self, gltf: Gltf) -> None:
        self.gltf, self.json = gltf, gltf.json
        self.objects: list[Drawn] = []
        self.groups: list[tuple[str, str, tuple[int, ...]]] = []
        self.worlds = [IDENTITY for _ in self.json["nodes"]]
        for root in self.json["scenes"][0]["nodes"]:
            self.place(root, IDENTITY)
        for root in self.json["scenes"][0]["nodes"]:
            self.visit(root, "", "", True)

    def place(self, node: int, above: Matrix) -> None:
        self.worlds[node] = times(above, own_matrix(self.json["nodes"][node]))
        for child in self.json["nodes"][node].get("children", []):
            self.place(int(child), self.worlds[node])

    def visit(self, node: int, above: str, path: str, shown: bool) -> None:
        entry = self.json["nodes"][node]
        extensions = entry.get("extensions", {})
        shown &= extensions.get("KHR_node_visibility", {}).get("visible", True)
        if "mesh" in entry:
            self.draw(node, above, path, shown)
        name = entry.get("name", "")
        for child in entry.get("children", []):
            self.visit(int(child), name or above, below(path, name), shown)

    def draw(self, node: int, above: str, path: str, shown: bool) -> None:
        entry = self.json["nodes"][node]
        mesh = self.json["meshes"][entry["mesh"]]
        own = entry.get("name", "") or mesh.get("name", "")
        name = clean(own or above) or "object"
        where = clean(below(path, own)) or name
        world = IDENTITY if "skin" in entry else self.worlds[node]
        worlds = [world]
        instancing = entry.get("extensions", {}).get("EXT_mesh_gpu_instancing")
        if instancing is not None:
            moves = self.values(instancing["attributes"]["TRANSLATION"])
            turns = self.values(instancing["attributes"]["ROTATION"])
            pairs = zip(moves, turns, strict=True)
            each = [own_matrix({"translation": move, "rotation": turn}) for move, turn in pairs]
            worlds = [times(world, one) for one in each]
            start = len(self.objects)
            self.groups.append((name, where, tuple(range(start, start + len(worlds)))))
        points: list[list[float]] = []
        faces: list[list[int]] = []
        for primitive in mesh["primitives"] if shown else []:
            base = len(points)
            points += self.points(primitive, entry, mesh)
            corners = list(range(3))
            if "indices" in primitive:
                corners = [int(row[0]) for row in self.values(primitive["indices"])]
            faces += [[base + c for c in corners[k : k + 3]] for k in range(0, len(corners), 3)]
        for matrix in worlds:
            vertices = [moved(matrix, point) for point in points]
            mirrored = determinant(matrix) < 0.0
            self.objects.append(Drawn(name, where, node, vertices, faces, mirrored))

    def points(self, primitive: Any, entry: Any, mesh: Any) -> list[list[float]]:
        points = self.values(primitive["attributes"]["POSITION"])
        weights = entry.get("weights", mesh.get("weights", []))
        for target, weight in zip(primitive.get("targets", []), weights, strict=False):
            ways = self.values(target["POSITION"])
            points = [
                [a + b * weight for a, b in zip(point, way, strict=True)]
                for point, way in zip(points, ways, strict=True)
            ]
        if "skin" not in entry:
            return points
        skin = self.json["skins"][entry["skin"]]
        binds = self.values(skin["inverseBindMatrices"])
        matrices = [
            times(self.worlds[joint], [[bind[4 * k + row] for k in range(4)] for row in range(4)])
            for joint, bind in zip(skin["joints"], binds, strict=True)
        ]
        joints = self.values(primitive["attributes"]["JOINTS_0"])
        shares = self.values(primitive["attributes"]["WEIGHTS_0"])
        result = []
        for point, which, share in zip(points, joints, shares, strict=True):
            total = 0.0
            for weight in share:
                total += weight
            placed = []
            for row in range(3):
                blended = [0.0] * 4
                for column in range(4):
                    for joint, weight in zip(which, share, strict=True):
                        blended[column] += weight * matrices[int(joint)][row][column]
                at = blended[3] / total + blended[0] / total * point[0]
                at += blended[1] / total * point[1]
                placed.append(at + blended[2] / total * point[2])
            result.append(placed)
        return result

    def values(self, accessor: int) -> list[list[float]]:
        entry = self.json["accessors"][accessor]
        view = self.json["bufferViews"][entry["bufferView"]]
        kind = {5121: "u1", 5123: "<u2", 5126: "<f4"}[entry["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[entry["type"]]
        flat = np.frombuffer(self.gltf.blob, kind, entry["count"] * width, view["byteOffset"])
        return [[float(value) for value in row] for row in flat.reshape(-1, width)]


def own_matrix(entry: dict[str, Any]) -> Matrix:
    if "matrix" in entry:
        return [
            [float(entry["matrix"][4 * column + row]) for column in range(4)] for row in range(4)
        ]
    x, y, z, w = entry.get("rotation", (0.0, 0.0, 0.0, 1.0))
    length = math.sqrt(((x * x + y * y) + z * z) + w * w)
    x, y, z, w = x / length, y / length, z / length, w / length
    turned = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    scale = entry.get("scale", (1.0, 1.0, 1.0))
    move = entry.get("translation", (0.0, 0.0, 0.0))
    rows = [[turned[r][c] * scale[c] for c in range(3)] + [float(move[r])] for r in range(3)]
    return [*rows, [0.0, 0.0, 0.0, 1.0]]


def times(a: Matrix, b: Matrix) -> Matrix:
    return [
        [((a[i][0] * b[0][j] + a[i][1] * b[1][j]) + a[i][2] * b[2][j]) + a[i][3] * b[3][j]
         for j in range(4)]
        for i in range(4)
    ]  # fmt: skip


def moved(matrix: Matrix, p: list[float]) -> list[float]:
    return [((r[0] * p[0] + r[1] * p[1]) + r[2] * p[2]) + r[3] for r in matrix[:3]]


def determinant(m: Matrix) -> float:
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in m[:3])
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def below(path: str, name: str) -> str:
    return f"{path}/{name}" if path and name else path or name


def clean(name: str) -> str:
    return "".join("\ufffd" if c == "\0" or 0xD800 <= ord(c) < 0xE000 else c for c in name)


def marked(names: list[str]) -> list[str]:
    """Repeats with the least mark that neither the file nor an earlier repeat has."""
    result: list[str] = []
    for place, name in enumerate(names):
        if name in names[:place]:
            mark = 2
            while f"{name}#{mark}" in names or f"{name}#{mark}" in result:
                mark += 1
            name = f"{name}#{mark}"
        result.append(name)
    return result
