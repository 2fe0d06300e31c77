"""What is measured on: nine scenes with three views each, and files for the commands."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.scene import Scene
from visref_datasets_gen.city import city
from visref_datasets_gen.dataset import Dataset, scene_of
from visref_datasets_gen.forest import forest
from visref_datasets_gen.formula_one import formula_one
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.graph import Material, Mesh, Node, Primitive
from visref_datasets_gen.leaf_cards import leaves
from visref_datasets_gen.seismic import seismic
from visref_datasets_gen.skyscraper import skyscraper
from visref_datasets_gen.soda_hall import soda_hall
from visref_datasets_gen.terrain_towers import terrain_towers

OBJECTS, SIDE_CELLS = 4000, 4
WIDTH, HEIGHT = 1280, 960
_GREY = Material("grey", (0.5, 0.5, 0.5, 1.0))

Views = list[Camera]


@dataclass(frozen=True)
class Sizes:
    """How large the inputs are."""

    image: tuple[int, int] = (1280, 960)
    run_frames: int = 24
    check_frames: int = 100
    judged_triangles: int = 10_000_000
    misses: int = 46_000
    nodes: int = 1_000_000
    instanced_triangles: int = 10_000_000


QUICK = Sizes((64, 48), 16, 4, 12_000, 200, 400, 12_000)


def town(seed: int = 7, count: int = OBJECTS) -> Scene:
    """Boxes on a grid, each face 4 x 4 quads: 192 triangles an object."""
    rng = np.random.default_rng(seed)
    points, faces = tessellated_box(SIDE_CELLS)
    columns = math.isqrt(count) + 1
    objects = []
    for i in range(count):
        size = rng.uniform((8.0, 3.0, 8.0), (18.0, 30.0, 18.0))
        at = 20.0 * np.array([i % columns - columns / 2, 0.0, i // columns - columns / 2])
        objects.append((f"box {i}", points * size + at, faces))
    return Scene.from_objects(objects)


def tessellated_box(cells: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A unit box that stands on y = 0, its vertices not shared between faces."""
    line = np.linspace(-0.5, 0.5, cells + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    corner = np.add.outer(np.arange(cells) * (cells + 1), np.arange(cells)).ravel()
    step = np.array([[0, cells + 1, cells + 2], [0, cells + 2, 1]])
    quads = (corner[:, None, None] + step).reshape(-1, 3)
    points, faces = [], []
    for axis in range(3):
        for side in (-0.5, 0.5):
            face = np.empty((len(u), 3))
            face[:, axis] = side
            face[:, (axis + 1) % 3] = u * 2.0 * side
            face[:, (axis + 2) % 3] = v
            faces.append(quads + len(points) * len(u))
            points.append(face + np.array([0.0, 0.5, 0.0]))
    return np.concatenate(points), np.concatenate(faces)


def cameras() -> dict[str, Camera]:
    """The town's views."""

    def camera(eye: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
        return Camera(look_at(eye, target), WIDTH, HEIGHT, near=0.1, far=math.inf, yfov=1.0472)

    return {
        "street": camera((10.0, 1.7, 0.0), (10.0, 6.0, -100.0)),
        "roofs": camera((100.0, 40.0, 500.0), (100.0, 0.0, 0.0)),
        "overview": camera((0.0, 200.0, 700.0), (0.0, 0.0, 0.0)),
    }


def _town(small: bool) -> tuple[Scene, Views]:
    return town(count=40 if small else OBJECTS), list(cameras().values())


def _generated(make: Callable[..., Dataset], **small: Any) -> Callable[[bool], tuple[Scene, Views]]:
    """A generated scene, and three views of its path: its start, and after each third."""

    def read(is_small: bool) -> tuple[Scene, Views]:
        dataset = make(**small) if is_small else make()
        cameras = dataset.path.cameras
        return scene_of(dataset), [cameras[len(cameras) * third // 3] for third in range(3)]

    return read


NINE: dict[str, Callable[[bool], tuple[Scene, Views]]] = {
    "town": _town,
    "city": _generated(city, scale=0.01),
    "forest": _generated(forest, scale=0.01),
    "leaves": _generated(leaves),
    "soda_hall": _generated(soda_hall),
    "skyscraper": _generated(skyscraper),
    "terrain_towers": _generated(terrain_towers),
    "seismic": _generated(seismic),
    "formula_one": _generated(formula_one),
}


def one_of_nine(name: str, size: tuple[int, int], *, small: bool) -> tuple[Scene, Views]:
    """A scene and its three views in that many pixels; `small`: few triangles, where it can be."""
    scene, views = NINE[name](small)
    return scene, [replace(view, width=size[0], height=size[1]) for view in views]


# Files for the commands.


def box_mesh(cells: int, name: str = "box") -> Mesh:
    points, faces = tessellated_box(cells)
    return Mesh(name, (Primitive(points.astype(np.float32), faces, _GREY),))


def write_wall(folder: Path, count: int) -> tuple[Path, Path]:
    """A wall of so many tiles, all of them seen, and a path of eight frames before it."""
    tile = np.array([[-0.4, -0.4, 0], [0.4, -0.4, 0], [0.4, 0.4, 0], [-0.4, 0.4, 0]], np.float32)
    mesh = Mesh("tile", (Primitive(tile, np.array([[0, 1, 2], [0, 2, 3]]), _GREY),))
    columns = max(1, math.isqrt(count * WIDTH // HEIGHT))
    rows = -(-count // columns)
    nodes = []
    for i in range(count):
        at = np.eye(4)
        at[:2, 3] = i % columns - (columns - 1) / 2, i // columns - (rows - 1) / 2
        nodes.append(Node(f"tile {i}", mesh, at))
    scene = folder / "wall.glb"
    scene.write_bytes(glb_bytes(tuple(nodes)))
    away = 0.52 * max(rows, columns * HEIGHT / WIDTH) / math.tan(1.0472 / 2)
    eyes = [(0.02 * frame, 0.0, away) for frame in range(8)]
    return scene, write_path(folder / "wall.path.json", eyes)


def write_blocks(folder: Path, triangles: int) -> tuple[Path, Path]:
    """Some 1,000 finely tessellated boxes, so many triangles together, and a path around them."""
    cells = max(1, math.isqrt(triangles // (12 * 1000)))
    count = max(1, triangles // (12 * cells * cells))
    columns = math.isqrt(count) + 1
    mesh = box_mesh(cells)
    nodes = []
    for i in range(count):
        at = np.diag([8.0 + i % 7, 3.0 + 2.0 * (i % 11), 8.0 + i % 5, 1.0])
        at[0, 3] = 20.0 * (i % columns - columns / 2)
        at[2, 3] = 20.0 * (i // columns - columns / 2)
        nodes.append(Node(f"block {i}", mesh, at))
    scene = folder / "blocks.glb"
    scene.write_bytes(glb_bytes(tuple(nodes)))
    reach = 12.0 * columns
    turns = np.linspace(0.0, 2.0 * math.pi, 25)[:-1]
    eyes = [(reach * math.sin(t), 0.3 * reach, reach * math.cos(t)) for t in turns]
    return scene, write_path(folder / "blocks.path.json", eyes)


def write_path(file: Path, eyes: list[tuple[float, float, float]]) -> Path:
    """A path of cameras at these points that look at the world's origin."""
    frames = [{"world_from_camera": look_at(eye, (0.0, 0.0, 0.0)).tolist()} for eye in eyes]
    head = {"format": "visref-path", "version": 1, "width": WIDTH, "height": HEIGHT}
    lens = {"near": 0.1, "far": None, "yfov": 1.0472}
    file.write_text(json.dumps({**head, **lens, "frames": frames}), encoding="utf-8")
    return file


def write_tree(file: Path, nodes: int) -> Path:
    """A glTF file of so many named nodes, one in 16 a parent of the others, all with one of three
    meshes of 12 triangles: as converters of CAD and game levels write them."""
    rng = np.random.default_rng(2)
    places = np.round(rng.uniform(-1000.0, 1000.0, (nodes, 3)), 3).tolist()
    entries: list[dict[str, Any]] = []
    for i in range(nodes):
        entry: dict[str, Any] = {"name": f"part_{i % 5000}", "translation": places[i]}
        if i % 16 == 0:
            entry["children"] = list(range(i + 1, min(i + 16, nodes)))
        else:
            entry["mesh"] = i % 3
            if i % 4 == 0:
                entry["rotation"] = [0.0, 0.6, 0.0, 0.8]
            if i % 8 == 1:
                entry["scale"] = [1.0, 2.0, 1.0]
        entries.append(entry)
    document, chunk = _opened(glb_bytes((Node("box", box_mesh(1)),)))
    document["meshes"] = [{**document["meshes"][0], "name": f"box {k}"} for k in range(3)]
    document["nodes"] = entries
    document["scenes"] = [{"nodes": list(range(0, nodes, 16))}]
    return _packed(file, document, chunk)


def write_instances(file: Path, triangles: int) -> Path:
    """One node of instances (EXT_mesh_gpu_instancing) of a box, so many triangles together."""
    cells = 5
    count = max(1, triangles // (12 * cells * cells))
    document, chunk = _opened(glb_bytes((Node("boxes", box_mesh(cells)),)))
    places = np.random.default_rng(4).uniform(-2000.0, 2000.0, (count, 3)).astype("<f4").tobytes()
    document["buffers"][0]["byteLength"] = len(chunk) + len(places)
    view = {"buffer": 0, "byteOffset": len(chunk), "byteLength": len(places)}
    document["bufferViews"].append(view)
    accessor = {"bufferView": len(document["bufferViews"]) - 1, "componentType": 5126}
    document["accessors"].append({**accessor, "count": count, "type": "VEC3"})
    place = len(document["accessors"]) - 1
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": place}}}
    document["nodes"][0]["extensions"] = extension
    document["extensionsUsed"] = list(extension)
    return _packed(file, document, chunk + places)


def _opened(glb: bytes) -> tuple[dict[str, Any], bytes]:
    """A GLB file's JSON and its binary chunk."""
    end = 20 + int.from_bytes(glb[12:16], "little")
    return json.loads(glb[20:end]), glb[end + 8 :]


def _packed(file: Path, document: dict[str, Any], chunk: bytes) -> Path:
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    parts = [(b"JSON", text), (b"BIN\0", chunk + b"\0" * (-len(chunk) % 4))]
    body = b"".join(len(data).to_bytes(4, "little") + kind + data for kind, data in parts)
    file.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)
    return file
