"""Bad scenes and camera paths, with what the one-line error must say.

`BAD_INPUT` is for the readers' own tests and for the command line's (exit status 2): each
entry writes a scene file and a path file, one of them bad.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf, one_triangle

# Writes (scene file, path file) into a folder.
Make = Callable[[Path], tuple[Path, Path]]


class BadInput(NamedTuple):
    name: str
    make: Make
    expected: str


def path_json(**changes: Any) -> dict[str, Any]:
    """A good path of one frame, with some fields changed (... removes one)."""
    fields = {
        "format": "visref-path",
        "version": 1,
        "width": 8,
        "height": 6,
        "near": 0.1,
        "far": 100.0,
        "yfov": 1.0,
        "frames": [{"world_from_camera": np.eye(4).tolist()}],
        **changes,
    }
    return {name: value for name, value in fields.items() if value is not ...}


def good_scene(folder: Path) -> Path:
    return one_triangle().write(folder / "good.glb")


def good_path(folder: Path) -> Path:
    file = folder / "good.json"
    file.write_text(json.dumps(path_json()))
    return file


def _scene(file_name: str, content: Callable[[], bytes]) -> Make:
    def make(folder: Path) -> tuple[Path, Path]:
        file = folder / file_name
        file.write_bytes(content())
        return file, good_path(folder)

    return make


def _gltf(change: Callable[[Gltf], object], file_name: str = "bad.glb") -> Make:
    def make(folder: Path) -> tuple[Path, Path]:
        gltf = one_triangle()
        change(gltf)
        return gltf.write(folder / file_name), good_path(folder)

    return make


def _set(*place: Any, to: Any) -> Make:
    """The good scene's JSON with one place changed."""

    def change(gltf: Gltf) -> None:
        value: Any = gltf.json
        for step in place[:-1]:
            value = value.setdefault(step, {}) if isinstance(step, str) else value[step]
        value[place[-1]] = to

    return _gltf(change)


def _path_text(text: str | bytes) -> Make:
    def make(folder: Path) -> tuple[Path, Path]:
        file = folder / "bad.json"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return good_scene(folder), file

    return make


def _path(**changes: Any) -> Make:
    return _path_text(json.dumps(path_json(**changes)))


def _pose(change: Callable[[np.ndarray[Any, Any]], object]) -> Make:
    matrix = np.eye(4)
    change(matrix)
    return _path(frames=[{"world_from_camera": matrix.tolist()}])


def _entry(row: int, column: int, value: Any) -> Make:
    matrix: list[list[Any]] = np.eye(4).tolist()
    matrix[row][column] = value
    return _path(frames=[{"world_from_camera": matrix}])


def _missing(folder: Path) -> tuple[Path, Path]:
    return folder / "absent.glb", good_path(folder)


def _folder(folder: Path) -> tuple[Path, Path]:
    (folder / "folder.glb").mkdir()
    return folder / "folder.glb", good_path(folder)


def _missing_path(folder: Path) -> tuple[Path, Path]:
    return good_scene(folder), folder / "absent.json"


def _folder_path(folder: Path) -> tuple[Path, Path]:
    (folder / "folder.json").mkdir()
    return good_scene(folder), folder / "folder.json"


def _external(uri: str, size: int | None = None) -> Make:
    def make(folder: Path) -> tuple[Path, Path]:
        if size is not None:
            (folder / uri).write_bytes(b"\0" * size)
        return one_triangle().write_gltf(folder / "bad.gltf", uri), good_path(folder)

    return make


def _truncated(keep: int) -> Callable[[], bytes]:
    return lambda: one_triangle().glb()[:keep]


def _with(positions: Any, indices: Any) -> Make:
    def change(gltf: Gltf) -> None:
        gltf.json["meshes"][0]["primitives"] = [gltf.primitive(positions, indices)]

    return _gltf(change)


def _cycle(gltf: Gltf) -> None:
    gltf.json["nodes"][0]["children"] = [1]
    gltf.node(children=[0], root=False)


def _two_parents(gltf: Gltf) -> None:
    gltf.node(children=[0])
    gltf.node(children=[0])
    gltf.json["scenes"][0]["nodes"] = [1, 2]


def _draco(gltf: Gltf) -> None:
    view = gltf.view(b"not what Draco writes, by far")
    extension = {"bufferView": view, "attributes": {"POSITION": 0}}
    gltf.json["meshes"][0]["primitives"][0]["extensions"] = {
        "KHR_draco_mesh_compression": extension
    }
    gltf.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]


def _meshopt(gltf: Gltf) -> None:
    gltf.json["extensionsRequired"] = ["EXT_meshopt_compression"]
    fallback = {"EXT_meshopt_compression": {"fallback": True}}
    gltf.json["buffers"] = [
        {"byteLength": len(gltf.blob)},
        {"byteLength": 99, "extensions": fallback},
    ]
    for view in gltf.json["bufferViews"]:
        view["buffer"] = 1
        view["byteLength"] = 6
        extension = {"buffer": 0, "byteLength": 6, "byteStride": 2, "count": 3, "mode": "INDICES"}
        view["extensions"] = {"EXT_meshopt_compression": extension}


def _instances(gltf: Gltf) -> None:
    attributes = {
        "TRANSLATION": gltf.accessor(np.zeros((3, 3), "f4")),
        "SCALE": gltf.accessor(np.ones((2, 3), "f4")),
    }
    gltf.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}


def _material(**material: Any) -> Make:
    def change(gltf: Gltf) -> None:
        gltf.entry("materials", **material)
        gltf.json["meshes"][0]["primitives"][0]["material"] = 0

    return _gltf(change)


def _gltf_path(change: Callable[[Gltf, dict[str, Any]], object], **lens: Any) -> Make:
    """A path read from a glTF's camera: `change` spoils the file or the camera's node."""

    def make(folder: Path) -> tuple[Path, Path]:
        gltf = one_triangle()
        perspective = {"yfov": 1.0, "znear": 0.1, **lens}
        gltf.entry("cameras", type="perspective", perspective=perspective)
        node = gltf.json["nodes"][gltf.node(camera=0)]
        change(gltf, node)
        return good_scene(folder), gltf.write(folder / "bad_camera.glb")

    return make


def _nothing(gltf: Gltf, node: dict[str, Any]) -> None:
    del gltf, node


def _no_camera(gltf: Gltf, node: dict[str, Any]) -> None:
    del gltf, node["camera"]


def _node(**changes: Any) -> Callable[[Gltf, dict[str, Any]], None]:
    return lambda gltf, node: node.update(changes)


def _columns(x: Any, y: Any, z: Any) -> list[float]:
    return [*x, 0.0, *y, 0.0, *z, 0.0, 0.0, 0.0, 0.0, 1.0]


def _times(gltf: Gltf, node: dict[str, Any]) -> None:
    sampler = {
        "input": gltf.accessor(np.array([0, 2, 1], "f4")),
        "output": gltf.accessor(np.zeros((3, 3), "f4")),
    }
    target = {"node": gltf.json["nodes"].index(node), "path": "translation"}
    gltf.entry("animations", samplers=[sampler], channels=[{"sampler": 0, "target": target}])


NAN_TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], "f4")
DEEP = b"[" * 100_000
LONG = b'{"format": ' + b"9" * 5000 + b"}"
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
OFF = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"
STL = b"solid part\nfacet normal 0 0 1\nouter loop\nvertex 0 0"
PLY = b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n\0"

BAD_SCENES = [
    BadInput("missing file", _missing, "absent.glb: there is no such file"),
    BadInput("folder", _folder, "folder.glb: this is not a file"),
    BadInput("empty file", _scene("bad.glb", bytes), "the file is empty"),
    BadInput("empty OBJ", _scene("bad.obj", bytes), "the file is empty"),
    BadInput("unknown extension", _scene("bad.xyzzy", lambda: b"?"), "'.xyzzy' are not known"),
    BadInput("archive", _scene("bad.zip", lambda: b"PK"), "this is an archive"),
    BadInput("GLB header cut", _scene("bad.glb", _truncated(10)), "the header is cut"),
    BadInput("GLB cut in its JSON", _scene("bad.glb", _truncated(90)), "truncated GLB"),
    BadInput("GLB cut in its bytes", _scene("bad.glb", _truncated(-8)), "truncated GLB"),
    BadInput(
        "GLB version 1",
        _scene("bad.glb", lambda: b"glTF\1\0\0\0" + one_triangle().glb()[8:]),
        "GLB version 1",
    ),
    BadInput("not a mesh", _scene("bad.glb", lambda: b"\x89PNG\r\n\x1a\n"), "not UTF-8 text"),
    BadInput("bad JSON", _scene("bad.gltf", lambda: b'{"asset": }'), "line 1 column 11"),
    BadInput("deep JSON", _scene("bad.gltf", lambda: DEEP), "lists too deep"),
    BadInput("long number", _scene("bad.gltf", lambda: LONG), "number too long"),
    BadInput("JSON of another kind", _scene("bad.gltf", lambda: b"[]"), "not a JSON object"),
    BadInput("glTF 1.0", _set("asset", "version", to="1.0"), "this is glTF 1.0"),
    BadInput("no asset", _gltf(lambda g: g.json.pop("asset")), "'asset' is missing"),
    BadInput("no mesh", _gltf(lambda g: g.json["nodes"][0].pop("mesh")), "there is no mesh"),
    BadInput("no scene roots", _set("scenes", 0, "nodes", to=[]), "there is no mesh"),
    BadInput("scene out of range", _set("scene", to=3), "scene: scenes[3] is named"),
    BadInput("mesh out of range", _set("nodes", 0, "mesh", to=5), "nodes[0].mesh: meshes[5]"),
    BadInput("negative index", _set("nodes", 0, "mesh", to=-1), "nodes[0].mesh: -1 is outside"),
    BadInput("boolean index", _set("nodes", 0, "mesh", to=True), "True is not an integer"),
    BadInput("string index", _set("nodes", 0, "mesh", to="0"), "'0' is not an integer"),
    BadInput("nodes no list", _set("nodes", to={}), "nodes: this is not a list"),
    BadInput("node no object", _set("nodes", 0, to=7), "nodes[0]: this is not a JSON object"),
    BadInput("name no string", _set("nodes", 0, "name", to=[1]), "nodes[0].name: [1] is not"),
    BadInput(
        "short translation",
        _set("nodes", 0, "translation", to=[1, 2]),
        "nodes[0].translation: this is not a list of 3 numbers",
    ),
    BadInput(
        "NaN translation",
        _set("nodes", 0, "translation", to=[1, 2, float("nan")]),
        "nodes[0].translation[2]",
    ),
    BadInput(
        "huge translation",
        _set("nodes", 0, "translation", to=[1, 2, 10**400]),
        "the number is too large",
    ),
    BadInput("zero rotation", _set("nodes", 0, "rotation", to=[0] * 4), "zero or infinite length"),
    BadInput("projective matrix", _set("nodes", 0, "matrix", to=[1] * 16), "last row"),
    BadInput("cyclic nodes", _gltf(_cycle), "the node graph has a cycle"),
    BadInput("node with two parents", _gltf(_two_parents), "has a parent already"),
    BadInput(
        "unknown required extension",
        _set("extensionsRequired", to=["ACME_invisible_ink"]),
        "requires extension ACME_invisible_ink",
    ),
    BadInput("spoilt meshopt", _gltf(_meshopt), "the compressed data starts with 0x"),
    BadInput("spoilt Draco", _gltf(_draco), "the Draco decoder refused the data"),
    BadInput("uneven instances", _gltf(_instances), "differ in count"),
    BadInput("missing buffer", _external("absent.bin"), "buffers[0].uri: file 'absent.bin'"),
    BadInput("short buffer", _external("short.bin", 8), "holds 8 of its"),
    BadInput("buffer elsewhere", _external("https://a.invalid/b.bin"), "not a file beside"),
    BadInput("spoilt data URI", _external("data:;base64,???"), "not valid base64"),
    BadInput("no bytes", _set("buffers", to=[{"byteLength": 10**6}]), "the file is truncated"),
    BadInput(
        "view outside its buffer",
        _set("bufferViews", 0, "byteLength", to=4000),
        "bufferViews[0]: it ends at byte 4000",
    ),
    BadInput(
        "accessor outside its view", _set("accessors", 0, "count", to=4), "accessors[0]: it ends"
    ),
    BadInput("accessor of nothing", _set("accessors", 0, "count", to=0), "0 is outside 1"),
    BadInput("wrong component", _set("accessors", 1, "componentType", to=5126), "componentType"),
    BadInput("wrong type", _set("accessors", 0, "type", to="VEC2"), "its type is VEC2"),
    BadInput("tight stride", _set("bufferViews", 0, "byteStride", to=4), "4 bytes apart"),
    BadInput("unknown mode", _set("meshes", 0, "primitives", 0, "mode", to=9), "9 is outside"),
    BadInput("unknown alpha", _material(alphaMode="SHINY"), "materials[0].alphaMode: 'SHINY'"),
    BadInput("side no boolean", _material(doubleSided=1), "1 is not true or false"),
    BadInput("NaN vertex", _with(NAN_TRIANGLE, None), "object 'part': a vertex is NaN"),
    BadInput(
        "vertex beyond float32",
        _set("nodes", 0, "scale", to=[1e39, 1, 1]),
        "object 'part': a vertex is NaN or infinite",
    ),
    BadInput(
        "index out of range", _with(SQUARE, TWO + np.uint16(1)), "meshes[0].primitives[0].indices"
    ),
    BadInput("OBJ face of nothing", _scene("bad.obj", lambda: OBJ + b"f 1 2 4\n"), "line 4"),
    BadInput("OBJ index 0", _scene("bad.obj", lambda: OBJ + b"f 0 1 2\n"), "counts from 1"),
    BadInput("OBJ far back", _scene("bad.obj", lambda: OBJ + b"f -9 -2 -1\n"), "out of range"),
    BadInput("OBJ word", _scene("bad.obj", lambda: OBJ + b"v 1 two 3\n"), "'two' is not a number"),
    BadInput("OBJ 2D vertex", _scene("bad.obj", lambda: OBJ + b"v 1 2\n"), "line 4: a vertex has"),
    BadInput("OBJ without faces", _scene("bad.obj", lambda: OBJ), "there is no mesh"),
    BadInput("OBJ NaN", _scene("bad.obj", lambda: b"v nan 0 0\n" + OBJ + b"f 1 2 3\n"), "NaN"),
    BadInput("OFF index", _scene("bad.off", lambda: OFF), "face 0: it names vertex 7 of 3"),
    BadInput("cut STL", _scene("bad.stl", lambda: STL), "bad.stl"),
    BadInput(
        "cut PLY", _scene("bad.ply", lambda: PLY), "truncated: it holds 0 of its 9 rows of 'vertex'"
    ),
    BadInput("no COLLADA", _scene("bad.dae", lambda: b"<COLLADA>"), "not valid COLLADA"),
    BadInput("no zip", _scene("bad.zae", lambda: b"PK"), "not a zip archive"),
]

BAD_PATHS = [
    BadInput("missing path", _missing_path, "absent.json: cannot read the file"),
    BadInput("path a folder", _folder_path, "this is a folder"),
    BadInput("empty path", _path_text(""), "the file is empty"),
    BadInput("path not JSON", _path_text("{"), "bad.json: line 1 column 2: not valid JSON"),
    BadInput("path not text", _path_text(b"\xff\xfe\xfd"), "not UTF-8 text"),
    BadInput("deep path", _path_text(DEEP), "lists too deep"),
    BadInput("path a list", _path_text("[]"), "this is not a JSON object"),
    BadInput("wrong format", _path(format="gltf"), "format: this is not a camera path"),
    BadInput("wrong version", _path(version=2), "version: version 2 is not known"),
    BadInput("boolean version", _path(version=True), "version: version True is not known"),
    BadInput("no frames", _path(frames=[]), "frames: the path has no frames"),
    BadInput("frames missing", _path(frames=...), "frames is not a list"),
    BadInput("frames no list", _path(frames={}), "frames is not a list"),
    BadInput("frame no object", _path(frames=[3]), "frames[0]: this is not a JSON object"),
    BadInput("no matrix", _path(frames=[{}]), "frames[0]: world_from_camera is missing"),
    BadInput(
        "matrix 3 by 4",
        _path(frames=[{"world_from_camera": np.eye(4)[:3].tolist()}]),
        "frames[0].world_from_camera: not a 4 by 4 matrix",
    ),
    BadInput("string in matrix", _entry(1, 2, "0"), "world_from_camera[1][2]: '0' is not a number"),
    BadInput("boolean in matrix", _entry(0, 0, True), "world_from_camera[0][0]: True is not"),
    BadInput("NaN in matrix", _entry(0, 3, float("nan")), "the matrix is not finite"),
    BadInput("huge integer in matrix", _entry(0, 3, 10**400), "the number is too large"),
    BadInput("overflowing matrix", _entry(0, 1, 1e200), "singular"),
    BadInput("projective camera", _entry(3, 0, 0.5), "last row is not 0 0 0 1"),
    BadInput("singular matrix", _pose(lambda m: m[:, 0].fill(0.0)), "the matrix is singular"),
    BadInput("sheared matrix", _entry(0, 1, 0.01), "not orthonormal"),
    BadInput("scaled matrix", _entry(0, 0, 1.01), "not orthonormal"),
    BadInput("mirrored matrix", _entry(0, 0, -1.0), "the camera's matrix is mirrored"),
    BadInput("near missing", _path(near=...), "near is missing"),
    BadInput("near at far", _path(near=100.0), "near (100.0) is not less than far"),
    BadInput("near beyond far", _path(near=200.0), "is not less than far"),
    BadInput("near zero", _path(near=0.0), "near: near is 0.0"),
    BadInput("near negative", _path(near=-1.0), "near: near is -1.0"),
    BadInput("near NaN", _path(near=float("nan")), "near: near is nan"),
    BadInput("near boolean", _path(near=True), "near: True is not a number"),
    BadInput("far string", _path(far="inf"), "far: 'inf' is not a number"),
    BadInput("far NaN", _path(far=float("nan")), "far: far is nan"),
    BadInput("width zero", _path(width=0), "width: the image's width is 0"),
    BadInput("height negative", _path(height=-6), "height: the image's height is -6"),
    BadInput("width enormous", _path(width=10**9), "the image's width is 1000000000"),
    BadInput("too many pixels", _path(width=10**6, height=10**6), "1000000 x 1000000 pixels"),
    BadInput("width fractional", _path(width=8.5), "width: 8.5 is not an integer"),
    BadInput("width boolean", _path(width=True), "width: True is not an integer"),
    BadInput("width missing", _path(width=...), "width is missing"),
    BadInput("yfov zero", _path(yfov=0.0), "yfov: yfov is 0.0"),
    BadInput("yfov in degrees", _path(yfov=60.0), "give radians between 0 and pi"),
    BadInput("yfov missing", _path(yfov=...), "give either 'yfov' or 'ymag'"),
    BadInput("yfov and ymag", _path(ymag=1.0), "give either 'yfov' or 'ymag'"),
    BadInput("ymag negative", _path(yfov=..., ymag=-1.0), "ymag: ymag is -1.0"),
    BadInput("yfov a list", _path(yfov=[1.0]), "yfov: [1.0] is not a number"),
    BadInput("shift infinite", _path(shift_x_px=float("inf")), "shift_x_px is not finite"),
    BadInput(
        "cut no boolean",
        _path(frames=[{"world_from_camera": np.eye(4).tolist(), "cut": 1}]),
        "frames[0].cut: cut is not true or false",
    ),
    BadInput("no camera in glTF", _gltf_path(_no_camera), "scene has a camera"),
    BadInput(
        "camera out of range", _gltf_path(_node(camera=4)), "nodes[1].camera: cameras[4] is named"
    ),
    BadInput("glTF camera near", _gltf_path(_nothing, znear=-1), "perspective.near: near is -1.0"),
    BadInput("glTF camera far", _gltf_path(_nothing, zfar=0.05), "is not less than far (0.05)"),
    BadInput("glTF camera yfov", _gltf_path(_nothing, yfov=4.0), "yfov is 4.0"),
    BadInput("glTF camera boolean", _gltf_path(_nothing, yfov=True), "yfov: True is not a number"),
    BadInput("glTF camera singular", _gltf_path(_node(scale=[1, 0, 1])), "matrix is singular"),
    BadInput("glTF camera mirrored", _gltf_path(_node(scale=[-1, 1, 1])), "matrix is mirrored"),
    BadInput(
        "glTF camera sheared",
        _gltf_path(_node(matrix=_columns((1, 0, 0), (0.1, 1, 0), (0, 0, 1)))),
        "nodes[1]: the camera's matrix is sheared",
    ),
    BadInput("times decrease", _gltf_path(_times), "samplers[0].input: its times do not increase"),
]

BAD_INPUT = BAD_SCENES + BAD_PATHS

__all__ = ["BAD_INPUT", "BAD_PATHS", "BAD_SCENES", "TRIANGLE", "BadInput", "good_path"]
